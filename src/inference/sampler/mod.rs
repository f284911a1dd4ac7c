//! A Metropolis–Hastings sampler that knows no model.
//!
//! A fit has two parts. A warm-up ([`warm_up`]) carries a population of points from the prior to the posterior through
//! tempered densities, so that no mode is lost because all chains began in another, and fits a [`Proposal`] to it.
//! Then chains ([`run_chains`]) start from points of a tempered density, more widely spread than the posterior, and every
//! draw comes from one kernel that was fixed before and is reversible with respect to the posterior. Between rounds the
//! proposal may be fitted again; draws of earlier rounds are then dropped.
//!
//! Sources: Del Moral, Doucet & Jasra (2006) for the tempered population; Tierney (1994) for independence proposals
//! and mixtures of kernels.

mod chains;
mod evidence;
mod proposal;
mod warm_up;

use std::ops::ControlFlow;

use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;

pub use chains::{Chains, run_chains};
pub use evidence::ln_evidence;
pub use proposal::Proposal;
pub use warm_up::{WarmUp, warm_up};

/// A posterior density on unconstrained coordinates, up to a constant, in its two factors.
///
/// Evaluation may use scratch space (`&mut self`) but must be a pure function of the position.
pub trait LogDensity {
    /// How many coordinates there are, at least 1.
    fn dimension(&self) -> usize;

    /// The density at a position of [`dimension`](Self::dimension) finite coordinates; −∞ where it vanishes, never NaN.
    fn evaluate(&mut self, position: &[f64]) -> LnDensity;

    /// A position drawn from the prior.
    fn draw_prior(&mut self, rng: &mut ChaCha12Rng) -> Vec<f64>;
}

/// The logarithms of the two factors of a posterior density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LnDensity {
    /// ln prior density, Jacobian included.
    pub prior: f64,
    /// ln likelihood.
    pub likelihood: f64,
}

impl LnDensity {
    /// ln posterior density up to a constant.
    pub fn posterior(self) -> f64 {
        self.tempered(1.0)
    }

    /// ln of prior × likelihood^`temperature`, −∞ where either vanishes.
    fn tempered(self, temperature: f64) -> f64 {
        if temperature == 0.0 {
            self.prior
        } else {
            self.prior + temperature * self.likelihood
        }
    }
}

/// Asked now and then during long work; `Break` stops it.
pub type Watch<'a> = dyn FnMut() -> ControlFlow<()> + 'a;

/// The work was stopped by its [`Watch`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Stopped;

/// The random stream number `stream` of a seed: streams of one seed are independent of each other.
pub fn random_stream(seed: u64, stream: u64) -> ChaCha12Rng {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

#[cfg(test)]
pub(crate) mod tests {
    use rand::RngExt;
    use rand_distr::StandardNormal;

    use super::*;
    use crate::inference::diagnostics::{Convergence, mean, variance};

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

        fn evaluate(&mut self, position: &[f64]) -> LnDensity {
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
            LnDensity {
                prior: square(&origin, PRIOR_SD),
                likelihood: bumps.ln(),
            }
        }

        fn draw_prior(&mut self, rng: &mut ChaCha12Rng) -> Vec<f64> {
            (0..self.dimension())
                .map(|_| PRIOR_SD * rng.sample::<f64, _>(StandardNormal))
                .collect()
        }
    }

    fn sample(density: &mut Normals, seed: u64) -> Chains {
        let mut watch = || ControlFlow::Continue(());
        let warm = warm_up(density, seed, &mut watch).unwrap();
        run_chains(
            density,
            &warm.proposal,
            &warm.starts(8),
            seed,
            0,
            500,
            3,
            &mut watch,
        )
        .unwrap()
    }

    fn column(chains: &Chains, coordinate: usize) -> Vec<Vec<f64>> {
        let one = |chain: &Vec<Vec<f64>>| chain.iter().map(|x| x[coordinate]).collect();
        chains.positions.iter().map(one).collect()
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
            let values = column(&chains, coordinate);
            let slices: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
            let convergence = Convergence::of(&slices);
            assert!(convergence.is_converged(), "{convergence:?}");
            let pooled = values.concat();
            let error = 4.0 * (1.0 / precision / convergence.ess_bulk).sqrt();
            assert!((mean(&pooled) - 4.0 * centre / precision).abs() < error);
            assert!((variance(&pooled) * precision - 1.0).abs() < 0.15);
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
        let values = column(&chains, 0);
        let slices: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        assert!(Convergence::of(&slices).is_converged());
        let pooled = values.concat();
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
        let narrow = Proposal::fit(&[vec![8.0], vec![8.01], vec![7.98], vec![8.03]], 1, 5);
        let starts: Vec<Vec<f64>> = [8.0, -8.0, 8.0, -8.0].map(|x| vec![x]).to_vec();
        let mut watch = || ControlFlow::Continue(());
        let chains = run_chains(&mut density, &narrow, &starts, 5, 0, 400, 1, &mut watch).unwrap();
        let values = column(&chains, 0);
        let slices: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        assert!(Convergence::of(&slices).rhat > 1.5);
    }

    #[test]
    fn the_same_seed_gives_the_same_draws_and_another_seed_others() {
        let mut density = Normals {
            centres: vec![vec![1.0, 1.0]],
            sd: 0.7,
        };
        let first = sample(&mut density, 3);
        assert_eq!(first.positions, sample(&mut density, 3).positions);
        assert_ne!(first.positions, sample(&mut density, 4).positions);
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
