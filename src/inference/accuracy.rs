//! How far a model's choice probabilities are from what people did.
//!
//! Source: the paper compares models by ln KL over posterior samples, with t-tests over samples; the reference level,
//! smoothed shares and Welch's test stand beside them so that the comparison can be read rightly.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::function::gamma::digamma;

use super::diagnostics::{mean, quantile, variance};

/// Kullback–Leibler divergence of predicted from observed shares, in nats.
///
/// ```text
/// KL = Σ_{f>0} f ln(f/q) = Σ_{f>0} f (x − ln(1 + x)) + Σ_{f=0} q,   x = (q − f)/f
/// ```
///
/// * `observed`: shares f, summing to 1.
/// * `ln_predicted`: ln q, the q summing to 1; −∞ where f > 0 makes the divergence infinite.
///
/// Every term of the second form is ≥ 0, so close agreement keeps its digits. Under q = f/2 nothing cancels, and the term
/// is f (ln f − ln q) − f + q: there 1 + x would lose the digits of q and at last be 0.
pub fn divergence(observed: &[f64], ln_predicted: &[f64]) -> f64 {
    let pairs = observed.iter().zip(ln_predicted);
    pairs
        .map(|(f, ln_q)| {
            let q = ln_q.exp();
            if *f == 0.0 {
                q
            } else if q < f / 2.0 {
                f * (f.ln() - ln_q) - f + q
            } else {
                f * excess((q - f) / f)
            }
        })
        .sum()
}

/// x − ln(1 + x) for x ≥ −½, without cancellation near 0.
fn excess(x: f64) -> f64 {
    if x.abs() < 1e-3 {
        x * x * (1.0 / 2.0 - x * (1.0 / 3.0 - x * (1.0 / 4.0 - x * (1.0 / 5.0 - x / 6.0))))
    } else {
        x - x.ln_1p()
    }
}

/// The ln KL that the true probabilities themselves would score, on average, against `n` answers.
///
/// ```text
/// E[ln KL] ≈ ψ((A − 1)/2) + ln 2 − ln 2n
/// ```
///
/// * `actions`: A ≥ 2; `n` ≥ 1 answers.
///
/// 2n KL is about χ² with A − 1 degrees of freedom (Wilks 1938), whose mean logarithm this is. A score below it means
/// closer to the sample than the truth would be, not better.
pub fn reference_level(actions: usize, n: u64) -> f64 {
    digamma((actions as f64 - 1.0) / 2.0) + std::f64::consts::LN_2 - (2.0 * n as f64).ln()
}

/// ln KL over independent posterior samples. Where a sample's KL is exactly 0 or infinite, mean and sd are missing; where
/// one is no number, all figures are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct LnKl {
    /// Mean.
    pub mean: Option<f64>,
    /// Standard deviation, with n − 1 below.
    pub sd: Option<f64>,
    /// Median.
    pub median: Option<f64>,
    /// 5 % quantile.
    pub q5: Option<f64>,
    /// 95 % quantile.
    pub q95: Option<f64>,
    /// How many samples.
    pub samples: usize,
    /// How many of them have a KL of exactly 0.
    pub exact_zeros: usize,
}

impl LnKl {
    /// The figures of samples, each the ln KL or nothing where KL is exactly 0.
    pub fn of(samples: &[Option<f64>]) -> Self {
        let mut sorted: Vec<f64> = samples
            .iter()
            .map(|ln_kl| ln_kl.unwrap_or(f64::NEG_INFINITY))
            .collect();
        sorted.sort_by(f64::total_cmp);
        let exact_zeros = samples.iter().filter(|ln_kl| ln_kl.is_none()).count();
        let usable = |value: f64| Some(value).filter(|value| value.is_finite());
        let at = |probability| {
            if sorted.is_empty() || sorted.iter().any(|ln_kl| ln_kl.is_nan()) {
                None
            } else {
                usable(quantile(&sorted, probability))
            }
        };
        let whole = exact_zeros == 0 && !sorted.is_empty();
        Self {
            mean: whole.then(|| mean(&sorted)).and_then(usable),
            sd: whole.then(|| variance(&sorted).sqrt()).and_then(usable),
            median: at(0.5),
            q5: at(0.05),
            q95: at(0.95),
            samples: samples.len(),
            exact_zeros,
        }
    }
}

