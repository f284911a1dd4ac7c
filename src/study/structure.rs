//! What all languages of a study have in common: everything that stored steps and answers refer to.

use super::Study;
use super::definition::BlockBody;

impl Study {
    /// The ids, steps and problems of a study, without its texts: a line for each thing that a translation must leave
    /// as it is.
    pub(super) fn structure(&self) -> Vec<String> {
        let mut lines = vec![format!("{:?}", self.conditions)];
        for cell in &self.cells {
            lines.push(format!("{:?}", (&cell.id, &cell.levels, &cell.problem)));
        }
        for block in &self.blocks {
            lines.push(format!("{}", block.id));
            lines.extend(parts(&block.body));
        }
        lines
    }
}

fn parts(body: &BlockBody) -> Vec<String> {
    match body {
        BlockBody::Consent(text) => {
            let clauses = text.clauses.iter();
            clauses
                .map(|clause| format!("clause {} {}", clause.id, clause.required))
                .collect()
        }
        BlockBody::Info(text) => vec![format!("info {:?}", text.when)],
        BlockBody::Replays(text) => vec![format!("{:?}", text.replays)],
        BlockBody::Choice(choices) => {
            let questions = choices.questions.iter();
            let questions = questions.map(|question| {
                let actions: Vec<_> = question.actions.iter().map(|action| &action.id).collect();
                let (id, problem) = (&question.id, &question.problem);
                format!(
                    "{:?}",
                    (id, &question.levels, problem, question.role, actions)
                )
            });
            questions
                .chain([format!("{:?} {:?}", choices.limit_ms, choices.units)])
                .collect()
        }
        BlockBody::Form(text) => text
            .fields
            .iter()
            .map(|field| {
                let options: Vec<_> = field.options().iter().map(|option| &option.id).collect();
                let answers = (&field.correct, &field.expected);
                format!("{:?}", (field.value_names(), options, answers))
            })
            .collect(),
    }
}
