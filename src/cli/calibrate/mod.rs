//! `riskaware calibrate`: simulation-based calibration of the fits.

mod designs;
mod figure;
mod report;

use std::fmt;
use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use rayon::prelude::*;

use self::designs::Design;
use self::figure::{figure, file_name};
use self::report::{Calibrated, write_json, write_table};
use super::values::model;
use super::{output::print, parallel};
use crate::inference::calibration::{Experiment, RankSet, Replicate, judge};
use crate::inference::{FitSettings, Prior};
use crate::model::{ChoiceModel, MODELS};

/// Fixed before the first run, and all of them reported: the years of prospect theory, its cumulative form,
/// simulation-based calibration, the paper, and the bands.
const SEEDS: [u64; 5] = [1979, 1992, 2018, 2020, 2022];

/// Draws kept per chain: enough for the fit to count as converged and for samples to be independent.
const DRAWS: usize = 250;

/// Checks that fits are calibrated: people from the prior answer, a model is fitted to their answers, and the rank of
/// the true parameters among the posterior's draws must be uniform.
///
/// Exits with status 1 when it is not, judged by p-values corrected for the number of tests.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// Designs, separated by commas
    #[arg(long, value_name = "DESIGN,...", value_delimiter = ',', default_values = ["cups", "driving", "gambles"])]
    designs: Vec<Design>,
    /// Models, separated by commas
    #[arg(
        long, value_name = "MODEL,...", value_delimiter = ',', value_parser = model,
        default_values = ["noisy_rational", "risk_aware"]
    )]
    models: Vec<&'static ChoiceModel>,
    /// Simulated studies for each design, model and seed
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    replicates: u32,
    /// Random seeds, separated by commas
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = SEEDS)]
    seeds: Vec<u64>,
    /// Independent posterior draws among which the truth is ranked, from 7 to 255
    #[arg(long, value_name = "N", default_value_t = 63, value_parser = clap::value_parser!(u32).range(7..=255))]
    samples: u32,
    /// Fit with a tenth of the sensitivity that people have by the prior, to see that this is noticed
    #[arg(long)]
    wrong_prior: bool,
    /// Threads; by default one for each processor. The result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Write a figure for each design and model (SVG) into this folder
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// Print JSON for machines
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    // What comes twice would be counted as if it had been found twice.
    refuse_repeats("--seeds", &arguments.seeds)?;
    refuse_repeats("--designs", &arguments.designs)?;
    let models: Vec<&str> = arguments.models.iter().map(|model| model.id).collect();
    refuse_repeats("--models", &models)?;
    let mut experiments = Vec::new();
    for &design in &arguments.designs {
        for &model in &arguments.models {
            let mut experiment = experiment(design, model, arguments.samples as usize)?;
            if arguments.wrong_prior {
                experiment.settings.priors.tau = a_tenth(experiment.priors.tau);
            }
            experiments.push((design, experiment));
        }
    }
    if let Some(folder) = &arguments.figures {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    let replicates = u64::from(arguments.replicates);
    let total = experiments.len() as u64 * arguments.seeds.len() as u64 * replicates;
    let bar = parallel::progress_bar(total);
    let all: anyhow::Result<Vec<Vec<Vec<Replicate>>>> =
        parallel::pool(arguments.threads)?.install(|| {
            let of_seed = |(design, experiment): &(Design, Experiment), seed: u64| {
                bar.set_message(format!(
                    "{}, {}, seed {seed}",
                    design.id(),
                    experiment.model.label
                ));
                let replicates = (0..replicates).into_par_iter();
                replicates
                    .map(|number| {
                        let replicate = experiment.replicate(seed, number);
                        bar.inc(1);
                        replicate.with_context(|| {
                            format!(
                                "{}, {}, seed {seed}, replicate {number}",
                                design.id(),
                                experiment.model
                            )
                        })
                    })
                    .collect()
            };
            let of_experiment = |experiment| {
                arguments
                    .seeds
                    .iter()
                    .map(|&seed| of_seed(experiment, seed))
                    .collect()
            };
            experiments.iter().map(of_experiment).collect()
        });
    bar.finish_and_clear();
    let all = all?;

    let sets: Vec<RankSet<'_>> = all.iter().map(|seeds| RankSet { seeds }).collect();
    let judgement = judge(&sets, arguments.samples as usize + 1);
    let calibrated: Vec<Calibrated<'_>> = experiments
        .iter()
        .zip(&all)
        .zip(&judgement.experiments)
        .map(|(((design, experiment), seeds), quantities)| Calibrated {
            design: *design,
            experiment,
            seeds: &arguments.seeds,
            replicates: arguments.replicates as usize,
            unconverged: seeds.iter().map(|seed| unconverged(seed)).collect(),
            quantities,
        })
        .collect();
    if let Some(folder) = &arguments.figures {
        for calibrated in &calibrated {
            let path = folder.join(file_name(calibrated));
            std::fs::write(&path, figure(calibrated))
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
    }
    let mut text = Vec::new();
    if arguments.json {
        write_json(&mut text, &calibrated, &judgement)?;
    } else {
        write_table(&mut text, &calibrated, &judgement)?;
    }
    print(&text)?;
    if !judgement.is_calibrated {
        bail!(
            "the fits are not calibrated: the smallest of {} corrected p-values is {:.2e}",
            judgement.tests,
            judgement.smallest_p
        );
    }
    Ok(())
}

fn experiment(
    design: Design,
    model: &'static ChoiceModel,
    samples: usize,
) -> anyhow::Result<Experiment> {
    let (problems, settings) = design.problems()?;
    Ok(Experiment {
        model,
        problems,
        people: design.people(),
        priors: settings.priors,
        first_stream: first_stream(design, model),
        settings: FitSettings {
            draws: DRAWS,
            samples,
            ..settings
        },
    })
}

fn a_tenth(prior: Prior) -> Prior {
    match prior {
        Prior::Uniform { low, high } => Prior::Uniform {
            low: low / 10.0,
            high: high / 10.0,
        },
        Prior::LogNormal { median, log_sd } => Prior::LogNormal {
            median: median / 10.0,
            log_sd,
        },
    }
}

/// A place of its own for each design and model, whichever others are asked for.
fn first_stream(design: Design, model: &ChoiceModel) -> u64 {
    let place = MODELS.iter().position(|known| *known == model);
    ((design as u64) << 48) + ((place.unwrap_or(MODELS.len()) as u64) << 32)
}

fn refuse_repeats<T: PartialEq + fmt::Debug>(option: &str, values: &[T]) -> anyhow::Result<()> {
    for (place, value) in values.iter().enumerate() {
        ensure!(
            !values[..place].contains(value),
            "{option} has {value:?} twice, allowed is each once"
        );
    }
    Ok(())
}

fn unconverged(replicates: &[Replicate]) -> usize {
    replicates
        .iter()
        .filter(|replicate| !replicate.converged)
        .count()
}
