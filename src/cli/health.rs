//! `riskaware health`: asks a running server whether it is well, for containers.

use std::{net::SocketAddr, time::Duration};

use anyhow::{Context, ensure};
use clap::Args;

/// Which server to ask.
#[derive(Debug, Clone, Args)]
pub struct HealthArgs {
    /// The address that the server listens on
    #[arg(long, env = "RISKAWARE_LISTEN", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
}

/// Asks once.
///
/// # Errors
/// When nobody answers within two seconds, or not with success.
pub async fn run(args: HealthArgs) -> anyhow::Result<()> {
    let mut address = args.listen;
    if address.ip().is_unspecified() {
        // A server that listens everywhere listens here too.
        address.set_ip(if address.is_ipv4() {
            [127, 0, 0, 1].into()
        } else {
            std::net::Ipv6Addr::LOCALHOST.into()
        });
    }
    let client = reqwest::Client::builder()
        .timeout(Duration::from_secs(2))
        .build()?;
    let response = client
        .get(format!("http://{address}/healthz"))
        .send()
        .await
        .with_context(|| format!("no answer from {address}"))?;
    ensure!(
        response.status().is_success(),
        "the server at {address} answered with {}",
        response.status()
    );
    Ok(())
}
