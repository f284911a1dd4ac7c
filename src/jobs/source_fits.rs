//! The models fitted to people from each source, on demand.

use std::{collections::BTreeMap, ops::ControlFlow};

use serde::Serialize;

use super::{
    QuestionCounts, Snapshot, StudyCounts,
    fit_input::{FitInput, hash_of},
    on_demand::{OnDemand, Work},
};
use crate::{
    inference::{
        ChoiceData, FitError,
        factor::{FactorDesign, FactorPart, FactorReport, compare_levels},
    },
    store::{AskedProblem, SourceCount},
    study::{FitPlan, Study},
};

/// The name of the factor.
const FACTOR: &str = "source";
/// With fewer choices a fit is hardly more than its prior.
const LEAST_CHOICES: u64 = 20;
/// The sources with the most choices that are compared: each takes two fits of every model.
const MOST_SOURCES: usize = 8;

/// The comparisons of sources of one server.
pub type SourceFits = OnDemand<SourceFitInput>;

/// What is to be fitted, with the hash of all that it depends on.
#[derive(Debug, Clone)]
pub struct SourceFitInput {
    design: FactorDesign,
    hash: String,
}

/// Where people of a study came from, and what can be compared.
#[derive(Debug, Clone)]
pub struct SourceComparison {
    /// Every source that somebody with a fitted choice came from, people without a label first, then by name.
    pub sources: Vec<StudySource>,
    /// The fits; none where fewer than two sources have enough choices.
    pub input: Option<SourceFitInput>,
}

/// People from one source.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct StudySource {
    /// The label of their links; null for those who had none.
    pub source: Option<String>,
    /// How many people gave answers that count.
    pub people: u64,
    /// How many of these are choices that the plan fits.
    pub n: u64,
    /// Why it is not compared; null if it is.
    pub left_out: Option<LeftOutReason>,
}

/// Why a source is not compared with others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LeftOutReason {
    /// It has fewer than twenty choices.
    TooFew,
    /// Eight others have more.
    TooMany,
}

impl LeftOutReason {
    /// The reason in words.
    pub fn words(self) -> String {
        match self {
            Self::TooFew => format!("fewer than {LEAST_CHOICES} choices"),
            Self::TooMany => format!("{MOST_SOURCES} others have more choices"),
        }
    }
}

impl SourceComparison {
    /// What can be compared of a study with one of its plans.
    ///
    /// * `choices`, `people`: of the study's analysis set, by source.
    pub fn new(
        snapshot: &Snapshot,
        plan: &FitPlan,
        choices: &[SourceCount],
        people: &[(Option<String>, u64)],
    ) -> Self {
        let study = &snapshot.study;
        let mut by_source: BTreeMap<Option<&str>, Vec<&SourceCount>> = BTreeMap::new();
        for count in choices {
            let of_source = by_source.entry(count.source.as_deref()).or_default();
            of_source.push(count);
        }
        let mut inputs: BTreeMap<Option<&str>, Vec<FitInput>> = BTreeMap::new();
        let mut sources: Vec<StudySource> = Vec::new();
        for (source, counts) in by_source {
            let of_source =
                FitInput::of_plan(study, plan, study.models(), &study_counts(study, &counts));
            let n = choices_in(&of_source);
            if n == 0 {
                continue;
            }
            let known = people.iter().find(|(known, _)| known.as_deref() == source);
            sources.push(StudySource {
                source: source.map(str::to_owned),
                people: known.map_or(0, |(_, people)| *people),
                n,
                left_out: (n < LEAST_CHOICES).then_some(LeftOutReason::TooFew),
            });
            inputs.insert(source, of_source);
        }
        leave_out_the_smallest(&mut sources);
        let compared: Vec<(&StudySource, &Vec<FitInput>)> = sources
            .iter()
            .filter(|source| source.left_out.is_none())
            .filter_map(|source| Some((source, inputs.get(&source.source.as_deref())?)))
            .collect();
        let input = (compared.len() > 1).then(|| SourceFitInput::new(&compared));
        Self { sources, input }
    }
}

