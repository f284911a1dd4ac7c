//! The tables and sentences of the page of sources.

use super::super::results::{
    Align, Cell, SourceChoices, Sources, Table, contraction, count, decimal, estimate, mean_sd,
    percent, percents, range, ratio, significant, symbol,
};
use crate::{
    inference::factor::{FactorEvidence, FactorReport, FactorVerdict, LevelFit},
    model::model_named,
};

const NO_LABEL: &str = "(no label)";

/// What the fits say.
pub(super) struct SourceTables {
    /// A sentence for each model.
    pub verdicts: Vec<String>,
    pub evidence: Table,
    pub fits: Table,
    pub parameters: Table,
    pub differences: Table,
    /// Whether each source is held against all others.
    pub against_rest: bool,
}

/// Where people came from, and who is compared.
pub(super) fn sources(sources: &Sources) -> Table {
    let mut table = Table::new(&[
        ("Source", Align::Words),
        ("People", Align::Numbers),
        ("Choices", Align::Numbers),
        ("Compared", Align::Words),
    ]);
    for source in &sources.sources {
        table.row([
            source.source.clone().unwrap_or_else(|| NO_LABEL.to_owned()),
            count(source.people),
            count(source.n),
            source.left_out.map_or_else(
                || "yes".to_owned(),
                |reason| format!("no: {}", reason.words()),
            ),
        ]);
    }
    table
}

/// How often the first action was chosen in each cell.
pub(super) fn choices(sources: &Sources) -> Table {
    let mut table = Table::new(&[
        ("Cell", Align::Prose),
        ("Source", Align::Words),
        ("n", Align::Numbers),
        ("Action", Align::Words),
        ("Chose it", Align::Numbers),
        ("Share", Align::Numbers),
        ("95 % interval", Align::Words),
        ("p", Align::Numbers),
        ("p, Holm", Align::Numbers),
    ]);
    for row in &sources.choices {
        table.row(choice_row(row));
    }
    table
}

fn choice_row(row: &SourceChoices) -> [String; 9] {
    [
        row.label.clone(),
        row.source.clone().unwrap_or_else(|| NO_LABEL.to_owned()),
        count(row.n),
        row.action_label.clone(),
        count(row.chosen),
        percent(Some(row.share)),
        percents(Some(row.low), Some(row.high)),
        p_text(row.p),
        p_text(row.p_holm),
    ]
}

fn p_text(p: Option<f64>) -> String {
    match p {
        Some(p) if p < 0.001 => "< 0.001".to_owned(),
        Some(_) | None => decimal(p, 3),
    }
}

impl SourceTables {
    pub(super) fn new(report: &FactorReport) -> Self {
        let mut tables = Self {
            verdicts: Vec::new(),
            evidence: Table::new(&[
                ("Model", Align::Words),
                ("ln Bayes factor ± error", Align::Numbers),
                ("Separate to shared", Align::Numbers),
                ("ln evidence, separate", Align::Numbers),
                ("ln evidence, shared", Align::Numbers),
            ]),
            fits: Table::new(&[
                ("Source", Align::Words),
                ("Part", Align::Words),
                ("Model", Align::Words),
                ("Choices", Align::Numbers),
                ("State", Align::Words),
                ("largest R̂", Align::Numbers),
                ("smallest ESS", Align::Numbers),
                ("ln KL, mean ± sd", Align::Numbers),
                ("Seed", Align::Numbers),
            ]),
            parameters: Table::new(&[
                ("Source", Align::Words),
                ("Part", Align::Words),
                ("Model", Align::Words),
                ("Parameter", Align::Words),
                ("Median", Align::Numbers),
                ("5–95 %", Align::Numbers),
                ("Contraction", Align::Words),
                ("Mean ± sd", Align::Numbers),
            ]),
            differences: Table::new(&[
                ("Difference", Align::Words),
                ("Part", Align::Words),
                ("Model", Align::Words),
                ("Parameter", Align::Words),
                ("Median", Align::Numbers),
                ("5–95 %", Align::Numbers),
                ("P(first is larger)", Align::Numbers),
                ("Informed in both", Align::Words),
            ]),
            against_rest: report.levels.len() > 2,
        };
        for (model, found) in report.models.iter() {
            let label = model_named(model).map_or(model, |model| model.label);
            tables
                .verdicts
                .push(verdict(label, found.evidence.as_ref()));
            tables.add_evidence(label, found.evidence.as_ref());
            for part in &found.parts {
                let all = std::iter::once(("all together", &part.shared));
                let levels = report.levels.iter().map(|level| level.label());
                for (level, fit) in all.chain(levels.zip(&part.levels)) {
                    tables.add_fit([level, &part.label, label], fit);
                }
                for contrast in &part.contrasts {
                    for (name, found) in contrast.differences.iter() {
                        tables.differences.row([
                            contrast.label(),
                            part.label.clone(),
                            label.to_owned(),
                            symbol(name),
                            significant(found.q50),
                            range(found.q5, found.q95),
                            probability(found.probability_larger),
                            if found.informed { "yes" } else { "no" }.to_owned(),
                        ]);
                    }
                }
            }
        }
        tables
    }

