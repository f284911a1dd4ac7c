//! What happens in a replay, in words: captions while it plays, and a text of the whole.

use serde::Serialize;

use crate::{
    planning::table::{By, CUPS, CupId, Event, Timeline, Tower, TowerState},
    study::Words,
};

/// A line under the picture, which stands until the next one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Caption {
    pub(super) at_ms: u32,
    text: String,
}

/// The captions, in the order of their times. The first one stands from the start.
pub(super) fn captions(timeline: &Timeline, words: &Words) -> Vec<Caption> {
    let begin = match timeline.replay.tower {
        Tower::Stable => &words.replay_begin_stable,
        Tower::Unstable => &words.replay_begin_unstable,
    };
    let mut captions = vec![Caption {
        at_ms: 0,
        text: begin.clone(),
    }];
    let mut placed = 0;
    for happened in &timeline.events {
        let text = match happened.event {
            // Setting down is followed at once by reaching for the next cup; the person's reaching is what tells
            // which tower it will be, and only the first one is worth a line.
            Event::ReachesFor { by: By::Hand, cup } if placed == 0 => {
                if cup == CupId::ORANGE {
                    words.replay_reaches_orange.clone()
                } else {
                    words.replay_reaches_cup.clone()
                }
            }
            Event::ReachesFor { .. }
            | Event::Grasps { .. }
            | Event::PutBack { .. }
            | Event::AtRest => continue,
            Event::Placed { by, cup, .. } => {
                placed += 1;
                capitalised(&words.replay_puts(who(by, words), what(cup, words), placed, CUPS))
            }
            Event::TowerStands => words.replay_stands.clone(),
            Event::TowerFalls => words.replay_falls.clone(),
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
pub(super) fn description(timeline: &Timeline, words: &Words) -> String {
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
        Tower::Stable => &words.replay_builds_stable,
        Tower::Unstable => &words.replay_builds_unstable,
    };
    let first = placed
        .next()
        .map(|(by, cup)| words.replay_first(who(by, words), what(cup, words)));
    let then: Vec<String> = placed
        .map(|(by, cup)| {
            if cup == CupId::ORANGE {
                words.replay_with_orange(who(by, words))
            } else {
                who(by, words).to_owned()
            }
        })
        .collect();
    let end = match timeline.tower {
        TowerState::Standing => words.replay_end_stands.clone(),
        TowerState::Fallen { in_slots } => words.replay_end_fallen(in_slots),
    };
    let sentences = [
        Some(tower.clone()),
        first,
        Some(words.replay_then(&then.join(", "))),
        Some(end),
    ];
    let sentences: Vec<String> = sentences.into_iter().flatten().collect();
    sentences.join(" ")
}

fn who(by: By, words: &Words) -> &str {
    match by {
        By::Hand => &words.replay_person,
        By::Gripper => &words.replay_arm,
    }
}

fn what(cup: CupId, words: &Words) -> &str {
    if cup == CupId::ORANGE {
        &words.replay_orange
    } else {
        &words.replay_cup
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
            let captions = captions(&timeline, &Words::english());
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
        let stable = captions(&timeline(Tower::Stable, Outcome::Stands), &Words::english());
        assert_eq!(stable[1].text, "The person reaches for the orange cup.");
        let unstable = captions(
            &timeline(Tower::Unstable, Outcome::Stands),
            &Words::english(),
        );
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
        let stands = description(&timeline(Tower::Stable, Outcome::Stands), &Words::english());
        assert!(
            stands.contains("First the person puts down the orange cup."),
            "{stands}"
        );
        assert!(stands.ends_with("and the tower stands."), "{stands}");
        assert!(!stands.contains("falls"), "{stands}");
        let falls = description(
            &timeline(Tower::Unstable, Outcome::Falls),
            &Words::english(),
        );
        assert!(falls.contains("then the tower falls;"), "{falls}");
        assert_eq!(falls.matches("(the orange cup)").count(), 1, "{falls}");
    }

    #[test]
    fn german_words_tell_the_same() {
        let german = Words::of_languages(["de"]);
        let stable = timeline(Tower::Stable, Outcome::Stands);
        let english = captions(&stable, &Words::english());
        let told = captions(&stable, &german);
        let times = |captions: &[Caption]| -> Vec<u32> {
            captions.iter().map(|caption| caption.at_ms).collect()
        };
        assert_eq!(times(&told), times(&english));
        assert_eq!(
            told[1].text,
            "Der Mensch greift nach dem orangefarbenen Becher."
        );
        let text = description(&stable, &german);
        let first = "Zuerst stellt der Mensch den orangefarbenen Becher ab.";
        assert!(text.contains(first), "{text}");
        assert!(text.ends_with("und der Turm steht."), "{text}");
        assert!(!text.contains("the "), "{text}");
    }
}
