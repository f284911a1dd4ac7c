//! The log-posterior of P1 to P4 with its gradient, written by hand for NUTS.
//!
//! All four are choices between a sure reward and one risky reward or nothing, so that everything follows from the gap
//! of utilities G(φ) of each gamble, with the reference reward worth 1:
//!
//! ```text
//! gains:    G = w⁺(p) − r^α                r = |sure| / |risky|
//! losses:   G = r^β − π̄,   π̄ = w⁻(p) / (w⁻(p) + w⁺(1 − p))
//! rewards:  G = (p R − S) / |R_ref|
//!
//! ln L = Σ n_risky ln σ(τ G) + n_sure ln σ(−τ G)
//! ```
//!
//! Coordinates are those of `riskaware::inference::LnPosterior`: logits within the priors' bounds, and
//! s = ln τ + ½ ln(0.02² + Σ n G² / Σ n) last; or, as one would write it without knowing of the funnel, s = ln τ.

use riskaware::inference::{ChoiceData, Prior, Priors, default_reference_reward};
use riskaware::model::{ChoiceModel, NOISY_RATIONAL};

use crate::posteriors::Case;

/// Keeps s finite where utilities do not differ, as in riskaware.
const SPREAD_FLOOR: f64 = 0.02;

/// What the sensitivity's coordinate is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensitivity {
    /// s = ln τ.
    Plain,
    /// s = ln τ + ½ ln(0.02² + Σ n G² / Σ n).
    FunnelRemoved,
}

/// How utilities come about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Noisy Rational: expected rewards.
    Rewards,
    /// Risk-Aware with gains only: α and γ.
    Gains,
    /// Risk-Aware with losses only: β, γ and δ.
    Losses,
}

/// A sure reward or a risky one, with how often each was chosen.
#[derive(Debug, Clone, Copy)]
struct Gamble {
    /// Probability of the risky reward.
    p: f64,
    /// |sure| / |risky|.
    ratio: f64,
    /// Gap of expected rewards, risky less sure, over |R_ref|.
    reward_gap: f64,
    risky: f64,
    sure: f64,
}

/// A log-posterior with its gradient.
#[derive(Debug, Clone)]
pub struct Density {
    kind: Kind,
    sensitivity: Sensitivity,
    gambles: Vec<Gamble>,
    answers: f64,
    /// |R_ref|.
    reference: f64,
    /// Lower bound of the priors of γ and δ.
    floor: f64,
    /// Mean and standard deviation of ln τ.
    ln_tau: [f64; 2],
    gaps: Vec<Gap>,
}

/// G and its derivatives by the coordinates before s.
#[derive(Debug, Clone, Copy, Default)]
struct Gap {
    value: f64,
    by: [f64; 3],
}

impl Density {
    /// The density of one of P1 to P4.
    ///
    /// # Panics
    /// When the case is none of those.
    pub fn of(case: &Case, sensitivity: Sensitivity) -> Self {
        let reference =
            default_reference_reward(case.data.problems()).expect("there are rewards other than 0");
        let gambles = gambles(&case.data, reference.abs());
        let Priors { gamma, tau, .. } = case.settings.priors;
        let (Prior::Uniform { low, .. }, Prior::LogNormal { median, log_sd }) = (gamma, tau) else {
            panic!("the four posteriors have the default kinds of priors");
        };
        Self {
            kind: kind(case.model, reference),
            sensitivity,
            answers: gambles
                .iter()
                .map(|gamble| gamble.risky + gamble.sure)
                .sum(),
            gaps: vec![Gap::default(); gambles.len()],
            gambles,
            reference: reference.abs(),
            floor: low,
            ln_tau: [median.ln(), log_sd],
        }
    }

    /// How many coordinates there are.
    pub fn dimension(&self) -> usize {
        1 + self.shape()
    }

    /// The coordinates before s.
    fn shape(&self) -> usize {
        match self.kind {
            Kind::Rewards => 0,
            Kind::Gains => 2,
            Kind::Losses => 3,
        }
    }

    /// ln density, with its gradient.
    pub fn evaluate(&mut self, position: &[f64], gradient: &mut [f64]) -> f64 {
        let shape = self.shape();
        let mut ln_density = 0.0;
        for (slope, x) in gradient.iter_mut().zip(&position[..shape]) {
            // ln σ(x) + ln σ(−x), whose slope is 1 − 2 σ(x).
            ln_density += ln_logistic(*x) + ln_logistic(-x);
            *slope = 1.0 - 2.0 * logistic(*x);
        }
        self.find_gaps(position);
        let (shift, shift_by) = self.shift();
        let ln_tau = position[shape] - shift;
        let tau = ln_tau.exp();
        let z = (ln_tau - self.ln_tau[0]) / self.ln_tau[1];
        ln_density -= 0.5 * z * z;
        // Of the density by ln τ, the other coordinates held.
        let mut by_ln_tau = -z / self.ln_tau[1];
        for (gamble, gap) in self.gambles.iter().zip(&self.gaps) {
            let logit = tau * gap.value;
            ln_density += gamble.risky * ln_logistic(logit) + gamble.sure * ln_logistic(-logit);
            let by_logit = gamble.risky - (gamble.risky + gamble.sure) * logistic(logit);
            by_ln_tau += by_logit * logit;
            for (slope, by) in gradient.iter_mut().zip(&gap.by[..shape]) {
                *slope += by_logit * tau * by;
            }
        }
        for (slope, by) in gradient.iter_mut().zip(&shift_by[..shape]) {
            *slope -= by_ln_tau * by;
        }
        gradient[shape] = by_ln_tau;
        ln_density
    }

