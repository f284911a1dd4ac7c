//! `riskaware study`: what a researcher does with a study from the terminal, one command a file.

mod check;
mod new;
mod report;
mod state;
mod warnings;

use std::process::ExitCode;

use clap::Subcommand;

use super::block_on;
use crate::clock::Clock;

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a commented study file to start from
    New(new::Arguments),
    /// Check study files and show what they amount to
    Check(check::Arguments),
    /// Let a study take people in
    Open(state::Arguments),
    /// Let nobody new into a study; those under way finish
    Pause(state::Arguments),
    /// End a study: nobody new is let in, those under way finish
    Close(state::Arguments),
}

/// Carries a command out.
///
/// # Errors
/// When the file, the database or the study cannot be used; the message says why.
pub fn run(command: Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::New(arguments) => new::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Check(arguments) => check::run(&arguments, Clock::start().now()),
        Command::Open(arguments) => block_on(state::run(arguments, state::Change::Open)),
        Command::Pause(arguments) => block_on(state::run(arguments, state::Change::Pause)),
        Command::Close(arguments) => block_on(state::run(arguments, state::Change::Close)),
    }
}
