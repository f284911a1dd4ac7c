//! How evidence is followed while people take part, and the preset rule for when it is enough.

use super::PlanId;
use crate::model::ChoiceModel;

/// Looks at the answers of the first people who finished: of `minimum` of them, then after each further `check_every`.
///
/// A rule that is looked at more often is reached sooner by chance. So the moments are fixed beforehand, in the study
/// file, and the rule is judged at them alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequential {
    /// The plan whose fits are followed.
    pub plan: PlanId,
    /// People between two looks, 1 or more.
    pub check_every: u64,
    /// People before the first look, 1 or more.
    pub minimum: u64,
    /// The Bayes factor that is followed: of the first model against the second. None where one model alone is fitted.
    pub models: Option<[&'static ChoiceModel; 2]>,
    /// The interval whose width is followed. None where the plan has several parts, each with an interval of its own.
    pub interval: Option<KeyInterval>,
    /// When there is enough. None where the study file sets no rule: then it is followed and nothing is announced.
    pub rule: Option<StoppingRule>,
}

/// The 90 % interval that a study is about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyInterval {
    /// The model.
    pub model: &'static ChoiceModel,
    /// The name of a parameter of the model, or `tau`.
    pub quantity: String,
}

/// When there is enough evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StoppingRule {
    /// The Bayes factor of [`Sequential::models`] is at least this, above 1, in favour of either of them.
    BayesFactor(f64),
    /// [`Sequential::interval`] is narrower than this, above 0.
    Width(f64),
}
