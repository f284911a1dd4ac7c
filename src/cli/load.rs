//! `riskaware load`: how many page turns the server bears while it refits, as whole participants see it.

use std::{
    fs::File,
    io::Write,
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

use anyhow::Context;
use clap::Args;
use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;
use reqwest::Client;
use tokio::{sync::oneshot, task::JoinSet};

use super::{
    serve::{ServeArgs, Server},
    simulation::Person,
};
use crate::{
    model::{Parameter, Parameters},
    store::Population,
    study::{Study, StudyId},
};

/// For how long the disk alone is measured.
const FSYNC_TIME: Duration = Duration::from_secs(1);

/// Settings of the load.
#[derive(Debug, Clone, Args)]
pub struct LoadArgs {
    /// Which study they take
    #[arg(long, default_value = "driving")]
    study: String,
    /// How many people answer at the same time
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=4_000))]
    people: u32,
    /// How often each of them takes the study
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rounds: u32,
    /// The folder for the temporary database: what is measured is the disk below it
    #[arg(long)]
    folder: Option<PathBuf>,
    /// Seed of the people's choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Plays the participants against a server of its own, on a temporary database, and prints what it took.
///
/// # Errors
/// When the server cannot start, or a participant meets an answer that a person should not meet.
pub async fn run(args: LoadArgs) -> anyhow::Result<()> {
    let folder = match &args.folder {
        Some(folder) => tempfile::tempdir_in(folder)
            .with_context(|| format!("--folder {}", folder.display()))?,
        None => tempfile::tempdir().context("making a temporary folder")?,
    };
    let fsyncs = fsyncs_per_second(folder.path()).context("measuring the disk")?;
    let serve =
        ServeArgs::on_temporary_database(([127, 0, 0, 1], 0).into(), folder.path().join("load.db"));
    let server = Server::open(&serve, Population::Simulated).await?;
    let url = format!("http://{}", server.listener.local_addr()?);
    let id = StudyId::from(args.study.as_str());
    let (_, study) = server
        .state
        .catalogue
        .current(&id)
        .with_context(|| format!("--study {id}: no such study"))?;
    let (stop, stopped) = oneshot::channel::<()>();
    let server = tokio::spawn(server.run(async move { drop(stopped.await) }));

    let start = Instant::now();
    let turns = play(&args, &url, &study).await?;
    let took = start.elapsed();
    drop(stop);
    server.await??;
    report(&args, turns, took, fsyncs)
}

/// Lets everybody take the study; returns how long each page turn took.
async fn play(args: &LoadArgs, url: &str, study: &Arc<Study>) -> anyhow::Result<Vec<Duration>> {
    let mut rng = ChaCha20Rng::seed_from_u64(args.seed);
    let parameters = Parameters::ONES.with(Parameter::Theta, 0.01)?;
    let mut people = JoinSet::new();
    for _ in 0..args.people {
        let mut person = Person {
            study: study.clone(),
            parameters,
            thinking: Duration::ZERO,
            rng: ChaCha20Rng::from_rng(&mut rng),
        };
        let (url, rounds) = (url.to_owned(), args.rounds);
        people.spawn(async move {
            // A connection of one's own, as a browser has.
            let client = Client::new();
            let mut turns = Vec::new();
            for _ in 0..rounds {
                turns.extend(person.takes_part(&client, &url).await?);
            }
            anyhow::Ok(turns)
        });
    }
    let mut turns = Vec::new();
    while let Some(person) = people.join_next().await {
        turns.extend(person??);
    }
    Ok(turns)
}

/// How many 4 KiB writes the disk can make durable one after the other, in a second.
fn fsyncs_per_second(folder: &Path) -> std::io::Result<f64> {
    let mut file = File::create(folder.join("fsync"))?;
    let start = Instant::now();
    let mut count = 0;
    while start.elapsed() < FSYNC_TIME {
        file.write_all(&[0; 4096])?;
        file.sync_data()?;
        count += 1;
    }
    Ok(f64::from(count) / start.elapsed().as_secs_f64())
}

fn report(
    args: &LoadArgs,
    mut turns: Vec<Duration>,
    took: Duration,
    fsyncs: f64,
) -> anyhow::Result<()> {
    turns.sort_unstable();
    let quantile = |share: f64| {
        let at = ((turns.len() - 1) as f64 * share).round() as usize;
        turns[at].as_secs_f64() * 1000.0
    };
    let seconds = took.as_secs_f64();
    let runs = f64::from(args.people) * f64::from(args.rounds);
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "{} people at the same time, {} times each, refits running",
        args.people, args.rounds
    )?;
    writeln!(
        out,
        "page turns     {} in {seconds:.1} s: {:.0} per second",
        turns.len(),
        turns.len() as f64 / seconds
    )?;
    writeln!(out, "whole runs     {:.1} per second", runs / seconds)?;
    writeln!(
        out,
        "a page turn    p50 {:.1} ms, p95 {:.1} ms, p99 {:.1} ms, longest {:.1} ms",
        quantile(0.5),
        quantile(0.95),
        quantile(0.99),
        quantile(1.0)
    )?;
    writeln!(
        out,
        "the disk alone {fsyncs:.0} fsyncs per second (4 KiB each, just before)"
    )?;
    Ok(())
}
