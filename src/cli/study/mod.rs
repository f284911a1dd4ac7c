//! `riskaware study`: what a researcher does with a study from the terminal.

mod state;

use clap::Subcommand;

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
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
/// When the database or the study cannot be used; the message says why.
pub async fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Open(arguments) => state::run(arguments, state::Change::Open).await,
        Command::Pause(arguments) => state::run(arguments, state::Change::Pause).await,
        Command::Close(arguments) => state::run(arguments, state::Change::Close).await,
    }
}
