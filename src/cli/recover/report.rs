//! What simulated studies find, as a table or as JSON.

use std::io::{self, Write};

use serde::Serialize;

use crate::inference::recovery::{QuantityRecovery, Recovery, Scale, Scenario, Truth};
use crate::inference::{Estimate, Quantity};
use crate::model::OrderedMap;

/// Everything that is told.
pub(super) struct Report<'a> {
    /// Where problems and settings come from.
    pub(super) source: &'a str,
    pub(super) scenario: &'a Scenario,
    pub(super) seed: u64,
    /// Whose width stands beside the comparison of models.
    pub(super) interval: Option<Quantity>,
    pub(super) recoveries: &'a [Recovery],
}

#[derive(Serialize)]
pub(super) struct Json<'a> {
    source: &'a str,
    model: &'static str,
    rival: &'static str,
    /// `null` if they come from the prior.
    parameters: Option<OrderedMap<f64>>,
    problems: usize,
    seed: u64,
    sizes: &'a [Recovery],
}

impl<'a> Report<'a> {
    /// For machines.
    pub(super) fn json(&self) -> Json<'a> {
        Json {
            source: self.source,
            model: self.scenario.model.id,
            rival: self.scenario.rival.id,
            parameters: self.parameters(),
            problems: self.scenario.problems.len(),
            seed: self.seed,
            sizes: self.recoveries,
        }
    }

    fn parameters(&self) -> Option<OrderedMap<f64>> {
        match &self.scenario.truth {
            Truth::Known(known) => {
                let names = self.scenario.model.parameters.iter();
                Some(
                    names
                        .map(|name| (name.key().to_owned(), known.get(*name)))
                        .collect(),
                )
            }
            Truth::Prior => None,
        }
    }
}

/// Writes which model wins by size, then what is recovered of each parameter.
pub(super) fn write_table(out: &mut impl Write, report: &Report<'_>) -> io::Result<()> {
    let scenario = report.scenario;
    writeln!(
        out,
        "{}: {} problems, each answered once by each person",
        report.source,
        scenario.problems.len()
    )?;
    let parameters = match report.parameters() {
        Some(known) => {
            let known: Vec<String> = known
                .iter()
                .map(|(name, value)| format!("{name} {value}"))
                .collect();
            known.join(", ")
        }
        None => "parameters from the prior, anew for each study".to_owned(),
    };
    writeln!(out, "People follow {} ({parameters})", scenario.model.label)?;
    let replicates = report
        .recoveries
        .first()
        .map_or(0, |first| first.replicates);
    writeln!(
        out,
        "{replicates} simulated studies of each size, seed {}; after each figure its Monte-Carlo error",
        report.seed
    )?;

    writeln!(
        out,
        "\n{} or {}: how often",
        scenario.model.label, scenario.rival.label
    )?;
    write!(
        out,
        "{:>7} {:>15} {:>15} {:>15} {:>15}",
        "people", "elpd > 2 SE", "BF > 10", "wrong by elpd", "wrong by BF"
    )?;
    if let Some(interval) = report.interval {
        write!(out, " {:>18}", format!("width of {interval}"))?;
    }
    writeln!(out, " {:>13}", "not converged")?;
    for recovery in report.recoveries {
        write!(out, "{:>7}", recovery.people)?;
        for figure in [
            recovery.elpd_beyond_two_se,
            recovery.bayes_factor_above_10,
            recovery.elpd_favours_wrong,
            recovery.bayes_factor_favours_wrong,
        ] {
            write!(out, " {:>15}", figure.map_or("-".to_owned(), with_error))?;
        }
        if let Some(interval) = report.interval {
            let found = recovery
                .quantities
                .iter()
                .find(|found| found.quantity == interval);
            let width = found.map_or("-".to_owned(), |found| with_error(found.width));
            write!(out, " {width:>18}")?;
        }
        writeln!(out, " {:>13}", recovery.not_scored)?;
    }
    for recovery in report.recoveries {
        writeln!(
            out,
            "\n{} people: posterior medians and 90 % intervals",
            recovery.people
        )?;
        writeln!(
            out,
            "{:>14} {:>17} {:>15} {:>15}",
            "", "bias", "coverage", "width"
        )?;
        for found in &recovery.quantities {
            write_quantity(out, found)?;
        }
        if recovery.unconverged > 0 {
            writeln!(
                out,
                "left out: {} studies in which the chains have not converged",
                recovery.unconverged
            )?;
        }
    }
    if report
        .recoveries
        .iter()
        .flat_map(|recovery| &recovery.quantities)
        .any(|found| found.scale == Scale::Log)
    {
        writeln!(
            out,
            "\nln: bias and width are of the natural logarithm, 0.1 is about 10 %."
        )?;
    }
    Ok(())
}

fn write_quantity(out: &mut impl Write, found: &QuantityRecovery) -> io::Result<()> {
    let name = match found.scale {
        Scale::Value => found.quantity.to_string(),
        Scale::Log => format!("ln {}", found.quantity),
    };
    let note = if found.is_prior {
        "  no choice depends on it"
    } else {
        ""
    };
    writeln!(
        out,
        "{name:>14} {:>17} {:>15} {:>15}{note}",
        with_error(found.bias),
        with_error(found.coverage),
        with_error(found.width)
    )
}

fn with_error(estimate: Estimate) -> String {
    format!("{:.3} ± {:.3}", estimate.value, estimate.se)
}
