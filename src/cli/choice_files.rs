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
    /// The same choices by the values of a column, where one was asked for: two or more.
    pub(super) levels: Vec<ChoiceLevel>,
}

/// The choices of the rows that have one value in a column.
pub(super) struct ChoiceLevel {
    /// The value; none for empty cells.
    pub(super) name: Option<String>,
    /// How many people, where each is known by name.
    pub(super) people: Option<u64>,
    pub(super) data: ChoiceData,
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
///
/// `by` names a column that splits the choices.
pub(super) fn read_choices(
    path: &Path,
    problems: Vec<FittedProblem>,
    by: Option<&str>,
) -> anyhow::Result<ChoiceFile> {
    let shown = path.display();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .with_context(|| format!("cannot read {shown}"))?;
    let headers = reader
        .headers()
        .with_context(|| format!("cannot read the header of {shown}"))?;
    let columns = Columns::of(headers, by).with_context(|| format!("{shown}, line 1"))?;

    let mut left_out = LeftOut::default();
    let is_known = |id: &str| problems.iter().any(|problem| problem.id == id);
    let mut all = Answers::default();
    let mut levels: BTreeMap<LevelName, Answers> = BTreeMap::new();
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
        let person = field(columns.participant);
        all.add(person, &choice)
            .with_context(|| format!("{shown}, line {line}"))?;
        // A count of 0 is no choice, and makes no level.
        if let Some(name) = field(columns.by).filter(|_| choice.count > 0) {
            let level = levels.entry(LevelName::new(name)).or_default();
            // No more than are in all of them.
            level.add(person, &choice)?;
        }
    }
    ensure!(
        all.has_choices(),
        "{shown}: there is no choice to fit: no row that is answered, has a count above 0, and is of a problem of the \
         problems file ({} answered rows are of other problems)",
        left_out.other_problems
    );
    if let (Some(by), [(LevelName(_, name), _)]) =
        (by, levels.iter().collect::<Vec<_>>().as_slice())
    {
        bail!(
            "{shown}: column `{by}` is {} in every row that is fitted, so there is nothing to compare",
            name.as_ref()
                .map_or_else(|| "empty".to_owned(), |name| format!("`{name}`"))
        );
    }
    // A count may sum the answers of several people under one name.
    let is_one_each = columns.count.is_none();
    let unit = if is_one_each && all.anonymous.is_empty() {
        Unit::Participant
    } else {
        Unit::Answer
    };
    let levels = levels
        .into_iter()
        .map(|(LevelName(_, name), answers)| {
            Ok(ChoiceLevel {
                name,
                people: (is_one_each && answers.anonymous.is_empty())
                    .then_some(answers.people.len() as u64),
                data: answers.data(&problems)?,
            })
        })
        .collect::<anyhow::Result<_>>()?;
    let data = all.data(&problems).with_context(|| format!("{shown}"))?;
    Ok(ChoiceFile {
        data,
        unit,
        left_out,
        levels,
    })
}

/// The value of a column: whole numbers in their order, then words in theirs; an empty cell comes first.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct LevelName(u64, Option<String>);

impl LevelName {
    fn new(text: &str) -> Self {
        let name = (!text.is_empty()).then(|| text.to_owned());
        let number = match &name {
            None => 0,
            Some(name) => name.parse().unwrap_or(u64::MAX),
        };
        Self(number, name)
    }
}

/// What people chose, each for themselves as far as they are known.
#[derive(Default)]
struct Answers {
    people: BTreeMap<String, Pattern>,
    anonymous: Pattern,
}

impl Answers {
    fn add(&mut self, person: Option<&str>, choice: &Choice) -> anyhow::Result<()> {
        let pattern = match person {
            Some(person) if !person.is_empty() => self.people.entry(person.to_owned()).or_default(),
            _ => &mut self.anonymous,
        };
        let count = pattern.entry((choice.problem, choice.action)).or_default();
        *count = count
            .checked_add(choice.count)
            .context("too many choices to count")?;
        Ok(())
    }

    fn has_choices(&self) -> bool {
        let patterns = self.people.values().chain([&self.anonymous]);
        patterns
            .flat_map(|pattern| pattern.values())
            .any(|count| *count > 0)
    }

    fn data(self, problems: &[FittedProblem]) -> anyhow::Result<ChoiceData> {
        let groups = groups(problems, self.people.into_values(), self.anonymous);
        Ok(ChoiceData::new(problems.to_vec(), groups)?)
    }
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
    by: Option<usize>,
}

impl Columns {
    fn of(headers: &csv::StringRecord, by: Option<&str>) -> anyhow::Result<Self> {
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
        let by = match by {
            None => None,
            // Whoever misspelt one wants to see them all.
            Some(name) => Some(find(name)?.with_context(|| {
                let there: Vec<&str> = headers.iter().collect();
                format!(
                    "no column `{name}` for --by, there are {}",
                    there.join(", ")
                )
            })?),
        };
        Ok(Self {
            by,
            problem: need("problem")?,
            action: need("action")?,
            participant: find("participant")?,
            count: find("count")?,
            status: find("status")?,
        })
    }
}
