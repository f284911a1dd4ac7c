//! The unconstrained coordinates of priors, in lanes.

use super::Prior;
use super::lanes::{LaneRandom, exp, fill_normals, ln};

/// A prior with what its coordinate needs computed once.
#[derive(Debug, Clone, Copy)]
pub(super) enum Coordinate {
    /// The logit over the bounds.
    Logit { low: f64, width: f64, high: f64 },
    /// The logarithm, with the normal prior's density at its peak.
    Logarithm {
        ln_median: f64,
        log_sd: f64,
        ln_peak: f64,
    },
}

impl Coordinate {
    pub(super) fn of(prior: Prior) -> Self {
        match prior {
            Prior::Uniform { low, high } => Self::Logit {
                low,
                width: high - low,
                high,
            },
            Prior::LogNormal { median, log_sd } => Self::Logarithm {
                ln_median: median.ln(),
                log_sd,
                ln_peak: prior.ln_density(median.ln()),
            },
        }
    }

    /// The values at coordinates x. Adds to `ln_prior` the logarithm of the prior's density on the coordinate but for
    /// 2 ln(1 + e^−|x|) of a logit, whose factors 1 + e^−|x| go into `product`.
    #[inline(always)]
    pub(super) fn place<const W: usize>(
        &self,
        position: &[f64; W],
        values: &mut [f64; W],
        ln_prior: &mut [f64; W],
        product: &mut [f64; W],
    ) {
        match *self {
            Self::Logit { low, width, high } => {
                for lane in 0..W {
                    let size = position[lane].abs();
                    let small = exp(-size);
                    let sum = 1.0 + small;
                    let upper = 1.0 / sum;
                    let share = if position[lane] >= 0.0 {
                        upper
                    } else {
                        small * upper
                    };
                    values[lane] = at_least_tiny(low + width * share).min(high);
                    ln_prior[lane] -= size;
                    product[lane] *= sum;
                }
            }
            Self::Logarithm {
                ln_median,
                log_sd,
                ln_peak,
            } => {
                let precision = 1.0 / log_sd;
                for lane in 0..W {
                    let z = (position[lane] - ln_median) * precision;
                    values[lane] = at_least_tiny(exp(position[lane])).min(f64::MAX);
                    ln_prior[lane] += ln_peak - 0.5 * z * z;
                }
            }
        }
    }

    /// Values drawn from the prior.
    #[inline(always)]
    pub(super) fn draw_values<const W: usize>(
        &self,
        random: &mut LaneRandom,
        values: &mut [f64; W],
    ) {
        match *self {
            Self::Logit { low, width, high } => {
                random.fill_uniform(values);
                for value in values {
                    *value = at_least_tiny(low + width * *value).min(high);
                }
            }
            Self::Logarithm { .. } => {
                self.draw(random, values);
                for value in values {
                    *value = at_least_tiny(exp(*value)).min(f64::MAX);
                }
            }
        }
    }

    /// Coordinates drawn from the prior.
    #[inline(always)]
    pub(super) fn draw<const W: usize>(&self, random: &mut LaneRandom, position: &mut [f64; W]) {
        match *self {
            Self::Logit { .. } => {
                random.fill_uniform(position);
                for x in position {
                    // The rounded 1 is as far from its end as the smallest number is from 0.
                    *x = ln(*x) - ln((1.0 - *x).max(f64::EPSILON / 2.0));
                }
            }
            Self::Logarithm {
                ln_median, log_sd, ..
            } => {
                let mut normals = [[0.0; W]];
                fill_normals(random, &mut normals);
                for lane in 0..W {
                    position[lane] = ln_median + log_sd * normals[0][lane];
                }
            }
        }
    }
}

/// Never 0 where only rounding would make it so; NaN stays.
#[inline(always)]
fn at_least_tiny(x: f64) -> f64 {
    if x < f64::MIN_POSITIVE {
        f64::MIN_POSITIVE
    } else {
        x
    }
}
