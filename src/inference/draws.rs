//! Draws from a posterior, one column per quantity.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::model::{ChoiceModel, Parameter, Parameters};

/// A quantity that a fit reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Quantity {
    /// A parameter in the paper's units.
    Parameter(Parameter),
    /// τ = θ |v(R_ref)|, sensitivity in logits, free of units.
    Tau,
    /// λ θ, all that losses alone can tell about the two.
    LambdaTheta,
}

impl Quantity {
    /// The name in JSON and tables.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Parameter(parameter) => parameter.key(),
            Self::Tau => "tau",
            Self::LambdaTheta => "lambda_theta",
        }
    }
}

impl Quantity {
    /// Its letter, as the paper writes it.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Parameter(Parameter::Alpha) => "α",
            Self::Parameter(Parameter::Beta) => "β",
            Self::Parameter(Parameter::Gamma) => "γ",
            Self::Parameter(Parameter::Delta) => "δ",
            Self::Parameter(Parameter::Lambda) => "λ",
            Self::Parameter(Parameter::Theta) => "θ",
            Self::Parameter(Parameter::EtaGain) => "η⁺",
            Self::Parameter(Parameter::EtaLoss) => "η⁻",
            Self::Tau => "τ",
            Self::LambdaTheta => "λ·θ",
        }
    }

    /// What it stands for, in a few words; `None` for a product of others.
    pub const fn meaning(self) -> Option<&'static str> {
        match self {
            Self::Parameter(Parameter::Alpha) => Some("curvature of gains"),
            Self::Parameter(Parameter::Beta) => Some("curvature of losses"),
            Self::Parameter(Parameter::Gamma) => Some("weighting of gains"),
            Self::Parameter(Parameter::Delta) => Some("weighting of losses"),
            Self::Parameter(Parameter::Lambda) => Some("loss aversion"),
            Self::Parameter(Parameter::Theta) => Some("sensitivity"),
            Self::Parameter(Parameter::EtaGain) => Some("elevation of the weighting of gains"),
            Self::Parameter(Parameter::EtaLoss) => Some("elevation of the weighting of losses"),
            Self::Tau => Some("sensitivity in logits at the reference reward"),
            Self::LambdaTheta => None,
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.key())
    }
}

impl From<Quantity> for String {
    fn from(quantity: Quantity) -> Self {
        quantity.key().to_owned()
    }
}

impl TryFrom<String> for Quantity {
    type Error = String;

    fn try_from(key: String) -> Result<Self, String> {
        match key.as_str() {
            "tau" => Ok(Self::Tau),
            "lambda_theta" => Ok(Self::LambdaTheta),
            other => Parameter::from_key(other)
                .map(Self::Parameter)
                .ok_or_else(|| format!("unknown quantity `{other}`")),
        }
    }
}

/// Draws of every quantity: chain after chain, equally many from each.
#[derive(Debug, Clone, PartialEq)]
pub struct Draws {
    /// Whose parameters they are.
    pub model: &'static ChoiceModel,
    /// How many chains.
    pub chains: usize,
    /// How many draws each chain kept.
    pub per_chain: usize,
    /// The values of each quantity, in the order in which they are reported.
    pub columns: Vec<(Quantity, Vec<f64>)>,
}

impl Draws {
    /// How many draws there are.
    pub fn len(&self) -> usize {
        self.chains * self.per_chain
    }

    /// Whether there is no draw.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values of one quantity, if it was learned.
    pub fn column(&self, quantity: Quantity) -> Option<&[f64]> {
        let found = self.columns.iter().find(|(known, _)| *known == quantity);
        found.map(|(_, values)| values.as_slice())
    }

    /// The parameters of one draw; those the model does not learn are 1, or follow from others.
    ///
    /// Draws lie within the ranges of [`Parameters`]; one from a damaged file that does not is read as 1 there.
    pub fn parameters(&self, draw: usize) -> Parameters {
        let mut parameters = Parameters::ONES;
        for (quantity, values) in &self.columns {
            if let Quantity::Parameter(parameter) = quantity {
                parameters = parameters
                    .with(*parameter, values[draw])
                    .unwrap_or(parameters);
            }
        }
        self.model.complete(parameters)
    }

    /// One column (or any other value per draw) cut into its chains.
    pub fn by_chain<'a>(&self, values: &'a [f64]) -> Vec<&'a [f64]> {
        values.chunks_exact(self.per_chain.max(1)).collect()
    }
}