    /// What draws are judged by: parameters, τ, θ (with losses only λθ), and the probability of each risky choice.
    pub fn quantities(&mut self, position: &[f64]) -> Vec<f64> {
        self.find_gaps(position);
        let tau = (position[self.shape()] - self.shift().0).exp();
        let mut quantities = Vec::new();
        match self.kind {
            Kind::Rewards => {}
            Kind::Gains | Kind::Losses => {
                let curvature = logistic(position[0]);
                quantities.push(curvature);
                quantities.push(tau / self.reference.powf(curvature));
            }
        }
        for x in position.iter().take(self.shape()).skip(1) {
            quantities.push(self.floor + (1.0 - self.floor) * logistic(*x));
        }
        quantities.push(tau);
        quantities.extend(self.gaps.iter().map(|gap| logistic(tau * gap.value)));
        quantities
    }

    /// s − ln τ, with its derivatives.
    fn shift(&self) -> (f64, [f64; 3]) {
        match self.sensitivity {
            Sensitivity::Plain => (0.0, [0.0; 3]),
            Sensitivity::FunnelRemoved => {
                let mut squares = 0.0;
                let mut by = [0.0; 3];
                for (gamble, gap) in self.gambles.iter().zip(&self.gaps) {
                    let n = gamble.risky + gamble.sure;
                    squares += n * gap.value * gap.value;
                    for (sum, slope) in by.iter_mut().zip(gap.by) {
                        *sum += n * gap.value * slope;
                    }
                }
                let inside = SPREAD_FLOOR * SPREAD_FLOOR + squares / self.answers;
                (
                    0.5 * inside.ln(),
                    by.map(|sum| sum / (self.answers * inside)),
                )
            }
        }
    }

    fn find_gaps(&mut self, position: &[f64]) {
        let kind = self.kind;
        if kind == Kind::Rewards {
            for (gap, gamble) in self.gaps.iter_mut().zip(&self.gambles) {
                gap.value = gamble.reward_gap;
            }
            return;
        }
        let (curvature, curvature_by) = bounded(position[0], 0.0);
        let (gamma, gamma_by) = bounded(position[1], self.floor);
        for (gap, gamble) in self.gaps.iter_mut().zip(&self.gambles) {
            let bent = gamble.ratio.powf(curvature);
            let bent_by = bent * gamble.ratio.ln() * curvature_by;
            if kind == Kind::Gains {
                let (ln_w, by_gamma) = ln_weighting(gamble.p, gamma);
                let w = ln_w.exp();
                gap.value = w - bent;
                gap.by = [-bent_by, w * by_gamma * gamma_by, 0.0];
            } else {
                let (delta, delta_by) = bounded(position[2], self.floor);
                let (ln_loss, by_delta) = ln_weighting(gamble.p, delta);
                let (ln_nothing, by_gamma) = ln_weighting(1.0 - gamble.p, gamma);
                let share = logistic(ln_loss - ln_nothing);
                let slope = share * (1.0 - share);
                gap.value = bent - share;
                gap.by = [
                    bent_by,
                    slope * by_gamma * gamma_by,
                    -slope * by_delta * delta_by,
                ];
            }
        }
    }
}

fn kind(model: &ChoiceModel, reference: f64) -> Kind {
    if model.id == NOISY_RATIONAL.id {
        Kind::Rewards
    } else if reference > 0.0 {
        Kind::Gains
    } else {
        Kind::Losses
    }
}

/// The gambles of the data, equal ones merged.
fn gambles(data: &ChoiceData, reference: f64) -> Vec<Gamble> {
    let mut merged: Vec<Gamble> = Vec::new();
    for (problem, counts) in data.problems().iter().zip(data.totals()) {
        let actions = problem.problem.actions();
        let outcomes = |action: usize| actions[action].prospect.outcomes();
        let sure = usize::from(outcomes(0).len() > 1);
        let risky = 1 - sure;
        assert!(
            actions.len() == 2 && outcomes(sure).len() == 1,
            "a sure reward against a risky one"
        );
        let prize = outcomes(risky)
            .iter()
            .find(|outcome| outcome.reward != 0.0)
            .expect("the risky action has a reward");
        let certain = outcomes(sure)[0].reward;
        let gamble = Gamble {
            p: prize.probability,
            ratio: (certain / prize.reward).abs(),
            reward_gap: (prize.probability * prize.reward - certain) / reference,
            risky: counts[risky] as f64,
            sure: counts[sure] as f64,
        };
        match merged
            .iter_mut()
            .find(|known| known.p == gamble.p && known.ratio == gamble.ratio)
        {
            Some(known) => {
                known.risky += gamble.risky;
                known.sure += gamble.sure;
            }
            None => merged.push(gamble),
        }
    }
    merged
}

/// low + (1 − low) σ(x), with its derivative.
fn bounded(x: f64, low: f64) -> (f64, f64) {
    let share = logistic(x);
    let width = 1.0 - low;
    (low + width * share, width * share * (1.0 - share))
}

/// ln w(p) of Tversky and Kahneman, with its derivative by the exponent.
fn ln_weighting(p: f64, exponent: f64) -> (f64, f64) {
    let (ln_p, ln_q) = (p.ln(), (1.0 - p).ln());
    let (first, second) = (exponent * ln_p, exponent * ln_q);
    let share = logistic(first - second);
    // ln(p^γ + q^γ) = γ ln p − ln σ(γ ln p − γ ln q)
    let ln_sum = first - ln_logistic(first - second);
    let ln_sum_by = share * ln_p + (1.0 - share) * ln_q;
    (
        first - ln_sum / exponent,
        ln_p - ln_sum_by / exponent + ln_sum / (exponent * exponent),
    )
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

fn ln_logistic(x: f64) -> f64 {
    if x >= 0.0 {
        -(-x).exp().ln_1p()
    } else {
        x - x.exp().ln_1p()
    }
}
