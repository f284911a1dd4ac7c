//! Problems and choices from files.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, anyhow, bail, ensure};

use crate::inference::comparison::Unit;
use crate::inference::{ChoiceData, FittedProblem, Group};
use crate::model::{ChoiceProblem, OrderedMap};

/// Choices read from a file, and what was left out of it.
pub(super) struct ChoiceFile {
    pub(super) data: ChoiceData,
    /// Whether the file says who gave each answer.
    pub(super) unit: Unit,
    pub(super) left_out: LeftOut,
}

/// How many rows of a file were left out.
#[derive(Clone, Copy, Default)]
pub(super) struct LeftOut {
    /// Those that are not answered, so no choice.
    pub(super) unanswered: u64,
    /// Answered ones of a problem that is not among those to fit.
    pub(super) other_problems: u64,
}

/// Reads `{"ID":{"ACTION":[[p,R],...],...},...}`.
pub(super) fn read_problems(path: &Path) -> anyhow::Result<Vec<FittedProblem>> {
    let shown = path.display();
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {shown}"))?;
    // Read as plain numbers first, so that what is wrong with a problem can be said with its id.
    let problems: OrderedMap<OrderedMap<Vec<(f64, f64)>>> = serde_json::from_str(&text)
        .with_context(|| {
            format!(r#"{shown} is not of the form {{"ID":{{"ACTION":[[p,R],...],...}},...}}"#)
        })?;
    ensure!(!problems.0.is_empty(), "{shown} has no problem");
    let read = |(id, actions): (String, OrderedMap<Vec<(f64, f64)>>)| {
        let problem = ChoiceProblem::from_outcomes(actions.0)
            .with_context(|| format!("{shown}: problem `{id}`"))?;
        Ok(FittedProblem { id, problem })
    };
    problems.0.into_iter().map(read).collect()
}

/// Reads choices with the columns `problem` and `action`, and `participant`, `count` and `status` where there are.
///
/// With a column `status` the file is an export. Rows in it that are not `answered` are no choice, and practice, baseline
/// and other questions have rows of problems that are not to be fitted: both are counted and otherwise ignored. In a file
/// without that column an unknown problem is an error.
pub(super) fn read_choices(
    path: &Path,
    problems: Vec<FittedProblem>,
) -> anyhow::Result<ChoiceFile> {
    let shown = path.display();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .with_context(|| format!("cannot read {shown}"))?;
    let headers = reader
        .headers()
        .with_context(|| format!("cannot read the header of {shown}"))?;
    let columns = Columns::of(headers).with_context(|| format!("{shown}, line 1"))?;

    let mut left_out = LeftOut::default();
    let is_known = |id: &str| problems.iter().any(|problem| problem.id == id);
    let mut people: BTreeMap<String, Pattern> = BTreeMap::new();
    let mut anonymous = Pattern::new();
    for record in reader.records() {
        let record = record.with_context(|| format!("cannot read {shown}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        let field = |column: Option<usize>| column.and_then(|column| record.get(column));
        if field(columns.status).is_some_and(|status| status != "answered") {
            left_out.unanswered += 1;
            continue;
        }
        if columns.status.is_some() && !is_known(&record[columns.problem]) {
            left_out.other_problems += 1;
            continue;
        }
        let choice = read_choice(&record, &columns, &problems)
            .with_context(|| format!("{shown}, line {line}"))?;
        let pattern = match field(columns.participant) {
            Some(person) if !person.is_empty() => people.entry(person.to_owned()).or_default(),
            _ => &mut anonymous,
        };
        let count = pattern.entry((choice.problem, choice.action)).or_default();
        *count = count
            .checked_add(choice.count)
            .with_context(|| format!("{shown}, line {line}: too many choices to count"))?;
    }
    let counted = people
        .values()
        .chain([&anonymous])
        .flat_map(|pattern| pattern.values());
    ensure!(
        counted.copied().any(|count| count > 0),
        "{shown}: there is no choice to fit: no row that is answered, has a count above 0, and is of a problem of the \
         problems file ({} answered rows are of other problems)",
        left_out.other_problems
    );
    // A count may sum the answers of several people under one name.
    let unit = if columns.count.is_none() && anonymous.is_empty() {
        Unit::Participant
    } else {
        Unit::Answer
    };
    let groups = groups(&problems, people.into_values(), anonymous);
    let data = ChoiceData::new(problems, groups).with_context(|| format!("{shown}"))?;
    Ok(ChoiceFile {
        data,
        unit,
        left_out,
    })
}

/// How often each action of each problem was chosen, by their positions.
type Pattern = BTreeMap<(usize, usize), u64>;

/// People with the same answers make one group; a choice of nobody known is a group of its own.
fn groups(
    problems: &[FittedProblem],
    people: impl Iterator<Item = Pattern>,
    anonymous: Pattern,
) -> Vec<Group> {
    let mut weights: BTreeMap<Pattern, u64> = BTreeMap::new();
    for pattern in people {
        *weights.entry(pattern).or_default() += 1;
    }
    for (choice, count) in anonymous {
        *weights.entry(Pattern::from([(choice, 1)])).or_default() += count;
    }
    let group = |(pattern, weight): (Pattern, u64)| {
        let mut counts: Vec<Vec<u64>> = problems
            .iter()
            .map(|problem| vec![0; problem.problem.actions().len()])
            .collect();
        for ((problem, action), count) in pattern {
            counts[problem][action] = count;
        }
        Group { weight, counts }
    };
    weights.into_iter().map(group).collect()
}

struct Choice {
    problem: usize,
    action: usize,
    count: u64,
}

fn read_choice(
    record: &csv::StringRecord,
    columns: &Columns,
    problems: &[FittedProblem],
) -> anyhow::Result<Choice> {
    let id = &record[columns.problem];
    let problem = problems
        .iter()
        .position(|problem| problem.id == id)
        .ok_or_else(|| {
            let ids: Vec<&str> = problems.iter().map(|problem| problem.id.as_str()).collect();
            anyhow!(
                "column `problem`: unknown problem `{id}`, allowed are {}",
                listed(&ids)
            )
        })?;
    let name = &record[columns.action];
    let action = problems[problem].problem.position(name).ok_or_else(|| {
        let names: Vec<&str> = problems[problem].problem.names().collect();
        anyhow!(
            "column `action`: `{name}` is no action of problem `{id}`, allowed are {}",
            listed(&names)
        )
    })?;
    let count = match columns.count {
        None => 1,
        Some(column) => record[column].parse().map_err(|_| {
            anyhow!(
                "column `count`: `{}` is not a number of choices, allowed is 0, 1, 2, ...",
                &record[column]
            )
        })?,
    };
    Ok(Choice {
        problem,
        action,
        count,
    })
}

/// The first few of many names.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 12;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    if names.len() > SHOWN {
        format!("{shown}, ... ({} in all)", names.len())
    } else {
        shown
    }
}

struct Columns {
    problem: usize,
    action: usize,
    participant: Option<usize>,
    count: Option<usize>,
    status: Option<usize>,
}

impl Columns {
    fn of(headers: &csv::StringRecord) -> anyhow::Result<Self> {
        let find = |name: &str| -> anyhow::Result<Option<usize>> {
            let mut found = headers
                .iter()
                .enumerate()
                .filter(|(_, header)| *header == name);
            let first = found.next().map(|(column, _)| column);
            if found.next().is_some() {
                bail!("column `{name}` comes twice");
            }
            Ok(first)
        };
        let need = |name: &str| {
            find(name)?.ok_or_else(|| {
                let there: Vec<&str> = headers.iter().collect();
                anyhow!("no column `{name}`, there are {}", listed(&there))
            })
        };
        Ok(Self {
            problem: need("problem")?,
            action: need("action")?,
            participant: find("participant")?,
            count: find("count")?,
            status: find("status")?,
        })
    }
}
