//! The keys of a study file, before any rule that goes beyond one key.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::Device;
use super::definition::{Assign, Order};
use super::step::AfterFailure;
use super::template::{Scalar, Values};
use crate::planning::table::{Outcome, Tower};

/// The whole file. Blocks are read one by one, each as its kind says.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawStudy {
    pub(super) format: i64,
    #[serde(default)]
    pub(super) open: bool,
    pub(super) id: String,
    #[expect(dead_code, reason = "read from the tree, by `parse::languages`")]
    pub(super) languages: Option<IgnoredAny>,
    #[expect(dead_code, reason = "read from the tree, by `parse::languages`")]
    pub(super) text: Option<IgnoredAny>,
    pub(super) title: String,
    pub(super) summary: String,
    pub(super) minutes: u32,
    pub(super) contact: String,
    pub(super) reward_unit: RawRewardUnit,
    pub(super) reference_reward: Option<f64>,
    #[serde(default)]
    pub(super) values: Values,
    #[serde(default)]
    pub(super) factor: Vec<RawFactor>,
    #[serde(default)]
    pub(super) action: Vec<RawAction>,
    #[serde(default)]
    pub(super) question: RawQuestionDefaults,
    pub(super) block: Vec<IgnoredAny>,
    pub(super) completion: RawCompletion,
    pub(super) bonus: Option<RawBonus>,
    #[serde(default)]
    pub(super) recruiting: RawRecruiting,
    #[serde(default)]
    pub(super) analysis: RawAnalysis,
    #[serde(default)]
    pub(super) stopping: Option<RawStopping>,
    #[serde(default)]
    pub(super) fit: RawFit,
    #[serde(default)]
    pub(super) paper: Vec<RawPaper>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRewardUnit {
    pub(super) name: String,
    #[serde(default)]
    pub(super) prefix: String,
    #[serde(default)]
    pub(super) suffix: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFactor {
    pub(super) id: String,
    pub(super) label: String,
    #[serde(default)]
    pub(super) assign: Assign,
    pub(super) level: Vec<RawLevel>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawLevel {
    pub(super) id: String,
    pub(super) label: String,
    #[serde(default)]
    pub(super) values: Values,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawAction {
    pub(super) id: String,
    pub(super) label: String,
    #[serde(default)]
    pub(super) detail: String,
    pub(super) outcomes: Vec<RawOutcome>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawOutcome {
    pub(super) p: Scalar,
    pub(super) reward: Scalar,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawQuestionDefaults {
    pub(super) text: Option<String>,
    #[serde(default)]
    pub(super) action_order: ActionOrder,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ActionOrder {
    #[default]
    File,
    PerRun,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawConsent {
    pub(super) id: String,
    pub(super) version: String,
    pub(super) title: String,
    pub(super) text: String,
    pub(super) agree: String,
    pub(super) decline: String,
    pub(super) declined_title: String,
    pub(super) declined_text: String,
    #[serde(default)]
    pub(super) clause: Vec<RawClause>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawClause {
    pub(super) id: String,
    pub(super) text: String,
    #[serde(default)]
    pub(super) required: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawInfo {
    pub(super) id: String,
    pub(super) title: String,
    pub(super) text: String,
    pub(super) scene: Option<String>,
    pub(super) button: String,
    #[serde(default)]
    pub(super) when: BTreeMap<String, String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawReplays {
    pub(super) id: String,
    pub(super) title: String,
    #[serde(default)]
    pub(super) text: String,
    pub(super) button: String,
    #[serde(default)]
    pub(super) order: Order,
    pub(super) replay: Vec<RawReplay>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawReplay {
    pub(super) tower: Tower,
    pub(super) outcome: Outcome,
    pub(super) seed: i64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawChoices {
    pub(super) id: String,
    pub(super) title: String,
    #[serde(default)]
    pub(super) levels: BTreeMap<String, String>,
    pub(super) limit_s: Option<f64>,
    pub(super) start: Option<RawStart>,
    #[serde(default)]
    pub(super) order: Order,
    pub(super) scene: Option<String>,
    #[serde(default)]
    pub(super) practice: bool,
    #[serde(default)]
    pub(super) baseline: bool,
    pub(super) reference_share: Option<f64>,
    pub(super) fitted: Option<bool>,
    #[serde(default)]
    pub(super) group: Vec<RawGroup>,
    #[serde(default)]
    pub(super) question: Vec<RawQuestion>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawStart {
    pub(super) title: String,
    pub(super) text: String,
    pub(super) button: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawGroup {
    #[serde(default)]
    pub(super) levels: BTreeMap<String, String>,
    #[serde(default)]
    pub(super) cross: BTreeMap<String, Vec<String>>,
    #[serde(default)]
    pub(super) order: Order,
    pub(super) fitted: Option<bool>,
    pub(super) text: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawQuestion {
    pub(super) id: String,
    pub(super) label: Option<String>,
    #[serde(default)]
    pub(super) levels: BTreeMap<String, String>,
    #[serde(default)]
    pub(super) values: Values,
    pub(super) text: Option<String>,
    pub(super) actions: Option<Vec<RawAction>>,
    pub(super) fitted: Option<bool>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawForm {
    pub(super) id: String,
    pub(super) title: String,
    #[serde(default)]
    pub(super) text: String,
    pub(super) button: String,
    pub(super) attempts: Option<u32>,
    pub(super) hint: Option<String>,
    pub(super) then: Option<AfterFailure>,
    pub(super) field: Vec<RawField>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawField {
    pub(super) id: String,
    pub(super) kind: RawFieldKind,
    pub(super) label: String,
    pub(super) hint: Option<String>,
    #[serde(default)]
    pub(super) required: bool,
    pub(super) min: Option<f64>,
    pub(super) max: Option<f64>,
    pub(super) digits: Option<u32>,
    pub(super) max_length: Option<usize>,
    pub(super) options: Option<Vec<RawOption>>,
    pub(super) other: Option<bool>,
    pub(super) scale: Option<Vec<String>>,
    pub(super) points: Option<usize>,
    pub(super) low: Option<String>,
    pub(super) high: Option<String>,
    pub(super) items: Option<Vec<RawItem>>,
    pub(super) correct: Option<RawAnswer>,
    pub(super) expected: Option<RawAnswer>,
    pub(super) autocomplete: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum RawFieldKind {
    Integer,
    Number,
    Text,
    LongText,
    Choice,
    Choices,
    Likert,
}

/// An answer as the file writes it down: an option's id, several of them, or a number.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum RawAnswer {
    One(String),
    Several(Vec<String>),
    Number(f64),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawOption {
    pub(super) id: String,
    pub(super) label: String,
    #[serde(default)]
    pub(super) screens_out: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawItem {
    pub(super) id: String,
    pub(super) text: String,
    #[serde(default)]
    pub(super) reverse: bool,
    pub(super) expected: Option<i64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawCompletion {
    pub(super) title: String,
    pub(super) text: String,
    pub(super) code: Option<String>,
    pub(super) redirect: Option<String>,
    #[serde(default)]
    pub(super) screened_out: RawEnding,
    #[serde(default)]
    pub(super) failed_check: RawEnding,
    #[serde(default)]
    pub(super) timed_out: RawEnding,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawEnding {
    pub(super) title: Option<String>,
    pub(super) text: Option<String>,
    pub(super) code: Option<String>,
    pub(super) redirect: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawBonus {
    pub(super) currency: String,
    pub(super) rate: f64,
    #[serde(default)]
    pub(super) endowment: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRecruiting {
    #[serde(default)]
    pub(super) ids: RawIds,
    pub(super) quota: Option<u32>,
    pub(super) opens: Option<toml::value::Datetime>,
    pub(super) closes: Option<toml::value::Datetime>,
    pub(super) devices: Option<Vec<Device>>,
    pub(super) time_limit_min: Option<u32>,
    pub(super) retention: Option<toml::value::Datetime>,
    #[serde(default)]
    pub(super) filters: Vec<String>,
    #[serde(default)]
    pub(super) more_time: bool,
    #[serde(default)]
    pub(super) mturk: RawMturk,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMturk {
    #[serde(default)]
    pub(super) frame: bool,
    #[serde(default)]
    pub(super) sites: Vec<String>,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum RawIds {
    #[default]
    Hashed,
    Plain,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawAnalysis {
    #[serde(default)]
    pub(super) include: RawInclude,
    #[serde(default)]
    pub(super) exclude: Vec<String>,
    pub(super) blind_until: Option<u64>,
    pub(super) hypothesis: Option<RawHypothesis>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawHypothesis {
    pub(super) id: String,
    pub(super) statement: String,
    pub(super) better: String,
    pub(super) than: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawStopping {
    pub(super) plan: Option<String>,
    pub(super) check_every: Option<u64>,
    pub(super) minimum: Option<u64>,
    pub(super) models: Option<Vec<String>>,
    pub(super) bayes_factor: Option<f64>,
    pub(super) width: Option<RawWidth>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawWidth {
    pub(super) model: String,
    pub(super) quantity: String,
    pub(super) below: f64,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum RawInclude {
    #[default]
    Completed,
    All,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFit {
    pub(super) models: Option<Vec<String>>,
    pub(super) samples: Option<usize>,
    #[serde(default)]
    pub(super) weighting: RawWeighting,
    pub(super) normalise: Option<bool>,
    #[serde(default)]
    pub(super) zero: crate::model::ZeroOutcome,
    #[serde(default)]
    pub(super) priors: RawPriors,
    #[serde(default)]
    pub(super) plan: Vec<RawPlan>,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum RawWeighting {
    #[default]
    Monotone,
    PaperRange,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPriors {
    pub(super) alpha: Option<RawPrior>,
    pub(super) beta: Option<RawPrior>,
    pub(super) gamma: Option<RawPrior>,
    pub(super) delta: Option<RawPrior>,
    pub(super) lambda: Option<RawPrior>,
    pub(super) tau: Option<RawPrior>,
    pub(super) eta_gain: Option<RawPrior>,
    pub(super) eta_loss: Option<RawPrior>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum RawPrior {
    Uniform([f64; 2]),
    LogNormal(RawLogNormal),
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawLogNormal {
    pub(super) median: f64,
    pub(super) log_sd: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPlan {
    pub(super) id: String,
    pub(super) label: String,
    #[serde(default)]
    pub(super) by: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPaper {
    pub(super) label: String,
    #[serde(default)]
    pub(super) levels: BTreeMap<String, String>,
    pub(super) risk_aware: Option<RawMeanSd>,
    pub(super) noisy_rational: Option<RawMeanSd>,
    pub(super) t: Option<f64>,
    pub(super) df: Option<u32>,
    pub(super) p: Option<String>,
    pub(super) n: Option<u32>,
    #[serde(default)]
    pub(super) choices: BTreeMap<String, u32>,
    pub(super) source: Option<String>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMeanSd {
    pub(super) mean: f64,
    pub(super) sd: f64,
}
