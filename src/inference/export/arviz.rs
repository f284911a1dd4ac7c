//! All chains as one InferenceData in JSON.

use std::io::{self, Write};

use serde::Serialize;
use serde::ser::{SerializeSeq, Serializer};

use super::{ChoiceOption, DrawsExport, Fact};
use crate::inference::Draws;
use crate::model::OrderedMap;

impl DrawsExport<'_> {
    /// Writes all chains as JSON that ArviZ 0.23 reads with `arviz.from_json`.
    ///
    /// | group | holds |
    /// |---|---|
    /// | `posterior` | parameters, τ, λθ where it is reported, and `p` by option |
    /// | `sample_stats` | `lp` |
    /// | `log_likelihood` | `by_problem`; `by_pattern`, for leave-one-participant-out: repeat each pattern by its weight |
    /// | `prior` | evenly spread draws of the same quantities |
    /// | `observed_data` | `count` by option |
    /// | `constant_data` | problem and action of each option, `pattern_weight` |
    ///
    /// # Errors
    /// When `out` fails.
    pub fn write_arviz_json(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut posterior = quantities(self.draws);
        let mut log_likelihood = OrderedMap(Vec::new());
        let mut dims = vec![
            ("count", ["option"]),
            ("option_problem", ["option"]),
            ("option_action", ["option"]),
        ];
        let labels = self.options.iter().map(ChoiceOption::label).collect();
        let mut coords = vec![("option", labels)];
        if let Some(predicted) = &self.predicted {
            let vectors = Variable::vectors(self.draws, predicted.iter().collect());
            posterior.0.push(("p".to_owned(), vectors));
            dims.push(("p", ["option"]));
        }
        if let Some(by_problem) = &self.by_problem {
            let (ids, sums): (Vec<String>, Vec<&Vec<f64>>) = by_problem
                .0
                .iter()
                .map(|(id, sums)| (id.clone(), sums))
                .unzip();
            let vectors = Variable::vectors(self.draws, sums);
            log_likelihood.0.push(("by_problem".to_owned(), vectors));
            dims.push(("by_problem", ["problem"]));
            coords.push(("problem", ids));
        }
        let mut pattern_weight = None;
        if let Some(by_pattern) = &self.by_pattern {
            let vectors = Variable::vectors(self.draws, by_pattern.iter().collect());
            log_likelihood.0.push(("by_pattern".to_owned(), vectors));
            dims.push(("by_pattern", ["pattern"]));
            dims.push(("pattern_weight", ["pattern"]));
            let names = (1..=by_pattern.len()).map(|number| number.to_string());
            coords.push(("pattern", names.collect()));
            pattern_weight = Some(self.pattern_weights.as_slice());
        }
        let lp = Variable::Scalars(self.draws.by_chain(&self.lp));
        let facts: OrderedMap<Fact> = self.facts().into_iter().collect();
        let document = Document {
            posterior,
            sample_stats: [("lp".to_owned(), lp)].into_iter().collect(),
            log_likelihood,
            prior: quantities(&self.prior),
            observed_data: ObservedData {
                count: self.options.iter().map(|option| option.count).collect(),
            },
            constant_data: ConstantData {
                option_problem: self.options.iter().map(|option| option.problem).collect(),
                option_action: self.options.iter().map(|option| option.action).collect(),
                pattern_weight,
            },
            dims: named(dims),
            coords: named(coords),
            posterior_attrs: &facts,
            attrs: &facts,
        };
        serde_json::to_writer(&mut *out, &document)?;
        out.write_all(b"\n")
    }
}

fn quantities(draws: &Draws) -> OrderedMap<Variable<'_>> {
    draws
        .columns
        .iter()
        .map(|(quantity, values)| {
            (
                quantity.key().to_owned(),
                Variable::Scalars(draws.by_chain(values)),
            )
        })
        .collect()
}

fn named<T>(pairs: Vec<(&str, T)>) -> OrderedMap<T> {
    pairs
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

/// The arguments of ArviZ's `from_dict`.
#[derive(Serialize)]
struct Document<'a> {
    posterior: OrderedMap<Variable<'a>>,
    sample_stats: OrderedMap<Variable<'a>>,
    #[serde(skip_serializing_if = "is_empty")]
    log_likelihood: OrderedMap<Variable<'a>>,
    prior: OrderedMap<Variable<'a>>,
    observed_data: ObservedData,
    constant_data: ConstantData<'a>,
    dims: OrderedMap<[&'a str; 1]>,
    coords: OrderedMap<Vec<String>>,
    posterior_attrs: &'a OrderedMap<Fact>,
    attrs: &'a OrderedMap<Fact>,
}

fn is_empty(group: &OrderedMap<Variable<'_>>) -> bool {
    group.0.is_empty()
}

#[derive(Serialize)]
struct ObservedData {
    count: Vec<u64>,
}

#[derive(Serialize)]
struct ConstantData<'a> {
    option_problem: Vec<&'a str>,
    option_action: Vec<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pattern_weight: Option<&'a [u64]>,
}

/// One variable's values by chain, draw and, for vectors, entry.
enum Variable<'a> {
    Scalars(Vec<&'a [f64]>),
    Vectors(Vec<ChainOfVectors<'a>>),
}

impl<'a> Variable<'a> {
    /// * `columns`: by entry, then by draw.
    fn vectors(draws: &Draws, columns: Vec<&'a Vec<f64>>) -> Self {
        let chain = |chain: usize| {
            let range = chain * draws.per_chain..(chain + 1) * draws.per_chain;
            ChainOfVectors(
                columns
                    .iter()
                    .map(|column| &column[range.clone()])
                    .collect(),
            )
        };
        Self::Vectors((0..draws.chains).map(chain).collect())
    }
}

impl Serialize for Variable<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Scalars(chains) => chains.serialize(serializer),
            Self::Vectors(chains) => chains.serialize(serializer),
        }
    }
}

/// The entries of one chain; written draw by draw, so that no turned copy of all values is made.
struct ChainOfVectors<'a>(Vec<&'a [f64]>);

impl Serialize for ChainOfVectors<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let draws = self.0.first().map_or(0, |column| column.len());
        let mut sequence = serializer.serialize_seq(Some(draws))?;
        for draw in 0..draws {
            let entries: Vec<f64> = self.0.iter().map(|column| column[draw]).collect();
            sequence.serialize_element(&entries)?;
        }
        sequence.end()
    }
}
