//! What the program itself says on participants' pages: a catalogue per language.

mod dates;
mod filled;

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Display,
};

use serde::Deserialize;

use super::{Device, NotAdmitted, markup};

/// The catalogues by language.
const CATALOGUES: [(&str, &str); 2] = [
    ("en", include_str!("words/en.toml")),
    ("de", include_str!("words/de.toml")),
];

/// The words of one language, as a study file may have changed them: on pages in another language than English and
/// German they are English until it does.
///
/// A field is a key of the catalogues; where something is to be filled in, the method of the same name does it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Words {
    /// The page's language, as HTML's `lang` wants it.
    #[serde(skip)]
    pub(crate) language: String,
    pub(crate) language_name: String,
    about_minutes: String,
    pub(crate) start: String,
    pub(crate) accept_first: String,
    pub(crate) preview: String,
    pub(crate) stop_and_withdraw: String,
    question_place: String,
    pub(crate) error_prefix: String,
    pub(crate) look_again: String,
    /// With its placeholder, which a script fills in.
    pub(crate) seconds_left: String,
    pub(crate) time_up: String,
    pub(crate) saving: String,
    pub(crate) no_connection: String,
    pub(crate) server_busy: String,
    consent_version: String,
    pub(crate) clauses: String,
    pub(crate) clause_needed: String,
    pub(crate) own_words: String,
    replays_read: String,
    pub(super) needs_answer: String,
    pub(super) line_needs_answer: String,
    whole_number: String,
    number_one_digit: String,
    number_digits: String,
    decimal_mark: String,
    pub(super) choose_one: String,
    pub(super) choose_from: String,
    choose_exactly: String,
    choose_or_more: String,
    choose_at_most: String,
    choose_between: String,
    pub(super) choose_point: String,
    too_long: String,
    choose_decision: String,
    clause_missing: String,
    choose_action: String,
    viewings_unreadable: String,
    viewings_missing: String,
    viewings_extra: String,
    viewings_early: String,
    pub(super) check_hint: String,
    pub(super) screened_out_title: String,
    pub(super) screened_out_text: String,
    pub(super) failed_check_title: String,
    pub(super) failed_check_text: String,
    pub(super) timed_out_title: String,
    pub(super) timed_out_text: String,
    pub(crate) bonus: String,
    pub(crate) bonus_drawn: String,
    bonus_question: String,
    pub(crate) bonus_chose: String,
    pub(crate) bonus_came_out: String,
    pub(crate) bonus_made_of: String,
    bonus_sum: String,
    bonus_least: String,
    pub(crate) bonus_fixed: String,
    pub(crate) completion_code: String,
    pub(crate) other_code: String,
    pub(crate) withdraw_later: String,
    withdraw_until: String,
    withdraw_elsewhere: String,
    pub(crate) withdraw_afterwards: String,
    pages_stored: String,
    pub(crate) return_to_site: String,
    pub(crate) submit_note: String,
    pub(crate) submit: String,
    pub(crate) already_taken: String,
    pub(crate) withdraw_title: String,
    pub(crate) withdraw_text: String,
    pub(crate) withdraw_code: String,
    pub(crate) withdraw_last: String,
    pub(crate) withdraw_button: String,
    pub(crate) go_back: String,
    pub(crate) withdrawn_title: String,
    pub(crate) withdrawn_text: String,
    pub(crate) cannot_start: String,
    pub(crate) study_draft: String,
    pub(crate) study_paused: String,
    pub(crate) study_closed: String,
    not_yet: String,
    over: String,
    other_device: String,
    phone: String,
    tablet: String,
    desktop: String,
    or: String,
    full: String,
    withdrew: String,
    pub(crate) gone_title: String,
    pub(crate) gone_text: String,
    pub(crate) error_no_page_title: String,
    pub(crate) error_no_page_text: String,
    pub(crate) error_no_study_title: String,
    pub(crate) error_no_study_text: String,
    pub(crate) error_expired_title: String,
    pub(crate) error_expired_text: String,
    pub(crate) error_link_title: String,
    error_link_value: String,
    error_link_placeholder: String,
    error_link_persons: String,
    error_link_site: String,
    pub(crate) error_form_title: String,
    pub(crate) error_form_text: String,
    pub(crate) error_large_title: String,
    error_large_text: String,
    pub(crate) error_method_title: String,
    pub(crate) error_method_text: String,
    pub(crate) error_owner_title: String,
    pub(crate) error_owner_text: String,
    pub(crate) error_foreign_title: String,
    pub(crate) error_foreign_text: String,
    pub(crate) error_conflict_title: String,
    pub(crate) error_conflict_text: String,
    pub(crate) error_often_title: String,
    error_often_text: String,
    pub(crate) error_busy_title: String,
    pub(crate) error_busy_text: String,
    pub(crate) error_slow_title: String,
    pub(crate) error_slow_text: String,
    pub(crate) error_ours_title: String,
    pub(crate) error_ours_text: String,
    pub(crate) open_studies: String,
    pub(crate) none_open: String,
    pub(crate) take_part: String,
    lasts_minutes: String,
    pub(crate) from_platform: String,
    pub(crate) from_link: String,
    pub(crate) all_simulated: String,
    pub(crate) player: String,
    player_place: String,
    pub(crate) player_keys: String,
    pub(crate) player_loading: String,
    pub(crate) player_failed: String,
    pub(crate) player_again: String,
    pub(crate) player_moment: String,
    player_seconds: String,
    pub(crate) player_play: String,
    pub(crate) player_pause: String,
    pub(crate) player_restart: String,
    pub(crate) player_next: String,
    pub(crate) player_all: String,
    pub(crate) player_ahead: String,
    player_mark: String,
    pub(crate) player_seen: String,
    pub(crate) player_unseen: String,
    pub(crate) player_shown: String,
    pub(crate) player_happened: String,
    pub(crate) player_later: String,
    player_watched: String,
    pub(crate) player_open: String,
    pub(crate) player_locked: String,
    scene_crossing_title: String,
    scene_crossing_description: String,
    scene_table_title: String,
    scene_table_description: String,
    pub(crate) replay_person: String,
    pub(crate) replay_arm: String,
    pub(crate) replay_orange: String,
    pub(crate) replay_cup: String,
    pub(crate) replay_begin_stable: String,
    pub(crate) replay_begin_unstable: String,
    pub(crate) replay_reaches_orange: String,
    pub(crate) replay_reaches_cup: String,
    replay_puts: String,
    pub(crate) replay_stands: String,
    pub(crate) replay_falls: String,
    pub(crate) replay_builds_stable: String,
    pub(crate) replay_builds_unstable: String,
    replay_first: String,
    replay_then: String,
    replay_with_orange: String,
    pub(crate) replay_end_stands: String,
    pub(crate) replay_end_none: String,
    pub(crate) replay_end_one: String,
    replay_end_some: String,
    day: String,
    moment: String,
    months: String,
}

