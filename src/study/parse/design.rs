//! Factors, their levels, and the values that levels bring along.

use std::collections::{BTreeMap, BTreeSet};

use super::{Origin, rules};
use crate::study::definition::{Assign, Factor, Level};
use crate::study::document::{Fault, KeyPath, did_you_mean, list};
use crate::study::file::{RawFactor, RawStudy};
use crate::study::template::{Scope, Values};
use crate::study::{CellId, FactorId, LevelId};

/// How many questions one group may ask. Nobody answers more, and a file must not fill the memory.
const MOST_QUESTIONS: usize = 1_000;

/// What columns are called that every table of data has, as far as an id could be the same: a factor's levels stand in a
/// column of its name beside them, or are joined to them. `count` is one that `fit --choices` reads.
const NAMES_OF_COLUMNS: [&str; 21] = [
    "study",
    "version",
    "participant",
    "block",
    "position",
    "question",
    "problem",
    "action",
    "status",
    "input",
    "source",
    "simulated",
    "condition",
    "language",
    "bonus",
    "excluded",
    "platform",
    "practice",
    "counted",
    "levels",
    "count",
];

/// The design: what the blocks' questions refer to.
pub(super) struct Design<'a> {
    factors: Vec<Factor>,
    raw: &'a [RawFactor],
    general: &'a Values,
    study: &'a Values,
    defined_anywhere: BTreeSet<&'a str>,
}

/// Chosen levels by position of their factor.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Levels(BTreeMap<usize, usize>);

impl<'a> Design<'a> {
    pub(super) fn read(
        raw: &'a RawStudy,
        general: &'a Values,
        origin: Origin,
    ) -> Result<Self, Fault> {
        let path = KeyPath::root().key("factor");
        rules::distinct_ids(
            raw.factor.iter().map(|factor| factor.id.as_str()),
            &path,
            "factor",
        )?;
        check_value_names(&raw.values, &KeyPath::root().key("values"))?;
        let mut defined_anywhere: BTreeSet<&str> = raw.values.keys().map(String::as_str).collect();
        let mut factors = Vec::with_capacity(raw.factor.len());
        for (index, factor) in raw.factor.iter().enumerate() {
            let path = path.index(index);
            if origin == Origin::File {
                check_factor_id(&factor.id, &path.key("id"))?;
            }
            rules::line(&factor.label, &path.key("label"))?;
            if factor.level.is_empty() {
                return Err(path.key("level").fault("no level", "one level or more"));
            }
            rules::distinct_ids(
                factor.level.iter().map(|level| level.id.as_str()),
                &path.key("level"),
                "level",
            )?;
            for (index, level) in factor.level.iter().enumerate() {
                let path = path.key("level").index(index);
                rules::line(&level.label, &path.key("label"))?;
                check_value_names(&level.values, &path.key("values"))?;
                defined_anywhere.extend(level.values.keys().map(String::as_str));
            }
            factors.push(Factor {
                id: FactorId::from(factor.id.as_str()),
                label: factor.label.clone(),
                assign: factor.assign,
                levels: factor
                    .level
                    .iter()
                    .map(|level| Level {
                        id: LevelId::from(level.id.as_str()),
                        label: level.label.clone(),
                    })
                    .collect(),
            });
        }
        Ok(Self {
            factors,
            raw: &raw.factor,
            general,
            study: &raw.values,
            defined_anywhere,
        })
    }

    pub(super) fn into_factors(self) -> Vec<Factor> {
        self.factors
    }

    pub(super) fn factors(&self) -> &[Factor] {
        &self.factors
    }

