//! `riskaware simulate`: choices of people who do not exist, in the form of an export.

use std::path::PathBuf;

use anyhow::{Context, ensure};

use super::{
    export::to_file,
    fit_source::read_study,
    simulation::SimulatedGroup,
    values::{model, parameter},
};
use crate::{
    export::write_unstored,
    model::{ChoiceModel, RISK_AWARE},
};

/// Simulates people who take a study with given parameters, and writes their choices as CSV in the long form of an export.
///
/// Everybody answers every question, practice included, in an order of their own, and follows the model; where a question
/// withholds a probability or a reward they toss up. `riskaware fit --choices` takes the file as it is.
#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The study that they take: the id of a built-in one, or a file
    #[arg(long, value_name = "ID|FILE.toml")]
    study: String,
    /// How many people
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    n: u32,
    /// The model that they follow
    #[arg(long, default_value = RISK_AWARE.id, value_parser = model)]
    model: &'static ChoiceModel,
    /// A parameter, such as alpha=0.88; once for each parameter of the model
    #[arg(long = "parameter", value_name = "NAME=VALUE", value_parser = parameter, required = true)]
    parameters: Vec<(String, f64)>,
    /// Random seed: the same seed gives the same file
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// What the column `source` says of them
    #[arg(long, value_name = "LABEL", default_value = "")]
    source: String,
    /// The number of the first of them, so that several files can be joined
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000_000))]
    first: u32,
    /// The file to write, which must not exist; - is standard output
    #[arg(long, value_name = "FILE", default_value = "-")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let study = read_study(&arguments.study)?;
    let entries = arguments.parameters.iter();
    let parameters = arguments
        .model
        .parameters_from(entries.map(|(name, value)| (name.as_str(), *value)))
        .context("--parameter")?;
    ensure!(
        !arguments.source.contains(char::is_control),
        "--source {:?} holds a control character, allowed is text on one line",
        arguments.source
    );
    let people = SimulatedGroup {
        study: &study,
        parameters,
        options: arguments.model.options(study.fit().options),
        source: Some(arguments.source.clone()).filter(|source| !source.is_empty()),
        seed: arguments.seed,
    };
    let answers = (arguments.first..)
        .take(arguments.n as usize)
        .flat_map(|person| match people.answers(person) {
            Ok(rows) => rows.into_iter().map(Ok).collect(),
            Err(error) => vec![Err(anyhow::Error::from(error))],
        });
    to_file(&arguments.output, |file| {
        write_unstored(&study, answers, file)?;
        Ok(())
    })
}
