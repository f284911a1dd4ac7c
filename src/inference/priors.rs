//! What is assumed about parameters before any choice is seen.

use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

use crate::model::Parameter;

/// Smallest γ and δ by default: above about 0.2792 the weighting function is monotone.
pub const WEIGHTING_FLOOR: f64 = 0.28;

/// Smallest γ and δ in the paper's wider range, where weights need not be monotone.
pub const PAPER_RANGE_FLOOR: f64 = 0.05;

/// The prior of one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Prior {
    /// Every value between two bounds is equally likely.
    Uniform {
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
    },
    /// The logarithm is normal.
    LogNormal {
        /// Median, the exponential of the mean logarithm.
        median: f64,
        /// Standard deviation of the logarithm.
        log_sd: f64,
    },
}

impl Prior {
    /// The value below which the share `probability` of the prior lies.
    ///
    /// * `probability`: in (0, 1).
    pub fn quantile(&self, probability: f64) -> f64 {
        match *self {
            Self::Uniform { low, high } => low + probability * (high - low),
            Self::LogNormal { median, log_sd } => {
                median * (log_sd * Normal::standard().inverse_cdf(probability)).exp()
            }
        }
    }

    /// The unconstrained coordinate of a value: logit over the bounds, or the logarithm.
    pub fn coordinate(&self, value: f64) -> f64 {
        match *self {
            Self::Uniform { low, high } => ((value - low) / (high - value)).ln(),
            Self::LogNormal { .. } => value.ln(),
        }
    }

    /// The value at an unconstrained coordinate; never 0 where only rounding would make it so.
    pub fn value(&self, coordinate: f64) -> f64 {
        let value = match *self {
            Self::Uniform { low, high } => low + (high - low) / (1.0 + (-coordinate).exp()),
            Self::LogNormal { .. } => coordinate.exp(),
        };
        value.clamp(f64::MIN_POSITIVE, f64::MAX)
    }

    /// The logarithm of the prior's density on the unconstrained coordinate, Jacobian included.
    ///
    /// ```text
    /// uniform:     ln σ(x) + ln σ(−x)
    /// log-normal:  ln N(x; ln median, log_sd)
    /// ```
    pub fn ln_density(&self, coordinate: f64) -> f64 {
        match *self {
            Self::Uniform { .. } => -coordinate.abs() - 2.0 * (-coordinate.abs()).exp().ln_1p(),
            Self::LogNormal { median, log_sd } => {
                let z = (coordinate - median.ln()) / log_sd;
                -0.5 * z * z - log_sd.ln() - 0.5 * (2.0 * std::f64::consts::PI).ln()
            }
        }
    }

    /// The prior's variance on the unconstrained coordinate: π²/3 for the logit of a uniform, log_sd² for a logarithm.
    pub fn coordinate_variance(&self) -> f64 {
        match *self {
            Self::Uniform { .. } => std::f64::consts::PI.powi(2) / 3.0,
            Self::LogNormal { log_sd, .. } => log_sd * log_sd,
        }
    }

    /// The prior's variance of the parameter itself.
    pub fn variance(&self) -> f64 {
        match *self {
            Self::Uniform { low, high } => (high - low).powi(2) / 12.0,
            Self::LogNormal { median, log_sd } => {
                let square = (log_sd * log_sd).exp();
                median * median * square * (square - 1.0)
            }
        }
    }

    /// The prior's variance of the parameter's logarithm.
    pub fn ln_variance(&self) -> f64 {
        match *self {
            Self::LogNormal { log_sd, .. } => log_sd * log_sd,
            Self::Uniform { low, high } => {
                // ∫ ln x dx = x ln x − x and ∫ ln² x dx = x ln² x − 2 (x ln x − x); both vanish at 0.
                let first = |x: f64| if x == 0.0 { 0.0 } else { x * x.ln() - x };
                let second = |x: f64| {
                    if x == 0.0 {
                        0.0
                    } else {
                        x * x.ln().powi(2) - 2.0 * (x * x.ln() - x)
                    }
                };
                let width = high - low;
                let mean = (first(high) - first(low)) / width;
                (second(high) - second(low)) / width - mean * mean
            }
        }
    }
}

