//! What is notable about a participant, and whom a study leaves out of its analysis for it.

use serde::{Deserialize, Serialize};

use super::{InstructedItem, Study};

/// Something notable about a participant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Flag {
    /// Some choice took less than 0.3 s on the page's clock.
    FastChoice,
    /// The whole run took less than a third of the median of all completed ones.
    ShortRun,
    /// The page was hidden while a question was shown.
    HiddenPage,
    /// A comprehension check was answered wrongly, or an attention check not as asked.
    FailedCheck,
    /// Some timed question was answered too late.
    LateAnswer,
    /// The person came by several links.
    SeveralArrivals,
}

impl Flag {
    /// All flags.
    pub const ALL: [Self; 6] = [
        Self::FastChoice,
        Self::ShortRun,
        Self::HiddenPage,
        Self::FailedCheck,
        Self::LateAnswer,
        Self::SeveralArrivals,
    ];

    /// The name in study files, in addresses and in the API.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::FastChoice => "fast-choice",
            Self::ShortRun => "short-run",
            Self::HiddenPage => "hidden-page",
            Self::FailedCheck => "failed-check",
            Self::LateAnswer => "late-answer",
            Self::SeveralArrivals => "several-arrivals",
        }
    }

    /// The flag with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|flag| flag.as_str() == name)
    }

    /// Whether a run tells it by itself once it is over, and for good. A median moves with other people's runs, and a
    /// person can come by another link later.
    pub fn can_exclude(self) -> bool {
        match self {
            Self::FastChoice | Self::HiddenPage | Self::FailedCheck | Self::LateAnswer => true,
            Self::ShortRun | Self::SeveralArrivals => false,
        }
    }

    /// What somebody with it did, after a number of people: `2 answered too late`.
    pub fn deed(self) -> &'static str {
        match self {
            Self::FastChoice => "chose within 0.3 s",
            Self::ShortRun => "took under a third of the median time",
            Self::HiddenPage => "hid the page during a question",
            Self::FailedCheck => "answered a check wrongly",
            Self::LateAnswer => "answered too late",
            Self::SeveralArrivals => "came by several links",
        }
    }
}

/// Whom a version of a study leaves out of its analysis: everybody with one of these flags when their run ends.
#[derive(Debug, Clone, PartialEq)]
pub struct ExclusionRule {
    /// The flags, in file order; at least one.
    pub flags: Vec<Flag>,
    /// The attention checks that [`Flag::FailedCheck`] looks at.
    pub checks: Vec<InstructedItem>,
}

impl Study {
    /// The flags of people whose answers are left out of the analysis, in file order; none in a study without such a
    /// rule. They take part, are paid and take up places like everybody else.
    pub fn exclude(&self) -> &[Flag] {
        &self.exclude
    }

    /// The same as it is stored with this version of the study.
    pub fn exclusion_rule(&self) -> Option<ExclusionRule> {
        (!self.exclude.is_empty()).then(|| ExclusionRule {
            flags: self.exclude.clone(),
            checks: self.instructed_items(),
        })
    }
}

/// How many people are left out for what: `1 answered a check wrongly, 2 by hand`. Each person has one reason, none
/// for those who are left out by hand alone.
pub fn exclusions_in_words(exclusions: &[(Option<Flag>, u64)]) -> String {
    let parts: Vec<String> = exclusions
        .iter()
        .map(|(flag, n)| format!("{n} {}", flag.map_or("by hand", Flag::deed)))
        .collect();
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_leads_to_its_flag() {
        for flag in Flag::ALL {
            assert_eq!(Flag::named(flag.as_str()), Some(flag));
        }
        assert_eq!(Flag::named("bored"), None);
    }

    #[test]
    fn reasons_are_told_with_their_numbers() {
        let reasons = [(Some(Flag::FailedCheck), 1), (None, 2)];
        assert_eq!(
            exclusions_in_words(&reasons),
            "1 answered a check wrongly, 2 by hand"
        );
    }
}
