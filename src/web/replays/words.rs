//! What happens in a replay, in words: captions while it plays, and a text of the whole.

use serde::Serialize;

use crate::planning::table::{By, CUPS, CupId, Event, Timeline, Tower, TowerState};

/// A line under the picture, which stands until the next one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Caption {
    pub(super) at_ms: u32,
    text: String,
}

/// The captions, in the order of their times. The first one stands from the start.
pub(super) fn captions(timeline: &Timeline) -> Vec<Caption> {
    let begin = format!(
        "Five cups on the table. Person and arm will build the {} tower.",
        timeline.replay.tower.as_str()
    );
    let mut captions = vec![Caption {
        at_ms: 0,
        text: begin,
    }];
    let mut placed = 0;
    for happened in &timeline.events {
        let text = match happened.event {
            // Setting down is followed at once by reaching for the next cup; the person's reaching is what tells
            // which tower it will be, and only the first one is worth a line.
            Event::ReachesFor { by: By::Hand, cup } if placed == 0 => {
                format!("The person reaches for {}.", cup_in_words(cup))
            }
            Event::ReachesFor { .. }
            | Event::Grasps { .. }
            | Event::PutBack { .. }
            | Event::AtRest => continue,
            Event::Placed { by, cup, .. } => {
                placed += 1;
                format!(
                    "{} puts down {}: {placed} of {CUPS}.",
                    capitalised(who(by)),
                    cup_in_words(cup)
                )
            }
            Event::TowerStands => "The tower stands.".to_owned(),
            Event::TowerFalls => "The tower falls.".to_owned(),
        };
        match captions.last_mut() {
            // The last cup and the tower that stands: the second line would hide the first.
            Some(last) if last.at_ms == happened.at_ms => {
                last.text = format!("{} {text}", last.text)
            }
            Some(_) | None => captions.push(Caption {
                at_ms: happened.at_ms,
                text,
            }),
        }
    }
    captions
}

/// The moments that tell the story without motion: a cup in its place, the tower before and in its fall, the end.
pub(super) fn stills(timeline: &Timeline) -> Vec<u32> {
    let end = timeline.duration_ms();
    let mut moments = vec![0];
    for happened in &timeline.events {
        match happened.event {
            Event::Grasps { .. } | Event::Placed { .. } | Event::TowerStands => {
                moments.push(happened.at_ms);
            }
            Event::TowerFalls => moments.extend([
                happened.at_ms,
                (happened.at_ms + FALLING_MS).min(end),
                (happened.at_ms + 2 * FALLING_MS).min(end),
            ]),
            Event::ReachesFor { .. } | Event::PutBack { .. } | Event::AtRest => {}
        }
    }
    moments.sort_unstable();
    // Hand and arm are often done at nearly the same time.
    moments.dedup_by(|next, kept| *next < *kept + LEAST_STILL_MS);
    moments.retain(|moment| moment + LEAST_STILL_MS <= end);
    moments.push(end);
    moments
}

/// A still stands at least so long, in milliseconds.
const LEAST_STILL_MS: u32 = 200;

/// Time between the stills of a fall, in milliseconds.
const FALLING_MS: u32 = 300;

/// The whole replay as a text, for whoever does not see it.
pub(super) fn description(timeline: &Timeline) -> String {
    let mut placed = timeline
        .events
        .iter()
        .filter_map(|happened| match happened.event {
            Event::Placed { by, cup, .. } => Some((by, cup)),
            Event::ReachesFor { .. }
            | Event::Grasps { .. }
            | Event::PutBack { .. }
            | Event::TowerStands
            | Event::TowerFalls
            | Event::AtRest => None,
        });
    let tower = match timeline.replay.tower {
        Tower::Stable => "the stable tower, three cups below and two on top",
        Tower::Unstable => "the unstable tower, a column of five cups",
    };
    let first = placed.next().map_or_else(String::new, |(by, cup)| {
        format!(" First {} puts down {}.", who(by), cup_in_words(cup))
    });
    let then: Vec<String> = placed
        .map(|(by, cup)| {
            if cup == CupId::ORANGE {
                format!("{} (the orange cup)", who(by))
            } else {
                who(by).to_owned()
            }
        })
        .collect();
    let end = match timeline.tower {
        TowerState::Standing => "All five cups are in place, and the tower stands.".to_owned(),
        TowerState::Fallen { in_slots } => {
            let left = match in_slots {
                0 => "no cup stays in its place".to_owned(),
                1 => "one cup stays in its place".to_owned(),
                some => format!("{some} cups stay in their places"),
            };
            format!("All five cups are in place, then the tower falls; {left}.")
        }
    };
    format!(
        "Person and robot arm build {tower}.{first} Then come, one cup each: {}. {end}",
        then.join(", ")
    )
}

fn who(by: By) -> &'static str {
    match by {
        By::Hand => "the person",
        By::Gripper => "the arm",
    }
}

fn cup_in_words(cup: CupId) -> &'static str {
    if cup == CupId::ORANGE {
        "the orange cup"
    } else {
        "a cup"
    }
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::table::{Outcome, Replay};

    fn timeline(tower: Tower, outcome: Outcome) -> Timeline {
        let replay = Replay {
            tower,
            outcome,
            seed: 3,
        };
        replay.timeline().unwrap()
    }

    #[test]
    fn captions_count_the_cups_and_tell_the_end() {
        for (tower, outcome, end) in [
            (Tower::Stable, Outcome::Stands, "The tower stands."),
            (Tower::Unstable, Outcome::Falls, "The tower falls."),
        ] {
            let timeline = timeline(tower, outcome);
            let captions = captions(&timeline);
            assert_eq!(captions[0].at_ms, 0);
            assert!(captions.is_sorted_by(|one, next| one.at_ms < next.at_ms));
            for n in 1..=5 {
                let count = format!(": {n} of 5.");
                assert!(captions.iter().any(|caption| caption.text.contains(&count)));
            }
            assert!(captions.last().unwrap().text.ends_with(end));
        }
    }

    #[test]
    fn the_first_cup_tells_the_tower() {
        let stable = captions(&timeline(Tower::Stable, Outcome::Stands));
        assert_eq!(stable[1].text, "The person reaches for the orange cup.");
        let unstable = captions(&timeline(Tower::Unstable, Outcome::Stands));
        assert_eq!(unstable[1].text, "The person reaches for a cup.");
    }

    #[test]
    fn stills_begin_and_end_with_the_replay_and_show_the_fall() {
        let falls = timeline(Tower::Unstable, Outcome::Falls);
        let stills = stills(&falls);
        assert_eq!(stills.first(), Some(&0));
        assert_eq!(stills.last(), Some(&falls.duration_ms()));
        assert!(stills.is_sorted_by(|one, next| one + LEAST_STILL_MS <= *next));
        let event = |event| falls.events.iter().find(|found| found.event == event);
        let begin = event(Event::TowerFalls).unwrap().at_ms;
        assert!(stills.iter().filter(|at| **at > begin).count() >= 3);
    }

    #[test]
    fn the_text_tells_the_outcome_and_who_did_what() {
        let stands = description(&timeline(Tower::Stable, Outcome::Stands));
        assert!(
            stands.contains("First the person puts down the orange cup."),
            "{stands}"
        );
        assert!(stands.ends_with("and the tower stands."), "{stands}");
        assert!(!stands.contains("falls"), "{stands}");
        let falls = description(&timeline(Tower::Unstable, Outcome::Falls));
        assert!(falls.contains("then the tower falls;"), "{falls}");
        assert_eq!(falls.matches("(the orange cup)").count(), 1, "{falls}");
    }
}