/// The priors of all parameters. Sensitivity has its prior on τ = θ |v(R_ref)|, which is free of units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Priors {
    /// α, default Uniform(0, 1).
    pub alpha: Prior,
    /// β, default Uniform(0, 1).
    pub beta: Prior,
    /// γ, default Uniform(0.28, 1): monotone weighting.
    pub gamma: Prior,
    /// δ, default Uniform(0.28, 1).
    pub delta: Prior,
    /// λ, default LogNormal(median 1.5, log-sd 0.75).
    pub lambda: Prior,
    /// τ, default LogNormal(median 5, log-sd 1.5).
    pub tau: Prior,
    /// η⁺, default LogNormal(median 1, log-sd 0.5): no elevation most likely, estimates of the literature (about 0.6 to
    /// 1.5, Stott 2006) well within it.
    pub eta_gain: Prior,
    /// η⁻, default LogNormal(median 1, log-sd 0.5).
    pub eta_loss: Prior,
}

impl Default for Priors {
    fn default() -> Self {
        Self::with_weighting_floor(WEIGHTING_FLOOR)
    }
}

impl Priors {
    /// The default priors with γ and δ uniform from `floor` to 1.
    pub fn with_weighting_floor(floor: f64) -> Self {
        Self {
            alpha: Prior::Uniform {
                low: 0.0,
                high: 1.0,
            },
            beta: Prior::Uniform {
                low: 0.0,
                high: 1.0,
            },
            gamma: Prior::Uniform {
                low: floor,
                high: 1.0,
            },
            delta: Prior::Uniform {
                low: floor,
                high: 1.0,
            },
            lambda: Prior::LogNormal {
                median: 1.5,
                log_sd: 0.75,
            },
            tau: Prior::LogNormal {
                median: 5.0,
                log_sd: 1.5,
            },
            eta_gain: Prior::LogNormal {
                median: 1.0,
                log_sd: 0.5,
            },
            eta_loss: Prior::LogNormal {
                median: 1.0,
                log_sd: 0.5,
            },
        }
    }

    /// The prior that a parameter is drawn from: for θ that of τ.
    pub fn of(&self, parameter: Parameter) -> Prior {
        match parameter {
            Parameter::Alpha => self.alpha,
            Parameter::Beta => self.beta,
            Parameter::Gamma => self.gamma,
            Parameter::Delta => self.delta,
            Parameter::Lambda => self.lambda,
            Parameter::Theta => self.tau,
            Parameter::EtaGain => self.eta_gain,
            Parameter::EtaLoss => self.eta_loss,
        }
    }

    /// Checks that every prior stays within the values that the models accept.
    ///
    /// # Errors
    /// Names the first parameter whose prior does not.
    pub fn check(&self) -> Result<(), PriorError> {
        for parameter in Parameter::ALL {
            let name = if parameter == Parameter::Theta {
                "tau"
            } else {
                parameter.key()
            };
            let bounded = parameter.is_share();
            match self.of(parameter) {
                Prior::Uniform { low, high } => {
                    let ceiling = if bounded { 1.0 } else { f64::MAX };
                    if !(0.0 <= low && low < high && high <= ceiling) {
                        return Err(PriorError::Bounds {
                            name,
                            low,
                            high,
                            bounded,
                        });
                    }
                }
                Prior::LogNormal { .. } if bounded => return Err(PriorError::Unbounded { name }),
                Prior::LogNormal { median, log_sd } => {
                    let usable = |x: f64| 0.0 < x && x < f64::INFINITY;
                    if !(usable(median) && usable(log_sd)) {
                        return Err(PriorError::LogNormal {
                            name,
                            median,
                            log_sd,
                        });
                    }
                }
            }
        }
        Ok(())
    }
}