/// How one model does on one cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct CellAccuracy {
    /// The cell's problem id.
    pub problem: String,
    /// How many answers, at least 1.
    pub n: u64,
    /// Observed share of each action.
    pub observed: Vec<f64>,
    /// Whether everybody chose the same: ln KL then falls without bound as sensitivity grows.
    pub unanimous: bool,
    /// What the truth would score on average, see [`reference_level`]; not for a unanimous cell.
    pub reference_level: Option<f64>,
    /// Against the observed shares.
    pub ln_kl: LnKl,
    /// Against smoothed shares (n_a + ½)/(n + A/2).
    pub smoothed: LnKl,
    /// ln KL of each sample, nothing where KL is exactly 0.
    #[serde(with = "stored_samples")]
    #[schema(value_type = Vec<Option<stored_samples::Stored>>)]
    pub samples: Vec<Option<f64>>,
    /// The same against smoothed shares.
    #[serde(with = "stored_samples")]
    #[schema(value_type = Vec<Option<stored_samples::Stored>>)]
    pub smoothed_samples: Vec<Option<f64>>,
}

impl CellAccuracy {
    /// The accuracy of predictions, one list of ln P(a) per sample, against counts. Nothing without answers.
    pub fn of(problem: &str, counts: &[u64], ln_predicted: &[&[f64]]) -> Option<Self> {
        let n: u64 = counts.iter().sum();
        if n == 0 {
            return None;
        }
        let actions = counts.len();
        let observed: Vec<f64> = counts
            .iter()
            .map(|count| *count as f64 / n as f64)
            .collect();
        let smoothed_shares: Vec<f64> = smoothed_shares(counts);
        let against = |shares: &[f64]| -> Vec<Option<f64>> {
            ln_predicted
                .iter()
                .map(|ln_q| ln_divergence(shares, ln_q))
                .collect()
        };
        let (samples, smoothed_samples) = (against(&observed), against(&smoothed_shares));
        let unanimous = counts.contains(&n);
        Some(Self {
            problem: problem.to_owned(),
            n,
            observed,
            unanimous,
            reference_level: (!unanimous).then(|| reference_level(actions, n)),
            ln_kl: LnKl::of(&samples),
            smoothed: LnKl::of(&smoothed_samples),
            samples,
            smoothed_samples,
        })
    }
}

/// Shares (n_a + ½)/(n + A/2), which no unanimity brings to 0 or 1.
pub fn smoothed_shares(counts: &[u64]) -> Vec<f64> {
    let n: u64 = counts.iter().sum();
    let total = n as f64 + counts.len() as f64 / 2.0;
    counts
        .iter()
        .map(|count| (*count as f64 + 0.5) / total)
        .collect()
}

/// ln KL, or nothing if KL is exactly 0; a KL that is infinite or no number stays what it is.
pub fn ln_divergence(observed: &[f64], ln_predicted: &[f64]) -> Option<f64> {
    let divergence = divergence(observed, ln_predicted);
    (divergence != 0.0).then(|| divergence.ln())
}

/// Samples in JSON, which knows no infinity: null is a KL of exactly 0, so what is not finite is written as text.
mod stored_samples {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    #[derive(Serialize, Deserialize, utoipa::ToSchema)]
    #[schema(as = StoredSample)]
    #[serde(untagged)]
    pub enum Stored {
        Finite(f64),
        NotFinite(String),
    }

