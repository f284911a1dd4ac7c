//! Comparisons of models over simulated and constructed answers.

use std::ops::ControlFlow;

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use riskaware::inference::comparison::{
    Comparison, ComparisonProgress, ComparisonSettings, Hypothesis, KnownFit, Leaning, Outcome,
    Pair, PlanData, Question, Unit, Verdict, compare_models,
};
use riskaware::inference::{
    ChoiceData, FitError, FitSettings, FittedProblem, Group, fit, predict_from_draws, uninterrupted,
};
use riskaware::model::{
    ChoiceModel, ChoiceProblem, MODELS, NOISY_RATIONAL, Parameter, Parameters, RISK_AWARE,
    RiskAwareOptions, probabilities,
};

fn problem(id: &str, actions: &[(&str, &[(f64, f64)])]) -> FittedProblem {
    FittedProblem {
        id: id.to_owned(),
        problem: ChoiceProblem::from_outcomes(actions.iter().copied()).unwrap(),
    }
}

/// Problems over gains, losses and both, with certain and rare outcomes.
fn problems() -> Vec<FittedProblem> {
    vec![
        problem(
            "gain",
            &[
                ("safe", &[(1.0, 30.0)]),
                ("risky", &[(0.8, 40.0), (0.2, 0.0)]),
            ],
        ),
        problem(
            "rare",
            &[
                ("safe", &[(1.0, 5.0)]),
                ("risky", &[(0.05, 120.0), (0.95, 0.0)]),
            ],
        ),
        problem(
            "loss",
            &[
                ("safe", &[(1.0, -30.0)]),
                ("risky", &[(0.8, -40.0), (0.2, 0.0)]),
            ],
        ),
        problem(
            "mixed",
            &[
                ("safe", &[(1.0, 0.0)]),
                ("risky", &[(0.5, 40.0), (0.5, -25.0)]),
            ],
        ),
    ]
}

/// One answer to each problem from each of `people`, who all choose alike.
fn simulated(
    problems: &[FittedProblem],
    person: &Parameters,
    people: u64,
    seed: u64,
) -> ChoiceData {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    let mut answer = |problem: &FittedProblem| {
        let shares = probabilities(&problem.problem, person, RiskAwareOptions::default()).unwrap();
        let at: f64 = rng.random();
        let mut below = 0.0;
        let chosen = shares
            .iter()
            .position(|share| {
                below += share;
                at < below
            })
            .unwrap_or(shares.len() - 1);
        let mut counts = vec![0; shares.len()];
        counts[chosen] = 1;
        counts
    };
    let groups = (0..people)
        .map(|_| Group {
            weight: 1,
            counts: problems.iter().map(&mut answer).collect(),
        })
        .collect();
    ChoiceData::new(problems.to_vec(), groups).unwrap()
}

fn rational() -> Parameters {
    Parameters::ONES.with(Parameter::Theta, 0.25).unwrap()
}

fn prospect_chooser() -> Parameters {
    let values = [0.8, 0.8, 0.5, 0.5, 2.25, 0.5];
    let entries = Parameter::ALL.iter().map(|name| name.key()).zip(values);
    RISK_AWARE.parameters_from(entries).unwrap()
}

