//! The parameters of a chooser.

use std::fmt;

/// One parameter of the models, named as in the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Parameter {
    /// α, curvature of the value of gains.
    Alpha,
    /// β, curvature of the value of losses.
    Beta,
    /// γ, distortion of the probabilities of gains.
    Gamma,
    /// δ, distortion of the probabilities of losses.
    Delta,
    /// λ, loss aversion.
    Lambda,
    /// θ, sensitivity of choices to utility, in 1/utility.
    Theta,
    /// η⁺, elevation of Prelec's weighting of the probabilities of gains.
    EtaGain,
    /// η⁻, the same for losses.
    EtaLoss,
}

impl Parameter {
    /// All parameters.
    pub const ALL: [Self; 8] = [
        Self::Alpha,
        Self::Beta,
        Self::Gamma,
        Self::Delta,
        Self::Lambda,
        Self::Theta,
        Self::EtaGain,
        Self::EtaLoss,
    ];

    /// The name in JSON, tables and files.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Alpha => "alpha",
            Self::Beta => "beta",
            Self::Gamma => "gamma",
            Self::Delta => "delta",
            Self::Lambda => "lambda",
            Self::Theta => "theta",
            Self::EtaGain => "eta_gain",
            Self::EtaLoss => "eta_loss",
        }
    }

    /// The parameter with this [`key`](Self::key).
    pub fn from_key(key: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|parameter| parameter.key() == key)
    }

    /// The accepted values, in words.
    pub const fn allowed(self) -> &'static str {
        match self {
            Self::Alpha | Self::Beta | Self::Gamma | Self::Delta => "above 0 and at most 1",
            Self::Lambda | Self::Theta => "0 or more, and finite",
            Self::EtaGain | Self::EtaLoss => "above 0 and finite",
        }
    }

    /// Whether the parameter lies between 0 and 1.
    pub const fn is_share(self) -> bool {
        match self {
            Self::Alpha | Self::Beta | Self::Gamma | Self::Delta => true,
            Self::Lambda | Self::Theta | Self::EtaGain | Self::EtaLoss => false,
        }
    }

    /// Whether the models accept this value.
    pub fn accepts(self, value: f64) -> bool {
        match self {
            Self::Alpha | Self::Beta | Self::Gamma | Self::Delta => 0.0 < value && value <= 1.0,
            Self::Lambda | Self::Theta => (0.0..f64::INFINITY).contains(&value),
            Self::EtaGain | Self::EtaLoss => 0.0 < value && value < f64::INFINITY,
        }
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.key())
    }
}

/// A value for each parameter, each within its range: α, β, γ, δ in (0, 1], λ ≥ 0, θ ≥ 0, η⁺, η⁻ > 0, all finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    values: [f64; 8],
}

impl Parameters {
    /// Every parameter at 1: rewards and probabilities are taken as they are.
    pub const ONES: Self = Self { values: [1.0; 8] };

    /// The value of one parameter.
    pub const fn get(&self, parameter: Parameter) -> f64 {
        self.values[parameter as usize]
    }

    /// These parameters with one of them changed.
    ///
    /// # Errors
    /// When the value is outside the parameter's range.
    pub fn with(mut self, parameter: Parameter, value: f64) -> Result<Self, ParameterError> {
        if !parameter.accepts(value) {
            return Err(ParameterError { parameter, value });
        }
        self.values[parameter as usize] = value;
        Ok(self)
    }
}

/// A parameter outside its range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("parameter `{parameter}` is {value}, allowed is {}", .parameter.allowed())]
pub struct ParameterError {
    /// Which parameter.
    pub parameter: Parameter,
    /// What was found.
    pub value: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_outside_the_range_are_refused() {
        for (parameter, value) in [
            (Parameter::Alpha, 0.0),
            (Parameter::Beta, 1.01),
            (Parameter::Gamma, -0.5),
            (Parameter::Delta, f64::NAN),
            (Parameter::Lambda, -1e-9),
            (Parameter::Theta, f64::INFINITY),
        ] {
            let error = Parameters::ONES.with(parameter, value).unwrap_err();
            assert_eq!(error.parameter, parameter);
        }
        let error = Parameters::ONES.with(Parameter::Gamma, 1.5).unwrap_err();
        assert_eq!(
            error.to_string(),
            "parameter `gamma` is 1.5, allowed is above 0 and at most 1"
        );
    }

    #[test]
    fn a_changed_parameter_is_read_back_and_the_others_stay() {
        let changed = Parameters::ONES.with(Parameter::Lambda, 2.25).unwrap();
        for parameter in Parameter::ALL {
            let expected = if parameter == Parameter::Lambda {
                2.25
            } else {
                1.0
            };
            assert_eq!(changed.get(parameter), expected);
            assert_eq!(Parameter::from_key(parameter.key()), Some(parameter));
        }
    }
}
