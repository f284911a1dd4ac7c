//! `comparison.json` and `sequential.json`: which model predicts better, and how the evidence for it grew.

use serde::Serialize;

use crate::{
    inference::{
        Estimate,
        comparison::{ChoiceTests, Comparison as Compared, Verdict},
        sequential,
    },
    jobs::{PlanComparison, RuleText, Snapshot},
    study::FitPlan,
    web::results::format::rfc3339,
};

/// How the models of a study compare on one plan.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Comparison<'a> {
    pub data_version: i64,
    pub fit_version: i64,
    pub plan: &'a str,
    /// Every two models, the richer one first, from the fits as they are now.
    pub live: Vec<LivePair>,
    /// Null while no comparison has been made.
    pub compared: Option<StoredComparison<'a>>,
}

/// The Bayes factor of two models.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct LivePair {
    pub first: &'static str,
    pub second: &'static str,
    /// Null while a part has no converged fit of both.
    pub ln_bayes_factor: Option<Estimate>,
    /// A fit that it rests on depends on the fits before it.
    pub provisional: bool,
}

/// A comparison of final fits.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct StoredComparison<'a> {
    /// Newer answers wait to be compared.
    pub is_behind: bool,
    pub data_version: i64,
    pub seed: u64,
    pub program_version: &'a str,
    pub at: String,
    /// Null where it failed.
    #[schema(value_type = Option<Compared>)]
    pub report: Option<&'a Compared>,
    /// One per hypothesis of the paper that the study is about.
    pub verdicts: Vec<Verdict>,
    /// What the choices of all cells say without a model.
    #[schema(value_type = Option<ChoiceTests>)]
    pub tests: Option<&'a ChoiceTests>,
    /// Why it failed.
    #[schema(value_type = Option<String>)]
    pub message: Option<&'a str>,
}

impl<'a> Comparison<'a> {
    pub(in crate::web) fn new(snapshot: &'a Snapshot, plan: &'a FitPlan) -> Self {
        let models = snapshot.study.models();
        let mut live = Vec::new();
        for (place, first) in models.iter().enumerate() {
            for second in &models[..place] {
                let is_provisional = snapshot.fits.iter().any(|part| {
                    part.plan == plan.id
                        && [first.id, second.id].contains(&part.model.id)
                        && part.is_provisional()
                });
                live.push(LivePair {
                    first: first.id,
                    second: second.id,
                    ln_bayes_factor: snapshot.ln_bayes_factor(&plan.id, first.id, second.id),
                    provisional: is_provisional,
                });
            }
        }
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            plan: plan.id.as_str(),
            live,
            compared: snapshot
                .comparison(&plan.id)
                .map(|stored| StoredComparison::new(snapshot, stored)),
        }
    }
}

impl<'a> StoredComparison<'a> {
    fn new(snapshot: &Snapshot, stored: &'a PlanComparison) -> Self {
        let report = stored.report.as_deref().ok();
        let verdicts = snapshot.hypothesis().zip(report);
        Self {
            is_behind: stored.is_behind,
            data_version: stored.data_version,
            seed: stored.seed,
            program_version: &stored.program_version,
            at: rfc3339(stored.at),
            report,
            verdicts: verdicts
                .and_then(|(hypothesis, report)| Verdict::of(&hypothesis, report))
                .into_iter()
                .collect(),
            tests: stored.tests.as_deref(),
            message: stored.report.as_ref().err().map(String::as_str),
        }
    }
}

/// How the evidence grew while people finished.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Sequential<'a> {
    pub data_version: i64,
    pub fit_version: i64,
    pub plan: &'a str,
    pub check_every: u64,
    pub minimum: u64,
    /// The Bayes factor is of the first against the second.
    #[schema(value_type = Option<[String; 2]>)]
    pub models: Option<[&'static str; 2]>,
    /// Whose 90 % interval is followed.
    pub interval: Option<Followed<'a>>,
    /// A look that is due is still being made.
    pub is_behind: bool,
    pub looks: Vec<Look>,
    /// Null where the study has no rule.
    pub stopping: Option<Stopping<'a>>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Followed<'a> {
    pub model: &'static str,
    pub quantity: &'a str,
}

/// What the first n people who finished say.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Look {
    pub n: u64,
    pub answers: u64,
    pub ln_bayes_factor: Option<Estimate>,
    pub q5: Option<f64>,
    pub q95: Option<f64>,
    pub width: Option<f64>,
}

/// The study's rule for stopping, and the first look that reached it.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Stopping<'a> {
    pub rule: RuleText<'a>,
    /// How many people had finished; null while it has not been reached.
    pub reached_at: Option<u64>,
    /// The Bayes factor or the width there.
    pub value: Option<f64>,
    pub at: Option<String>,
}

impl<'a> Sequential<'a> {
    pub(in crate::web) fn new(snapshot: &'a Snapshot) -> Self {
        let set = snapshot.study.sequential();
        let evidence = snapshot.sequential();
        let reached = evidence.and_then(|evidence| evidence.reached);
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            plan: set.plan.as_str(),
            check_every: set.check_every,
            minimum: set.minimum,
            models: set.models.map(|models| models.map(|model| model.id)),
            interval: set.interval.as_ref().map(|interval| Followed {
                model: interval.model.id,
                quantity: &interval.quantity,
            }),
            is_behind: evidence.is_some_and(|evidence| evidence.is_behind),
            looks: evidence
                .map(|evidence| evidence.looks.iter().map(Look::new).collect())
                .unwrap_or_default(),
            stopping: RuleText::new(set).map(|rule| Stopping {
                rule,
                reached_at: reached.map(|reached| reached.n),
                value: reached.map(|reached| reached.value),
                at: reached.map(|reached| rfc3339(reached.at)),
            }),
        }
    }
}

impl Look {
    fn new(look: &sequential::Look) -> Self {
        Self {
            n: look.n,
            answers: look.answers,
            ln_bayes_factor: look.ln_bayes_factor,
            q5: look.interval.map(|[low, _]| low),
            q95: look.interval.map(|[_, high]| high),
            width: look.width(),
        }
    }
}

/// The sentence that announces that the study's rule was reached.
pub(super) fn announcement(snapshot: &Snapshot) -> Option<String> {
    let reached = snapshot.sequential()?.reached?;
    let rule = RuleText::new(snapshot.study.sequential())?;
    let what = match (rule.models, rule.bayes_factor, rule.quantity, rule.model) {
        (Some([first, second]), Some(bound), _, _) => format!(
            "the Bayes factor of {first} against {second} was {:.3e} (the bound is {bound} in favour of either)",
            reached.value
        ),
        (_, _, Some(quantity), Some(model)) => format!(
            "the 90 % interval of {quantity} in {model} was {:.3} wide (the bound is {})",
            reached.value,
            rule.width_below.unwrap_or_default()
        ),
        (_, _, Some(_) | None, None) | (_, _, None, Some(_)) => return None,
    };
    Some(format!(
        "The rule for stopping is reached: when {} people had finished, {what}.",
        reached.n
    ))
}