    pub(super) fn serialize<S: Serializer>(
        samples: &[Option<f64>],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(samples.iter().map(|sample| {
            sample.map(|ln_kl| {
                if ln_kl.is_finite() {
                    Stored::Finite(ln_kl)
                } else {
                    Stored::NotFinite(ln_kl.to_string())
                }
            })
        }))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<Option<f64>>, D::Error> {
        let number = |stored| match stored {
            Stored::Finite(ln_kl) => Ok(ln_kl),
            Stored::NotFinite(text) => text.parse().map_err(D::Error::custom),
        };
        let samples: Vec<Option<Stored>> = Vec::deserialize(deserializer)?;
        samples
            .into_iter()
            .map(|sample| sample.map(number).transpose())
            .collect()
    }
}

/// Which shares pooled figures are made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shares {
    /// Observed shares; unanimous cells are left out.
    Observed,
    /// Smoothed shares; all cells.
    Smoothed,
}

impl Shares {
    fn samples(self, cell: &CellAccuracy) -> Option<&[Option<f64>]> {
        match self {
            Self::Observed => (!cell.unanimous).then_some(cell.samples.as_slice()),
            Self::Smoothed => Some(&cell.smoothed_samples),
        }
    }
}

/// ln KL over the samples of several cells together.
pub fn pooled(cells: &[&CellAccuracy], shares: Shares) -> LnKl {
    let samples: Vec<Option<f64>> = cells
        .iter()
        .filter_map(|cell| shares.samples(cell))
        .flatten()
        .copied()
        .collect();
    LnKl::of(&samples)
}

/// A t-test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TTest {
    /// The statistic.
    pub t: f64,
    /// Degrees of freedom.
    pub df: f64,
    /// Two-sided p.
    pub p: f64,
}

impl TTest {
    /// A mean difference against its standard error; nothing if that is 0 or not a number.
    fn of(difference: f64, standard_error: f64, df: f64) -> Option<Self> {
        let t = difference / standard_error;
        let distribution = StudentsT::new(0.0, 1.0, df).ok()?;
        let p = 2.0 * distribution.cdf(-t.abs());
        (t.is_finite() && p.is_finite()).then_some(Self { t, df, p })
    }
}

/// Two models' ln KL over the same cells.
///
/// Draws are not observations: p shrinks with the number of samples kept, and which draw is paired with which is
/// arbitrary, so Welch's test stands beside the paper's paired one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Cells compared.
    pub cells: usize,
    /// Unanimous cells left out.
    pub left_out: usize,
    /// Pairs of samples.
    pub pairs: usize,
    /// Pairs left out because a KL is exactly 0.
    pub exact_zeros: usize,
    /// Mean of the first model's ln KL minus the second's.
    pub mean_difference: f64,
    /// Paired over samples, df = pairs − 1.
    pub paired: Option<TTest>,
    /// Welch's test, which pairs nothing.
    pub welch: Option<TTest>,
}

