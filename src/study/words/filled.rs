//! Words with what is filled into them.

use std::fmt::Display;

use super::{
    super::{Bonus, RewardUnit},
    Words, fill,
};

impl Words {
    pub(crate) fn about_minutes(&self, minutes: &u32) -> String {
        fill(&self.about_minutes, &[("minutes", minutes)])
    }

    pub(crate) fn question_place(&self, number: &usize, of: &usize) -> String {
        fill(&self.question_place, &[("number", number), ("of", of)])
    }

    pub(crate) fn consent_version(&self, version: &str) -> String {
        fill(&self.consent_version, &[("version", &version)])
    }

    pub(crate) fn replays_read(&self, seconds: &u64) -> String {
        fill(&self.replays_read, &[("seconds", seconds)])
    }

    pub(in crate::study) fn whole_number(&self, min: i64, max: i64) -> String {
        fill(&self.whole_number, &[("min", &min), ("max", &max)])
    }

    pub(in crate::study) fn number(&self, min: f64, max: f64, digits: u32) -> String {
        let shown = |number: f64| number.to_string().replace('.', &self.decimal_mark);
        let bounds: [(&str, &dyn Display); 3] = [
            ("min", &shown(min)),
            ("max", &shown(max)),
            ("digits", &digits),
        ];
        match digits {
            1 => fill(&self.number_one_digit, &bounds),
            _ => fill(&self.number_digits, &bounds),
        }
    }

    /// How many of `of` options can be chosen.
    pub(in crate::study) fn choose_some(&self, min: usize, max: usize, of: usize) -> String {
        match (min, max) {
            (min, max) if min == max => fill(&self.choose_exactly, &[("count", &min)]),
            (min, max) if max == of => fill(&self.choose_or_more, &[("count", &min)]),
            (0, max) => fill(&self.choose_at_most, &[("count", &max)]),
            (min, max) => fill(&self.choose_between, &[("min", &min), ("max", &max)]),
        }
    }

    pub(in crate::study) fn too_long(&self, allowed: usize, length: usize) -> String {
        fill(
            &self.too_long,
            &[("allowed", &allowed), ("length", &length)],
        )
    }

    pub(in crate::study) fn choose_decision(&self, agree: &str, decline: &str) -> String {
        fill(
            &self.choose_decision,
            &[("agree", &agree), ("decline", &decline)],
        )
    }

    pub(in crate::study) fn clause_missing(&self, clause: &str) -> String {
        fill(&self.clause_missing, &[("clause", &clause)])
    }

    pub(in crate::study) fn choose_action(&self, actions: &str) -> String {
        fill(&self.choose_action, &[("actions", &actions)])
    }

    pub(in crate::study) fn viewings_unreadable(&self, of: usize) -> String {
        fill(&self.viewings_unreadable, &[("of", &of)])
    }

    pub(in crate::study) fn viewings_missing(&self, watched: usize, of: usize) -> String {
        fill(
            &self.viewings_missing,
            &[("watched", &watched), ("of", &of)],
        )
    }

    pub(in crate::study) fn viewings_extra(&self, viewings: usize, of: usize) -> String {
        fill(
            &self.viewings_extra,
            &[("viewings", &viewings), ("of", &of)],
        )
    }

    pub(crate) fn viewings_early(&self, seconds: u64, missing: u64) -> String {
        fill(
            &self.viewings_early,
            &[("seconds", &seconds), ("missing", &missing)],
        )
    }

    /// How an amount follows from what is paid at first, the rate and the reward, each with its unit.
    pub(crate) fn bonus_sum(&self, bonus: &Bonus, reward: f64, unit: &RewardUnit) -> String {
        // No line ends between an amount and its currency or unit.
        let whole = |amount: String| amount.replace(' ', "\u{a0}");
        let endowment = whole(bonus.format(bonus.endowment));
        let rate = whole(format!("{} {}", bonus.currency, bonus.rate));
        let reward_shown = whole(unit.format(reward));
        let amount = whole(bonus.format(bonus.amount(reward)));
        let values: [(&str, &dyn Display); 4] = [
            ("endowment", &endowment),
            ("rate", &rate),
            ("reward", &reward_shown),
            ("amount", &amount),
        ];
        let is_below = bonus.endowment + bonus.rate * reward < 0.0;
        let text = if is_below {
            &self.bonus_least
        } else {
            &self.bonus_sum
        };
        fill(text, &values)
    }

