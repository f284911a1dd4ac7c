//! What a calibration says, as a table or as JSON.

use std::io::{self, Write};

use serde::Serialize;

use super::designs::Design;
use crate::inference::calibration::{Experiment, Judgement, LEVEL, QuantityJudgement, RankTest};

/// A design with a model, and how its ranks were judged.
pub(super) struct Calibrated<'a> {
    pub(super) design: Design,
    pub(super) experiment: &'a Experiment,
    pub(super) seeds: &'a [u64],
    /// For each seed.
    pub(super) replicates: usize,
    /// For each seed: how many fits had not converged.
    pub(super) unconverged: Vec<usize>,
    pub(super) quantities: &'a [QuantityJudgement],
}

impl Calibrated<'_> {
    /// Design, model and size in a line.
    pub(super) fn title(&self) -> String {
        let problems = self.experiment.problems.len();
        format!(
            "{}, {}: {problems} problem{}, {} answers to each",
            self.design.id(),
            self.experiment.model.label,
            if problems == 1 { "" } else { "s" },
            self.experiment.people
        )
    }
}

/// Writes a table for each design and model, and the verdict.
pub(super) fn write_table(
    out: &mut impl Write,
    all: &[Calibrated<'_>],
    judgement: &Judgement,
) -> io::Result<()> {
    let Some(first) = all.first() else {
        return Ok(());
    };
    let seeds: Vec<String> = first.seeds.iter().map(u64::to_string).collect();
    writeln!(
        out,
        "{} simulated studies for each of {} seeds; ranks of the truth among {} posterior draws",
        first.replicates,
        seeds.len(),
        first.experiment.settings.samples
    )?;
    writeln!(
        out,
        "p-values of uniform ranks by seed, of all seeds together, and the smallest after correction for {} tests",
        judgement.tests
    )?;
    for calibrated in all {
        writeln!(out, "\n{}", calibrated.title())?;
        let unconverged: usize = calibrated.unconverged.iter().sum();
        writeln!(
            out,
            "chains not converged in {unconverged} of {} (ranked like the others)",
            calibrated.replicates * seeds.len()
        )?;
        write!(out, "{:38}", "")?;
        for seed in &seeds {
            write!(out, " {seed:>7}")?;
        }
        writeln!(out, " {:>8} {:>9}", "together", "corrected")?;
        for quantity in calibrated.quantities {
            write!(out, "{:38}", quantity.quantity.to_string())?;
            for test in &quantity.seeds {
                let mark = if test.is_inside { "" } else { "*" };
                write!(out, " {:>7}", format!("{:.3}{mark}", test.p))?;
            }
            let together = quantity.together.as_ref();
            write!(
                out,
                " {:>8}",
                together.map_or("".to_owned(), |test| format!("{:.3}", test.p))
            )?;
            writeln!(out, " {:>9.3}", smallest(quantity))?;
        }
    }
    let tests = || {
        all.iter()
            .flat_map(|calibrated| calibrated.quantities)
            .flat_map(|q| &q.seeds)
    };
    let outside = tests().filter(|test| !test.is_inside).count();
    writeln!(
        out,
        "\n* {outside} of {} seeds' ranks leave their own bands of {:.0} %; by chance about {:.1} would.",
        tests().count(),
        100.0 * LEVEL,
        tests().count() as f64 * (1.0 - LEVEL)
    )?;
    let verdict = if judgement.is_calibrated {
        "Calibrated"
    } else {
        "NOT CALIBRATED"
    };
    writeln!(
        out,
        "{verdict}: the smallest of {} corrected p-values is {:.4}; it must be above {:.2}.",
        judgement.tests,
        judgement.smallest_p,
        1.0 - LEVEL
    )
}

fn smallest(quantity: &QuantityJudgement) -> f64 {
    let tests = quantity.seeds.iter().chain(&quantity.together);
    tests.map(|test| test.corrected_p).fold(1.0, f64::min)
}

#[derive(Serialize)]
struct Report<'a> {
    calibrated: bool,
    smallest_corrected_p: f64,
    tests: usize,
    level: f64,
    experiments: Vec<ExperimentReport<'a>>,
}

#[derive(Serialize)]
struct ExperimentReport<'a> {
    design: &'static str,
    model: &'static str,
    problems: usize,
    answers_per_problem: u64,
    replicates: usize,
    samples: usize,
    seeds: &'a [u64],
    unconverged: &'a [usize],
    quantities: Vec<QuantityReport<'a>>,
}

#[derive(Serialize)]
struct QuantityReport<'a> {
    name: String,
    seeds: Vec<TestReport<'a>>,
    together: Option<TestReport<'a>>,
}

#[derive(Serialize)]
struct TestReport<'a> {
    p: f64,
    corrected_p: f64,
    inside_bands: bool,
    /// How many ranks are below 1, 2, ….
    ranks_below: &'a [usize],
}

/// Writes one JSON object.
pub(super) fn write_json(
    out: &mut impl Write,
    all: &[Calibrated<'_>],
    judgement: &Judgement,
) -> anyhow::Result<()> {
    let report = Report {
        calibrated: judgement.is_calibrated,
        smallest_corrected_p: judgement.smallest_p,
        tests: judgement.tests,
        level: LEVEL,
        experiments: all.iter().map(ExperimentReport::of).collect(),
    };
    serde_json::to_writer(&mut *out, &report)?;
    out.write_all(b"\n")?;
    Ok(())
}

impl<'a> ExperimentReport<'a> {
    fn of(calibrated: &'a Calibrated<'_>) -> Self {
        Self {
            design: calibrated.design.id(),
            model: calibrated.experiment.model.id,
            problems: calibrated.experiment.problems.len(),
            answers_per_problem: calibrated.experiment.people,
            replicates: calibrated.replicates,
            samples: calibrated.experiment.settings.samples,
            seeds: calibrated.seeds,
            unconverged: &calibrated.unconverged,
            quantities: calibrated
                .quantities
                .iter()
                .map(QuantityReport::of)
                .collect(),
        }
    }
}

impl<'a> QuantityReport<'a> {
    fn of(judged: &'a QuantityJudgement) -> Self {
        Self {
            name: judged.quantity.to_string(),
            seeds: judged.seeds.iter().map(TestReport::of).collect(),
            together: judged.together.as_ref().map(TestReport::of),
        }
    }
}

impl<'a> TestReport<'a> {
    fn of(test: &'a RankTest) -> Self {
        Self {
            p: test.p,
            corrected_p: test.corrected_p,
            inside_bands: test.is_inside,
            ranks_below: &test.counts,
        }
    }
}