/// Compares two models over cells, given as pairs of the same cell. Nothing if fewer than two pairs of samples remain.
pub fn compare(cells: &[(&CellAccuracy, &CellAccuracy)], shares: Shares) -> Option<Comparison> {
    let mut used = 0;
    let (mut first, mut second) = (Vec::new(), Vec::new());
    let mut exact_zeros = 0;
    for (left, right) in cells {
        let (Some(left), Some(right)) = (shares.samples(left), shares.samples(right)) else {
            continue;
        };
        used += 1;
        for pair in left.iter().zip(right) {
            match pair {
                (Some(left), Some(right)) => {
                    first.push(*left);
                    second.push(*right);
                }
                (None, _) | (_, None) => exact_zeros += 1,
            }
        }
    }
    if first.len() < 2 {
        return None;
    }
    let n = first.len() as f64;
    let differences: Vec<f64> = first
        .iter()
        .zip(&second)
        .map(|(left, right)| left - right)
        .collect();
    let mean_difference = mean(&differences);
    let (left, right) = (variance(&first) / n, variance(&second) / n);
    // Satterthwaite's degrees of freedom for two samples of one size.
    let welch_df = (left + right).powi(2) / ((left * left + right * right) / (n - 1.0));
    Some(Comparison {
        cells: used,
        left_out: cells.len() - used,
        pairs: first.len(),
        exact_zeros,
        mean_difference,
        paired: TTest::of(
            mean_difference,
            (variance(&differences) / n).sqrt(),
            n - 1.0,
        ),
        welch: TTest::of(mean_difference, (left + right).sqrt(), welch_df),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ln(shares: &[f64]) -> Vec<f64> {
        shares.iter().map(|share| share.ln()).collect()
    }

    /// KL((½, ½) ‖ (¼, ¾)) = ½ ln 2 + ½ ln ⅔ = ½ ln(4/3).
    #[test]
    fn divergences_by_hand() {
        let found = divergence(&[0.5, 0.5], &ln(&[0.25, 0.75]));
        assert!((found - 0.5 * (4.0_f64 / 3.0).ln()).abs() < 1e-15);
        let found = divergence(&[1.0, 0.0], &ln(&[0.25, 0.75]));
        assert!((found - 4.0_f64.ln()).abs() < 1e-15);
        assert_eq!(divergence(&[0.3, 0.7], &ln(&[0.3, 0.7])), 0.0);
    }

    /// For q = f + ε the divergence is ε²/2 Σ 1/f: with ε = 1e-9 the plain form has no digit left.
    #[test]
    fn close_agreement_keeps_its_digits() {
        let epsilon = 1e-6;
        let found = divergence(&[0.25, 0.75], &ln(&[0.25 + epsilon, 0.75 - epsilon]));
        let expected = epsilon * epsilon / 2.0 * (1.0 / 0.25 + 1.0 / 0.75);
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
    }

    /// q = e^−2000 is no number any more, but its logarithm is.
    #[test]
    fn vanishing_predictions_cost_their_logarithm() {
        let found = divergence(&[0.5, 0.5], &[-2000.0, 0.0]);
        assert!((found - (1000.0 - std::f64::consts::LN_2)).abs() < 1e-9);
    }

    /// KL((½, ½) ‖ (q, 1)) → −ln 2 − ½ ln q, over the range in which q is a number but 1 + (q − f)/f may be 0.
    #[test]
    fn tiny_predictions_cost_a_finite_divergence() {
        for ln_q in [-30.0_f64, -40.0, -100.0, -700.0] {
            let found = divergence(&[0.5, 0.5], &[ln_q, (-ln_q.exp()).ln_1p()]);
            let expected = -std::f64::consts::LN_2 - ln_q / 2.0;
            assert!((found / expected - 1.0).abs() < 1e-12, "{ln_q}: {found}");
        }
    }

    /// Both forms of a term are the same function where one takes over from the other, at q = f/2.
    #[test]
    fn the_two_forms_meet() {
        let f = 0.6;
        for ratio in [0.45, 0.499_999_999, 0.5, 0.500_000_001, 0.55] {
            let q = ratio * f;
            let found = divergence(&[f, 1.0 - f], &ln(&[q, 1.0 - q]));
            let expected = f * (f / q).ln() + (1.0 - f) * ((1.0 - f) / (1.0 - q)).ln();
            assert!((found - expected).abs() < 1e-13, "{ratio}: {found}");
            let x = (q - f) / f;
            assert!((excess(x) - ((f.ln() - q.ln()) - 1.0 + ratio)).abs() < 1e-13);
        }
    }

    /// An impossible prediction is no exact one, in memory and after JSON.
    #[test]
    fn infinite_scores_are_no_exact_zeros() {
        let impossible = [f64::NEG_INFINITY, 0.0];
        let exact = ln(&[0.5, 0.5]);
        let unknown = [f64::NAN, f64::NAN];
        let near = ln(&[0.4, 0.6]);
        let cell = CellAccuracy::of("x", &[5, 5], &[&impossible, &exact, &near]).unwrap();
        assert_eq!(cell.samples[..2], [Some(f64::INFINITY), None]);
        assert_eq!((cell.ln_kl.exact_zeros, cell.ln_kl.mean), (1, None));
        let text = serde_json::to_string(&cell).unwrap();
        let read: CellAccuracy = serde_json::from_str(&text).unwrap();
        assert_eq!(read.samples[..2], cell.samples[..2]);

        let cell = CellAccuracy::of("x", &[5, 5], &[&unknown, &near]).unwrap();
        assert!(cell.samples[0].unwrap().is_nan());
        assert_eq!((cell.ln_kl.exact_zeros, cell.ln_kl.median), (0, None));
    }

    #[test]
    fn reference_levels_of_two_actions() {
        assert!((reference_level(2, 30) - -5.36).abs() < 0.01);
        assert!((reference_level(2, 50) - -5.88).abs() < 0.01);
        // ψ(½) = −γ − 2 ln 2.
        assert!((reference_level(2, 1) - (-1.270_362_845 - std::f64::consts::LN_2)).abs() < 1e-8);
    }

    #[test]
    fn unanimous_cells_are_marked_and_smoothed() {
        let ln_q = ln(&[0.9, 0.1]);
        let cell = CellAccuracy::of("x", &[10, 0], &[&ln_q, &ln_q]).unwrap();
        assert!(cell.unanimous && cell.reference_level.is_none());
        assert_eq!(smoothed_shares(&[10, 0]), [10.5 / 11.0, 0.5 / 11.0]);
        assert_eq!(pooled(&[&cell], Shares::Observed).samples, 0);
        assert_eq!(pooled(&[&cell], Shares::Smoothed).samples, 2);
        assert!(CellAccuracy::of("x", &[0, 0], &[]).is_none());
    }

    #[test]
    fn an_exact_hit_takes_mean_and_sd_away() {
        let half = ln(&[0.5, 0.5]);
        let near = ln(&[0.6, 0.4]);
        let cell = CellAccuracy::of("x", &[5, 5], &[&half, &near, &near]).unwrap();
        assert_eq!(
            (cell.ln_kl.mean, cell.ln_kl.sd, cell.ln_kl.exact_zeros),
            (None, None, 1)
        );
        assert!(cell.ln_kl.median.is_some());
    }

    fn cell(samples: &[f64]) -> CellAccuracy {
        let samples: Vec<Option<f64>> = samples.iter().copied().map(Some).collect();
        CellAccuracy {
            problem: "x".to_owned(),
            n: 10,
            observed: vec![0.5, 0.5],
            unanimous: false,
            reference_level: None,
            ln_kl: LnKl::of(&samples),
            smoothed: LnKl::of(&samples),
            smoothed_samples: samples.clone(),
            samples,
        }
    }

    /// Student's sleep data (1908), ten patients under two drugs: paired t = −4.0621, df 9, p = 0.002833;
    /// Welch t = −1.8608, df 17.776, p = 0.07939 (R, `t.test(extra ~ group)`).
    #[test]
    fn t_tests_of_student_and_welch() {
        let first = cell(&[0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]);
        let second = cell(&[1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]);
        let found = compare(&[(&first, &second)], Shares::Observed).unwrap();
        let (paired, welch) = (found.paired.unwrap(), found.welch.unwrap());
        assert!((paired.t - -4.0621).abs() < 1e-4 && paired.df == 9.0);
        assert!((paired.p - 0.002833).abs() < 1e-6);
        assert!((welch.t - -1.8608).abs() < 1e-4 && (welch.df - 17.776).abs() < 1e-3);
        assert!((welch.p - 0.07939).abs() < 1e-5);
    }
}
