//! A Metropolis–Hastings sampler that knows no model.
//!
//! A cold fit has three parts. A warm-up ([`warm_up`]) carries a population of points from the prior to the posterior
//! through tempered densities, so that no mode is lost because all chains began in another, and fits a [`Proposal`] to it;
//! [`adapt`] improves that by importance sampling. Then chains ([`run_chains`]) start from points of a tempered density, more
//! widely spread than the posterior, and every draw comes from kernels that were fixed before and are each reversible with
//! respect to the posterior. Between rounds the proposal may be fitted again; draws of earlier rounds are then dropped.
//! A warm fit has the last part only.
//!
//! Everything is computed for blocks of positions ([`lanes`](super::lanes)).
//!
//! Sources: Del Moral, Doucet & Jasra (2006) for the tempered population; Cappé et al. (2008) for the adaptation; Tierney
//! (1994) for independence proposals and sequences of kernels.

mod chains;
mod cloud;
mod evidence;
mod expectation_maximisation;
mod proposal;
mod triangle;
mod warm_up;

use std::ops::ControlFlow;

use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;

use super::lanes::{LANES, LaneRandom};
pub use chains::{Chains, Run, run_chains};
pub use cloud::Cloud;
pub use evidence::ln_evidence;
pub use proposal::Proposal;
pub use warm_up::{WarmUp, adapt, warm_up};

/// Positions that are evaluated at once where nothing asks for another number: four steps of eight chains.
pub const BLOCK: usize = 4 * LANES;

/// A posterior density on unconstrained coordinates, up to a constant, in its two factors.
///
/// Evaluation may use scratch space (`&mut self`) but must be a pure function of each position, whatever its lane.
pub trait LogDensity {
    /// How many coordinates there are, at least 1.
    fn dimension(&self) -> usize;

    /// The density at `W` positions of [`dimension`](Self::dimension) coordinates, `positions[coordinate][lane]`; −∞ where
    /// it vanishes, never NaN if the coordinates are finite.
    fn evaluate<const W: usize>(&mut self, positions: &[[f64; W]]) -> LnDensities<W>;

    /// Positions drawn from the prior.
    fn draw_prior<const W: usize>(&mut self, random: &mut LaneRandom, positions: &mut [[f64; W]]);
}

/// The logarithms of the two factors of a posterior density, in lanes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LnDensities<const W: usize> {
    /// ln prior density, Jacobian included.
    pub prior: [f64; W],
    /// ln likelihood.
    pub likelihood: [f64; W],
}

impl<const W: usize> LnDensities<W> {
    /// ln posterior density up to a constant.
    #[inline(always)]
    pub fn posterior(&self) -> [f64; W] {
        std::array::from_fn(|lane| self.prior[lane] + self.likelihood[lane])
    }
}

/// Asked now and then during long work; `Break` stops it.
pub type Watch<'a> = dyn FnMut() -> ControlFlow<()> + 'a;

/// The work was stopped by its [`Watch`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// Numbers of the random streams that are not those of chains and warm-up, each for one purpose.
///
/// Chains count up in each round of a fit from a multiple of 2³², and the warm-up begins at 0, so all of these lie far
/// above; the fit of mixtures has the last one. A purpose that needs several streams counts up from its number, by less
/// than 2³². 2⁴⁰ and 2⁴¹ are taken as well: a fit draws inert parameters and its evidence from them.
pub mod streams {
    /// Adaptation of a proposal, one per round.
    pub const ADAPTATION: u64 = 1 << 42;
    /// People drawn anew for tests on choices, one per comparison.
    pub const CHOICE_TESTS: u64 = 1 << 43;
    /// People drawn anew for fits.
    pub const BOOTSTRAP: u64 = 1 << 44;
    /// Answers replicated from a posterior.
    pub const PREDICTIVE_CHECKS: u64 = 1 << 45;
    /// Problems that are held out together.
    pub const FOLDS: u64 = 1 << 46;
}

