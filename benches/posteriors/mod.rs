//! The four posteriors on which samplers are compared, with the weighting floor at 0.28.

use riskaware::inference::{ChoiceData, FitSettings, FittedProblem};
use riskaware::model::{ChoiceModel, ChoiceProblem, NOISY_RATIONAL, RISK_AWARE};

/// One posterior: a model, choices, and the default settings.
pub struct Case {
    /// The name in tables.
    pub name: &'static str,
    /// The model.
    pub model: &'static ChoiceModel,
    /// The choices.
    pub data: ChoiceData,
    /// Priors and seed.
    pub settings: FitSettings,
}

impl std::fmt::Display for Case {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(self.name)
    }
}

/// P1 to P4.
///
/// * P1: Noisy Rational, the cups, 43 of 50 stable.
/// * P2: Risk-Aware, the same choices.
/// * P3: Risk-Aware, one driving cell of low risk with a fine of 100, 25 of 30 stop.
/// * P4: Risk-Aware, eight driving cells together: 98 of 120 stop under low risk, 112 of 120 under high risk.
pub fn cases() -> Vec<Case> {
    let case = |name, model, data| Case {
        name,
        model,
        data,
        settings: FitSettings::default(),
    };
    vec![
        case("P1", &NOISY_RATIONAL, cups()),
        case("P2", &RISK_AWARE, cups()),
        case("P3", &RISK_AWARE, driving(&[(0.05, 25)])),
        case(
            "P4",
            &RISK_AWARE,
            driving(&[
                (0.05, 24),
                (0.05, 25),
                (0.05, 24),
                (0.05, 25),
                (0.95, 28),
                (0.95, 28),
                (0.95, 28),
                (0.95, 28),
            ]),
        ),
    ]
}

/// 20 for sure against 105 with probability 0.2: 43 of 50 take the stable cup.
pub fn cups() -> ChoiceData {
    let stable = [(1.0, 20.0)];
    let unstable = [(0.2, 105.0), (0.8, 0.0)];
    let actions = [("stable", &stable[..]), ("unstable", &unstable[..])];
    data(vec![("cups".to_owned(), actions, [43, 7])])
}

/// Driving cells of 30 people with a fine of 100: each with the probability that the light turns red, and how many stop.
pub fn driving(cells: &[(f64, u64)]) -> ChoiceData {
    let stop = [(1.0, -100.0)];
    let gambles: Vec<_> = cells
        .iter()
        .map(|(red, _)| [(*red, -500.0), (1.0 - red, 0.0)])
        .collect();
    let rows = cells.iter().zip(&gambles).enumerate();
    data(
        rows.map(|(index, ((_, stopped), gamble))| {
            let actions = [("accelerate", &gamble[..]), ("stop", &stop[..])];
            (format!("cell {index}"), actions, [30 - stopped, *stopped])
        })
        .collect(),
    )
}

type Row<'a> = (String, [(&'a str, &'a [(f64, f64)]); 2], [u64; 2]);

fn data(rows: Vec<Row<'_>>) -> ChoiceData {
    let counts = rows.iter().map(|(_, _, counts)| counts.to_vec()).collect();
    let problems = rows.into_iter().map(|(id, actions, _)| FittedProblem {
        id,
        problem: ChoiceProblem::from_outcomes(actions).expect("the problem is valid"),
    });
    ChoiceData::from_counts(problems.collect(), counts).expect("the shapes agree")
}
