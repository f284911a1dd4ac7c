//! Plain tests on choices, which need no model.

use crate::{
    inference::comparison::ChoiceTests,
    jobs::Snapshot,
    web::results::{
        format::{count, percent, percents},
        table::{Align, Table},
    },
};

/// The tests of the newest comparison: the same for every plan.
fn tests(snapshot: &Snapshot) -> Option<&ChoiceTests> {
    let plans = snapshot.study.plans().iter();
    plans
        .filter_map(|plan| snapshot.comparison(&plan.id))
        .max_by_key(|known| known.at)?
        .tests
        .as_deref()
}

/// Each cell against one half.
pub(super) fn halves(snapshot: &Snapshot) -> Table {
    let mut table = Table::new(&[
        ("Cell", Align::Words),
        ("Action", Align::Words),
        ("Chosen", Align::Numbers),
        ("Share (95 % Wilson)", Align::Numbers),
        ("p, exact binomial", Align::Numbers),
        ("p after Holm", Align::Numbers),
    ]);
    for test in tests(snapshot).map_or(&[][..], |tests| &tests.cells) {
        table.row([
            cell_label(snapshot, &test.cell),
            action_label(snapshot, &test.action),
            format!("{} of {}", count(test.count), count(test.n)),
            format!(
                "{} ({})",
                percent(Some(test.share)),
                percents(Some(test.low), Some(test.high))
            ),
            p_value(test.p),
            p_value(test.p_holm),
        ]);
    }
    table
}

/// What changes within people between neighbouring levels of a factor.
pub(super) fn changes(snapshot: &Snapshot) -> Table {
    let mut table = Table::new(&[
        ("Factor", Align::Words),
        ("First cell", Align::Words),
        ("Second cell", Align::Words),
        ("Action", Align::Words),
        ("People", Align::Numbers),
        ("Only in the first", Align::Numbers),
        ("Only in the second", Align::Numbers),
        (
            "Difference of shares (95 %, people drawn anew)",
            Align::Numbers,
        ),
        ("p, exact McNemar", Align::Numbers),
        ("p after Holm", Align::Numbers),
    ]);
    for test in tests(snapshot).map_or(&[][..], |tests| &tests.pairs) {
        let factor = snapshot
            .study
            .factors()
            .iter()
            .find(|factor| factor.id == *test.pair.factor);
        table.row([
            factor.map_or_else(|| test.pair.factor.clone(), |factor| factor.label.clone()),
            cell_label(snapshot, &test.pair.first),
            cell_label(snapshot, &test.pair.second),
            action_label(snapshot, &test.pair.action),
            count(test.n),
            count(test.pair.first_only),
            count(test.pair.second_only),
            format!(
                "{} ({} to {})",
                points(test.risk_difference),
                points(test.low),
                points(test.high)
            ),
            p_value(test.p),
            p_value(test.p_holm),
        ]);
    }
    table
}

/// A difference of shares in percentage points.
fn points(difference: f64) -> String {
    let rounded = (difference * 100.0).round();
    let sign = if rounded < 0.0 {
        "\u{2212}"
    } else if rounded > 0.0 {
        "+"
    } else {
        ""
    };
    format!("{sign}{} %", rounded.abs())
}

fn p_value(p: f64) -> String {
    if p < 0.001 {
        "< .001".to_owned()
    } else {
        format!("{p:.3}").trim_start_matches('0').to_owned()
    }
}

fn cell_label(snapshot: &Snapshot, id: &str) -> String {
    let cell = snapshot.study.cell(id);
    cell.map_or_else(|| id.to_owned(), |cell| cell.label.clone())
}

fn action_label(snapshot: &Snapshot, id: &str) -> String {
    let mut actions = snapshot.study.cells().iter().flat_map(|cell| &cell.actions);
    let action = actions.find(|action| action.id == *id);
    action.map_or_else(|| id.to_owned(), |action| action.label.clone())
}
