//! The results page: every number as text, so that it can be read without scripts.

use askama::Template;
use askama_web::WebTemplate;

use super::{
    Accuracy, Curves, Reading, Sequential, Summary,
    curves::{PartCurves, Series},
    format::{count, decimal, interval, mean_sd, percent},
    page_tables as tables, predictive,
    summary::{Answers, People},
    table::{Align, Cell, Table},
};
use crate::{
    jobs::{Blind, PartState, Snapshot},
    model::model_named,
    store::{Error, Store},
    study::{Flag, PaperFigure},
    web::{
        accounts::{Bar, Who},
        assets,
    },
};

/// Rows of a curve's table.
const CURVE_ROWS: usize = 11;

#[derive(Template, WebTemplate)]
#[template(path = "results/study.html")]
pub(super) struct ResultsPage {
    bar: Bar,
    /// Whether this reader may see what each person answered.
    shows_data: bool,
    study: String,
    title: String,
    simulated: bool,
    /// That the study's rule for stopping was reached.
    announcement: Option<String>,
    people: [String; 4],
    /// Who is left out of the analysis.
    left_out: String,
    answers: [String; 4],
    verdict: super::verdict::Verdict,
    plan: String,
    /// What people chose in the source study, a sentence for each of its figures.
    published: Vec<String>,
    exclusions: Table,
    figures: Figures,
    ladder: Figure,
    sequential: Figure,
    checks: Option<Checks>,
    pooled: Table,
    smoothed: Table,
    attention: Vec<Attention>,
    notes: Vec<String>,
    failures: u64,
    reading: Reading,
    fits: Table,
}

struct Figures {
    actions: Figure,
    weighting: Figure,
    weight_of_risk: Figure,
    value: Figure,
    value_shape: Figure,
    accuracy: Figure,
    predictive: Figure,
}

/// A figure that a script draws, with the table that holds its numbers.
struct Figure {
    kind: &'static str,
    title: &'static str,
    subtitle: &'static str,
    /// Which plan's curves come first.
    plan: Option<String>,
    caption: String,
    table: Table,
}

struct Checks {
    share: String,
    interval: String,
    n: String,
    paper: Option<String>,
    table: Table,
}

/// What is shown of a study that hides its results until enough people have finished.
#[derive(Template, WebTemplate)]
#[template(path = "results/blind.html")]
pub(super) struct BlindPage {
    bar: Bar,
    study: String,
    title: String,
    simulated: bool,
    until: String,
    people: [String; 4],
    /// Who is left out of the analysis.
    left_out: String,
    answers: [String; 4],
}

impl BlindPage {
    pub(super) fn new(snapshot: &Snapshot, blind: Blind, bar: Bar) -> Self {
        let Summary {
            study,
            simulated,
            people,
            answers,
            ..
        } = Summary::new(snapshot);
        Self {
            bar,
            study: study.id,
            title: study.title,
            simulated,
            until: count(blind.until),
            left_out: people.exclusions_text.clone(),
            people: counted_people(&people),
            answers: counted_answers(&answers),
        }
    }
}

/// How people did on an item that asks for one certain answer.
pub(super) struct Attention {
    label: String,
    n: String,
    as_asked: String,
    /// Whether the analysis leaves out whoever did not.
    leaves_out: bool,
}

impl ResultsPage {
    pub(super) fn new(
        snapshot: &Snapshot,
        attention: Vec<Attention>,
        bar: Bar,
        shows_data: bool,
    ) -> Self {
        let summary = Summary::new(snapshot);
        let accuracy = Accuracy::new(snapshot, snapshot.finest_plan());
        let reading = Reading::new(snapshot);
        let sequential = Sequential::new(snapshot);
        let curve_plan = &snapshot.curve_plan().id;
        let curves = Curves::new(snapshot, Some(curve_plan), None);
        let (people, answers) = (&summary.people, &summary.answers);
        Self {
            bar,
            shows_data,
            study: summary.study.id.clone(),
            title: summary.study.title.clone(),
            simulated: summary.simulated,
            announcement: summary.stopping.clone(),
            left_out: people.exclusions_text.clone(),
            people: counted_people(people),
            answers: counted_answers(answers),
            plan: accuracy.plan_label.clone(),
            published: snapshot
                .study
                .paper()
                .iter()
                .filter_map(published)
                .collect(),
            exclusions: tables::exclusions(&summary),
            figures: figures(&summary, &accuracy, &curves, curve_plan.as_str()),
            ladder: ladder(&summary, &reading),
            sequential: followed(&summary, &sequential),
            checks: checks(&summary),
            pooled: tables::pooled(&accuracy, &accuracy.pooled),
            smoothed: tables::pooled(&accuracy, &accuracy.pooled_smoothed),
            attention,
            notes: notes(snapshot),
            failures: snapshot
                .fits
                .iter()
                .filter(|part| part.state == PartState::Failed)
                .count() as u64,
            reading,
            fits: tables::fits(&summary),
            verdict: summary.verdict,
        }
    }
}

