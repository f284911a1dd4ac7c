//! The fits of a factor's levels.

use std::ops::ControlFlow;

use sha2::{Digest, Sha256};

use super::FactorEvidence;
use super::report::{
    Against, Contrast, FactorLevel, FactorModelReport, FactorPartReport, FactorReport, LevelFit,
};
use crate::inference::{ChoiceData, Fit, FitError, FitSettings, fit};
use crate::model::{ChoiceModel, OrderedMap};

/// Choices split by a factor, and the models to be fitted to them.
#[derive(Debug, Clone)]
pub struct FactorDesign {
    /// The factor, such as `source`.
    pub factor: String,
    /// The name of each level, none for people without one, and how many people it has where that is known.
    pub levels: Vec<(Option<String>, Option<u64>)>,
    /// What is fitted. Those of one model belong together, and each has its own choices: the parts of a plan.
    pub parts: Vec<FactorPart>,
}

/// One model and one part of the choices.
#[derive(Debug, Clone)]
pub struct FactorPart {
    /// The part's id.
    pub id: String,
    /// Its text on pages.
    pub label: String,
    /// The model.
    pub model: &'static ChoiceModel,
    /// The settings of the shared fit. The others have seeds of their own that follow from this one and the level's name,
    /// because posteriors that are held against each other must not share random numbers.
    pub settings: FitSettings,
    /// The choices of each level, all of the same problems.
    pub levels: Vec<ChoiceData>,
}

impl FactorDesign {
    /// How many fits it takes: for each model and part one to all, one to each level, and, where there are more than two
    /// levels, one to all others of each.
    pub fn fits(&self) -> usize {
        let levels = self.levels.len();
        let rests = if levels > 2 { levels } else { 0 };
        self.parts.len() * (1 + levels + rests)
    }

    fn choices(&self) -> Vec<u64> {
        let of_level = |level: usize| {
            let Some(first) = self.parts.first() else {
                return 0;
            };
            let parts = self.parts.iter();
            parts
                .filter(|part| part.model == first.model)
                .map(|part| part.levels[level].n())
                .sum()
        };
        (0..self.levels.len()).map(of_level).collect()
    }
}

/// Fits every model to every level, to all levels together and to the others of each level, and compares them.
///
/// Like a fit it is a pure function of its arguments. `watch` hears how many fits are done, many times a second, and stops
/// the work by answering `Break`.
///
/// # Errors
/// As [`fit`].
pub fn compare_levels(
    design: &FactorDesign,
    watch: &mut dyn FnMut(usize) -> ControlFlow<()>,
) -> Result<FactorReport, FitError> {
    let mut done = 0;
    let mut models: Vec<ModelFits> = Vec::new();
    for part in &design.parts {
        let mut run = |data: &ChoiceData, settings: &FitSettings| {
            let fitted = fit(part.model, data, settings, &mut |_| watch(done));
            done += 1;
            fitted
        };
        let fits = PartFits::of(design, part, &mut run)?;
        match models.iter_mut().find(|known| known.model == part.model) {
            Some(known) => known.parts.push(fits),
            None => models.push(ModelFits {
                model: part.model,
                parts: vec![fits],
            }),
        }
    }
    let choices = design.choices();
    let levels = design.levels.iter().zip(choices);
    Ok(FactorReport {
        factor: design.factor.clone(),
        levels: levels
            .map(|((level, people), n)| FactorLevel {
                level: level.clone(),
                people: *people,
                n,
            })
            .collect(),
        models: models
            .into_iter()
            .map(|fits| (fits.model.id.to_owned(), fits.report()))
            .collect::<OrderedMap<FactorModelReport>>(),
    })
}

struct ModelFits {
    model: &'static ChoiceModel,
    parts: Vec<PartFits>,
}

struct PartFits {
    shared: Fit,
    levels: Vec<Fit>,
    report: FactorPartReport,
}

impl ModelFits {
    fn report(self) -> FactorModelReport {
        let separate = self.parts.iter().flat_map(|part| &part.levels);
        let shared = self.parts.iter().map(|part| &part.shared);
        FactorModelReport {
            evidence: FactorEvidence::of(
                separate.map(|fit| &fit.summary),
                shared.map(|fit| &fit.summary),
            ),
            parts: self.parts.into_iter().map(|part| part.report).collect(),
        }
    }
}

