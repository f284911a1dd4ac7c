//! The models as entries: each says by what name it goes and which parameters it leaves free.

use std::fmt;

use super::{
    Parameter, ParameterError, Parameters, RiskAwareOptions, WeightingFunction, ZeroOutcome,
};

/// One choice model of the family.
///
/// All members share the choice rule of this module; a member is what it leaves free and which form of the rule it
/// asks for. A parameter that is not free is 1, where rewards and probabilities are taken as they are.
#[derive(Debug, PartialEq, Eq)]
pub struct ChoiceModel {
    /// The name in JSON and on the command line.
    pub id: &'static str,
    /// The name for people.
    pub label: &'static str,
    /// The parameters that are learned, in the order in which they are reported.
    pub parameters: &'static [Parameter],
    /// Whether losses bend as gains do.
    pub curvature: Curvature,
    form: Form,
}

/// How the values of gains and of losses bend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Curvature {
    /// α for gains, β for losses.
    Separate,
    /// α for both: β = α.
    Shared,
}

/// What a member asks for whatever the options are.
#[derive(Debug, PartialEq, Eq)]
enum Form {
    AsOptions,
    Unnormalised,
    SameSignZero,
    Prelec,
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
    curvature: Curvature::Separate,
    form: Form::AsOptions,
};

/// Expected utility: rewards are bent, probabilities are taken as they are.
///
/// ```text
/// v(R) = sign(R) |R|^α
/// ```
///
/// Source: von Neumann & Morgenstern (1944), with the power function of Tversky & Kahneman (1992).
pub static EXPECTED_UTILITY: ChoiceModel = ChoiceModel {
    id: "expected_utility",
    label: "Expected utility",
    parameters: &[Parameter::Alpha, Parameter::Theta],
    curvature: Curvature::Shared,
    form: Form::AsOptions,
};

/// Cumulative prospect theory with one curvature, β = α: then λ does not depend on the unit of the rewards.
///
/// Weights are normalised as the options say, so that it lies inside [`RISK_AWARE`].
///
/// Source: Tversky & Kahneman (1992); the restriction is discussed by Wakker (2010), section 9.6.
pub static CUMULATIVE_PROSPECT: ChoiceModel = ChoiceModel {
    id: "cumulative_prospect",
    label: "CPT, α = β",
    parameters: &[
        Parameter::Alpha,
        Parameter::Gamma,
        Parameter::Delta,
        Parameter::Lambda,
        Parameter::Theta,
    ],
    curvature: Curvature::Shared,
    form: Form::AsOptions,
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
    parameters: &SIX,
    curvature: Curvature::Separate,
    form: Form::AsOptions,
};

/// Risk-Aware with decision weights that need not sum to 1: U = Σ π v, as in Tversky & Kahneman (1992).
pub static RISK_AWARE_UNNORMALISED: ChoiceModel = ChoiceModel {
    id: "risk_aware_unnormalised",
    label: "Risk-Aware, not normalised",
    parameters: &SIX,
    curvature: Curvature::Separate,
    form: Form::Unnormalised,
};

/// Risk-Aware where nothing joins the losses of a prospect without gains, see [`ZeroOutcome::SameSign`].
pub static RISK_AWARE_SAME_SIGN: ChoiceModel = ChoiceModel {
    id: "risk_aware_same_sign",
    label: "Risk-Aware, zero with its sign",
    parameters: &SIX,
    curvature: Curvature::Separate,
    form: Form::SameSignZero,
};

/// Risk-Aware with Prelec's weighting function of one parameter, see [`WeightingFunction::Prelec`]; η = 1.
pub static RISK_AWARE_PRELEC: ChoiceModel = ChoiceModel {
    id: "risk_aware_prelec",
    label: "Risk-Aware, Prelec",
    parameters: &SIX,
    curvature: Curvature::Separate,
    form: Form::Prelec,
};

/// Risk-Aware with Prelec's weighting function of two parameters: exponents γ, δ and elevations η⁺, η⁻.
pub static RISK_AWARE_PRELEC_ELEVATION: ChoiceModel = ChoiceModel {
    id: "risk_aware_prelec_elevation",
    label: "Risk-Aware, Prelec with elevation",
    parameters: &[
        Parameter::Alpha,
        Parameter::Beta,
        Parameter::Gamma,
        Parameter::Delta,
        Parameter::EtaGain,
        Parameter::EtaLoss,
        Parameter::Lambda,
        Parameter::Theta,
    ],
    curvature: Curvature::Separate,
    form: Form::Prelec,
};

/// The six parameters of the paper, in the order in which they are reported. Sensitivity is the last of every model.
static SIX: [Parameter; 6] = [
    Parameter::Alpha,
    Parameter::Beta,
    Parameter::Gamma,
    Parameter::Delta,
    Parameter::Lambda,
    Parameter::Theta,
];

/// The two models that the paper compares: what is fitted unless a study or a command names others.
pub static PAPER_MODELS: [&ChoiceModel; 2] = [&NOISY_RATIONAL, &RISK_AWARE];

/// Every model, in the order in which they are reported.
///
/// The first four are nested and form a ladder: each gains something that the one before it lacks.
pub static MODELS: [&ChoiceModel; 8] = [
    &NOISY_RATIONAL,
    &EXPECTED_UTILITY,
    &CUMULATIVE_PROSPECT,
    &RISK_AWARE,
    &RISK_AWARE_UNNORMALISED,
    &RISK_AWARE_SAME_SIGN,
    &RISK_AWARE_PRELEC,
    &RISK_AWARE_PRELEC_ELEVATION,
];

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
            None => Ok(self.complete(parameters)),
        }
    }

    /// The parameters with those set that follow from others: β = α where curvature is shared.
    pub fn complete(&self, parameters: Parameters) -> Parameters {
        match self.curvature {
            Curvature::Separate => parameters,
            Curvature::Shared => parameters
                .with(Parameter::Beta, parameters.get(Parameter::Alpha))
                .expect("α and β have the same range"),
        }
    }

    /// The options under which the model is evaluated: those given, but for what its form asks for.
    pub fn options(&self, given: RiskAwareOptions) -> RiskAwareOptions {
        match self.form {
            Form::AsOptions => given,
            Form::Unnormalised => RiskAwareOptions {
                normalise: false,
                ..given
            },
            Form::SameSignZero => RiskAwareOptions {
                zero: ZeroOutcome::SameSign,
                ..given
            },
            Form::Prelec => RiskAwareOptions {
                weighting_function: WeightingFunction::Prelec,
                ..given
            },
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
            "unknown model `bayes`, allowed are noisy_rational, expected_utility, cumulative_prospect, risk_aware, \
             risk_aware_unnormalised, risk_aware_same_sign, risk_aware_prelec, risk_aware_prelec_elevation"
        );
    }

    #[test]
    fn shared_curvature_bends_losses_as_gains() {
        let read = EXPECTED_UTILITY
            .parameters_from([("alpha", 0.5), ("theta", 1.0)])
            .unwrap();
        assert_eq!(read.get(Parameter::Beta), 0.5);
        for model in MODELS {
            assert_eq!(model.parameters.last(), Some(&Parameter::Theta), "{model}");
        }
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