fn undisturbed(_: ComparisonProgress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn compared(plan: &PlanData, wanted: &ComparisonSettings) -> Comparison {
    let models: Vec<&'static ChoiceModel> = MODELS.to_vec();
    let settings = FitSettings::default();
    compare_models(plan, &models, &settings, &[], wanted, &mut undisturbed).unwrap()
}

fn risk_aware_against_noisy_rational(comparison: &Comparison) -> &Pair {
    let pairs = &mut comparison.pairs.iter();
    pairs
        .find(|pair| pair.first == RISK_AWARE.id && pair.second == NOISY_RATIONAL.id)
        .unwrap()
}

/// Fits without each person in turn are what the weighted draws stand for.
#[test]
fn leaving_out_by_weights_agrees_with_leaving_out_by_fits() {
    let data = simulated(&problems(), &prospect_chooser(), 12, 3);
    let found = compared(
        &PlanData::whole(&data, Unit::Participant),
        &ComparisonSettings::BRIEF,
    );
    for model in [&NOISY_RATIONAL, &RISK_AWARE] {
        let mut exact = 0.0;
        for left_out in 0..data.groups().len() {
            let mut groups = data.groups().to_vec();
            let person = groups.remove(left_out);
            let others = ChoiceData::new(data.problems().to_vec(), groups).unwrap();
            let fit = fit(model, &others, &FitSettings::default(), &mut uninterrupted).unwrap();
            assert!(fit.summary.converged);
            let mut likelihood = 0.0;
            for draw in 0..fit.draws.len() {
                let mut ln_l = 0.0;
                for (problem, counts) in data.problems().iter().zip(&person.counts) {
                    let shares = probabilities(
                        &problem.problem,
                        &fit.draws.parameters(draw),
                        RiskAwareOptions::default(),
                    )
                    .unwrap();
                    let chosen = counts.iter().position(|count| *count == 1).unwrap();
                    ln_l += shares[chosen].ln();
                }
                likelihood += ln_l.exp();
            }
            exact += (likelihood / fit.draws.len() as f64).ln();
        }
        let scores = found.models.get(model.id).unwrap();
        let leave_one_out = scores.leave_one_out.as_ref().unwrap();
        // Twelve terms, each with a Monte-Carlo error of about 0.01.
        assert!(
            (leave_one_out.elpd - exact).abs() < 0.15,
            "{leave_one_out:?} {exact}"
        );
        assert_eq!(leave_one_out.units, 12);
    }
}

#[test]
fn the_model_that_made_the_answers_is_favoured() {
    for (person, seed, sign) in [(rational(), 5, -1.0), (prospect_chooser(), 6, 1.0)] {
        let data = simulated(&problems(), &person, 60, seed);
        let wanted = ComparisonSettings {
            leave_one_out: false,
            sensitivity: true,
            held_out: None,
            bootstrap: None,
        };
        let found = compared(&PlanData::whole(&data, Unit::Participant), &wanted);
        let pair = risk_aware_against_noisy_rational(&found);
        let factor = pair.bayes_factor.as_ref().unwrap();
        assert_eq!(factor.ln.value.signum(), sign, "{factor:?}");
        assert_eq!(factor.sensitivity.as_ref().unwrap().len(), 7);
        if factor.words.is_some() {
            assert_eq!(factor.common_sign(), Some(sign));
        }
    }
}

/// 150 people who weigh probabilities as prospect theory says, in ten problems that differ: all three criteria speak for
/// the richer model, so the claim is supported.
#[test]
fn a_full_comparison_reaches_a_verdict() {
    let mut many = problems();
    let more = [
        (0.3, 90.0, 20.0),
        (0.6, 60.0, 25.0),
        (0.01, 200.0, 4.0),
        (0.1, 150.0, 12.0),
        (0.9, 50.0, 38.0),
        (0.02, 300.0, 10.0),
    ];
    for (index, (probability, gain, sure)) in more.iter().enumerate() {
        let risky = [(*probability, *gain), (1.0 - probability, 0.0)];
        many.push(problem(
            &format!("more {index}"),
            &[("safe", &[(1.0, *sure)]), ("risky", &risky)],
        ));
    }
    let data = simulated(&many, &prospect_chooser(), 150, 11);
    let plan = PlanData::whole(&data, Unit::Participant);
    let found = compare_models(
        &plan,
        &[&NOISY_RATIONAL, &RISK_AWARE],
        &FitSettings::default(),
        &[],
        &ComparisonSettings::full(1),
        &mut undisturbed,
    )
    .unwrap();

    let held_out = found.held_out.as_ref().unwrap();
    assert_eq!((held_out.problems.len(), held_out.n), (10, 1500));
    let names: Vec<&str> = held_out.scores.iter().map(|(name, _)| name).collect();
    assert_eq!(
        names,
        ["random", "observed_share", "noisy_rational", "risk_aware"]
    );
    for cell in &held_out.problems {
        for (_, prediction) in cell.predictions.iter() {
            let sum: f64 = prediction.as_ref().unwrap().predicted.iter().sum();
            assert!((sum - 1.0).abs() < 1e-9);
        }
    }
    let random = held_out.scores.get("random").unwrap().unwrap();
    assert!((random.per_answer - 0.5_f64.ln()).abs() < 1e-12);

    let ids: Vec<&str> = found.ladder.iter().map(|step| step.id.as_str()).collect();
    assert_eq!(ids, ["random", "noisy_rational", "risk_aware"]);
    let gain: f64 = found.ladder[1..]
        .iter()
        .map(|step| step.units.unwrap().gain.unwrap().value)
        .sum();
    let total = found.ladder[2].units.unwrap().score - found.ladder[0].units.unwrap().score;
    assert!((gain - total).abs() < 1e-9);

    let hypothesis = Hypothesis {
        id: "H1",
        statement: "Risk-Aware foresees drivers better",
        better: "risk_aware",
        than: "noisy_rational",
    };
    let verdict = Verdict::of(&hypothesis, &found).unwrap();
    assert_eq!(verdict.criteria.len(), 3);
    assert_eq!(verdict.criteria[0].question, Question::HeldOut);
    for criterion in &verdict.criteria {
        assert_eq!(criterion.leaning, Leaning::For, "{}", verdict.line);
    }
    assert_eq!(verdict.outcome, Outcome::Supported, "{}", verdict.line);
    let json = serde_json::to_string(&found).unwrap();
    assert_eq!(serde_json::from_str::<Comparison>(&json).unwrap(), found);
}

/// The same people in another order, with problems in another order, score the same.
#[test]
fn order_does_not_matter() {
    let data = simulated(&problems(), &prospect_chooser(), 20, 8);
    let mut groups = data.groups().to_vec();
    groups.reverse();
    let mut reversed = data.problems().to_vec();
    reversed.reverse();
    for group in &mut groups {
        group.counts.reverse();
    }
    let other = ChoiceData::new(reversed, groups).unwrap();
    let plan = |data: &ChoiceData| PlanData::whole(data, Unit::Participant);
    let found = compared(&plan(&data), &ComparisonSettings::BRIEF);
    let again = compared(&plan(&other), &ComparisonSettings::BRIEF);
    for (ours, theirs) in found.pairs.iter().zip(&again.pairs) {
        let difference = |pair: &Pair| pair.leave_one_out.unwrap().difference.value;
        assert!((difference(ours) - difference(theirs)).abs() < 1e-9);
        assert_eq!(
            ours.bayes_factor.as_ref().unwrap().ln,
            theirs.bayes_factor.as_ref().unwrap().ln
        );
    }
}

/// Parts are fitted apart, so evidence adds up over them, while people stay whole.
#[test]
fn parts_add_up_and_people_stay_whole() {
    let data = simulated(&problems(), &prospect_chooser(), 30, 9);
    let parts = vec![
        ("gains".to_owned(), vec![1, 0]),
        ("others".to_owned(), vec![2, 3]),
    ];
    let plan = PlanData::new(&data, Unit::Participant, parts).unwrap();
    let found = compared(&plan, &ComparisonSettings::BRIEF);
    assert_eq!((found.units, found.n), (30, 120));
    let mut sum = 0.0;
    for part in plan.parts() {
        let fit = fit(
            &RISK_AWARE,
            part.data(),
            &FitSettings::default(),
            &mut uninterrupted,
        );
        sum += fit.unwrap().summary.log_marginal_likelihood.unwrap().value;
    }
    let scores = found.models.get("risk_aware").unwrap();
    assert_eq!(scores.log_marginal_likelihood.unwrap().value, sum);
    let leave_one_out = scores.leave_one_out.as_ref().unwrap();
    assert_eq!(leave_one_out.units, 30);
    assert!(leave_one_out.elpd > 120.0 * 0.5_f64.ln() && leave_one_out.elpd < 0.0);
}

#[test]
fn without_people_the_unit_is_an_answer() {
    let data = simulated(&problems(), &prospect_chooser(), 40, 10);
    let counts = ChoiceData::from_counts(data.problems().to_vec(), data.totals().to_vec()).unwrap();
    let found = compared(
        &PlanData::whole(&counts, Unit::Answer),
        &ComparisonSettings::BRIEF,
    );
    assert_eq!((found.unit, found.units), (Unit::Answer, 160));
    let pair = risk_aware_against_noisy_rational(&found)
        .leave_one_out
        .unwrap();
    assert_eq!(pair.difference.units, 160);
    let json = serde_json::to_string(&found).unwrap();
    assert!(json.starts_with(r#"{"unit":"answer""#));
    assert_eq!(serde_json::from_str::<Comparison>(&json).unwrap(), found);
}

/// Leaving out costs something, but no more than a few nats for two probabilities.
#[test]
fn a_known_fit_is_used_and_stopping_stops() {
    let cell = problem(
        "cups",
        &[
            ("safe", &[(1.0, 20.0)]),
            ("risky", &[(0.2, 105.0), (0.8, 0.0)]),
        ],
    );
    let data = ChoiceData::from_counts(vec![cell], vec![vec![25, 5]]).unwrap();
    let plan = PlanData::whole(&data, Unit::Answer);
    let known = fit(
        &RISK_AWARE,
        &data,
        &FitSettings::default(),
        &mut uninterrupted,
    )
    .unwrap();
    let fits = [KnownFit {
        part: 0,
        fit: known.clone().into(),
    }];
    let mut fitted = Vec::new();
    let found = compare_models(
        &plan,
        &[&NOISY_RATIONAL, &RISK_AWARE],
        &FitSettings::default(),
        &fits,
        &ComparisonSettings::LIVE,
        &mut |progress| {
            if let ComparisonProgress::Fitting(model) = progress {
                fitted.push(model.id);
            }
            ControlFlow::Continue(())
        },
    )
    .unwrap();
    fitted.dedup();
    assert_eq!(fitted, ["noisy_rational"]);
    let scores = found.models.get("risk_aware").unwrap();
    assert_eq!(
        scores.log_marginal_likelihood,
        known.summary.log_marginal_likelihood
    );
    assert!(scores.leave_one_out.is_none());
    let share = predict_from_draws(
        &data.problems()[0].problem,
        &known.draws,
        RiskAwareOptions::default(),
    )
    .unwrap()
    .actions[0]
        .mean;
    let brief = compared(&plan, &ComparisonSettings::BRIEF);
    let elpd = brief
        .models
        .get("risk_aware")
        .unwrap()
        .leave_one_out
        .as_ref()
        .unwrap()
        .elpd;
    let with_everybody = 25.0 * share.ln() + 5.0 * (1.0 - share).ln();
    assert!(
        elpd < with_everybody && elpd > with_everybody - 4.0,
        "{elpd} {with_everybody}"
    );

    let stopped = compare_models(
        &plan,
        &[&RISK_AWARE],
        &FitSettings::default(),
        &fits,
        &ComparisonSettings::BRIEF,
        &mut |_| ControlFlow::Break(()),
    );
    assert_eq!(stopped.unwrap_err(), FitError::Stopped);
}
