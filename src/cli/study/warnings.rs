//! What a study file allows and its author may not want.

use crate::{
    inference::design_note,
    model::{ChoiceProblem, Outcome},
    study::{CompletionCode, RecruitingIds, RedirectTarget, StepKind, Study, Timestamp},
};

/// Expected rewards that differ by less than this share of the problem's range are nearly equal. (decision)
const NEARLY_EQUAL: f64 = 0.02;

/// How far the reckoned duration may be from the one that is told, as a factor. (decision)
const DURATION_FACTOR: f64 = 1.5;

/// All warnings about a study at a moment, the design first.
pub(super) fn of(study: &Study, now: Timestamp) -> Vec<String> {
    let mut warnings = cells(study);
    warnings.extend(parameters(study));
    warnings.extend(texts(study));
    warnings.extend(languages(study));
    warnings.extend(duration(study));
    warnings.extend(dates(study, now));
    warnings.extend(payment(study));
    warnings.extend(sites(study));
    warnings
}

/// Cells in which no action is better than another one by much.
fn cells(study: &Study) -> Vec<String> {
    let mut warnings = Vec::new();
    for cell in study.cells().iter().filter(|cell| cell.fitted) {
        let Some(problem) = &cell.problem else {
            continue;
        };
        let mut expected: Vec<f64> = problem
            .actions()
            .iter()
            .map(|action| action.prospect.expected_reward())
            .collect();
        expected.sort_by(|left, right| right.total_cmp(left));
        let (best, second) = (expected[0], expected[1]);
        if best - second < NEARLY_EQUAL * range(problem) {
            let format = |reward| study.reward_unit().format(rounded(reward));
            let how = if best == second {
                "equal"
            } else {
                "nearly equal"
            };
            warnings.push(format!(
                "cell {}: the best two expected rewards are {how} ({} and {}), so no action is clearly the better one",
                cell.id,
                format(best),
                format(second)
            ));
        }
    }
    warnings
}

/// The distance of the largest and the smallest reward.
fn range(problem: &ChoiceProblem) -> f64 {
    let rewards = || outcomes([problem]).map(|outcome| outcome.reward);
    rewards().fold(f64::NEG_INFINITY, f64::max) - rewards().fold(f64::INFINITY, f64::min)
}

fn outcomes<'a>(
    problems: impl IntoIterator<Item = &'a ChoiceProblem>,
) -> impl Iterator<Item = &'a Outcome> {
    problems
        .into_iter()
        .flat_map(ChoiceProblem::actions)
        .flat_map(|action| action.prospect.outcomes())
        .filter(|outcome| outcome.probability > 0.0)
}

pub(super) fn rounded(number: f64) -> f64 {
    (number * 1e6).round() / 1e6
}

/// What the design can tell about parameters, whatever people choose.
fn parameters(study: &Study) -> Vec<String> {
    let problems: Vec<&ChoiceProblem> = study
        .cells()
        .iter()
        .filter(|cell| cell.fitted)
        .filter_map(|cell| cell.problem.as_ref())
        .collect();
    let mut warnings = Vec::new();
    for model in study.models() {
        let note = design_note(model, problems.iter().copied(), study.fit().options);
        if let Some(note) = note {
            warnings.push(format!("{}: {note}", model.id));
        }
    }
    let uncertain = |sign: f64| -> Vec<f64> {
        let mut probabilities: Vec<f64> = outcomes(problems.iter().copied())
            .filter(|outcome| outcome.reward * sign > 0.0 && outcome.probability < 1.0)
            .map(|outcome| outcome.probability)
            .collect();
        probabilities.sort_by(f64::total_cmp);
        probabilities.dedup_by(|left, right| (*left - *right).abs() < 1e-9);
        probabilities
    };
    let weighted = [
        ("gains", "γ", uncertain(1.0)),
        ("losses", "δ", uncertain(-1.0)),
    ];
    if weighted.iter().all(|(_, _, found)| found.is_empty()) {
        warnings.push(
            "nothing is uncertain in any fitted question, so γ and δ (how probabilities are weighted) stay at their prior"
                .to_owned(),
        );
    }
    for (what, parameter, found) in &weighted {
        if let [only] = found.as_slice() {
            warnings.push(format!(
                "all uncertain {what} of fitted questions have the probability {only}, so {parameter} (how the probabilities of {what} are weighted) is learned at one point of the curve only"
            ));
        }
    }
    for (sign, what, parameter) in [(1.0, "gains", "α"), (-1.0, "losses", "β")] {
        let mut sizes: Vec<f64> = outcomes(problems.iter().copied())
            .map(|outcome| outcome.reward * sign)
            .filter(|size| *size > 0.0)
            .collect();
        sizes.sort_by(f64::total_cmp);
        sizes.dedup();
        if sizes.len() == 1 {
            warnings.push(format!(
                "all {what} of fitted questions have the same size, so {parameter} (how {what} bend) cannot be told from the sensitivity"
            ));
        }
    }
    warnings
}

