//! The models as entries: each says by what name it goes and which parameters it leaves free.

use std::fmt;

use super::{Parameter, ParameterError, Parameters};

/// One choice model of the family.
///
/// All members share the choice rule of this module; a member is what it leaves free. A parameter that is not free
/// is 1, where rewards and probabilities are taken as they are.
#[derive(Debug, PartialEq, Eq)]
pub struct ChoiceModel {
    /// The name in JSON and on the command line.
    pub id: &'static str,
    /// The name for people.
    pub label: &'static str,
    /// The parameters that are learned, in the order in which they are reported.
    pub parameters: &'static [Parameter],
}

/// Noisy Rational: choices follow the expected reward, with noise.
///
/// ```text
/// P(a) = softmax(θ Σ p R)(a)
/// ```
///
/// Source: the paper, section on the Noisy Rational model.
pub static NOISY_RATIONAL: ChoiceModel = ChoiceModel {
    id: "noisy_rational",
    label: "Noisy Rational",
    parameters: &[Parameter::Theta],
};

/// Risk-Aware: cumulative prospect theory with normalised decision weights, and noise.
///
/// ```text
/// P(a) = softmax(θ Σ π̄ v(R))(a)
/// ```
///
/// Source: the paper, section on the Risk-Aware model; Tversky & Kahneman (1992).
pub static RISK_AWARE: ChoiceModel = ChoiceModel {
    id: "risk_aware",
    label: "Risk-Aware",
    parameters: &Parameter::ALL,
};

/// Every model, in the order in which they are reported.
pub static MODELS: [&ChoiceModel; 2] = [&NOISY_RATIONAL, &RISK_AWARE];

/// The model with this id.
///
/// # Errors
/// When there is no such model; the error lists those there are.
pub fn model_named(id: &str) -> Result<&'static ChoiceModel, ModelError> {
    MODELS
        .into_iter()
        .find(|model| model.id == id)
        .ok_or_else(|| ModelError::UnknownModel { id: id.to_owned() })
}

impl fmt::Display for ChoiceModel {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.id)
    }
}

impl ChoiceModel {
    /// The model's parameters from names and values.
    ///
    /// # Errors
    /// When a name is unknown to the model or comes twice, one is missing, or a value is out of range.
    pub fn parameters_from<'a>(
        &self,
        entries: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> Result<Parameters, ModelError> {
        let mut parameters = Parameters::ONES;
        let mut missing = self.parameters.to_vec();
        for (name, value) in entries {
            let parameter = Parameter::from_key(name).filter(|known| missing.contains(known));
            let Some(parameter) = parameter else {
                return Err(ModelError::UnknownParameter {
                    model: self.id,
                    name: name.to_owned(),
                    allowed: self.parameter_names(),
                });
            };
            missing.retain(|other| *other != parameter);
            parameters = parameters.with(parameter, value)?;
        }
        match missing.first() {
            Some(&parameter) => Err(ModelError::MissingParameter {
                model: self.id,
                parameter,
            }),
            None => Ok(parameters),
        }
    }

    /// Whether the parameter is learned rather than fixed at 1.
    pub fn is_free(&self, parameter: Parameter) -> bool {
        self.parameters.contains(&parameter)
    }

    fn parameter_names(&self) -> String {
        let names: Vec<&str> = self
            .parameters
            .iter()
            .map(|parameter| parameter.key())
            .collect();
        names.join(", ")
    }
}

/// Why a model or its parameters could not be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// No model goes by this name.
    #[error("unknown model `{id}`, allowed are {}", MODELS.map(|model| model.id).join(", "))]
    UnknownModel {
        /// The name.
        id: String,
    },
    /// The model has no such parameter, or it was given before.
    #[error("parameter `{name}` is unknown to {model} or comes twice, allowed are {allowed}")]
    UnknownParameter {
        /// The model's id.
        model: &'static str,
        /// The name that was given.
        name: String,
        /// The names there are.
        allowed: String,
    },
    /// A parameter was left out.
    #[error("{model} needs parameter `{parameter}`, {}", .parameter.allowed())]
    MissingParameter {
        /// The model's id.
        model: &'static str,
        /// The first one missing.
        parameter: Parameter,
    },
    /// A parameter is out of range.
    #[error(transparent)]
    Value(#[from] ParameterError),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_found_by_name_and_others_listed() {
        for model in MODELS {
            assert_eq!(model_named(model.id), Ok(model));
        }
        let message = model_named("bayes").unwrap_err().to_string();
        assert_eq!(
            message,
            "unknown model `bayes`, allowed are noisy_rational, risk_aware"
        );
    }

    #[test]
    fn parameters_must_be_those_of_the_model() {
        let read = NOISY_RATIONAL.parameters_from([("theta", 0.3)]).unwrap();
        assert_eq!(read, Parameters::ONES.with(Parameter::Theta, 0.3).unwrap());

        let unknown = NOISY_RATIONAL
            .parameters_from([("theta", 0.3), ("alpha", 0.5)])
            .unwrap_err();
        assert!(
            matches!(unknown, ModelError::UnknownParameter { .. }),
            "{unknown}"
        );
        let missing = RISK_AWARE.parameters_from([("alpha", 0.3)]).unwrap_err();
        assert_eq!(
            missing.to_string(),
            "risk_aware needs parameter `beta`, above 0 and at most 1"
        );
        let outside = NOISY_RATIONAL
            .parameters_from([("theta", -1.0)])
            .unwrap_err();
        assert_eq!(
            outside.to_string(),
            "parameter `theta` is -1, allowed is 0 or more, and finite"
        );
    }
}