    fn add_evidence(&mut self, model: &str, evidence: Option<&FactorEvidence>) {
        let ln = evidence.map(|found| &found.ln_bayes_factor);
        self.evidence.row([
            model.to_owned(),
            estimate(ln),
            ln.map_or_else(|| "–".to_owned(), |ln| ratio(ln.value)),
            estimate(evidence.map(|found| &found.separate)),
            estimate(evidence.map(|found| &found.shared)),
        ]);
    }

    fn add_fit(&mut self, names: [&str; 3], fit: &LevelFit) {
        let names = names.map(str::to_owned);
        let ln_kl = fit.ln_kl.as_ref();
        let state = if fit.converged {
            ("converged", "converged")
        } else {
            ("unconverged", "not converged")
        };
        let mut row: Vec<Cell> = names.clone().map(Cell::from).into();
        row.extend([
            count(fit.n).into(),
            Cell::State {
                id: state.0,
                word: state.1,
            },
            decimal(fit.rhat_max, 3).into(),
            decimal(fit.ess_min, 0).into(),
            mean_sd(
                ln_kl.and_then(|found| found.mean),
                ln_kl.and_then(|found| found.sd),
                2,
            )
            .into(),
            fit.seed.to_string().into(),
        ]);
        self.fits.row(row);
        for (name, found) in fit.parameters.iter().flat_map(|all| all.iter()) {
            let mut row = names.to_vec();
            row.extend([
                symbol(name),
                significant(found.q50),
                range(found.q5, found.q95),
                contraction(found),
                format!("{} ± {}", significant(found.mean), significant(found.sd)),
            ]);
            self.parameters.row(row);
        }
    }
}

/// What decides, in a sentence.
fn verdict(model: &str, evidence: Option<&FactorEvidence>) -> String {
    let Some(evidence) = evidence else {
        return format!("{model}: a fit did not converge, so nothing is said.");
    };
    match evidence.verdict {
        FactorVerdict::Differ => format!(
            "{model}: sources differ. Parameters of their own make the choices likelier than shared ones, {}.",
            ratio(evidence.ln_bayes_factor.value)
        ),
        FactorVerdict::Alike => format!(
            "{model}: one set of parameters does for all sources. It makes the choices likelier than parameters of their own, {}.",
            ratio(-evidence.ln_bayes_factor.value)
        ),
        FactorVerdict::Undecided => format!(
            "{model}: undecided; the choices are about as likely with shared parameters as with separate ones."
        ),
    }
}

/// Draws are some thousands: what they cannot tell from 0 or 1 is not shown as certain.
fn probability(share: f64) -> String {
    if share < 0.001 {
        "< 0.001".to_owned()
    } else if share > 0.999 {
        "> 0.999".to_owned()
    } else {
        decimal(Some(share), 3)
    }
}
