//! `riskaware study`: study files, one command a file.

mod check;
mod new;
mod report;
mod warnings;

use std::process::ExitCode;

use clap::{Args, Subcommand};

/// What to do with a study.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Write a commented study file to start from
    New(new::Arguments),
    /// Check a study file and show what it amounts to
    Check(check::Arguments),
}

/// Carries the command out.
///
/// # Errors
/// Those of the command.
pub(super) fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    match arguments.command {
        Command::New(arguments) => new::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Check(arguments) => check::run(&arguments),
    }
}
