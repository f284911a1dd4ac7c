//! Choice blocks: groups and questions.

use super::blocks::{Asked, Reader, block_id, scene};
use super::cells::AskedCell;
use super::design::{Levels, check_value_names};
use super::problem::{self, Offer};
use super::rules;
use crate::model::ChoiceProblem;
use crate::study::definition::{Choices, Order, Unit};
use crate::study::document::{Fault, KeyPath};
use crate::study::file::{RawAction, RawChoices, RawGroup, RawQuestion};
use crate::study::step::{ChoiceQuestion, InfoText, Role};
use crate::study::template::{Scalar, Scope, Values};
use crate::study::{ActionId, Baseline, BlockId, CellId, QuestionId};

/// The longest time limit, in seconds.
const LONGEST_LIMIT_S: f64 = 3_600.0;

/// Reads a choice block: its id and its questions. What they ask is added to `asked`.
pub(super) fn read(
    reader: &Reader<'_>,
    raw: &RawChoices,
    at: &KeyPath,
    asked: &mut Asked,
) -> Result<(String, Choices), Fault> {
    let id = block_id(&raw.id, at)?;
    if raw.practice && raw.baseline {
        return Err(at.key("baseline").fault(
            "`true` in a practice block",
            "either `practice` or `baseline`",
        ));
    }
    let limit_ms = raw
        .limit_s
        .map(|seconds| limit_ms(seconds, &at.key("limit_s")))
        .transpose()?;
    let block_values: Values = raw
        .limit_s
        .map(|seconds| ("limit".to_owned(), Scalar::Number(seconds)))
        .into_iter()
        .collect();
    let levels = reader.design.levels(&raw.levels, &at.key("levels"))?;
    let general = reader.design.scope().with(&block_values);
    let scope = reader.design.scope_with(&general, &levels);

    let start = match &raw.start {
        Some(start) => {
            let at = at.key("start");
            Some(InfoText {
                title: rules::filled_line(&start.title, &scope, &at.key("title"))?,
                text_html: rules::filled_markdown(&start.text, &scope, &at.key("text"))?,
                scene: None,
                button: rules::filled_line(&start.button, &scope, &at.key("button"))?,
                when: Vec::new(),
            })
        }
        None if limit_ms.is_some() => {
            let allowed = "a table with title, text and button: a person starts the clock, nobody is surprised by it";
            return Err(at
                .key("start")
                .fault("no start page for a block with a time limit", allowed));
        }
        None => None,
    };

    let scene = scene(raw.scene.as_ref(), at)?;
    let mut block = BlockReader {
        reader,
        raw,
        at,
        id: &id,
        scope: &general,
        levels,
        limit_ms,
        scene,
        questions: Vec::new(),
        asked,
    };
    let mut units = Vec::with_capacity(raw.group.len() + raw.question.len());
    for (index, group) in raw.group.iter().enumerate() {
        units.push(block.group(group, &at.key("group").index(index))?);
    }
    for (index, question) in raw.question.iter().enumerate() {
        units.push(block.single(question, &at.key("question").index(index))?);
    }
    let questions = block.questions;
    if questions.is_empty() {
        return Err(at.fault(
            "no question",
            "one [[block.group]] or [[block.question]] or more",
        ));
    }
    if let Some(share) = raw.reference_share {
        reference_share(share, raw.baseline, asked, &at.key("reference_share"))?;
    }
    Ok((
        id,
        Choices {
            limit_ms,
            start,
            order: raw.order,
            units,
            questions,
        },
    ))
}

fn limit_ms(seconds: f64, at: &KeyPath) -> Result<u64, Fault> {
    // The smallest limit is the smallest time that can be stored.
    if (0.001..=LONGEST_LIMIT_S).contains(&seconds) {
        Ok((seconds * 1_000.0).round() as u64)
    } else {
        Err(at.fault(
            seconds,
            format!("more than 0 and at most {LONGEST_LIMIT_S} seconds; leave it out for no limit"),
        ))
    }
}

fn reference_share(
    share: f64,
    is_baseline: bool,
    asked: &mut Asked,
    at: &KeyPath,
) -> Result<(), Fault> {
    if !is_baseline {
        return Err(at.fault(
            "a share for a block that is no baseline",
            "`reference_share` beside `baseline = true`",
        ));
    }
    if !(0.0..=1.0).contains(&share) {
        return Err(at.fault(share, "a share from 0 to 1"));
    }
    if asked.baseline_share.replace(share).is_some() {
        return Err(at.fault("a second share", "one `reference_share` in the file"));
    }
    Ok(())
}