/// How people chose in the source study, where its file tells.
fn published(figure: &PaperFigure) -> Option<String> {
    let n: u32 = figure.choices.iter().map(|(_, count)| count).sum();
    let shares: Vec<String> = figure
        .choices
        .iter()
        .map(|(action, count)| {
            let share = percent(Some(f64::from(*count) / f64::from(n)));
            format!("{}: {count} of {n} ({share})", action.label)
        })
        .collect();
    let source = figure.source.as_deref().unwrap_or("the paper");
    (!shares.is_empty()).then(|| {
        format!(
            "{} in the source study: {}. From {source}.",
            figure.label,
            shares.join("; ")
        )
    })
}

fn counted_people(people: &People) -> [String; 4] {
    [
        people.completed,
        people.started,
        people.withdrawn,
        people.declined,
    ]
    .map(count)
}

fn counted_answers(answers: &Answers) -> [String; 4] {
    [
        answers.counted,
        answers.late,
        answers.timed_out,
        answers.before_exclusions,
    ]
    .map(count)
}

fn figures(summary: &Summary, accuracy: &Accuracy, curves: &Curves, plan: &str) -> Figures {
    let source = source(summary);
    let plan_label = summary
        .plans
        .iter()
        .find(|known| known.id == plan)
        .map_or(plan, |known| known.label.as_str());
    let curve_caption = format!("{source} · fit: {plan_label}");
    let parts: Vec<&PartCurves> = curves
        .plans
        .iter()
        .filter(|part| part.plan == plan)
        .collect();
    let curve = |kind, title, subtitle, table| Figure {
        kind,
        title,
        subtitle,
        plan: Some(plan.to_owned()),
        caption: curve_caption.clone(),
        table,
    };
    Figures {
        actions: Figure {
            kind: "actions",
            title: "Choices in each situation",
            subtitle: "Share of people who chose each action, with 95 % Wilson intervals; beside it what each model predicts, with 90 % of the posterior.",
            plan: None,
            caption: source.clone(),
            table: tables::actions(summary),
        },
        weighting: curve(
            "weighting",
            "How much weight does a probability get?",
            "Weight w(p) against probability p; bands: 50 % and 90 % of the posterior; fine dashes: the prior’s mean.",
            curve_table(
                &parts,
                "p",
                &|x| trimmed(x),
                &[
                    ("gains", |curves| curves.weighting_gain.as_ref()),
                    ("losses", |curves| curves.weighting_loss.as_ref()),
                ],
            ),
        ),
        weight_of_risk: curve(
            "weight_of_risk",
            "How large does the risk look?",
            "Decision weight of the risky outcome against its true probability (the paper’s perceived probability); bands as above.",
            curve_table(
                &parts,
                "p",
                &|x| trimmed(x),
                &[("decision weight", |curves| {
                    curves.decision_weight.as_ref().map(|weight| &weight.series)
                })],
            ),
        ),
        value: curve(
            "value",
            "How much does a reward move the choice?",
            "θ·v(R) in logits (Noisy Rational: θ·R); bands: 50 % and 90 % of the posterior; fine dashes: the prior’s median.",
            curve_table(
                &parts,
                "Reward",
                &reward(summary),
                &[("logits", |curves| Some(&curves.value_logits))],
            ),
        ),
        value_shape: curve(
            "value_shape",
            "What shape has value?",
            "v(R) divided by its size at the reference reward: shape only, each draw is ±1 there by construction.",
            curve_table(
                &parts,
                "Reward",
                &reward(summary),
                &[("shape only", |curves| Some(&curves.value_shape))],
            ),
        ),
        accuracy: Figure {
            kind: "accuracy",
            title: "Which model comes closer to the choices?",
            subtitle: "ln KL from the choices to each model’s predictions (natural logarithm; lower is closer), mean ± sd over independent draws. Dotted: the reference level, what the true probabilities themselves would score against as many answers; below it means closer to the sample than the truth would be, not better.",
            plan: None,
            caption: format!(
                "{source} · fit: {} · {} draws per cell",
                accuracy.plan_label, accuracy.samples
            ),
            table: tables::ln_kl(accuracy),
        },
        predictive: Figure {
            kind: "predictive_check",
            title: "Would people who choose so leave such answers?",
            subtitle: "Dots: what was chosen. Bars: 50 % and 90 % of what as many people would choose if the model were right, over draws of its fit. p: how often they would choose it more (ties half); near 0 or 1 the model misses. The fit saw these answers, so a middling p says little.",
            plan: None,
            caption: format!("{source} · fit: {}", accuracy.plan_label),
            table: predictive::table(&accuracy.checks),
        },
    }
}

