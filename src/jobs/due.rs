//! Which fits are due, and which goes first.

use std::{collections::HashMap, sync::Arc};

use super::{PartFit, fit_input::FitInput, live_fits::LiveFit};
use crate::{
    store::{FitKey, FitState},
    study::StudyId,
};

/// How often one and the same input is tried.
pub(super) const MAX_ATTEMPTS: u32 = 3;

/// A fit that is to be run.
pub(super) struct Due {
    pub(super) input: Arc<FitInput>,
    /// From where; from nothing without it.
    pub(super) previous: Option<Arc<LiveFit>>,
    /// It replaces a provisional fit of the same answers.
    pub(super) is_final: bool,
    /// The first data version that it waits for.
    pub(super) since: i64,
    /// Whether it is of the plan whose curves a page shows first.
    pub(super) is_watched: bool,
    pub(super) attempts: u32,
}

impl Due {
    /// The fit that a part needs now, if it needs one.
    pub(super) fn of(
        part: &PartFit,
        known: Option<Arc<LiveFit>>,
        is_settled: bool,
        since: i64,
        is_watched: bool,
    ) -> Option<Self> {
        let input = &part.input;
        if input.data.n() == 0 {
            return None;
        }
        let of_these = part.fit.as_ref().filter(|fit| fit.input_hash == input.hash);
        let (attempts, is_final) = match of_these {
            None => (1, false),
            Some(fit) => match fit.outcome.state() {
                FitState::Converged | FitState::Unconverged if fit.is_provisional => {
                    if !is_settled {
                        return None;
                    }
                    (1, true)
                }
                FitState::Converged | FitState::Unconverged => return None,
                FitState::Failed if fit.attempts >= MAX_ATTEMPTS => return None,
                FitState::Failed => (fit.attempts + 1, false),
            },
        };
        // What failed once is not tried again from the same point.
        let is_first = attempts == 1 && !is_final && !is_settled;
        Some(Self {
            input: input.clone(),
            previous: known.filter(|_| is_first),
            is_final,
            since,
            is_watched,
            attempts,
        })
    }

    /// The least goes first: what has newer answers before what is to become final, of those the one that waits
    /// longest, so that no part waits for ever while answers keep arriving, and of those the one that people look at.
    pub(super) fn urgency(&self) -> (bool, i64, bool) {
        (self.is_final, self.since, !self.is_watched)
    }
}

/// Since which data version each part that is behind has been so.
#[derive(Debug, Default)]
pub(super) struct Waits(HashMap<(StudyId, FitKey), i64>);

impl Waits {
    /// The first data version that a part waits for. `fitted_at`: the data version that it was last fitted to.
    pub(super) fn since(
        &mut self,
        study: &StudyId,
        key: &FitKey,
        fitted_at: Option<i64>,
        data_version: i64,
    ) -> i64 {
        let at = (study.clone(), key.clone());
        let since = self.0.entry(at).or_insert(data_version);
        // Fitted in the meantime, and behind again.
        *since = (*since).max(fitted_at.map_or(0, |version| version + 1));
        *since
    }

    /// A part is not behind any more.
    pub(super) fn end(&mut self, study: &StudyId, key: &FitKey) {
        self.0.remove(&(study.clone(), key.clone()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_waits_from_the_first_answer_that_its_fit_lacks() {
        let study = StudyId::from("driving");
        let key = |part: &str| FitKey {
            plan: "risk".into(),
            part: part.into(),
            model: "risk_aware".to_owned(),
        };
        let mut waits = Waits::default();
        assert_eq!(waits.since(&study, &key("low"), Some(3), 7), 7);
        assert_eq!(waits.since(&study, &key("high"), None, 8), 8);
        // Further answers do not push it back.
        assert_eq!(waits.since(&study, &key("low"), Some(3), 9), 7);
        // It was fitted to version 8, and version 9 came meanwhile: now the other one waits longer.
        assert_eq!(waits.since(&study, &key("low"), Some(8), 9), 9);
        waits.end(&study, &key("low"));
        assert_eq!(waits.since(&study, &key("low"), Some(9), 12), 12);
    }
}
