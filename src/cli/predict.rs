//! `riskaware predict`: choice problems in, choice probabilities out, one JSON object a line.

use std::io::{self, BufRead, BufReader, Write};

use anyhow::{Context, ensure};
use serde::{Deserialize, Serialize};

use crate::model::{
    ChoiceProblem, OrderedMap, RiskAwareOptions, model_named, probabilities, utilities,
};

/// Reads one JSON object a line from standard input and answers each with one line:
///
/// {"model":"noisy_rational","parameters":{"theta":0.2},"problem":{"stay":[[1,20]],"go":[[0.2,105],[0.8,0]]}}
///
/// {"probabilities":{"stay":...,"go":...},"utilities":{...}}
///
/// The model is noisy_rational (theta) or risk_aware (alpha, beta, gamma, delta, lambda, theta; "options" may set
/// "normalise" and "zero"). A line that is wrong is answered with {"error":"..."} and the rest still is. The exit status
/// is 1 when a line was wrong (how many is told on standard error), or when input or output fails.
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub(super) struct Arguments {}

pub(super) fn run(Arguments {}: &Arguments) -> anyhow::Result<()> {
    let lines = match answer_lines(BufReader::new(io::stdin().lock()), io::stdout().lock()) {
        // Whoever reads has seen enough.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
        result => result.context("cannot read problems or write answers")?,
    };
    ensure!(
        lines.wrong == 0,
        "{} of {} lines could not be answered; each has its error as its answer",
        lines.wrong,
        lines.all
    );
    Ok(())
}

/// How many lines came.
#[derive(Debug, Default)]
struct Lines {
    all: u64,
    wrong: u64,
}

fn answer_lines<R: io::Read>(mut input: BufReader<R>, output: impl Write) -> io::Result<Lines> {
    let mut lines = Lines::default();
    let mut output = io::BufWriter::new(output);
    let mut line = Vec::new();
    while input.read_until(b'\n', &mut line)? > 0 {
        lines.all += 1;
        let answer = answer(&line).unwrap_or_else(|error| {
            lines.wrong += 1;
            Answer::Error {
                error: format!("{error:#}"),
            }
        });
        serde_json::to_writer(&mut output, &answer)?;
        output.write_all(b"\n")?;
        // A robot that waits for the answer before it asks again must get it.
        if input.buffer().is_empty() {
            output.flush()?;
        }
        line.clear();
    }
    output.flush()?;
    Ok(lines)
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Question {
    model: String,
    parameters: OrderedMap<f64>,
    problem: ChoiceProblem,
    #[serde(default)]
    options: RiskAwareOptions,
}

#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Answer {
    Choice {
        probabilities: OrderedMap<f64>,
        utilities: OrderedMap<f64>,
    },
    Error {
        error: String,
    },
}

fn answer(line: &[u8]) -> anyhow::Result<Answer> {
    let line = line.trim_ascii();
    anyhow::ensure!(
        !line.is_empty(),
        "the line is empty, a JSON object is needed"
    );
    let Question {
        model,
        parameters,
        problem,
        options,
    } = serde_json::from_slice(line).map_err(|error| {
        // Every line is line 1 to the parser.
        anyhow::Error::msg(error.to_string().replace(" at line 1 column", " at column"))
    })?;
    let model = model_named(&model)?;
    let options = model.options(options);
    let parameters =
        model.parameters_from(parameters.iter().map(|(name, value)| (name, *value)))?;
    let by_action = |values: Vec<f64>| -> OrderedMap<f64> {
        problem.names().map(str::to_owned).zip(values).collect()
    };
    Ok(Answer::Choice {
        probabilities: by_action(probabilities(&problem, &parameters, options)?),
        utilities: by_action(utilities(&problem, &parameters, options)?),
    })
}