/// A prior that a parameter cannot have.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PriorError {
    /// Bounds that are not in order or outside the parameter's range.
    #[error(
        "the uniform prior of `{name}` goes from {low} to {high}, allowed is 0 <= low < high{}",
        if *.bounded { " <= 1" } else { "" }
    )]
    Bounds {
        /// The parameter.
        name: &'static str,
        /// Lower bound.
        low: f64,
        /// Upper bound.
        high: f64,
        /// Whether the parameter may not exceed 1.
        bounded: bool,
    },
    /// A prior that goes beyond 1 for a parameter that may not.
    #[error("the prior of `{name}` must be uniform within 0 and 1")]
    Unbounded {
        /// The parameter.
        name: &'static str,
    },
    /// A log-normal that is none.
    #[error(
        "the log-normal prior of `{name}` has median {median} and log_sd {log_sd}, both must be above 0 and finite"
    )]
    LogNormal {
        /// The parameter.
        name: &'static str,
        /// Its median.
        median: f64,
        /// Its standard deviation of logarithms.
        log_sd: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIFORM: Prior = Prior::Uniform {
        low: 0.28,
        high: 1.0,
    };
    const LOG_NORMAL: Prior = Prior::LogNormal {
        median: 5.0,
        log_sd: 1.5,
    };

    /// Midpoint rule over the coordinate, wide enough for both kinds.
    fn integrate(prior: Prior, integrand: impl Fn(f64) -> f64) -> f64 {
        let step = 1e-3;
        let nodes = (0..200_000).map(|i| (f64::from(i) + 0.5) * step - 100.0);
        nodes
            .map(|x| step * prior.ln_density(x).exp() * integrand(x))
            .sum()
    }

    #[test]
    fn densities_on_the_coordinate_integrate_to_one_with_the_stated_variances() {
        for prior in [UNIFORM, LOG_NORMAL] {
            assert!((integrate(prior, |_| 1.0) - 1.0).abs() < 1e-9);
            let mean = integrate(prior, |x| x);
            let variance = integrate(prior, |x| (x - mean).powi(2));
            assert!((variance - prior.coordinate_variance()).abs() < 1e-6);
            let ln_mean = integrate(prior, |x| prior.value(x).ln());
            let ln_variance = integrate(prior, |x| (prior.value(x).ln() - ln_mean).powi(2));
            assert!(
                (ln_variance - prior.ln_variance()).abs() < 1e-6,
                "{ln_variance}"
            );
            let below = integrate(prior, |x| f64::from(prior.value(x) < prior.quantile(0.3)));
            assert!((below - 0.3).abs() < 1e-3, "{below}");
        }
    }

    #[test]
    fn coordinates_lead_back() {
        for prior in [UNIFORM, LOG_NORMAL] {
            for x in [-3.0, 0.0, 0.7] {
                assert!((prior.coordinate(prior.value(x)) - x).abs() < 1e-12);
            }
        }
        assert!(
            Prior::Uniform {
                low: 0.0,
                high: 1.0
            }
            .value(-1e6)
                > 0.0
        );
    }

    #[test]
    fn overrides_are_read_and_checked() {
        let read: Priors = toml::from_str(
            "gamma = { uniform = { low = 0.05, high = 1 } }\ntau = { log_normal = { median = 2, log_sd = 3 } }",
        )
        .unwrap();
        assert_eq!(
            read.gamma,
            Prior::Uniform {
                low: 0.05,
                high: 1.0
            }
        );
        assert_eq!(read.alpha, Priors::default().alpha);
        assert_eq!(read.check(), Ok(()));
        assert!(toml::from_str::<Priors>("theta = { uniform = { low = 0, high = 1 } }").is_err());

        let wrong = Priors {
            beta: Prior::Uniform {
                low: 0.5,
                high: 1.5,
            },
            ..Priors::default()
        };
        assert_eq!(
            wrong.check().unwrap_err().to_string(),
            "the uniform prior of `beta` goes from 0.5 to 1.5, allowed is 0 <= low < high <= 1"
        );
        let unbounded = Priors {
            alpha: LOG_NORMAL,
            ..Priors::default()
        };
        assert_eq!(
            unbounded.check(),
            Err(PriorError::Unbounded { name: "alpha" })
        );
        let flat = Prior::LogNormal {
            median: 1.0,
            log_sd: 0.0,
        };
        assert!(
            Priors {
                lambda: flat,
                ..Priors::default()
            }
            .check()
            .is_err()
        );
    }
}
