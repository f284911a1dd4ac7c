//! A posterior density by itself, for measurements and checks.

use super::lanes::LaneRandom;
use super::likelihood::Predictor;
use super::posterior::Posterior;
use super::sampler::{Chains, LnDensities, LogDensity, random_stream};
use super::{ChoiceData, Draws, FitError, FitSettings};
use crate::model::ChoiceModel;

/// The posterior density of a model on the coordinates that a fit moves.
///
/// As a [`LogDensity`] it can be sampled with the parts of [`sampler`](super::sampler).
#[derive(Debug, Clone)]
pub struct LnPosterior {
    posterior: Posterior,
    predictor: Predictor,
}

impl LnPosterior {
    /// The posterior that [`fit`](super::fit()) draws from.
    ///
    /// # Errors
    /// As [`fit`](super::fit()).
    pub fn new(
        model: &'static ChoiceModel,
        data: &ChoiceData,
        settings: &FitSettings,
    ) -> Result<Self, FitError> {
        let problems = data.problems().iter().map(|problem| &problem.problem);
        Ok(Self {
            posterior: settings.posterior(model, data)?,
            predictor: Predictor::new(problems, model.options(settings.options)),
        })
    }

    /// How many coordinates there are: inert parameters have none.
    pub fn dimension(&self) -> usize {
        self.posterior.dimension()
    }

    /// ln posterior density at a position, without the marginal likelihood.
    pub fn at(&mut self, position: &[f64]) -> f64 {
        self.posterior.ln_density(position)
    }

    /// ln posterior density at `W` positions at once, `positions[coordinate][lane]`. The number of lanes does not change
    /// a bit of it.
    pub fn at_lanes<const W: usize>(&mut self, positions: &[[f64; W]]) -> [f64; W] {
        self.posterior.evaluate(positions).posterior()
    }

    /// What chains on these coordinates say about the parameters; a seed for those that have no coordinate.
    pub fn draws(&mut self, chains: &Chains, seed: u64) -> Draws {
        self.posterior.draws(chains, &mut random_stream(seed, 0))
    }

    /// ln P(a) by draw for every action but the last of every problem, equal problems once.
    pub fn ln_predicted(&mut self, draws: &Draws) -> Vec<Vec<f64>> {
        let mut columns = self.predictor.of_draws(draws);
        self.predictor
            .distinct_ranges()
            .flat_map(|range| range.start..range.end - 1)
            .map(|column| std::mem::take(&mut columns[column]))
            .collect()
    }
}

impl LogDensity for LnPosterior {
    fn dimension(&self) -> usize {
        self.posterior.dimension()
    }

    fn evaluate<const W: usize>(&mut self, positions: &[[f64; W]]) -> LnDensities<W> {
        self.posterior.evaluate(positions)
    }

    fn draw_prior<const W: usize>(&mut self, random: &mut LaneRandom, positions: &mut [[f64; W]]) {
        self.posterior.draw_prior(random, positions);
    }
}
