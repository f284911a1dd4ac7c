//! Since when each study has had no new data.

use std::{collections::HashMap, time::Duration};

use tokio::time::Instant;

use crate::study::StudyId;

/// After so long without a change of its data a study counts as idle, and its provisional fits become final
/// (models.md, section 5).
pub(super) const IDLE: Duration = Duration::from_secs(10);

/// The data versions that were seen last, each with the moment when it was seen first.
#[derive(Debug, Default)]
pub(super) struct Quiet(HashMap<StudyId, (i64, Instant)>);

impl Quiet {
    /// Takes note of a study's data version.
    pub(super) fn note(&mut self, study: &StudyId, data_version: i64, now: Instant) {
        match self.0.get_mut(study) {
            Some((known, _)) if *known == data_version => {}
            Some(seen) => *seen = (data_version, now),
            None => {
                self.0.insert(study.clone(), (data_version, now));
            }
        }
    }

    /// Whether the study's data have not changed for long enough.
    pub(super) fn is_idle(&self, study: &StudyId, now: Instant) -> bool {
        self.0
            .get(study)
            .is_some_and(|(_, since)| *since + IDLE <= now)
    }

    /// When the next study becomes idle, if one is still to.
    pub(super) fn wake(&self, now: Instant) -> Option<Instant> {
        let ends = self.0.values().map(|(_, since)| *since + IDLE);
        ends.filter(|end| *end > now).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_study_is_idle_ten_seconds_after_its_last_change() {
        let start = Instant::now();
        let after = |millis| start + Duration::from_millis(millis);
        let (driving, cups) = (StudyId::from("driving"), StudyId::from("cups"));
        let mut quiet = Quiet::default();
        assert!(!quiet.is_idle(&driving, after(60_000)), "never seen");
        assert_eq!(quiet.wake(start), None);

        quiet.note(&driving, 1, start);
        quiet.note(&cups, 7, after(2_000));
        // The same version again is no change.
        quiet.note(&driving, 1, after(5_000));
        assert_eq!(quiet.wake(after(5_000)), Some(after(10_000)));
        assert!(!quiet.is_idle(&driving, after(9_999)));
        assert!(quiet.is_idle(&driving, after(10_000)));
        assert!(!quiet.is_idle(&cups, after(10_000)));
        assert_eq!(quiet.wake(after(10_000)), Some(after(12_000)));

        quiet.note(&driving, 2, after(11_000));
        assert!(!quiet.is_idle(&driving, after(12_000)));
        assert_eq!(quiet.wake(after(12_000)), Some(after(21_000)));
    }
}
