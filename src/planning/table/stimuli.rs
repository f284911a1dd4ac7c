//! The ten replays of the built-in cup study: that they differ, and that no update changes them unseen.

use std::collections::HashSet;

use data_encoding::HEXLOWER;
use sha2::{Digest, Sha256};

use super::*;

/// Tower, outcome and seed, and the SHA-256 of the tracks as JSON.
const FRAMES: [(Tower, Outcome, u64, &str); 10] = [
    (
        Tower::Stable,
        Outcome::Stands,
        1,
        "c32fbf4421ef956304820c96d06b082e233063b6908a4c3976b115f042b95f0a",
    ),
    (
        Tower::Stable,
        Outcome::Stands,
        2,
        "0ae7ccd1fc21f62e8cf0d4d967e9252b6cd67c7871f1ba541bbad0294fd8b582",
    ),
    (
        Tower::Stable,
        Outcome::Stands,
        3,
        "1844e8004f0700076a68f5999e89992d6d2c0fab7b6fa0f08de4349032b7609c",
    ),
    (
        Tower::Stable,
        Outcome::Stands,
        4,
        "8125884b55f5ceb274d934bcc7057fe9f79196c778a4a8e4b286e967c16849fe",
    ),
    (
        Tower::Stable,
        Outcome::Stands,
        5,
        "5fc34e9c5e9dc117d11208cc36efa8201ea412a6c685fcd871e68b6ec9ec2c66",
    ),
    (
        Tower::Unstable,
        Outcome::Stands,
        6,
        "2dc6b22b833b232912c2f7b83b6747cf51735896b68d4ca1a2e0c5e565a339a4",
    ),
    (
        Tower::Unstable,
        Outcome::Falls,
        7,
        "a1345a376981e0854891a061b14f5bac010b74d6458c655ee2ce5ee0bbc44272",
    ),
    (
        Tower::Unstable,
        Outcome::Falls,
        8,
        "29ad984fa50cae29434a6db730ae6d0c49c6b15bf48fec36472d787d944ee6b1",
    ),
    (
        Tower::Unstable,
        Outcome::Falls,
        9,
        "29298012986cf6a4e3aeff17293766bb89a6e8b77c7402f4e42a2faa530dfb29",
    ),
    (
        Tower::Unstable,
        Outcome::Falls,
        10,
        "db9936d29c760dbe1ffd944cfe4309b5b81fcc1d0dacecf340948a564a166c59",
    ),
];

fn stimuli() -> [Replay; 10] {
    FRAMES.map(|(tower, outcome, seed, _)| Replay {
        tower,
        outcome,
        seed,
    })
}

#[test]
fn the_ten_are_those_of_the_study() {
    let file = include_str!("../../../studies/cups.toml");
    let study: toml::Value = toml::from_str(file).unwrap();
    let blocks = study["block"].as_array().unwrap();
    let lists = blocks.iter().filter_map(|block| block.get("replay"));
    let replays: Vec<Replay> = lists
        .flat_map(|list| list.as_array().unwrap())
        .map(|replay| replay.clone().try_into().unwrap())
        .collect();
    assert_eq!(replays, stimuli());
}

#[test]
fn the_frames_are_those_that_people_saw() {
    let found = stimuli().map(|replay| {
        let tracks = replay.timeline().unwrap().tracks();
        let json = serde_json::to_vec(&tracks).unwrap();
        HEXLOWER.encode(&Sha256::digest(json))
    });
    let wanted = FRAMES.map(|(.., sum)| sum);
    assert!(
        found == wanted,
        "replays show other frames than before, so that people who answered before and after saw different things. If \
         an update of rapier2d or rand did that, keep the version that was. If it is meant, raise the version in \
         Cargo.toml, tell it in CHANGELOG.md, look at all ten replays, and take these sums over: {found:#?}"
    );
}

#[test]
fn the_cups_come_in_another_way_in_each_of_the_ten() {
    let mut seen = HashSet::new();
    for replay in stimuli() {
        let timeline = replay.timeline().unwrap();
        let placed: Vec<_> = timeline
            .events
            .iter()
            .filter_map(|event| match event.event {
                Event::Placed { by, cup, slot } => Some((by, cup, slot)),
                Event::ReachesFor { .. }
                | Event::Grasps { .. }
                | Event::PutBack { .. }
                | Event::TowerStands
                | Event::TowerFalls
                | Event::AtRest => None,
            })
            .collect();
        assert!(seen.insert(placed), "{replay:?} builds like another one");
        assert!(seen.iter().all(|placed| placed.len() == CUPS));
    }
}

/// More than 5 cm beside the middle, to the left and to the right.
fn beside(cups: [Pose; CUPS]) -> (usize, usize) {
    let count = |is_there: fn(f64) -> bool| {
        let there = cups.iter().filter(|cup| is_there(cup.position.x));
        there.count()
    };
    (count(|x| x < -0.05), count(|x| x > 0.05))
}

#[test]
fn the_four_collapses_differ_in_kind() {
    let falls = stimuli().into_iter();
    let falls: Vec<Timeline> = falls
        .filter(|replay| replay.outcome == Outcome::Falls)
        .map(|replay| replay.timeline().unwrap())
        .collect();
    assert_eq!(falls.len(), 4);
    let ends = falls.iter().map(|timeline| {
        let last = timeline.frames[timeline.frames.len() - 1];
        beside(last.cups)
    });
    let ends: HashSet<(usize, usize)> = ends.collect();
    assert_eq!(ends.len(), 4, "cups to the left and right: {ends:?}");
    assert!(ends.iter().any(|(left, right)| left > right), "{ends:?}");
    assert!(ends.iter().any(|(left, right)| left < right), "{ends:?}");
}
