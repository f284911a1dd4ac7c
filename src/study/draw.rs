//! The steps of one run, drawn at its start and stored.

use std::collections::BTreeMap;

use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::definition::{BlockBody, Choices, Order, Study, Unit};
use super::step::ReplaysText;
use super::{ActionId, BlockId, BonusTerms, Condition, FactorId, LevelId, QuestionId, ReplayId};

/// What kind of step it is: the name under which it is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StepKind {
    /// Asks for consent.
    Consent,
    /// Tells something; a button goes on.
    Info,
    /// Shows replays of towers being built.
    Replays,
    /// Asks to choose an action.
    Choice,
    /// Asks to fill in fields.
    Form,
    /// The end of the run.
    Thanks,
}

impl StepKind {
    /// The name under which the kind is stored.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Consent => "consent",
            Self::Info => "info",
            Self::Replays => "replays",
            Self::Choice => "choice",
            Self::Form => "form",
            Self::Thanks => "thanks",
        }
    }
}

/// One step of a run as it is stored: what was drawn, while texts come from the study's version.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepPlan {
    /// Its kind.
    pub kind: StepKind,
    /// The block that it belongs to. The start page of a choice block is an info step of that block; the last step
    /// belongs to a block named `thanks`.
    pub block: BlockId,
    /// The question, for choices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub question: Option<QuestionId>,
    /// The time limit, for timed choices, before the person's time factor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit_ms: Option<u64>,
    /// What was drawn for it.
    #[serde(default)]
    pub data: StepData,
}

/// What is particular to a step in one run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StepData {
    /// The question's factor levels, for whoever reads the stored run without its study file.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub levels: BTreeMap<FactorId, LevelId>,
    /// The order in which the actions stand on the page.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actions: Vec<ActionId>,
    /// The order in which replays are shown.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replays: Vec<ReplayId>,
    /// Which question of its block this is, counted from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub number: Option<usize>,
    /// How many questions its block asks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<usize>,
    /// What the last step pays, in a study with a bonus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bonus: Option<BonusTerms>,
}

/// The block of the last step. A study file cannot use this id for a block of its own.
pub(super) const THANKS_BLOCK: &str = "thanks";

impl Study {
    /// Draws the whole run of one person: every step in order, with all random orders settled. Of a study with
    /// conditions it is what one of them meets, or without `condition` everything that the file holds.
    ///
    /// Only orders that the file calls random and the seed of a bonus use `rng`.
    pub fn draw_steps(&self, condition: Option<&Condition>, rng: &mut impl Rng) -> Vec<StepPlan> {
        let meets = |levels: &[(FactorId, LevelId)]| {
            condition.is_none_or(|condition| condition.takes(levels))
        };
        let mut steps = Vec::new();
        let mut action_orders = ActionOrders::default();
        for block in &self.blocks {
            match &block.body {
                BlockBody::Consent(_) => steps.push(plain_step(StepKind::Consent, &block.id)),
                BlockBody::Info(text) if !meets(&text.when) => {}
                BlockBody::Info(_) => steps.push(plain_step(StepKind::Info, &block.id)),
                BlockBody::Form(_) => steps.push(plain_step(StepKind::Form, &block.id)),
                BlockBody::Replays(text) => steps.push(draw_replays(&block.id, text, rng)),
                BlockBody::Choice(choices) => {
                    let order = draw_order(choices, meets, rng);
                    if choices.start.is_some() && !order.is_empty() {
                        steps.push(plain_step(StepKind::Info, &block.id));
                    }
                    steps.extend(self.draw_block(
                        &block.id,
                        choices,
                        order,
                        &mut action_orders,
                        rng,
                    ));
                }
            }
        }
        let mut thanks = plain_step(StepKind::Thanks, &BlockId::from(THANKS_BLOCK));
        thanks.data.bonus = self.bonus.clone().map(|bonus| BonusTerms {
            bonus,
            seed: rng.random(),
        });
        steps.push(thanks);
        steps
    }

    fn draw_block(
        &self,
        block: &BlockId,
        choices: &Choices,
        order: Vec<usize>,
        action_orders: &mut ActionOrders,
        rng: &mut impl Rng,
    ) -> Vec<StepPlan> {
        let of = order.len();
        order
            .into_iter()
            .enumerate()
            .map(|(position, index)| {
                let question = &choices.questions[index];
                let actions: Vec<ActionId> = question
                    .actions
                    .iter()
                    .map(|action| action.id.clone())
                    .collect();
                StepPlan {
                    kind: StepKind::Choice,
                    block: block.clone(),
                    question: Some(question.id.clone()),
                    limit_ms: choices.limit_ms,
                    data: StepData {
                        levels: question.levels.iter().cloned().collect(),
                        actions: if self.draws_action_order {
                            action_orders.draw(actions, rng)
                        } else {
                            actions
                        },
                        replays: Vec::new(),
                        number: Some(position + 1),
                        of: Some(of),
                        bonus: None,
                    },
                }
            })
            .collect()
    }
}

/// The questions of a block that a person meets, in their order.
fn draw_order(
    choices: &Choices,
    meets: impl Fn(&[(FactorId, LevelId)]) -> bool,
    rng: &mut impl Rng,
) -> Vec<usize> {
    let mut units: Vec<&Unit> = choices.units.iter().collect();
    if choices.order == Order::Random {
        units.shuffle(rng);
    }
    let mut order = Vec::with_capacity(choices.questions.len());
    for unit in units {
        let mut members: Vec<usize> = unit.questions.clone().collect();
        if unit.order == Order::Random {
            members.shuffle(rng);
        }
        order.extend(members);
    }
    order.retain(|index| meets(&choices.questions[*index].levels));
    order
}

/// One order per run and set of actions, so that a person finds each action in the same place throughout.
#[derive(Default)]
struct ActionOrders(BTreeMap<Vec<ActionId>, Vec<ActionId>>);

impl ActionOrders {
    fn draw(&mut self, actions: Vec<ActionId>, rng: &mut impl Rng) -> Vec<ActionId> {
        self.0
            .entry(actions)
            .or_insert_with_key(|actions| {
                let mut order = actions.clone();
                order.shuffle(rng);
                order
            })
            .clone()
    }
}

fn draw_replays(block: &BlockId, text: &ReplaysText, rng: &mut impl Rng) -> StepPlan {
    let mut replays: Vec<ReplayId> = text
        .replays
        .iter()
        .map(|replay| replay.id.clone())
        .collect();
    if text.order == Order::Random {
        replays.shuffle(rng);
    }
    let mut step = plain_step(StepKind::Replays, block);
    step.data.replays = replays;
    step
}

fn plain_step(kind: StepKind, block: &BlockId) -> StepPlan {
    StepPlan {
        kind,
        block: block.clone(),
        question: None,
        limit_ms: None,
        data: StepData::default(),
    }
}
