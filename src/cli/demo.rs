//! `riskaware demo`: the server on a temporary database, with simulated people arriving.

use std::{
    io::{IsTerminal, Write},
    net::SocketAddr,
    path::PathBuf,
    sync::Arc,
    time::Duration,
};

use anyhow::Context;
use clap::Args;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha20Rng;
use reqwest::Client;
use tokio_util::task::TaskTracker;

use super::{
    serve::{Reachable, ServeArgs, Server, asked_to_stop},
    simulation::Person,
};
use crate::{
    model::{Parameter, Parameters},
    store::Population,
    study::{Study, StudyId},
};

/// Settings of the demonstration.
///
/// The default parameters are a person as the paper describes: small probabilities weigh much, losses more than gains.
#[derive(Debug, Clone, Args)]
pub struct DemoArgs {
    /// Address and port to listen on
    #[arg(long, env = "RISKAWARE_LISTEN", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// Which study they take
    #[arg(long, default_value = "driving")]
    study: String,
    /// A folder with study files (*.toml) to serve beside the built-in ones
    #[arg(long, env = "RISKAWARE_STUDIES")]
    studies: Option<PathBuf>,
    /// How many people arrive
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    people: u32,
    /// Over how many minutes they arrive
    #[arg(long, default_value_t = 4.0)]
    minutes: f64,
    /// Mean time that a person spends on a page, in seconds
    #[arg(long, default_value_t = 1.5)]
    thinking: f64,
    /// Seed of the people's arrivals and choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Curvature of gains
    #[arg(long, default_value_t = 0.88)]
    alpha: f64,
    /// Curvature of losses
    #[arg(long, default_value_t = 0.88)]
    beta: f64,
    /// Weighting of the probabilities of gains
    #[arg(long, default_value_t = 0.35)]
    gamma: f64,
    /// Weighting of the probabilities of losses
    #[arg(long, default_value_t = 0.45)]
    delta: f64,
    /// Loss aversion
    #[arg(long, default_value_t = 2.25)]
    lambda: f64,
    /// Sensitivity
    #[arg(long, default_value_t = 0.012)]
    theta: f64,
}

/// Runs the demonstration until the process is asked to stop.
///
/// # Errors
/// When a parameter is out of its range, the study is unknown, or the server cannot start.
pub async fn run(args: DemoArgs) -> anyhow::Result<()> {
    let parameters = parameters(&args)?;
    let seconds = |name: &str, value: f64| {
        Duration::try_from_secs_f64(value)
            .with_context(|| format!("--{name} {value} is not allowed: 0 or more"))
    };
    let over = seconds("minutes", args.minutes * 60.0)?;
    let thinking = seconds("thinking", args.thinking)?;
    let folder = tempfile::tempdir().context("making a temporary folder")?;
    let database = folder.path().join("demo.db");
    let serve = ServeArgs {
        studies: args.studies.clone(),
        ..ServeArgs::on_temporary_database(args.listen, database)
    };
    let server = Server::open(&serve, Population::Simulated).await?;
    let address = server.listener.local_addr()?;
    let study = server
        .state
        .catalogue
        .current(&StudyId::from(args.study.as_str()))
        .with_context(|| format!("--study {}: there is no such study", args.study))?
        .1;
    announce(address, &args)?;
    let crowd = Crowd {
        study,
        parameters,
        thinking,
        over,
        people: args.people,
        seed: args.seed,
    };
    let stop = server.state.stop.clone();
    let arrivals = tokio::spawn(async move {
        tokio::select! {
            () = stop.cancelled() => {}
            () = crowd.arrives(format!("http://{address}")) => {}
        }
    });
    server.run(asked_to_stop()?).await?;
    arrivals.abort();
    Ok(())
}

fn parameters(args: &DemoArgs) -> anyhow::Result<Parameters> {
    let given = [
        (Parameter::Alpha, args.alpha),
        (Parameter::Beta, args.beta),
        (Parameter::Gamma, args.gamma),
        (Parameter::Delta, args.delta),
        (Parameter::Lambda, args.lambda),
        (Parameter::Theta, args.theta),
    ];
    let start = Parameters::ONES;
    Ok(given
        .into_iter()
        .try_fold(start, |parameters, (name, value)| {
            parameters.with(name, value)
        })?)
}

struct Crowd {
    study: Arc<Study>,
    parameters: Parameters,
    thinking: Duration,
    over: Duration,
    people: u32,
    seed: u64,
}

impl Crowd {
    /// Lets people arrive at random moments and waits until the last one has finished.
    async fn arrives(self, server: String) {
        let mut rng = ChaCha20Rng::seed_from_u64(self.seed);
        let mut moments: Vec<f64> = (0..self.people).map(|_| rng.random()).collect();
        moments.sort_by(f64::total_cmp);
        let people = TaskTracker::new();
        let client = Client::new();
        let start = tokio::time::Instant::now();
        for moment in moments {
            tokio::time::sleep_until(start + self.over.mul_f64(moment)).await;
            let mut person = Person {
                study: self.study.clone(),
                parameters: self.parameters,
                thinking: self.thinking,
                rng: ChaCha20Rng::from_rng(&mut rng),
            };
            let (client, server) = (client.clone(), server.clone());
            people.spawn(async move {
                if let Err(error) = person.takes_part(&client, &server).await {
                    tracing::warn!(%error, "a simulated person did not finish");
                }
            });
        }
        people.close();
        people.wait().await;
        tracing::info!("all simulated people have finished");
    }
}

fn announce(address: SocketAddr, args: &DemoArgs) -> anyhow::Result<()> {
    let address = Reachable::at(address).here;
    let mut out = std::io::stdout().lock();
    let bold = if out.is_terminal() {
        ("\x1b[1m", "\x1b[0m")
    } else {
        ("", "")
    };
    writeln!(
        out,
        "{}Simulated people{} take the study {}; no answer here is a person's.",
        bold.0, bold.1, args.study
    )?;
    writeln!(
        out,
        "  results       http://{address}/results/{}",
        args.study
    )?;
    writeln!(out, "  take part     http://{address}/s/{}", args.study)?;
    writeln!(
        out,
        "  {} people arrive over {} minutes (seed {}); the database is temporary and goes with the program",
        args.people, args.minutes, args.seed
    )?;
    out.flush()?;
    Ok(())
}
