use super::super::tests::{driving, scores, settings};
use super::*;
use crate::model::{PAPER_MODELS, RISK_AWARE};

#[test]
fn the_driving_studys_fine_runs_from_26_to_474_with_the_optimum_unchanged() {
    let problems = [driving(0.95, false), driving(0.05, false)];
    let variation = Variation::default_for(&problems).unwrap();
    assert_eq!(variation.to_string(), "stop:-50=-26..-474");
    let sweep = GapSweep::new(&problems, variation, 15, &Pattern::default()).unwrap();
    let gaps: Vec<f64> = sweep.points().map(|point| point.gap).collect();
    assert_eq!(gaps.len(), 30);
    let near = |found: f64, expected: f64| (found - expected).abs() < 1e-9;
    // Stopping is optimal at 95 %, accelerating at 5 %.
    assert!(near(gaps[0], 449.0) && near(gaps[14], 1.0), "{gaps:?}");
    assert!(near(gaps[15], -1.0) && near(gaps[29], -449.0), "{gaps:?}");
    assert!(
        sweep.cells().iter().all(|cell| cell.counts == [5, 25]),
        "the safe action is held"
    );
}

#[test]
fn a_probability_varies_with_its_complement() {
    let variation: Variation = "accelerate:p(-500)=0.1..0.9".parse().unwrap();
    assert_eq!(variation.to_string(), "accelerate:p(-500)=0.1..0.9");
    let found = variation.applied(&driving(0.95, false), 0.25).unwrap();
    let outcomes = found.problem.actions()[0].prospect.outcomes();
    assert!((outcomes[1].probability - 0.25).abs() < 1e-12);
    assert!((outcomes[0].probability - 0.75).abs() < 1e-12);
}

#[track_caller]
fn refused(text: &str, expected: &str) {
    let problems = [driving(0.95, false)];
    let error = text
        .parse()
        .and_then(|variation| GapSweep::new(&problems, variation, 3, &Pattern::default()))
        .unwrap_err()
        .to_string();
    assert!(error.contains(expected), "{error}");
}

#[test]
fn what_cannot_vary_is_refused() {
    refused("fine=26..474", "does not say what varies");
    refused("stop:-50=26..inf", "does not say what varies");
    refused("wait:-50=-26..-474", "allowed are accelerate, stop");
    refused("stop:-51=-26..-474", "has no outcome with reward -51");
    refused("stop:p(-50)=0..1", "comes for sure");
    refused("accelerate:p(-500)=0..2", "with the value 2");
    let pattern = Pattern::Held {
        action: None,
        count: 31,
        n: 30,
    };
    let problems = [driving(0.95, false)];
    let variation = Variation::default_for(&problems).unwrap();
    assert_eq!(
        GapSweep::new(&problems, variation, 3, &pattern),
        Err(SweepError::TooManyOnAction { count: 31, n: 30 })
    );
}

/// The paper's claim, and its limits. 25 of 30 on the better action by far: both models follow. On the worse one by far (474
/// for sure against a 5 % risk of 500): neither does. Where the two are close: Risk-Aware alone if a small risk is to be
/// avoided; Noisy Rational if a large one is, which Risk-Aware sees as smaller than it is.
#[test]
fn risk_aware_gains_where_expected_rewards_are_close() {
    let problems = [driving(0.95, false), driving(0.05, false)];
    let variation = Variation::default_for(&problems).unwrap();
    let sweep = GapSweep::new(&problems, variation, 2, &Pattern::default()).unwrap();
    let simulation = Simulation::new(sweep.cells(), PAPER_MODELS.to_vec(), 2, settings()).unwrap();
    let report = sweep.report(&simulation, &scores(&simulation));
    let gain = |series: usize, point: usize| {
        let point = &report.series[series].points[point];
        point.difference.get(RISK_AWARE.id).unwrap().mean.unwrap()
    };
    assert!(gain(0, 0).abs() < 1.5, "optimal, far: {}", gain(0, 0));
    assert!(gain(1, 1).abs() < 0.5, "suboptimal, far: {}", gain(1, 1));
    assert!(gain(1, 0) > 1.5, "suboptimal by 1 of 500: {}", gain(1, 0));
    assert!(gain(0, 1) < -0.5, "optimal by 1 of 500: {}", gain(0, 1));
}

#[test]
fn observed_answers_stay_as_they_are_and_empty_cells_are_left_out() {
    let problems = [driving(0.95, false), driving(0.05, false)];
    let variation = Variation::default_for(&problems).unwrap();
    let pattern = Pattern::Observed(vec![vec![0, 0], vec![4, 2]]);
    let sweep = GapSweep::new(&problems, variation.clone(), 2, &pattern).unwrap();
    assert_eq!(sweep.series.len(), 1);
    assert_eq!(
        (sweep.series[0].held, sweep.cells()[0].counts.as_slice()),
        (0, &[4, 2][..])
    );
    let nobody = Pattern::Observed(vec![vec![0, 0]; 2]);
    assert_eq!(
        GapSweep::new(&problems, variation, 2, &nobody),
        Err(SweepError::Nothing)
    );
}