    pub(crate) fn bonus_question(&self, number: usize, of: usize) -> String {
        fill(&self.bonus_question, &[("number", &number), ("of", &of)])
    }

    pub(crate) fn withdraw_elsewhere(&self, contact: &str) -> String {
        fill(&self.withdraw_elsewhere, &[("contact", &contact)])
    }

    pub(crate) fn withdraw_until(&self, day: &str) -> String {
        fill(&self.withdraw_until, &[("day", &day)])
    }

    pub(crate) fn pages_stored(&self, count: &u32) -> String {
        fill(&self.pages_stored, &[("count", count)])
    }

    pub(crate) fn error_link_value(&self, name: &str, allowed: usize) -> String {
        let values: [(&str, &dyn Display); 2] = [("name", &name), ("allowed", &allowed)];
        fill(&self.error_link_value, &values)
    }

    pub(crate) fn error_link_placeholder(&self, name: &str) -> String {
        fill(&self.error_link_placeholder, &[("name", &name)])
    }

    pub(crate) fn error_link_persons(&self, one: &str, other: &str) -> String {
        fill(
            &self.error_link_persons,
            &[("one", &one), ("other", &other)],
        )
    }

    pub(crate) fn error_link_site(&self, found: &str, allowed: &str) -> String {
        let values: [(&str, &dyn Display); 2] = [("found", &found), ("allowed", &allowed)];
        fill(&self.error_link_site, &values)
    }

    pub(crate) fn error_large_text(&self, kib: usize) -> String {
        fill(&self.error_large_text, &[("kib", &kib)])
    }

    pub(crate) fn error_often_text(&self, seconds: u64) -> String {
        fill(&self.error_often_text, &[("seconds", &seconds)])
    }

    /// Title and description of a drawn scene, where it has some.
    pub(crate) fn of_scene(&self, id: &str) -> Option<(&str, &str)> {
        match id {
            "crossing" => Some((&self.scene_crossing_title, &self.scene_crossing_description)),
            "table" => Some((&self.scene_table_title, &self.scene_table_description)),
            _ => None,
        }
    }

    pub(crate) fn replay_puts(&self, who: &str, what: &str, placed: usize, of: usize) -> String {
        let values: [(&str, &dyn Display); 4] = [
            ("who", &who),
            ("what", &what),
            ("placed", &placed),
            ("of", &of),
        ];
        fill(&self.replay_puts, &values)
    }

    pub(crate) fn replay_first(&self, who: &str, what: &str) -> String {
        fill(&self.replay_first, &[("who", &who), ("what", &what)])
    }

    pub(crate) fn replay_then(&self, who: &str) -> String {
        fill(&self.replay_then, &[("who", &who)])
    }

    pub(crate) fn replay_with_orange(&self, who: &str) -> String {
        fill(&self.replay_with_orange, &[("who", &who)])
    }

    /// How a replay ends in which the tower falls and so many cups stay where they were put.
    pub(crate) fn replay_end_fallen(&self, in_slots: usize) -> String {
        match in_slots {
            0 => self.replay_end_none.clone(),
            1 => self.replay_end_one.clone(),
            some => fill(&self.replay_end_some, &[("count", &some)]),
        }
    }

    /// What a script says of replays, by the names under which it looks for it; what is filled in, the script fills in.
    pub(crate) fn of_player(&self) -> String {
        serde_json::json!({
            "place": self.player_place,
            "loading": self.player_loading,
            "seconds": self.player_seconds,
            "play": self.player_play,
            "pause": self.player_pause,
            "ahead": self.player_ahead,
            "mark": self.player_mark,
            "seen": self.player_seen,
            "unseen": self.player_unseen,
            "shown": self.player_shown,
            "watched": self.player_watched,
            "open": self.player_open,
            "locked": self.player_locked,
            "decimalMark": self.decimal_mark,
        })
        .to_string()
    }

    pub(crate) fn lasts_minutes(&self, minutes: &u32) -> String {
        fill(&self.lasts_minutes, &[("minutes", minutes)])
    }
}