fn ladder(summary: &Summary, reading: &Reading) -> Figure {
    let mut table = Table::new(&[
        ("Model", Align::Words),
        ("Log score", Align::Numbers),
        ("Per answer", Align::Numbers),
        ("Gain over the step below ± SE", Align::Numbers),
        ("Reading", Align::Words),
    ]);
    let rungs = reading
        .ladder
        .as_ref()
        .map(|ladder| ladder.rungs.as_slice());
    for rung in rungs.unwrap_or_default() {
        table.row([
            rung.label.clone(),
            decimal(rung.score, 1),
            decimal(rung.per_answer, 3),
            mean_sd(rung.gain, rung.gain_se, 1),
            match rung.distinguishable {
                Some(true) => "beyond two standard errors",
                Some(false) => "not distinguishable",
                None => "–",
            }
            .to_owned(),
        ]);
    }
    Figure {
        kind: "ladder",
        title: "What does each step of the ladder gain?",
        subtitle: "Log score of answers that the model has not seen, per answer (higher is better), from chance to the richest model; bars: the gain over the step below ± two standard errors.",
        plan: None,
        caption: reading.ladder.as_ref().map_or_else(
            || source(summary),
            |ladder| {
                format!(
                    "n = {} answers of {} {} · {} left out at a time · fit: {} · seed {} · {}",
                    count(ladder.n),
                    count(ladder.units),
                    ladder.units_are,
                    if ladder.cells_left_out {
                        "cells"
                    } else {
                        ladder.units_are
                    },
                    ladder.plan_label,
                    ladder.seed,
                    ladder.at
                )
            },
        ),
        table,
    }
}

/// How the evidence grew.
fn followed(summary: &Summary, sequential: &Sequential<'_>) -> Figure {
    let mut table = Table::new(&[
        ("People", Align::Numbers),
        ("Answers", Align::Numbers),
        ("ln Bayes factor ± error", Align::Numbers),
        ("90 % interval", Align::Numbers),
        ("Width", Align::Numbers),
    ]);
    for look in &sequential.looks {
        let factor = look.ln_bayes_factor;
        table.row([
            count(look.n),
            count(look.answers),
            mean_sd(factor.map(|ln| ln.value), factor.map(|ln| ln.se), 2),
            interval(look.q5, look.q95, 2),
            decimal(look.width, 3),
        ]);
    }
    Figure {
        kind: "sequential",
        title: "How did the evidence grow?",
        subtitle: "After the first people who finished, in their order: the Bayes factor on a logarithmic scale, and the width of the 90 % interval that the study follows. Dotted: the bound of the study’s rule, where it has one.",
        plan: None,
        caption: format!("{} · fit: {}", source(summary), sequential.plan),
        table,
    }
}

fn source(summary: &Summary) -> String {
    let left_out = match summary.people.excluded {
        0 => String::new(),
        n => format!(", {} left out", count(n)),
    };
    format!(
        "n = {} answers of {} people who finished{} · data version {}, fit version {}",
        count(summary.answers.counted),
        count(summary.people.completed),
        left_out,
        summary.data_version,
        summary.fit_version
    )
}

type Selected = fn(&super::curves::ModelCurves) -> Option<&Series>;