impl Words {
    /// The words for pages in `language`, a tag such as `de` or `pt-BR`, with those that are worded anew.
    pub(super) fn new(language: &str, anew: &BTreeMap<String, String>) -> Self {
        let mut table = catalogue(language).unwrap_or_else(|| {
            let mut english = english();
            // A language without a catalogue has no name here but its tag.
            english.insert("language_name".to_owned(), language.into());
            english
        });
        for (key, text) in anew {
            table.insert(key.clone(), text.as_str().into());
        }
        // The catalogues are compiled in and read by a test, and what replaces a text is a text.
        let words = Self::deserialize(table).expect("a catalogue with all keys");
        Self {
            language: language.to_owned(),
            ..words
        }
    }

    /// The words for pages of no study, in the first of `languages` that has a catalogue, else in English.
    pub(crate) fn of_languages<'a>(languages: impl IntoIterator<Item = &'a str>) -> Self {
        let known = languages
            .into_iter()
            .find_map(|language| CATALOGUES.iter().find(|(tag, _)| *tag == primary(language)));
        Self::new(known.map_or("en", |(tag, _)| tag), &BTreeMap::new())
    }

    /// The English ones.
    pub fn english() -> Self {
        Self::new("en", &BTreeMap::new())
    }

    /// Whether there is a catalogue for a language.
    pub(super) fn has_catalogue(language: &str) -> bool {
        catalogue(language).is_some()
    }

    /// The keys of all catalogues.
    pub(super) fn keys() -> BTreeSet<String> {
        english().into_iter().map(|(key, _)| key).collect()
    }

    /// What can be filled into the text of a key; nothing for an unknown key.
    pub(super) fn placeholders(key: &str) -> Option<BTreeSet<String>> {
        english().get(key)?.as_str().map(placeholders)
    }

    /// A text of the catalogue as HTML.
    pub(crate) fn to_html(text: &str) -> String {
        markup::to_html(text)
    }

    /// Why nobody can begin now, as HTML.
    pub(crate) fn not_admitted_html(&self, reason: &NotAdmitted) -> String {
        let text = match reason {
            NotAdmitted::NotYet(opens) => {
                fill(&self.not_yet, &[("moment", &self.moment_of(*opens))])
            }
            NotAdmitted::Over(closes) => fill(&self.over, &[("moment", &self.moment_of(*closes))]),
            NotAdmitted::Device(devices) => {
                let names: Vec<&str> = devices.iter().map(|device| self.device(device)).collect();
                let names = names.join(&format!(" {} ", self.or));
                fill(&self.other_device, &[("devices", &names)])
            }
            NotAdmitted::Full => self.full.clone(),
            NotAdmitted::Withdrawn => self.withdrew.clone(),
        };
        markup::to_html(&text)
    }

    fn device(&self, device: &Device) -> &str {
        match device {
            Device::Phone => &self.phone,
            Device::Tablet => &self.tablet,
            Device::Desktop => &self.desktop,
        }
    }
}

