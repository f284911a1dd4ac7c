//! Where a request comes from.

use std::net::{IpAddr, Ipv6Addr, SocketAddr};

use axum::{extract::Request, http::HeaderMap};

/// The other end of the connection: an extension that the accept loop puts on each request.
#[derive(Debug, Clone, Copy)]
pub(in crate::web) struct PeerAddress(pub SocketAddr);

/// Where a request comes from, as far as it can be believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::web) struct ClientAddress {
    address: IpAddr,
    /// Whether a trusted proxy passed it on: then it is from somebody else, whatever the address.
    is_forwarded: bool,
}

impl ClientAddress {
    /// Whoever is at the other end of a connection.
    pub(in crate::web) fn of_peer(address: IpAddr) -> Self {
        Self {
            address,
            is_forwarded: false,
        }
    }

    #[cfg(test)]
    pub(super) fn at(address: &str) -> Self {
        Self::of_peer(address.parse().expect("an address"))
    }

    /// Whoever sits at this machine. A proxy here that was not named stands for everybody.
    pub(super) fn is_this_machine(self) -> bool {
        self.address.is_loopback() && !self.is_forwarded
    }

    /// What limits count by: one IPv6 network of a household or a campus, not each of its endless addresses.
    pub(in crate::web) fn counted_as(self) -> IpAddr {
        match self.address {
            IpAddr::V4(_) => self.address,
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
    behind_proxies(peer, request.headers(), trusted)
}

fn behind_proxies(peer: IpAddr, headers: &HeaderMap, trusted: &[IpAddr]) -> ClientAddress {
    let mut address = peer.to_canonical();
    // Bytes, not text: an odd one to the left is the visitor's own, and must not hide what proxies wrote to the right.
    let listed: Vec<&[u8]> = headers
        .get_all("x-forwarded-for")
        .iter()
        .flat_map(|value| value.as_bytes().split(|byte| *byte == b','))
        .collect();
    let is_forwarded = !listed.is_empty() && trusted.contains(&address);
    // From the nearest on: each entry is believed only if a trusted proxy wrote it.
    for entry in listed.into_iter().rev() {
        if !trusted.contains(&address) {
            break;
        }
        let Some(next) = entry_address(entry) else {
            break;
        };
        address = next.to_canonical();
    }
    ClientAddress {
        address,
        is_forwarded,
    }
}

/// An entry's address: some proxies add the port, and put an IPv6 address in brackets.
fn entry_address(entry: &[u8]) -> Option<IpAddr> {
    let text = std::str::from_utf8(entry).ok()?.trim();
    let bare = text
        .strip_prefix('[')
        .and_then(|rest| rest.strip_suffix(']'))
        .unwrap_or(text);
    let with_port = || text.parse::<SocketAddr>().ok().map(|socket| socket.ip());
    bare.parse().ok().or_else(with_port)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn found(peer: &str, forwarded: &[&[u8]], trusted: &[&str]) -> ClientAddress {
        let mut headers = HeaderMap::new();
        for line in forwarded {
            headers.append("x-forwarded-for", HeaderValue::from_bytes(line).unwrap());
        }
        let trusted: Vec<IpAddr> = trusted
            .iter()
            .map(|address| address.parse().unwrap())
            .collect();
        behind_proxies(peer.parse().unwrap(), &headers, &trusted)
    }

    #[track_caller]
    fn check(peer: &str, forwarded: &[u8], trusted: &[&str], expected: &str) {
        let found = found(peer, &[forwarded], trusted);
        assert_eq!(found.address, expected.parse::<IpAddr>().unwrap());
    }

    #[test]
    fn only_trusted_proxies_are_believed() {
        let proxy = ["10.0.0.1"].as_slice();
        check("198.51.100.7", b"192.0.2.1", &[], "198.51.100.7");
        check("10.0.0.1", b"192.0.2.1", proxy, "192.0.2.1");
        // What the visitor wrote into the header itself stands to the left.
        check("10.0.0.1", b"127.0.0.1, 192.0.2.1", proxy, "192.0.2.1");
        check(
            "10.0.0.1",
            b"192.0.2.1, 10.0.0.2",
            &["10.0.0.1", "10.0.0.2"],
            "192.0.2.1",
        );
        check("10.0.0.1", b"nonsense", proxy, "10.0.0.1");
        check("::ffff:10.0.0.1", b"192.0.2.1", proxy, "192.0.2.1");
    }

    #[test]
    fn what_a_visitor_writes_hides_nothing_that_a_proxy_wrote() {
        let proxy = ["10.0.0.1"].as_slice();
        check("10.0.0.1", b"\xff, 192.0.2.1", proxy, "192.0.2.1");
        let lines: &[&[u8]] = &[b"\xe9", b"192.0.2.1"];
        let two = found("10.0.0.1", lines, proxy);
        assert_eq!(two.address, "192.0.2.1".parse::<IpAddr>().unwrap());
        for (entry, address) in [
            (b"x, 192.0.2.1:54321".as_slice(), "192.0.2.1"),
            (b"[2001:db8::1]:443", "2001:db8::1"),
            (b"[2001:db8::1]", "2001:db8::1"),
        ] {
            check("10.0.0.1", entry, proxy, address);
        }
    }

    #[test]
    fn whoever_was_passed_on_by_a_trusted_proxy_is_not_at_this_machine() {
        let proxy = ["127.0.0.1"].as_slice();
        for entry in [b"unknown".as_slice(), b"\xff", b"", b"127.0.0.1", b"::1"] {
            let client = found("127.0.0.1", &[entry], proxy);
            assert!(!client.is_this_machine(), "{entry:?}");
        }
        // Nothing that says so was passed on.
        assert!(found("127.0.0.1", &[], proxy).is_this_machine());
        assert!(found("127.0.0.1", &[b"192.0.2.1"], &[]).is_this_machine());
    }

    #[test]
    fn an_ipv6_network_counts_as_one() {
        let at = |address| found(address, &[], &[]).counted_as();
        let one = at("2001:db8:1:2::1");
        assert_eq!(one, at("2001:db8:1:2:ffff::9"));
        assert_ne!(one, at("2001:db8:1:3::1"));
    }
}
