//! Where a request comes from.

use std::net::{IpAddr, Ipv6Addr, SocketAddr};

use axum::{extract::Request, http::HeaderMap};

/// The other end of the connection: an extension that the accept loop puts on each request.
#[derive(Debug, Clone, Copy)]
pub(in crate::web) struct PeerAddress(pub SocketAddr);

/// Where a request comes from, as far as it can be believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::web) struct ClientAddress(pub IpAddr);

impl ClientAddress {
    /// Whoever sits at this machine. A proxy here that was not named stands for everybody.
    pub(super) fn is_this_machine(self) -> bool {
        self.0.is_loopback()
    }

    /// What limits count by: one IPv6 network of a household or a campus, not each of its endless addresses.
    pub(super) fn counted_as(self) -> IpAddr {
        match self.0 {
            IpAddr::V4(_) => self.0,
            IpAddr::V6(address) => match address.to_ipv4_mapped() {
                Some(address) => IpAddr::V4(address),
                None => IpAddr::V6(Ipv6Addr::from_bits(
                    address.to_bits() & !u128::from(u64::MAX),
                )),
            },
        }
    }
}

/// The address of the peer, or the last one that a trusted proxy says it had the request from.
pub(super) fn client(request: &Request, trusted: &[IpAddr]) -> ClientAddress {
    // Tests without a connection have no peer: an address that nobody has.
    let peer = request
        .extensions()
        .get::<PeerAddress>()
        .map_or(IpAddr::V6(Ipv6Addr::UNSPECIFIED), |peer| peer.0.ip());
    ClientAddress(behind_proxies(peer, request.headers(), trusted))
}

fn behind_proxies(peer: IpAddr, headers: &HeaderMap, trusted: &[IpAddr]) -> IpAddr {
    let mut address = peer.to_canonical();
    let listed = headers
        .get_all("x-forwarded-for")
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','));
    let listed: Vec<&str> = listed.map(str::trim).collect();
    // From the nearest on: each entry is believed only if a trusted proxy wrote it.
    for entry in listed.into_iter().rev() {
        if !trusted.contains(&address) {
            break;
        }
        let Ok(next) = entry.parse::<IpAddr>() else {
            break;
        };
        address = next.to_canonical();
    }
    address
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(peer: &str, forwarded: &str, trusted: &[&str], expected: &str) {
        let mut headers = HeaderMap::new();
        headers.insert("x-forwarded-for", forwarded.parse().unwrap());
        let trusted: Vec<IpAddr> = trusted
            .iter()
            .map(|address| address.parse().unwrap())
            .collect();
        let found = behind_proxies(peer.parse().unwrap(), &headers, &trusted);
        assert_eq!(found, expected.parse::<IpAddr>().unwrap());
    }

    #[test]
    fn only_trusted_proxies_are_believed() {
        check("198.51.100.7", "192.0.2.1", &[], "198.51.100.7");
        check("10.0.0.1", "192.0.2.1", &["10.0.0.1"], "192.0.2.1");
        // What the visitor wrote into the header itself stands to the left.
        check(
            "10.0.0.1",
            "127.0.0.1, 192.0.2.1",
            &["10.0.0.1"],
            "192.0.2.1",
        );
        check(
            "10.0.0.1",
            "192.0.2.1, 10.0.0.2",
            &["10.0.0.1", "10.0.0.2"],
            "192.0.2.1",
        );
        check("10.0.0.1", "nonsense", &["10.0.0.1"], "10.0.0.1");
        check("::ffff:10.0.0.1", "192.0.2.1", &["10.0.0.1"], "192.0.2.1");
    }

    #[test]
    fn an_ipv6_network_counts_as_one() {
        let one = ClientAddress("2001:db8:1:2::1".parse().unwrap());
        let two = ClientAddress("2001:db8:1:2:ffff::9".parse().unwrap());
        let other = ClientAddress("2001:db8:1:3::1".parse().unwrap());
        assert_eq!(one.counted_as(), two.counted_as());
        assert_ne!(one.counted_as(), other.counted_as());
    }
}
