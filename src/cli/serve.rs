//! `riskaware serve`: the server.

use std::{
    io::Write,
    net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket},
    path::PathBuf,
    sync::Arc,
};

use anyhow::{Context, ensure};
use clap::Args;
use tokio::{net::TcpListener, signal::unix::SignalKind};
use tokio_util::sync::CancellationToken;

use crate::{
    chance::Chance,
    clock::Clock,
    jobs::{self, Catalogue, Prepare, SourceFits, StudyFolder, Sweeps},
    store::{Options, Population, Store, StudyRow, StudyState, Token},
    study,
    web::{self, AppState, Limits, PublicUrl, Replays, Settings},
};

/// Settings of the server.
#[derive(Debug, Clone, Args)]
pub struct ServeArgs {
    /// Address and port to listen on, such as 127.0.0.1:8080 or 0.0.0.0:80
    #[arg(long, env = "RISKAWARE_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// The database file; it is made if it does not exist
    #[arg(long, env = "RISKAWARE_DATABASE", default_value = "riskaware.db")]
    pub database: PathBuf,
    /// A folder with study files (*.toml) to serve beside the built-in ones; the same id replaces a built-in study.
    /// It is looked at while the server runs: a changed file is served to whoever starts from then on
    #[arg(long, env = "RISKAWARE_STUDIES")]
    pub studies: Option<PathBuf>,
    /// Serve none of the built-in studies but those that somebody has begun in this database
    #[arg(long, env = "RISKAWARE_NO_BUILT_IN", value_parser = clap::builder::FalseyValueParser::new())]
    pub no_built_in: bool,
    /// Show results and API to everybody who can reach the server, not to this machine alone
    #[arg(long, env = "RISKAWARE_OPEN_RESULTS", value_parser = clap::builder::FalseyValueParser::new())]
    pub open_results: bool,
    /// The address under which others reach the server, such as https://study.example.org: links are printed with it,
    /// and with https cookies and browsers are bound to it
    #[arg(long, env = "RISKAWARE_PUBLIC_URL")]
    pub public_url: Option<PublicUrl>,
    /// The address of a proxy that is believed when it says in X-Forwarded-For whom a request is from; may be repeated
    #[arg(
        long = "trusted-proxy",
        value_name = "ADDRESS",
        env = "RISKAWARE_TRUSTED_PROXIES",
        value_delimiter = ','
    )]
    pub trusted_proxies: Vec<IpAddr>,
    /// How many people may start per minute from one address; a campus may share one
    #[arg(long, env = "RISKAWARE_STARTS_PER_MINUTE", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub starts_per_minute: u32,
}

impl ServeArgs {
    /// A server for simulated people, whose database goes with the program.
    pub(super) fn on_temporary_database(listen: SocketAddr, database: PathBuf) -> Self {
        Self {
            listen,
            database,
            studies: None,
            no_built_in: false,
            open_results: false,
            public_url: None,
            trusted_proxies: Vec::new(),
            starts_per_minute: 60,
        }
    }
}

/// Runs the server until the process is asked to stop.
///
/// # Errors
/// When the database, a study file or the address cannot be used; the message says which and why.
pub async fn run(args: ServeArgs) -> anyhow::Result<()> {
    let server = Server::open(&args, Population::People).await?;
    let address = server.listener.local_addr()?;
    let setup_link = setup_link(&server.state).await?;
    let served = &server.state.catalogue;
    let mut studies = server.state.store.studies().await?;
    studies.retain(|study| served.current(&study.id).is_some());
    announce(
        address,
        &args,
        &server.state.settings,
        &studies,
        setup_link.as_ref(),
    )?;
    server.run(asked_to_stop()?).await
}

/// A server that is bound and ready to run.
pub(super) struct Server {
    pub listener: TcpListener,
    pub state: AppState,
    /// The lab's study files, if it has some.
    folder: Option<StudyFolder>,
}

impl Server {
    pub(super) async fn open(args: &ServeArgs, population: Population) -> anyhow::Result<Self> {
        let listener = TcpListener::bind(args.listen).await.with_context(|| {
            format!(
                "listening on {}; choose another address with --listen",
                args.listen
            )
        })?;
        let store = Store::open(Options::at(&args.database), Clock::start())
            .await
            .with_context(|| format!("opening the database {}", args.database.display()))?;
        let mut folder = args.studies.as_deref().map(StudyFolder::new).map(|folder| {
            if args.no_built_in {
                folder.without_built_in()
            } else {
                folder
            }
        });
        let catalogue = match &mut folder {
            Some(folder) => folder
                .publish(&store)
                .await
                .context("reading the study files")?,
            None if args.no_built_in => Catalogue::publish_without_built_in(&store)
                .await
                .context("reading the studies")?,
            None => Catalogue::publish(&store, built_in())
                .await
                .context("reading the study files")?,
        };
        let replays = Replays::of(&catalogue);
        replays
            .compute()
            .map_err(|(id, error)| anyhow::Error::from(error).context(format!("replay {id}")))?;
        let stop = CancellationToken::new();
        let limits = Arc::new(Limits::new(store.clock(), args.starts_per_minute));
        let state = AppState {
            sweeps: Arc::new(Sweeps::new(stop.clone())),
            source_fits: Arc::new(SourceFits::new(stop.clone())),
            replays: Arc::new(replays),
            store,
            catalogue: Arc::new(catalogue),
            chance: Chance::from_system(),
            limits,
            settings: Arc::new(Settings {
                open_results: args.open_results,
                population,
                public_url: args.public_url.clone(),
                trusted_proxies: args.trusted_proxies.clone(),
            }),
            stop,
        };
        Ok(Self {
            listener,
            state,
            folder,
        })
    }