fn curve_table(
    parts: &[&PartCurves],
    x_label: &'static str,
    x_text: &dyn Fn(f64) -> String,
    curves: &[(&'static str, Selected)],
) -> Table {
    let mut table = Table::new(&[
        ("Fit", Align::Words),
        ("Model", Align::Words),
        ("Curve", Align::Words),
        (x_label, Align::Numbers),
        ("Mean", Align::Numbers),
        ("50 % posterior", Align::Numbers),
        ("90 % posterior", Align::Numbers),
        ("Prior mean", Align::Numbers),
    ]);
    for (name, select) in curves {
        for part in parts {
            for (model, fitted) in part.models.iter() {
                let Some(series) = select(fitted) else {
                    continue;
                };
                let label = model_named(model).map_or(model, |model| model.label);
                for index in spread(series.x.len()) {
                    let at = |column: &[Option<f64>]| column[index];
                    table.row([
                        part.label.clone(),
                        label.to_owned(),
                        (*name).to_owned(),
                        x_text(series.x[index]),
                        decimal(at(&series.mean), 3),
                        interval(at(&series.q25), at(&series.q75), 3),
                        interval(at(&series.q5), at(&series.q95), 3),
                        decimal(at(&series.prior_mean), 3),
                    ]);
                }
            }
        }
    }
    table
}

/// Some indices out of `length`, both ends included.
fn spread(length: usize) -> Vec<usize> {
    if length <= CURVE_ROWS {
        return (0..length).collect();
    }
    let steps = CURVE_ROWS - 1;
    (0..=steps)
        .map(|step| (step * (length - 1) + steps / 2) / steps)
        .collect()
}

fn trimmed(x: f64) -> String {
    format!("{}", (x * 1e6).round() / 1e6).replace('-', "\u{2212}")
}

fn reward(summary: &Summary) -> impl Fn(f64) -> String {
    let unit = &summary.study.reward_unit;
    move |x| {
        format!(
            "{}{}{}{}",
            if x < 0.0 { "\u{2212}" } else { "" },
            unit.prefix,
            trimmed(x.abs()),
            unit.suffix
        )
    }
}

fn checks(summary: &Summary) -> Option<Checks> {
    let baseline = summary.checks.baseline.as_ref()?;
    Some(Checks {
        share: percent(baseline.share),
        interval: super::format::percents(baseline.low, baseline.high),
        n: count(baseline.n),
        paper: baseline.paper.map(|share| percent(Some(share))),
        table: tables::checks(summary)?,
    })
}

/// How often each instructed-response item was answered as asked.
pub(super) async fn attention(store: &Store, snapshot: &Snapshot) -> Result<Vec<Attention>, Error> {
    let study = &snapshot.study;
    let mut found = Vec::new();
    for item in study.instructed_items() {
        let set = snapshot.analysis_set();
        let given = store
            .form_answers(
                study.id(),
                snapshot.population,
                set,
                &item.block,
                &item.field,
                // Whoever did not answer as asked may be left out for just that.
                true,
            )
            .await?;
        // As the database writes what it stores: a text as it is, the rest as JSON.
        let expected = item
            .expected
            .as_str()
            .map_or_else(|| item.expected.to_string(), str::to_owned);
        let n = given
            .iter()
            .filter(|answer| answer.value.is_some())
            .map(|answer| answer.n)
            .sum();
        let as_asked = given
            .iter()
            .filter(|answer| answer.value.as_deref() == Some(expected.as_str()))
            .map(|answer| answer.n)
            .sum();
        found.push(Attention {
            label: item.label.clone(),
            n: count(n),
            as_asked: count(as_asked),
            leaves_out: study.exclude().contains(&Flag::FailedCheck),
        });
    }
    Ok(found)
}

/// What the design makes of all fits alike.
fn notes(snapshot: &Snapshot) -> Vec<String> {
    let study = &snapshot.study;
    let mut notes = Vec::new();
    if study.cells().len() > 1 {
        notes.push(
            "One person answers several questions. The fits take all answers as independent of each other; where people differ lastingly, posterior intervals are narrower than they should be. Where the interval over people drawn anew stands above and is wider, believe that one; where it is narrower, believe the posterior."
                .to_owned(),
        );
    }
    notes
}