fn texts(study: &Study) -> Vec<String> {
    let mut warnings = Vec::new();
    let contact = study.contact();
    let reaches_nobody = contact == "the research team that sent you the link"
        || contact.contains("example.")
        || contact.contains("YOUR ");
    if reaches_nobody {
        warnings.push(format!(
            "contact: `{contact}` reaches nobody (it stands for somebody, or its address is an example); put in a name and an address"
        ));
    }
    let outline = study.outline();
    let consent: Vec<&str> = outline
        .iter()
        .filter(|step| step.kind == StepKind::Consent)
        .map(|step| step.text.as_str())
        .collect();
    if consent.is_empty() {
        warnings.push("no block of kind `consent`: nobody is asked whether they agree".to_owned());
    } else if !["withdraw", "erase", "delete"].iter().any(|word| {
        consent
            .iter()
            .any(|text| text.to_lowercase().contains(word))
    }) {
        warnings.push(
            "the consent text does not say that people can withdraw and have their answers erased"
                .to_owned(),
        );
    }
    for step in &outline {
        let tells = matches!(step.kind, StepKind::Consent | StepKind::Info);
        if tells && step.text.is_empty() {
            warnings.push(format!("block {}: its text is empty", step.block));
        }
    }
    if !study.has_attention_check() {
        warnings.push(
            "no attention check: no field has `expected`, so nothing tells whether people read"
                .to_owned(),
        );
    }
    if study.completion().text_html.trim().is_empty() {
        warnings.push("completion.text: it is empty".to_owned());
    }
    let redirect = study.completion().redirect.as_ref();
    if study.completion().code == CompletionCode::PerRun
        && redirect.is_some_and(RedirectTarget::names_code)
    {
        warnings.push(
            "completion: a redirect without a fixed `code`; recruiting sites know only codes that they were told"
                .to_owned(),
        );
    }
    warnings
}

/// Texts that somebody reads in another language than the one that they chose.
fn languages(study: &Study) -> Vec<String> {
    let mut warnings = Vec::new();
    for tag in study.languages() {
        let translation = study.in_language(tag);
        let missing = translation.untranslated();
        if !missing.is_empty() {
            let noun = match missing.len() {
                1 => "1 text is",
                count => &format!("{count} texts are"),
            };
            warnings.push(format!(
                "language {tag}: {noun} shown in `{}`, since [text.{tag}] lacks {}",
                study.language(),
                missing.join(", ")
            ));
        }
        if !translation.has_page_words() {
            warnings.push(format!(
                "language {tag}: the program has no words of its own for it (buttons, messages, notes); they are English where [text.{tag}] has no `page.…` key"
            ));
        }
    }
    warnings
}

fn duration(study: &Study) -> Option<String> {
    let minutes = study.outline().iter().map(|step| step.seconds).sum::<f64>() / 60.0;
    let said = f64::from(study.minutes());
    let is_far = minutes > DURATION_FACTOR * said || minutes < said / DURATION_FACTOR - 1.0;
    is_far.then(|| {
        format!("minutes: people are told {said}, and the pages amount to about {minutes:.1}")
    })
}

/// Dates after which nobody can take part any more.
fn dates(study: &Study, now: Timestamp) -> Vec<String> {
    let recruiting = study.recruiting();
    let dates = [
        ("closes", recruiting.closes, "nobody is taken in any more"),
        (
            "retention",
            recruiting.retention,
            "nobody is taken in any more, and what ties answers to people is erased",
        ),
    ];
    dates
        .into_iter()
        .filter_map(|(key, date, so)| Some((key, date.filter(|date| *date <= now)?, so)))
        .map(|(key, date, so)| {
            let line = study
                .line_of(&["recruiting", key])
                .map_or_else(String::new, |line| format!("line {line}, "));
            let date = jiff::Timestamp::from_millisecond(date.0)
                .map_or_else(|_| "this moment".to_owned(), |date| date.to_string());
            format!("{line}recruiting.{key}: {date} is past, so {so}")
        })
        .collect()
}

fn payment(study: &Study) -> Option<String> {
    let cannot_pay = study.bonus().is_some() && study.recruiting().ids == RecruitingIds::Hashed;
    cannot_pay.then(|| {
        "bonus: ids of the recruiting site are stored under a keyed hash, so that nobody can be paid by them; `recruiting.ids = \"plain\"` keeps them"
            .to_owned()
    })
}

fn sites(study: &Study) -> Option<String> {
    let sites = &study.recruiting().mturk.sites;
    (!sites.is_empty()).then(|| {
        format!(
            "recruiting.mturk.sites: {} can do what MTurk can; take it out before you recruit",
            sites.join(", ")
        )
    })
}
