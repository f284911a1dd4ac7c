//! The paragraph of a methods section that says who took part.

use std::fmt::Write;

use super::{Flag, exclusions_in_words};

/// What the paragraph is made of. What was not asked is empty, and its sentence is left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParticipantFacts {
    /// How many completed the study, by the label of their link; people without a label have the empty one.
    pub completed_by_source: Vec<(String, u64)>,
    /// How many started, completed runs included.
    pub started: u64,
    /// Those who did not consent.
    pub declined: u64,
    /// Those for whom the study was not meant.
    pub screened_out: u64,
    /// Those who failed a check for good.
    pub failed_check: u64,
    /// Those who did not finish within their time.
    pub timed_out: u64,
    /// Those who withdrew.
    pub withdrawn: u64,
    /// Those who are under way, or left without a word.
    pub unfinished: u64,
    /// How many of those who completed are left out of the analysis for what; no flag stands for those who are left out by
    /// hand alone.
    pub excluded: Vec<(Option<Flag>, u64)>,
    /// What people who completed and are analysed answered when they were asked for their gender: text of the answer, how many. No
    /// text stands for those who left it empty.
    pub genders: Vec<(Option<String>, u64)>,
    /// The ages of people who completed and are analysed, each with how many have it, in any order.
    pub ages: Vec<(i64, u64)>,
    /// The median time of completed runs, in milliseconds.
    pub median_ms: Option<u64>,
    /// What the recruiting platform was told to require.
    pub filters: Vec<String>,
    /// Whether the people are simulated.
    pub is_simulated: bool,
}

impl ParticipantFacts {
    /// The paragraph: n by source, what was required of people, who is left out of the analysis, gender shares, median and range of age, who is missing,
    /// times. Whoever is not in the completed runs is named with the reason, so that the numbers add up to those who
    /// started.
    pub fn paragraph(&self) -> String {
        let completed = self.completed();
        let mut text = self.who(completed);
        if !self.filters.is_empty() {
            write!(
                text,
                " The recruiting platform was asked for: {}.",
                self.filters.join("; ")
            )
            .expect("a text takes everything");
        }
        text.push_str(&self.excluded_sentence());
        if completed > 0 {
            text.push_str(&self.gender_sentence());
            text.push_str(&self.age_sentence());
        }
        text.push_str(&self.missing_sentence());
        if let Some(median_ms) = self.median_ms.filter(|_| completed > 0) {
            let minutes = median_ms as f64 / 60_000.0;
            write!(
                text,
                " The median time from start to end was {minutes:.1} minutes."
            )
            .expect("a text takes everything");
        }
        text
    }

    fn completed(&self) -> u64 {
        self.completed_by_source.iter().map(|(_, n)| n).sum()
    }

    fn who(&self, completed: u64) -> String {
        let whom = match (self.is_simulated, completed) {
            (true, 1) => "simulated person",
            (true, _) => "simulated people",
            (false, 1) => "person",
            (false, _) => "people",
        };
        let mut text = format!("{completed} {whom} completed the study");
        let has_labels = self
            .completed_by_source
            .iter()
            .any(|(source, n)| !source.is_empty() && *n > 0);
        if has_labels {
            let parts: Vec<String> = self
                .completed_by_source
                .iter()
                .filter(|(_, n)| *n > 0)
                .map(|(source, n)| match source.as_str() {
                    "" => format!("{n} without a label of their source"),
                    source => format!("{n} from {source}"),
                })
                .collect();
            write!(text, " ({})", parts.join(", ")).expect("a text takes everything");
        }
        text.push('.');
        text
    }

    fn left_out(&self) -> u64 {
        self.excluded.iter().map(|(_, n)| n).sum()
    }

    fn excluded_sentence(&self) -> String {
        match self.left_out() {
            0 => String::new(),
            n => {
                let verb = if n == 1 { "was" } else { "were" };
                let reasons = exclusions_in_words(&self.excluded);
                format!(" Of these, {n} {verb} left out of the analysis: {reasons}.")
            }
        }
    }

    /// Whom the sentences about gender and age speak of, where it is not everybody who completed.
    fn of_whom(&self) -> String {
        match self.left_out() {
            0 => String::new(),
            n => format!(" of the other {}", self.completed().saturating_sub(n)),
        }
    }

    fn gender_sentence(&self) -> String {
        let asked: u64 = self.genders.iter().map(|(_, n)| n).sum();
        if asked == 0 {
            return String::new();
        }
        let mut genders: Vec<&(Option<String>, u64)> =
            self.genders.iter().filter(|(_, n)| *n > 0).collect();
        genders.sort_by_key(|(gender, n)| (gender.is_none(), std::cmp::Reverse(*n)));
        let parts: Vec<String> = genders
            .iter()
            .map(|(gender, n)| {
                let share = *n as f64 / asked as f64 * 100.0;
                let gender = gender.as_deref().unwrap_or("no answer");
                format!("{gender} {share:.0} %")
            })
            .collect();
        format!(" Gender{}: {}.", self.of_whom(), parts.join(", "))
    }

