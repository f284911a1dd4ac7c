//! The commands of the `riskaware` binary.

mod choice_files;
mod fit;
mod fit_table;
mod predict;

use clap::{Parser, Subcommand};

/// Hosts risky-choice studies and fits models of the people who answer.
#[derive(Debug, Parser)]
#[command(version, about)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fit models to choices in a CSV file.
    Fit(fit::Arguments),
    /// Read choice problems line by line and write choice probabilities.
    Predict(predict::Arguments),
}

/// Runs the command that was asked for.
///
/// # Errors
/// When the command fails; the error says what was wrong and where.
pub fn run(cli: Cli) -> anyhow::Result<()> {
    match cli.command {
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Predict(arguments) => predict::run(&arguments),
    }
}