/// The language of a tag without its region or script: `pt` of `pt-BR`.
fn primary(language: &str) -> String {
    let primary = language.split('-').next().unwrap_or_default();
    primary.to_ascii_lowercase()
}

fn catalogue(language: &str) -> Option<toml::Table> {
    let (_, text) = CATALOGUES
        .iter()
        .find(|(tag, _)| *tag == primary(language))?;
    Some(parsed(text))
}

fn english() -> toml::Table {
    parsed(CATALOGUES[0].1)
}

fn parsed(catalogue: &str) -> toml::Table {
    // Compiled in, and read by a test.
    catalogue.parse().expect("a catalogue in TOML")
}

/// The names between braces.
pub(super) fn placeholders(text: &str) -> BTreeSet<String> {
    text.split('{')
        .skip(1)
        .filter_map(|rest| Some(rest.split_once('}')?.0.to_owned()))
        .collect()
}

/// Fills in what stands between braces, in one pass: what is filled in is not looked at again.
fn fill(text: &str, values: &[(&str, &dyn Display)]) -> String {
    let mut pieces = text.split('{');
    let mut filled = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let value = piece.split_once('}').and_then(|(name, rest)| {
            let (_, value) = values.iter().find(|(known, _)| *known == name)?;
            Some((value, rest))
        });
        match value {
            Some((value, rest)) => filled.push_str(&format!("{value}{rest}")),
            None => filled.push_str(&format!("{{{piece}")),
        }
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::Timestamp;

    #[test]
    fn every_catalogue_has_every_key_with_the_same_placeholders() {
        let english = english();
        for (language, text) in CATALOGUES {
            let catalogue = parsed(text);
            let keys = |table: &toml::Table| table.keys().cloned().collect::<BTreeSet<_>>();
            assert_eq!(keys(&catalogue), keys(&english), "{language}");
            for (key, text) in &catalogue {
                let text = text.as_str().expect("a text");
                assert!(!text.trim().is_empty(), "{language}: {key}");
                assert_eq!(
                    placeholders(text),
                    Words::placeholders(key).unwrap(),
                    "{language}: {key}"
                );
            }
            assert_eq!(Words::new(language, &BTreeMap::new()).language, language);
        }
    }

    #[test]
    fn months_are_twelve_in_each_catalogue() {
        for (language, _) in CATALOGUES {
            let words = Words::new(language, &BTreeMap::new());
            assert_eq!(words.months.split_whitespace().count(), 12, "{language}");
        }
    }

    #[test]
    fn days_and_moments_are_written_as_the_language_does() {
        let at = Timestamp(1_798_729_199_999);
        let english = Words::english();
        assert_eq!(english.day_of(at), "31 December 2026");
        assert_eq!(english.moment_of(at), "31 December 2026, 14:59 UTC");
        let german = Words::new("de-AT", &BTreeMap::new());
        assert_eq!(german.day_of(at), "31. Dezember 2026");
    }

    #[test]
    fn a_language_without_a_catalogue_speaks_english_under_its_own_tag() {
        let words = Words::new(
            "fr",
            &BTreeMap::from([("start".to_owned(), "Commencer".to_owned())]),
        );
        assert_eq!(words.language, "fr");
        assert_eq!(words.language_name, "fr");
        assert_eq!(words.start, "Commencer");
        assert_eq!(words.preview, Words::english().preview);
    }

    #[test]
    fn what_is_filled_in_is_not_filled_again() {
        let filled = fill("{a} and {b}, {c}", &[("a", &"{b}"), ("b", &2)]);
        assert_eq!(filled, "{b} and 2, {c}");
    }
}