/// The random stream number `stream` of a seed: streams of one seed are independent of each other.
pub fn random_stream(seed: u64, stream: u64) -> ChaCha12Rng {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::inference::diagnostics::{Convergence, mean, variance};
    use crate::inference::lanes::fill_normals;

    #[test]
    fn streams_of_different_purposes_stay_apart() {
        let mut all = [
            1 << 40,
            1 << 41,
            streams::ADAPTATION,
            streams::CHOICE_TESTS,
            streams::BOOTSTRAP,
            streams::PREDICTIVE_CHECKS,
            streams::FOLDS,
        ];
        all.sort_unstable();
        for pair in all.windows(2) {
            assert!(pair[1] - pair[0] >= 1 << 32, "{pair:?}");
        }
    }

    /// A normal prior times a normal likelihood in each coordinate, or two likelihood bumps far apart.
    struct Normals {
        centres: Vec<Vec<f64>>,
        sd: f64,
    }

    const PRIOR_SD: f64 = 3.0;

    impl LogDensity for Normals {
        fn dimension(&self) -> usize {
            self.centres[0].len()
        }

        fn evaluate<const W: usize>(&mut self, positions: &[[f64; W]]) -> LnDensities<W> {
            let at = |lane: usize| -> Vec<f64> { positions.iter().map(|x| x[lane]).collect() };
            let densities: [[f64; 2]; W] = std::array::from_fn(|lane| self.one(&at(lane)));
            LnDensities {
                prior: densities.map(|density| density[0]),
                likelihood: densities.map(|density| density[1]),
            }
        }

        fn draw_prior<const W: usize>(
            &mut self,
            random: &mut LaneRandom,
            positions: &mut [[f64; W]],
        ) {
            fill_normals(random, positions);
            for x in positions.iter_mut().flatten() {
                *x *= PRIOR_SD;
            }
        }
    }

    impl Normals {
        fn one(&self, position: &[f64]) -> [f64; 2] {
            let square = |centre: &[f64], sd: f64| -> f64 {
                position
                    .iter()
                    .zip(centre)
                    .map(|(x, c)| -0.5 * ((x - c) / sd).powi(2))
                    .sum()
            };
            let origin = vec![0.0; position.len()];
            let bumps: f64 = self
                .centres
                .iter()
                .map(|centre| square(centre, self.sd).exp())
                .sum();
            [square(&origin, PRIOR_SD), bumps.ln()]
        }
    }

    fn sample(density: &mut Normals, seed: u64) -> Chains {
        let mut watch = || ControlFlow::Continue(());
        let warm = warm_up(density, seed, &mut watch).unwrap();
        let run = Run {
            seed,
            stream: 1,
            burn_in: 50,
            draws: 500,
            steps: 3,
        };
        run_chains(density, &warm.proposal, &warm.starts(8), run, &mut watch).unwrap()
    }

    /// Normal prior N(0, 9) and likelihood N(2, ½²): the posterior is normal with precision 1/9 + 4.
    #[test]
    fn a_normal_posterior_is_reproduced() {
        let mut density = Normals {
            centres: vec![vec![2.0, -1.0, 0.5]],
            sd: 0.5,
        };
        let chains = sample(&mut density, 7);
        let precision = 1.0 / 9.0 + 4.0;
        for (coordinate, centre) in [2.0, -1.0, 0.5].into_iter().enumerate() {
            let convergence = Convergence::of(&chains.by_chain(coordinate));
            assert!(convergence.is_converged(), "{convergence:?}");
            let pooled = &chains.coordinates[coordinate];
            let error = 4.0 * (1.0 / precision / convergence.ess_bulk).sqrt();
            assert!((mean(pooled) - 4.0 * centre / precision).abs() < error);
            assert!((variance(pooled) * precision - 1.0).abs() < 0.15);
        }
    }

    /// Two bumps 12 sd apart, symmetric: half of the draws belong to each.
    #[test]
    fn two_modes_get_their_shares() {
        let mut density = Normals {
            centres: vec![vec![3.0, 0.0], vec![-3.0, 0.0]],
            sd: 0.5,
        };
        let chains = sample(&mut density, 11);
        assert!(Convergence::of(&chains.by_chain(0)).is_converged());
        let pooled = &chains.coordinates[0];
        let share = pooled.iter().filter(|x| **x > 0.0).count() as f64 / pooled.len() as f64;
        assert!((share - 0.5).abs() < 0.08, "{share}");
    }

    /// A kernel that does not reach the other mode must be noticed: the chains disagree.
    #[test]
    fn chains_that_stay_in_their_modes_are_noticed() {
        let mut density = Normals {
            centres: vec![vec![8.0], vec![-8.0]],
            sd: 0.05,
        };
        let near = Cloud::new(vec![vec![8.0, 8.01, 7.98, 8.03]]);
        let narrow = Proposal::fit(&near, 1, 5);
        let starts: Vec<Vec<f64>> = [8.0, -8.0, 8.0, -8.0].map(|x| vec![x]).to_vec();
        let mut watch = || ControlFlow::Continue(());
        let run = Run {
            seed: 5,
            stream: 1,
            burn_in: 50,
            draws: 400,
            steps: 1,
        };
        let chains = run_chains(&mut density, &narrow, &starts, run, &mut watch).unwrap();
        assert!(Convergence::of(&chains.by_chain(0)).rhat > 1.5);
    }

    #[test]
    fn the_same_seed_gives_the_same_draws_and_another_seed_others() {
        let mut density = Normals {
            centres: vec![vec![1.0, 1.0]],
            sd: 0.7,
        };
        let first = sample(&mut density, 3);
        assert_eq!(first, sample(&mut density, 3));
        assert_ne!(first, sample(&mut density, 4));
    }

    #[test]
    fn work_stops_when_asked() {
        let mut density = Normals {
            centres: vec![vec![1.0, 1.0]],
            sd: 0.7,
        };
        let mut asked = 0;
        let mut watch = || {
            asked += 1;
            if asked < 3 {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        };
        assert_eq!(
            warm_up(&mut density, 1, &mut watch).map(|_| ()),
            Err(Stopped)
        );
        assert_eq!(asked, 3);
    }
}