    /// The values outside any question.
    pub(super) fn scope(&self) -> Scope<'a> {
        Scope::default().with(self.general).with(self.study)
    }

    /// The values of `scope` with those of the levels on top.
    pub(super) fn scope_with(&self, scope: &Scope<'a>, levels: &Levels) -> Scope<'a> {
        levels
            .0
            .iter()
            .fold(scope.clone(), |scope, (factor, level)| {
                scope.with(&self.raw[*factor].level[*level].values)
            })
    }

    /// Whether some level or the file as a whole gives `name` a value.
    pub(super) fn defines(&self, name: &str) -> bool {
        self.defined_anywhere.contains(name)
    }

    /// All names that have a value somewhere.
    pub(super) fn defined_names(&self) -> impl Iterator<Item = &'a str> {
        self.defined_anywhere.iter().copied()
    }

    /// The position of a factor.
    pub(super) fn factor(&self, id: &str, at: &KeyPath) -> Result<usize, Fault> {
        let ids = || self.factors.iter().map(|factor| factor.id.as_str());
        ids().position(|known| known == id).ok_or_else(|| {
            let known = if self.factors.is_empty() {
                "none: the study has no factors".to_owned()
            } else {
                list(ids())
            };
            at.fault(
                format!(
                    "unknown factor {}{}",
                    rules::shown(id),
                    did_you_mean(id, ids())
                ),
                known,
            )
        })
    }

    /// The position of a level of the factor at `factor`.
    pub(super) fn level(&self, factor: usize, id: &str, at: &KeyPath) -> Result<usize, Fault> {
        let factor = &self.factors[factor];
        let ids = || factor.levels.iter().map(|level| level.id.as_str());
        ids().position(|known| known == id).ok_or_else(|| {
            let found = format!(
                "{} is no level of {}{}",
                rules::shown(id),
                factor.id,
                did_you_mean(id, ids())
            );
            at.fault(found, list(ids()))
        })
    }

    /// Levels as a table of the file names them: `{ risk = "low" }`.
    pub(super) fn levels(
        &self,
        raw: &BTreeMap<String, String>,
        at: &KeyPath,
    ) -> Result<Levels, Fault> {
        let mut levels = Levels::default();
        for (factor, level) in raw {
            let at = at.key(factor);
            let factor = self.factor(factor, &at)?;
            levels.0.insert(factor, self.level(factor, level, &at)?);
        }
        Ok(levels)
    }

    /// The same for what only some conditions meet: factors that differ between people.
    pub(super) fn condition_levels(
        &self,
        raw: &BTreeMap<String, String>,
        at: &KeyPath,
    ) -> Result<Levels, Fault> {
        let levels = self.levels(raw, at)?;
        let within = levels
            .0
            .keys()
            .map(|factor| &self.factors[*factor])
            .find(|factor| factor.assign == Assign::Within);
        match within {
            Some(factor) => Err(at.key(factor.id.as_str()).fault(
                format!(
                    "factor `{}`, of which everybody meets all levels",
                    factor.id
                ),
                "factors with `assign = \"between\"`",
            )),
            None => Ok(levels),
        }
    }

    /// `inner` in addition to `outer`; a factor cannot be set twice.
    pub(super) fn join(
        &self,
        outer: &Levels,
        inner: &Levels,
        at: &KeyPath,
    ) -> Result<Levels, Fault> {
        let mut joined = outer.clone();
        for (factor, level) in &inner.0 {
            if let Some(earlier) = joined.0.insert(*factor, *level) {
                let factor = &self.factors[*factor];
                return Err(at.fault(
                    format!(
                        "factor `{}`, which is already set to `{}`",
                        factor.id, factor.levels[earlier].id
                    ),
                    "factors that are not set further out",
                ));
            }
        }
        Ok(joined)
    }

    /// Every combination of the levels that `cross` lists, the first factor of the file changing slowest.
    pub(super) fn cross(
        &self,
        cross: &BTreeMap<String, Vec<String>>,
        at: &KeyPath,
    ) -> Result<Vec<Levels>, Fault> {
        let mut lists: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (factor, levels) in cross {
            let at = at.key(factor);
            let factor = self.factor(factor, &at)?;
            if levels.is_empty() {
                return Err(at.fault("an empty list", "a list of levels"));
            }
            let mut positions = Vec::with_capacity(levels.len());
            for (index, level) in levels.iter().enumerate() {
                let at = at.index(index);
                let position = self.level(factor, level, &at)?;
                if positions.contains(&position) {
                    return Err(at.fault(
                        format!("{} for the second time", rules::shown(level)),
                        "each level once",
                    ));
                }
                positions.push(position);
            }
            lists.insert(factor, positions);
        }
        let combinations = lists
            .values()
            .try_fold(1_usize, |product, levels| product.checked_mul(levels.len()));
        if combinations.is_none_or(|combinations| combinations > MOST_QUESTIONS) {
            let allowed = format!("at most {MOST_QUESTIONS} combinations of levels in a group");
            return Err(at.fault("a product of too many levels", allowed));
        }
        let mut combinations = vec![Levels::default()];
        for (factor, levels) in lists {
            combinations = combinations
                .iter()
                .flat_map(|combination| {
                    levels
                        .iter()
                        .map(move |level| combination.with(factor, *level))
                })
                .collect();
        }
        Ok(combinations)
    }

    /// Ids of the levels with their factors, in factor order.
    pub(super) fn named(&self, levels: &Levels) -> Vec<(FactorId, LevelId)> {
        levels
            .0
            .iter()
            .map(|(factor, level)| {
                let factor = &self.factors[*factor];
                (factor.id.clone(), factor.levels[*level].id.clone())
            })
            .collect()
    }

    /// The labels of the levels, for people.
    pub(super) fn label(&self, levels: &Levels) -> String {
        let labels: Vec<&str> = levels
            .0
            .iter()
            .map(|(factor, level)| self.factors[*factor].levels[*level].label.as_str())
            .collect();
        labels.join(" · ")
    }

    /// Level ids joined by `separator`, in factor order.
    pub(super) fn joined_ids(&self, levels: &Levels, separator: &str) -> String {
        let ids: Vec<&str> = levels
            .0
            .iter()
            .map(|(factor, level)| self.factors[*factor].levels[*level].id.as_str())
            .collect();
        ids.join(separator)
    }

    /// The cell of these levels if they name every factor of a study that has some.
    pub(super) fn cell_id(&self, levels: &Levels) -> Option<CellId> {
        let is_complete = !self.factors.is_empty() && levels.0.len() == self.factors.len();
        is_complete.then(|| CellId::from(self.joined_ids(levels, "/")))
    }

    /// The factors that the levels leave open.
    pub(super) fn open_factors(&self, levels: &Levels) -> Vec<&str> {
        let factors = self.factors.iter().enumerate();
        factors
            .filter(|(index, _)| !levels.0.contains_key(index))
            .map(|(_, factor)| factor.id.as_str())
            .collect()
    }
}

impl Levels {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn with(&self, factor: usize, level: usize) -> Self {
        let mut levels = self.clone();
        levels.0.insert(factor, level);
        levels
    }
}

/// A factor is a column of the data.
fn check_factor_id(id: &str, at: &KeyPath) -> Result<(), Fault> {
    if NAMES_OF_COLUMNS.contains(&id) {
        return Err(at.fault(
            format!(
                "{}, which is the name of another column of the data",
                rules::shown(id)
            ),
            format!("another id than {}", NAMES_OF_COLUMNS.join(", ")),
        ));
    }
    Ok(())
}

/// Checks the names of a table of values.
pub(super) fn check_value_names(values: &Values, at: &KeyPath) -> Result<(), Fault> {
    values
        .keys()
        .try_for_each(|name| rules::value_name(name, &at.key(name)))
}