impl PartFits {
    fn of(
        design: &FactorDesign,
        part: &FactorPart,
        fit: &mut dyn FnMut(&ChoiceData, &FitSettings) -> Result<Fit, FitError>,
    ) -> Result<Self, FitError> {
        let shared = fit(&summed(&part.levels, |_| true), &part.settings)?;
        let seeded = |role: &str, name: &Option<String>| FitSettings {
            seed: seed(part.settings.seed, &design.factor, role, name.as_deref()),
            ..part.settings.clone()
        };
        let mut levels = Vec::with_capacity(part.levels.len());
        for ((name, _), data) in design.levels.iter().zip(&part.levels) {
            levels.push(fit(data, &seeded("level", name))?);
        }
        let mut contrasts = Vec::new();
        if let [(first, _), (second, _)] = design.levels.as_slice() {
            let against = Against::Level {
                other: second.clone(),
            };
            contrasts.extend(Contrast::of(first.clone(), against, &levels[0], &levels[1]));
        } else {
            for (index, (name, _)) in design.levels.iter().enumerate() {
                let rest = summed(&part.levels, |other| other != index);
                let rest = fit(&rest, &seeded("rest", name))?;
                contrasts.extend(Contrast::of(
                    name.clone(),
                    Against::Rest,
                    &levels[index],
                    &rest,
                ));
            }
        }
        Ok(Self {
            report: FactorPartReport {
                part: part.id.clone(),
                label: part.label.clone(),
                shared: LevelFit::of(&shared),
                levels: levels.iter().map(LevelFit::of).collect(),
                contrasts,
            },
            shared,
            levels,
        })
    }
}

/// The choices of some levels together.
fn summed(levels: &[ChoiceData], is_wanted: impl Fn(usize) -> bool) -> ChoiceData {
    let mut totals: Vec<Vec<u64>> = levels[0]
        .totals()
        .iter()
        .map(|row| vec![0; row.len()])
        .collect();
    let wanted = levels
        .iter()
        .enumerate()
        .filter(|(index, _)| is_wanted(*index));
    for (_, level) in wanted {
        for (sums, counts) in totals.iter_mut().zip(level.totals()) {
            for (sum, count) in sums.iter_mut().zip(counts) {
                *sum = sum.saturating_add(*count);
            }
        }
    }
    ChoiceData::from_counts(levels[0].problems().to_vec(), totals)
        .expect("levels that were counted together add up")
}

/// The first 53 bits of SHA-256 over seed, factor, role and level: a seed that every reader of JSON shows exactly.
fn seed(shared: u64, factor: &str, role: &str, level: Option<&str>) -> u64 {
    let mut hash = Sha256::new();
    hash.update(shared.to_le_bytes());
    for name in [factor, role, level.unwrap_or("\0none")] {
        hash.update(name);
        hash.update([0]);
    }
    let first = hash
        .finalize()
        .iter()
        .take(8)
        .fold(0_u64, |number, &byte| number << 8 | u64::from(byte));
    first >> 11
}

#[cfg(test)]
mod tests {
    use super::super::FactorVerdict;
    use super::*;
    use crate::inference::sampler::random_stream;
    use crate::inference::{FittedProblem, SimulatedPerson};
    use crate::model::{ChoiceProblem, NOISY_RATIONAL, Parameter, Parameters};

    fn problems() -> Vec<FittedProblem> {
        let risky = [0.1, 0.3, 0.5, 0.7];
        risky
            .iter()
            .map(|p| FittedProblem {
                id: format!("p{p}"),
                problem: ChoiceProblem::from_outcomes([
                    ("safe", vec![(1.0, 20.0)]),
                    ("risky", vec![(*p, 60.0), (1.0 - *p, 0.0)]),
                ])
                .unwrap(),
            })
            .collect()
    }

    fn people(theta: f64, seed: u64) -> ChoiceData {
        let parameters = Parameters::ONES.with(Parameter::Theta, theta).unwrap();
        let mut rng = random_stream(seed, 0);
        SimulatedPerson::new(parameters, 60.0)
            .choices(&problems(), Default::default(), 60, &mut rng)
            .unwrap()
    }