    /// Serves with the background work until `shutdown` completes, and ends in order.
    pub(super) async fn run(self, shutdown: impl Future<Output = ()>) -> anyhow::Result<()> {
        let Self {
            listener,
            state,
            folder,
        } = self;
        let (store, stop) = (state.store.clone(), state.stop.clone());
        let background = jobs::start(&store, &state.catalogue, state.settings.population, &stop);
        let watching = folder.map(|folder| {
            let replays = state.replays.clone();
            let prepare: Prepare = Arc::new(move |study| {
                replays
                    .add(study)
                    .map_err(|(id, error)| format!("replay {id}: {error}"))
            });
            let (catalogue, stop) = (state.catalogue.clone(), stop.clone());
            tokio::spawn(folder.watch(store.clone(), catalogue, prepare, stop))
        });
        let disk_failed = CancellationToken::new();
        let ends = async {
            tokio::select! {
                () = shutdown => {}
                () = store.failed() => disk_failed.cancel(),
            }
        };
        web::serve(listener, state, ends).await.context("serving")?;
        background.await;
        if let Some(watching) = watching {
            watching.await.context("watching the studies folder")?;
        }
        store.close().await;
        // A status other than 0 makes a supervisor start the program anew.
        ensure!(
            !disk_failed.is_cancelled(),
            "the disk failed while answers were written; none that was acknowledged is lost"
        );
        Ok(())
    }
}

fn built_in() -> Vec<(String, String)> {
    study::built_in()
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.to_owned()))
        .collect()
}

/// A new link with which the first account can be made; none once an account exists.
async fn setup_link(state: &AppState) -> anyhow::Result<Option<Token>> {
    let link = Token::random(&mut state.chance.fork());
    let is_open = state
        .store
        .renew_setup_link(&link)
        .await
        .context("making the setup link")?;
    Ok(is_open.then_some(link))
}

/// Says where everything is, on standard output: the log goes to standard error.
fn announce(
    address: SocketAddr,
    args: &ServeArgs,
    settings: &Settings,
    studies: &[StudyRow],
    setup_link: Option<&Token>,
) -> anyhow::Result<()> {
    let public_url = args.public_url.as_ref();
    let reachable = Reachable::at(address);
    let own_url = format!("http://{}", reachable.here);
    let url = public_url.map_or_else(|| own_url.clone(), ToString::to_string);
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "riskaware {} serves {own_url}",
        env!("CARGO_PKG_VERSION")
    )?;
    if let Some(elsewhere) = reachable.elsewhere {
        writeln!(
            out,
            "  listens on    all addresses of this machine{elsewhere}"
        )?;
    }
    writeln!(out, "  database      {}", args.database.display())?;
    if studies.is_empty() {
        writeln!(
            out,
            "  no study is served; --studies names a folder of study files"
        )?;
    }
    for study in studies {
        let state = match study.state {
            StudyState::Open => String::new(),
            state @ (StudyState::Draft | StudyState::Paused | StudyState::Closed) => {
                format!("  ({state})")
            }
        };
        writeln!(out, "  take part     {url}/s/{}{state}", study.id)?;
        writeln!(out, "  results       {url}/results/{}", study.id)?;
    }
    if let Some(link) = setup_link {
        writeln!(out, "  set up        {url}/setup/{link}")?;
    }
    writeln!(out, "  {}", settings.access(setup_link.is_none()))?;
    out.flush()?;
    Ok(())
}

/// Under which addresses a listener is reached.
pub(super) struct Reachable {
    /// From this machine.
    pub here: SocketAddr,
    /// Where it listens on all addresses: how to say what others use, as far as that is known.
    elsewhere: Option<String>,
}

impl Reachable {
    /// Nobody can open the address that stands for all of a machine.
    pub(super) fn at(address: SocketAddr) -> Self {
        if !address.ip().is_unspecified() {
            return Self {
                here: address,
                elsewhere: None,
            };
        }
        let (here, documentation): (IpAddr, IpAddr) = match address.ip() {
            IpAddr::V4(_) => (
                Ipv4Addr::LOCALHOST.into(),
                Ipv4Addr::new(192, 0, 2, 1).into(),
            ),
            IpAddr::V6(_) => (
                Ipv6Addr::LOCALHOST.into(),
                Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1).into(),
            ),
        };
        // Connecting a datagram socket sends nothing; it makes the system choose the address from which it would.
        let outward = UdpSocket::bind((address.ip(), 0)).and_then(|socket| {
            socket.connect((documentation, 9))?;
            socket.local_addr()
        });
        let elsewhere = outward.map_or_else(
            |_| String::new(),
            |outward| {
                format!(
                    "; others reach http://{}",
                    SocketAddr::new(outward.ip(), address.port())
                )
            },
        );
        Self {
            here: SocketAddr::new(here, address.port()),
            elsewhere: Some(elsewhere),
        }
    }
}

/// Completes at Ctrl-C or when a supervisor ends the program.
pub(super) fn asked_to_stop() -> anyhow::Result<impl Future<Output = ()>> {
    let mut terminate =
        tokio::signal::unix::signal(SignalKind::terminate()).context("listening for SIGTERM")?;
    Ok(async move {
        tokio::select! {
            _ = tokio::signal::ctrl_c() => {}
            _ = terminate.recv() => {}
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_stands_for_all_is_not_the_one_to_open() {
        for (listen, here) in [
            ("0.0.0.0:8080", "127.0.0.1:8080"),
            ("[::]:81", "[::1]:81"),
            ("192.0.2.7:80", "192.0.2.7:80"),
        ] {
            let reachable = Reachable::at(listen.parse().unwrap());
            assert_eq!(reachable.here, here.parse().unwrap());
            assert_eq!(
                reachable.elsewhere.is_some(),
                !listen.starts_with("192"),
                "{listen}"
            );
        }
    }
}
