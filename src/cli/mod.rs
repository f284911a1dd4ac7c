//! The commands of the `riskaware` binary.

mod accounts;
mod audit;
mod backup;
mod calibrate;
mod choice_files;
mod demo;
mod doctor;
mod export;
mod fit;
mod fit_comparison;
mod fit_factor;
mod fit_files;
mod fit_source;
mod fit_table;
mod health;
mod import;
mod load;
mod output;
mod parallel;
mod predict;
mod recover;
mod serve;
mod simulate;
pub mod simulation;
mod study;
mod sweep;
mod sweep_drawing;
mod sweep_text;
mod values;

use std::{io::IsTerminal, process::ExitCode};

use clap::{Parser, Subcommand, ValueEnum};
use tracing_subscriber::{EnvFilter, fmt, layer::SubscriberExt, util::SubscriberInitExt};

/// Hosts risky-choice studies and fits models of the people who answer while they answer.
///
/// Exit status: 0 done, 1 failed, 2 wrong usage.
#[derive(Debug, Parser)]
#[command(version, about, args_conflicts_with_subcommands = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    // Without a command the server is meant, with its settings.
    #[command(flatten)]
    serve: serve::ServeArgs,
    /// What is logged to standard error, such as `warn` or `riskaware=debug`
    #[arg(long, global = true, env = "RISKAWARE_LOG", default_value = "info")]
    log: String,
    /// How log lines look
    #[arg(
        long,
        global = true,
        env = "RISKAWARE_LOG_FORMAT",
        default_value = "text"
    )]
    log_format: LogFormat,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line.
    Json,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the server (the default)
    Serve(serve::ServeArgs),
    /// Run the server on a temporary database with simulated people arriving
    Demo(demo::DemoArgs),
    /// Measure how many page turns the server bears while it refits
    Load(load::LoadArgs),
    /// Fit models to choices in a CSV file
    Fit(fit::Arguments),
    /// Read choice problems line by line and write choice probabilities
    Predict(predict::Arguments),
    /// Write choices of simulated people with given parameters, in the form of an export
    Simulate(simulate::Arguments),
    /// Check by simulation that fits are calibrated
    Calibrate(calibrate::Arguments),
    /// Tell what a study of a given size would find: parameter recovery and power
    Recover(recover::Arguments),
    /// Fit models to simulated shares of one problem, or over the gap of expected rewards
    Sweep(sweep::Arguments),
    /// Begin or check a study file; open, pause or close a study; leave people out of its analysis
    #[command(subcommand)]
    Study(study::Command),
    /// Make and change accounts
    User(accounts::user::UserArgs),
    /// Make and revoke tokens of the API
    Token(accounts::token::TokenArgs),
    /// Write a study's data to a file, also while a server takes answers
    Export(export::Arguments),
    /// Copy a database, also while a server uses it
    Backup(backup::BackupArguments),
    /// Check a copy and make a database of it
    Restore(backup::RestoreArguments),
    /// Check a database, and tell what to do where something is wrong
    Doctor(doctor::Arguments),
    /// Store answers from elsewhere, all of a file or none
    Import(import::Arguments),
    /// Ask a running server whether it is well
    Health(health::HealthArgs),
    /// Write the OpenAPI document of the server's API
    #[command(name = "openapi", hide = true)]
    OpenApi,
}

impl Cli {
    /// Carries the command out and says what went wrong, if anything did.
    pub fn run(self) -> ExitCode {
        let filter = match EnvFilter::try_new(&self.log) {
            Ok(filter) => filter,
            Err(error) => {
                eprintln!("error: --log {:?}: {error}", self.log);
                return ExitCode::from(2);
            }
        };
        let log = tracing_subscriber::registry().with(filter);
        match self.log_format {
            LogFormat::Text => log
                .with(
                    fmt::layer()
                        .with_ansi(std::io::stderr().is_terminal())
                        .with_writer(std::io::stderr),
                )
                .init(),
            LogFormat::Json => log
                .with(fmt::layer().json().with_writer(std::io::stderr))
                .init(),
        }
        match self.command.unwrap_or(Command::Serve(self.serve)).run() {
            Ok(code) => code,
            Err(error) => {
                eprintln!("error: {}", in_full(&error));
                ExitCode::FAILURE
            }
        }
    }
}

impl Command {
    fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Serve(args) => block_on(serve::run(args)),
            Self::Demo(args) => block_on(demo::run(args)),
            Self::Load(args) => block_on(load::run(args)),
            Self::Fit(arguments) => fit::run(&arguments).map(|()| ExitCode::SUCCESS),
            Self::Predict(arguments) => predict::run(&arguments).map(|()| ExitCode::SUCCESS),
            Self::Simulate(arguments) => simulate::run(&arguments).map(|()| ExitCode::SUCCESS),
            Self::Calibrate(arguments) => calibrate::run(&arguments).map(|()| ExitCode::SUCCESS),
            Self::Recover(arguments) => recover::run(&arguments).map(|()| ExitCode::SUCCESS),
            Self::Sweep(arguments) => sweep::run(&arguments).map(|()| ExitCode::SUCCESS),
            Self::Study(command) => study::run(command),
            Self::User(args) => block_on(accounts::user::run(args)),
            Self::Token(args) => block_on(accounts::token::run(args)),
            Self::Export(arguments) => block_on(export::run(arguments)),
            Self::Backup(arguments) => block_on(backup::back_up(arguments)),
            Self::Restore(arguments) => block_on(backup::restore(arguments)),
            Self::Doctor(arguments) => runtime()?.block_on(doctor::run(arguments)),
            Self::Import(arguments) => block_on(import::run(arguments)),
            Self::Health(args) => block_on(health::run(args)),
            Self::OpenApi => {
                output::print(crate::web::document().as_bytes()).map(|()| ExitCode::SUCCESS)
            }
        }
    }
}

/// An error with its causes; a cause that the text before it already tells is not told again.
fn in_full(error: &anyhow::Error) -> String {
    error
        .chain()
        .skip(1)
        .fold(error.to_string(), |told, cause| {
            let cause = cause.to_string();
            if told.contains(&cause) {
                told
            } else {
                format!("{told}: {cause}")
            }
        })
}

fn block_on(command: impl Future<Output = anyhow::Result<()>>) -> anyhow::Result<ExitCode> {
    runtime()?.block_on(command)?;
    Ok(ExitCode::SUCCESS)
}

fn runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
}