    fn age_sentence(&self) -> String {
        let mut ages = self.ages.clone();
        ages.retain(|(_, n)| *n > 0);
        ages.sort_unstable();
        let n: u64 = ages.iter().map(|(_, n)| n).sum();
        let (Some((youngest, _)), Some((oldest, _))) = (ages.first(), ages.last()) else {
            return String::new();
        };
        // The one in the middle, or the mean of the two.
        let at = |rank: u64| {
            let mut before = 0;
            ages.iter()
                .find(|(_, n)| {
                    before += n;
                    before > rank
                })
                .map_or(*oldest, |(age, _)| *age)
        };
        let median = (at((n - 1) / 2) + at(n / 2)) as f64 / 2.0;
        let missing = self.completed().saturating_sub(self.left_out() + n);
        let unknown = if missing > 0 {
            format!("; {missing} did not tell their age")
        } else {
            String::new()
        };
        format!(
            " The median age{} was {median} years (range {youngest} to {oldest}{unknown}).",
            self.of_whom()
        )
    }

    fn missing_sentence(&self) -> String {
        let reasons: Vec<String> = [
            (self.declined, "did not consent"),
            (self.screened_out, "were screened out"),
            (self.failed_check, "failed a comprehension check"),
            (self.timed_out, "did not finish in time"),
            (self.withdrawn, "withdrew and were erased"),
            (self.unfinished, "did not finish"),
        ]
        .into_iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, reason)| {
            // One person was, two were.
            let reason = if n == 1 {
                reason.replace("were ", "was ")
            } else {
                reason.to_owned()
            };
            format!("{n} {reason}")
        })
        .collect();
        if reasons.is_empty() {
            return String::new();
        }
        let mut text = format!(" Of {} who started, {}.", self.started, reasons.join(", "));
        if self.declined > 0 {
            text.push_str(
                " Those who did not consent are counted by visits, since nothing is kept by which one of them could be known again.",
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thirty() -> ParticipantFacts {
        ParticipantFacts {
            completed_by_source: vec![(String::new(), 2), ("prolific".to_owned(), 28)],
            started: 40,
            declined: 2,
            screened_out: 1,
            failed_check: 3,
            timed_out: 0,
            withdrawn: 1,
            unfinished: 3,
            excluded: Vec::new(),
            genders: vec![
                (None, 1),
                (Some("Woman".to_owned()), 9),
                (Some("Man".to_owned()), 20),
            ],
            ages: vec![(61, 1), (18, 10), (30, 5), (33, 13)],
            median_ms: Some(312_000),
            filters: vec!["Approval rate of at least 95 %".to_owned()],
            is_simulated: false,
        }
    }

    #[test]
    fn a_whole_study_is_told_in_one_paragraph() {
        assert_eq!(
            thirty().paragraph(),
            "30 people completed the study (2 without a label of their source, 28 from prolific). The recruiting \
             platform was asked for: Approval rate of at least 95 %. Gender: Man 67 %, Woman 30 %, no answer 3 %. The \
             median age was 30 years (range 18 to 61; 1 did not tell their age). Of 40 who started, 2 did not consent, \
             1 was screened out, 3 failed a comprehension check, 1 withdrew and was erased, 3 did not finish. Those who \
             did not consent are counted by visits, since nothing is kept by which one of them could be known again. The \
             median time from start to end was 5.2 minutes."
        );
    }

    #[test]
    fn whoever_is_left_out_is_told_with_the_reason_and_not_among_the_ages() {
        let facts = ParticipantFacts {
            excluded: vec![(Some(Flag::FailedCheck), 1), (None, 1)],
            genders: vec![(Some("Man".to_owned()), 28)],
            ages: vec![(30, 28)],
            ..thirty()
        };
        let told = facts.paragraph();
        assert!(
            told.contains(
                " Of these, 2 were left out of the analysis: 1 answered a check wrongly, 1 by hand. Gender of the other \
                 28: Man 100 %. The median age of the other 28 was 30 years (range 30 to 30). Of 40 who started,"
            ),
            "{told}"
        );
    }

    #[test]
    fn what_was_not_asked_is_not_told() {
        let facts = ParticipantFacts {
            completed_by_source: vec![(String::new(), 1)],
            started: 1,
            ..ParticipantFacts::default()
        };
        assert_eq!(facts.paragraph(), "1 person completed the study.");
        assert_eq!(
            ParticipantFacts {
                is_simulated: true,
                ..ParticipantFacts::default()
            }
            .paragraph(),
            "0 simulated people completed the study."
        );
    }

    #[test]
    fn the_median_of_an_even_number_lies_between_two() {
        let facts = ParticipantFacts {
            completed_by_source: vec![(String::new(), 2)],
            started: 2,
            ages: vec![(20, 1), (25, 1)],
            ..ParticipantFacts::default()
        };
        assert!(
            facts
                .paragraph()
                .contains("The median age was 22.5 years (range 20 to 25).")
        );
    }
}
