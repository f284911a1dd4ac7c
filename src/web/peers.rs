//! How many connections one address may hold, so that nobody holds all of them.

use std::{
    collections::{HashMap, hash_map::Entry},
    net::IpAddr,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::access::ClientAddress;

/// Connections of one address: a campus has fewer open at a time, since idle ones end soon.
const MAX_OF_ONE: usize = 512;

/// The open connections by address.
#[derive(Debug, Clone)]
pub(super) struct Peers {
    open: Arc<Mutex<HashMap<IpAddr, usize>>>,
    /// They stand for many, and are not counted; nor is this machine, where a proxy may run that was not named.
    trusted: Arc<[IpAddr]>,
}

/// A connection that is open until this is dropped.
#[derive(Debug)]
pub(super) struct Counted {
    peers: Peers,
    address: Option<IpAddr>,
}

impl Peers {
    pub(super) fn new(trusted: Vec<IpAddr>) -> Self {
        Self {
            open: Arc::default(),
            trusted: trusted.into(),
        }
    }

    /// Counts a connection, if its address may have one more.
    pub(super) fn count(&self, peer: IpAddr) -> Option<Counted> {
        let peer = peer.to_canonical();
        let stands_for_many = peer.is_loopback() || self.trusted.contains(&peer);
        let address = (!stands_for_many).then(|| ClientAddress::of_peer(peer).counted_as());
        if let Some(address) = address {
            let mut open = self.open();
            let open = open.entry(address).or_default();
            if *open >= MAX_OF_ONE {
                return None;
            }
            *open += 1;
        }
        Some(Counted {
            peers: self.clone(),
            address,
        })
    }

    fn open(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
        // Nothing can be left half done under this lock.
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        if let Some(address) = self.address
            && let Entry::Occupied(mut open) = self.peers.open().entry(address)
        {
            *open.get_mut() -= 1;
            if *open.get() == 0 {
                open.remove();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_address_holds_no_more_than_its_share() {
        let proxy = "10.0.0.1".parse().unwrap();
        let peers = Peers::new(vec![proxy]);
        let address = |last: u16| format!("2001:db8::{last:x}").parse().unwrap();
        let mut held: Vec<_> = (0..MAX_OF_ONE as u16)
            .map(|last| peers.count(address(last)).unwrap())
            .collect();
        // Another address of the same network is no other one.
        assert!(peers.count(address(0xffff)).is_none());
        assert!(peers.count("2001:db8:0:1::1".parse().unwrap()).is_some());
        held.pop();
        held.push(peers.count(address(0xffff)).unwrap());
        assert!(peers.count(address(1)).is_none());
        for many in [
            proxy,
            "::ffff:10.0.0.1".parse().unwrap(),
            "127.0.0.1".parse().unwrap(),
        ] {
            let counted: Vec<_> = (0..=MAX_OF_ONE).map(|_| peers.count(many)).collect();
            assert!(counted.iter().all(Option::is_some), "{many}");
        }
        drop(held);
        assert!(peers.open().is_empty());
    }
}