    fn design(levels: Vec<(&str, ChoiceData)>) -> FactorDesign {
        let (names, levels): (Vec<_>, Vec<_>) = levels
            .into_iter()
            .map(|(name, data)| ((Some(name.to_owned()), Some(60)), data))
            .unzip();
        FactorDesign {
            factor: "source".to_owned(),
            levels: names,
            parts: vec![FactorPart {
                id: "all".to_owned(),
                label: "All".to_owned(),
                model: &NOISY_RATIONAL,
                settings: FitSettings {
                    reference_reward: Some(60.0),
                    draws: 250,
                    ..FitSettings::default()
                },
                levels,
            }],
        }
    }

    fn report(design: &FactorDesign) -> FactorReport {
        let mut most = 0;
        let report = compare_levels(design, &mut |done| {
            most = most.max(done);
            ControlFlow::Continue(())
        });
        assert_eq!(most + 1, design.fits());
        report.unwrap()
    }

    #[test]
    fn people_of_other_sensitivity_are_told_apart_and_others_are_not() {
        let verdict = |report: &FactorReport| {
            let model = report.models.get("noisy_rational").unwrap();
            model.evidence.unwrap().verdict
        };
        let different = report(&design(vec![("a", people(0.02, 1)), ("b", people(0.3, 2))]));
        assert_eq!(verdict(&different), FactorVerdict::Differ);
        let part = &different.models.0[0].1.parts[0];
        let [contrast] = part.contrasts.as_slice() else {
            panic!("one pair: {part:?}");
        };
        let theta = contrast.differences.get("theta").unwrap();
        assert!(
            theta.probability_larger < 0.01 && theta.q95 < 0.0,
            "{theta:?}"
        );
        assert!(theta.informed);
        assert_eq!(different.levels[0].n, 240);

        let same = report(&design(vec![("a", people(0.1, 3)), ("b", people(0.1, 4))]));
        assert_eq!(verdict(&same), FactorVerdict::Alike);
    }

    /// The one set of choices gives one posterior, but not from the same random numbers.
    #[test]
    fn levels_with_equal_choices_share_no_draw() {
        let data = people(0.1, 5);
        let found = report(&design(vec![("a", data.clone()), ("b", data)]));
        let part = &found.models.0[0].1.parts[0];
        let theta = part.contrasts[0].differences.get("theta").unwrap();
        assert!(theta.sd > 0.0);
        assert!((theta.probability_larger - 0.5).abs() < 0.1, "{theta:?}");
        let seeds: std::collections::BTreeSet<u64> =
            part.levels.iter().map(|fit| fit.seed).collect();
        assert_eq!(seeds.len(), 2);
        assert!(seeds.iter().all(|seed| *seed < 1 << 53));
    }

    #[test]
    fn three_levels_are_each_held_against_the_rest() {
        let found = report(&design(vec![
            ("a", people(0.1, 6)),
            ("b", people(0.1, 7)),
            ("c", people(0.1, 8)),
        ]));
        let part = &found.models.0[0].1.parts[0];
        assert_eq!(part.contrasts.len(), 3);
        assert!(
            part.contrasts
                .iter()
                .all(|contrast| contrast.against == Against::Rest)
        );
        assert_eq!(part.contrasts[2].label(), "c − the rest");
        assert_eq!(part.shared.n, 720);
    }

    #[test]
    fn the_order_of_levels_changes_no_fit() {
        let (a, b) = (people(0.1, 9), people(0.2, 10));
        let forth = report(&design(vec![("a", a.clone()), ("b", b.clone())]));
        let back = report(&design(vec![("b", b), ("a", a)]));
        let of = |report: &FactorReport| report.models.0[0].1.clone();
        assert_eq!(of(&forth).parts[0].levels[0], of(&back).parts[0].levels[1]);
        assert_eq!(of(&forth).parts[0].shared, of(&back).parts[0].shared);
    }

    #[test]
    fn the_work_stops_when_it_is_told_to() {
        let design = design(vec![("a", people(0.1, 1)), ("b", people(0.1, 2))]);
        let stopped = compare_levels(&design, &mut |done| {
            if done == 1 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        assert_eq!(stopped, Err(FitError::Stopped));
    }
}
