//! The `riskaware` program: parses arguments, starts logging, calls the library.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    riskaware::cli::Cli::parse().run()
}