struct BlockReader<'a> {
    reader: &'a Reader<'a>,
    raw: &'a RawChoices,
    at: &'a KeyPath,
    id: &'a str,
    /// The values outside levels and questions.
    scope: &'a Scope<'a>,
    levels: Levels,
    limit_ms: Option<u64>,
    scene: Option<String>,
    questions: Vec<ChoiceQuestion>,
    asked: &'a mut Asked,
}

/// One question before its texts are filled in.
struct Draft<'a> {
    id: String,
    label: Option<&'a str>,
    levels: Levels,
    values: Option<&'a Values>,
    /// The text and where it stands.
    text: Option<(&'a str, KeyPath)>,
    actions: Option<&'a [RawAction]>,
    fitted: Option<bool>,
    at: &'a KeyPath,
}

impl BlockReader<'_> {
    fn group(&mut self, raw: &RawGroup, at: &KeyPath) -> Result<Unit, Fault> {
        let design = self.reader.design;
        let own = design.levels(&raw.levels, &at.key("levels"))?;
        let first = self.questions.len();
        for crossed in design.cross(&raw.cross, &at.key("cross"))? {
            let in_group = design.join(&own, &crossed, &at.key("cross"))?;
            if in_group.is_empty() {
                return Err(at.fault("a group without levels", "`levels`, `cross` or both"));
            }
            self.add(Draft {
                id: design.joined_ids(&in_group, "-"),
                label: None,
                levels: design.join(&self.levels, &in_group, &at.key("levels"))?,
                values: None,
                text: raw.text.as_deref().map(|text| (text, at.key("text"))),
                actions: None,
                fitted: raw.fitted,
                at,
            })?;
        }
        Ok(Unit {
            order: raw.order,
            questions: first..self.questions.len(),
        })
    }

    fn single(&mut self, raw: &RawQuestion, at: &KeyPath) -> Result<Unit, Fault> {
        let design = self.reader.design;
        check_value_names(&raw.values, &at.key("values"))?;
        let own = design.levels(&raw.levels, &at.key("levels"))?;
        let first = self.questions.len();
        self.add(Draft {
            id: rules::id(&raw.id, &at.key("id"))?,
            label: raw.label.as_deref(),
            levels: design.join(&self.levels, &own, &at.key("levels"))?,
            values: Some(&raw.values),
            text: raw.text.as_deref().map(|text| (text, at.key("text"))),
            actions: raw.actions.as_deref(),
            fitted: raw.fitted,
            at,
        })?;
        Ok(Unit {
            order: Order::Fixed,
            questions: first..self.questions.len(),
        })
    }

    fn add(&mut self, draft: Draft<'_>) -> Result<(), Fault> {
        let design = self.reader.design;
        if self
            .questions
            .iter()
            .any(|question| question.id == *draft.id)
        {
            let allowed = "another id for each question of a block";
            return Err(draft.at.fault(
                format!("question `{}` for the second time", draft.id),
                allowed,
            ));
        }
        let role = self.role(&draft)?;
        let mut scope = design.scope_with(self.scope, &draft.levels);
        if let Some(values) = draft.values {
            scope = scope.with(values);
        }
        let (text, text_at) = self.text(&draft)?;
        let text_html = rules::filled_markdown(text, &scope, &text_at)?;
        let Offer { actions, problem } = self.offer(&draft, &scope)?;
        let cell = match role {
            Role::Fitted | Role::ShownOnly => self.cell_id(&draft),
            Role::Baseline | Role::Practice => None,
        };
        if role == Role::Fitted {
            self.check_fitted(&draft, cell.as_ref(), problem.as_ref())?;
        }
        if role == Role::Baseline {
            let label = match draft.label {
                Some(label) => rules::filled_line(label, &scope, &draft.at.key("label"))?,
                None => draft.id.clone(),
            };
            let baseline = self.baseline(&draft, label, problem.as_ref())?;
            self.asked.baseline.push(baseline);
        }
        let question = ChoiceQuestion {
            id: QuestionId::from(draft.id.as_str()),
            levels: design.named(&draft.levels),
            title: rules::filled_line(&self.raw.title, &scope, &self.at.key("title"))?,
            text_html,
            scene: self.scene.clone(),
            actions,
            problem,
            cell,
            role,
        };
        self.asked.asked.extend(AskedCell::of(
            &question,
            design,
            &draft.levels,
            self.limit_ms,
            draft.at,
        ));
        self.questions.push(question);
        Ok(())
    }

    fn role(&self, draft: &Draft<'_>) -> Result<Role, Fault> {
        let given = draft.fitted.or(self.raw.fitted);
        if (self.raw.practice || self.raw.baseline) && given == Some(true) {
            let at = if draft.fitted.is_some() {
                draft.at
            } else {
                self.at
            };
            let allowed = "no `fitted` there: such a block is never fitted";
            return Err(at
                .key("fitted")
                .fault("`true` in a practice or baseline block", allowed));
        }
        Ok(if self.raw.practice {
            Role::Practice
        } else if self.raw.baseline {
            Role::Baseline
        } else if given.unwrap_or(true) {
            Role::Fitted
        } else {
            Role::ShownOnly
        })
    }

    fn text<'d>(&'d self, draft: &Draft<'d>) -> Result<(&'d str, KeyPath), Fault> {
        let default = KeyPath::root().key("question").key("text");
        match (&draft.text, &self.reader.raw.question.text) {
            (Some((text, at)), _) => Ok((text, at.clone())),
            (None, Some(text)) => Ok((text, default)),
            (None, None) => {
                let allowed = "a `text` here, or one for all questions under [question]";
                Err(draft.at.key("text").fault("no text", allowed))
            }
        }
    }

    fn offer(&self, draft: &Draft<'_>, scope: &Scope<'_>) -> Result<Offer, Fault> {
        let (actions, at) = match draft.actions {
            Some(actions) => (actions, draft.at.key("actions")),
            None => (
                self.reader.raw.action.as_slice(),
                KeyPath::root().key("action"),
            ),
        };
        problem::offer(
            self.reader.design,
            actions,
            scope,
            &format!("{}/{}", self.id, draft.id),
            &at,
        )
    }

    /// In a study without factors each question is a cell of its own.
    fn cell_id(&self, draft: &Draft<'_>) -> Option<CellId> {
        let design = self.reader.design;
        if design.factors().is_empty() {
            Some(CellId::from(draft.id.as_str()))
        } else {
            design.cell_id(&draft.levels)
        }
    }

    fn check_fitted(
        &self,
        draft: &Draft<'_>,
        cell: Option<&CellId>,
        problem: Option<&ChoiceProblem>,
    ) -> Result<(), Fault> {
        if cell.is_none() {
            let open = self.reader.design.open_factors(&draft.levels).join(", ");
            return Err(draft.at.key("levels").fault(
                format!(
                    "question `{}`, which is fitted, without a level of: {open}",
                    draft.id
                ),
                "a level of every factor, or `fitted = false`",
            ));
        }
        if problem.is_none() {
            return Err(draft.at.fault(
                format!(
                    "question `{}`, which is fitted, without all of its probabilities and rewards",
                    draft.id
                ),
                "values for every name in its outcomes, or `fitted = false`",
            ));
        }
        Ok(())
    }

    fn baseline(
        &self,
        draft: &Draft<'_>,
        label: String,
        problem: Option<&ChoiceProblem>,
    ) -> Result<Baseline, Fault> {
        let problem = problem.ok_or_else(|| {
            draft.at.fault(
                format!(
                    "baseline question `{}` without all of its probabilities and rewards",
                    draft.id
                ),
                "values for every name in its outcomes",
            )
        })?;
        let optimal = optimal_action(problem).ok_or_else(|| {
            draft.at.fault(
                format!(
                    "baseline question `{}`, in which two actions have the highest expected reward",
                    draft.id
                ),
                "one action with the highest expected reward",
            )
        })?;
        Ok(Baseline {
            block: BlockId::from(self.id),
            question: QuestionId::from(draft.id.as_str()),
            label,
            problem: problem.clone(),
            limit_ms: self.limit_ms,
            optimal,
        })
    }
}

/// The action with the highest expected reward, unless there is a tie.
fn optimal_action(problem: &ChoiceProblem) -> Option<ActionId> {
    let expected = |index: usize| problem.actions()[index].prospect.expected_reward();
    let best = (0..problem.actions().len())
        .max_by(|left, right| expected(*left).total_cmp(&expected(*right)))?;
    let is_tied = (0..problem.actions().len()).any(|other| {
        other != best
            && (expected(best) - expected(other)).abs() <= 1e-9 * expected(best).abs().max(1.0)
    });
    (!is_tied).then(|| ActionId::from(problem.actions()[best].name.as_str()))
}
