//! The `riskaware` command. Exit status 0: done, 1: failed, 2: wrong usage.

use std::process::ExitCode;

use clap::Parser;
use riskaware::cli::{Cli, run};

fn main() -> ExitCode {
    match run(Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