/// Of the sources that have enough choices, those with the most stay.
fn leave_out_the_smallest(sources: &mut [StudySource]) {
    let mut sizes: Vec<usize> = (0..sources.len())
        .filter(|&index| sources[index].left_out.is_none())
        .collect();
    // Stable: of equally large ones the first stays.
    sizes.sort_by_key(|&index| std::cmp::Reverse(sources[index].n));
    for &index in sizes.iter().skip(MOST_SOURCES) {
        sources[index].left_out = Some(LeftOutReason::TooMany);
    }
}

/// How many choices the parts of a plan hold; every model is fitted to the same.
fn choices_in(inputs: &[FitInput]) -> u64 {
    let Some(first) = inputs.first() else {
        return 0;
    };
    inputs
        .iter()
        .filter(|input| input.model == first.model)
        .map(|input| input.data.n())
        .sum()
}

/// What people from one source chose, in the study's own order.
fn study_counts(study: &Study, counts: &[&SourceCount]) -> StudyCounts {
    let cells = study.cells().iter().map(|cell| {
        let asked = AskedProblem::new(cell.id.to_string(), cell.problem.as_ref());
        let chosen = |action| -> u64 {
            counts
                .iter()
                .filter(|count| count.cell == asked.cell && count.hash == asked.hash)
                .filter(|count| count.action == action)
                .map(|count| count.n)
                .sum()
        };
        QuestionCounts {
            actions: cell
                .actions
                .iter()
                .map(|action| chosen(action.id.clone()))
                .collect(),
            ..QuestionCounts::default()
        }
    });
    StudyCounts {
        cells: cells.collect(),
        baseline: Vec::new(),
    }
}

impl SourceFitInput {
    /// Two sources at least, each with the same parts and models.
    fn new(compared: &[(&StudySource, &Vec<FitInput>)]) -> Self {
        let levels: Vec<(Option<String>, Option<u64>)> = compared
            .iter()
            .map(|(source, _)| (source.source.clone(), Some(source.people)))
            .collect();
        let parts = compared[0].1.iter().enumerate().map(|(index, input)| {
            let of_part = compared.iter().map(|(_, inputs)| &inputs[index].data);
            let levels: Vec<ChoiceData> = of_part.cloned().collect();
            FactorPart {
                id: input.part.to_string(),
                label: input.label.clone(),
                model: input.model,
                settings: input.settings.clone(),
                levels,
            }
        });
        let mut names = Vec::new();
        for (level, people) in &levels {
            names.push(format!("{level:?} {people:?}"));
        }
        let hashes = compared
            .iter()
            .flat_map(|(_, inputs)| inputs.iter())
            .map(|input| input.hash.as_str());
        Self {
            hash: hash_of(names.iter().map(String::as_str).chain(hashes)),
            design: FactorDesign {
                factor: FACTOR.to_owned(),
                levels,
                parts: parts.collect(),
            },
        }
    }
}

impl Work for SourceFitInput {
    type Output = FactorReport;

    const NAME: &'static str = "source fits";

    fn hash(&self) -> &str {
        &self.hash
    }

    fn fits(&self) -> usize {
        self.design.fits()
    }

    fn run(
        &self,
        watch: &mut dyn FnMut(usize) -> ControlFlow<()>,
    ) -> Result<FactorReport, FitError> {
        compare_levels(&self.design, watch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_of_many_sources_are_left_out_and_the_order_stays() {
        let mut sources: Vec<StudySource> = (0..11)
            .map(|index| StudySource {
                source: Some(format!("s{index:02}")),
                people: 5,
                n: 100 - index % 3,
                left_out: (index == 4).then_some(LeftOutReason::TooFew),
            })
            .collect();
        leave_out_the_smallest(&mut sources);
        let kept = |source: &&StudySource| source.left_out.is_none();
        assert_eq!(sources.iter().filter(kept).count(), MOST_SOURCES);
        // Of those with 98 choices the last goes first.
        let gone: Vec<&str> = sources
            .iter()
            .filter(|source| source.left_out == Some(LeftOutReason::TooMany))
            .filter_map(|source| source.source.as_deref())
            .collect();
        assert_eq!(gone, ["s05", "s08"]);
        assert_eq!(sources[4].left_out, Some(LeftOutReason::TooFew));
    }
}
