//! What a study file says about its models, about what is hidden, and about when there is enough data.

use riskaware::{
    model::{MODELS, NOISY_RATIONAL, RISK_AWARE},
    study::{KeyInterval, ParseError, StoppingRule, Study},
};

use super::lab::GAMBLES;

/// The study with a table before `[fit]` and one line more inside it.
fn with(tables: &str, fit: &str) -> Result<Study, ParseError> {
    let text = GAMBLES.replacen("[fit]\n", &format!("{tables}\n[fit]\n{fit}\n"), 1);
    assert_ne!(text, GAMBLES);
    Study::parse("gambles.toml", &text)
}

#[track_caller]
fn accepted(tables: &str, fit: &str) -> Study {
    with(tables, fit).unwrap_or_else(|error| panic!("{error}"))
}

#[track_caller]
fn refused(tables: &str, fit: &str, key: &str, found: &str, allowed: &str) {
    let error = with(tables, fit).unwrap_err();
    assert_eq!(error.key(), key, "{error}");
    assert!(error.found().contains(found), "found: {error}");
    assert!(error.allowed().contains(allowed), "allowed: {error}");
    assert!(error.line().is_some(), "no line: {error}");
}

#[test]
fn a_study_names_its_models_in_the_order_of_its_ladder() {
    assert_eq!(accepted("", "").models(), [&NOISY_RATIONAL, &RISK_AWARE]);
    let study = accepted("", "models = [\"risk_aware\", \"noisy_rational\"]");
    assert_eq!(study.models(), [&RISK_AWARE, &NOISY_RATIONAL]);
    assert_eq!(
        accepted("", "models = [\"risk_aware\"]").models(),
        [&RISK_AWARE]
    );
}

#[test]
fn models_that_cannot_be_fitted_are_refused_with_a_list() {
    for model in MODELS {
        refused("", "models = []", "fit.models", "no model", model.id);
        refused(
            "",
            "models = [\"bayes\"]",
            "fit.models[#1]",
            "`bayes`",
            model.id,
        );
    }
    refused(
        "",
        "models = [\"risk_aware\", \"risk_awre\"]",
        "fit.models[#2]",
        "did you mean `risk_aware`?",
        "`noisy_rational`",
    );
    refused(
        "",
        "models = [\"risk_aware\", \"risk_aware\"]",
        "fit.models[#2]",
        "second time",
        "each model once",
    );
}

#[test]
fn results_can_be_hidden_until_enough_people_have_finished() {
    assert_eq!(accepted("", "").blind_until(), None);
    assert_eq!(
        accepted("[analysis]\nblind_until = 30", "").blind_until(),
        Some(30)
    );
    refused(
        "[analysis]\nblind_until = 0",
        "",
        "analysis.blind_until",
        "0",
        "1 or more",
    );
}

#[test]
fn evidence_is_followed_without_a_rule() {
    let sequential = accepted("", "").sequential().clone();
    assert_eq!(sequential.plan, "together");
    assert_eq!((sequential.check_every, sequential.minimum), (5, 5));
    assert_eq!(sequential.models, Some([&RISK_AWARE, &NOISY_RATIONAL]));
    assert_eq!(
        sequential.interval,
        Some(KeyInterval {
            model: &RISK_AWARE,
            quantity: "gamma".to_owned()
        })
    );
    assert_eq!(sequential.rule, None);

    let alone = accepted("", "models = [\"noisy_rational\"]")
        .sequential()
        .clone();
    assert_eq!(alone.models, None);
    assert_eq!(alone.interval.unwrap().quantity, "tau");
}

#[test]
fn a_rule_has_one_bound_and_its_moments() {
    let study = accepted(
        "[stopping]\ncheck_every = 10\nminimum = 25\nbayes_factor = 10\nmodels = [\"noisy_rational\", \"risk_aware\"]\nplan = \"both\"",
        "",
    );
    let sequential = study.sequential();
    assert_eq!((sequential.check_every, sequential.minimum), (10, 25));
    assert_eq!(sequential.rule, Some(StoppingRule::BayesFactor(10.0)));
    assert_eq!(sequential.models, Some([&NOISY_RATIONAL, &RISK_AWARE]));
    assert_eq!(
        sequential.interval, None,
        "each part has an interval of its own"
    );

    let study = accepted(
        "[stopping]\nwidth = { model = \"noisy_rational\", quantity = \"theta\", below = 0.3 }",
        "",
    );
    let sequential = study.sequential();
    assert_eq!(sequential.rule, Some(StoppingRule::Width(0.3)));
    assert_eq!(
        sequential.interval,
        Some(KeyInterval {
            model: &NOISY_RATIONAL,
            quantity: "theta".to_owned()
        })
    );
}

#[test]
fn rules_that_cannot_be_judged_are_refused() {
    let check = |lines: &str, key: &str, found: &str, allowed: &str| {
        refused(&format!("[stopping]\n{lines}"), "", key, found, allowed);
    };
    let width = |rest: &str| format!("width = {{ {rest} }}");
    check("", "stopping", "no bound", "`bayes_factor` and `width`");
    check(
        &format!(
            "bayes_factor = 3\n{}",
            width("model = \"risk_aware\", quantity = \"gamma\", below = 1")
        ),
        "stopping",
        "two bounds",
        "not both",
    );
    check("bayes_factor = 1", "stopping.bayes_factor", "1", "above 1");
    check(
        "bayes_factor = inf",
        "stopping.bayes_factor",
        "inf",
        "finite",
    );
    check(
        "bayes_factor = 3\ncheck_every = 0",
        "stopping.check_every",
        "0",
        "1 or more",
    );
    check(
        "bayes_factor = 3\nminimum = 0",
        "stopping.minimum",
        "0",
        "1 or more",
    );
    check(
        "bayes_factor = 3\nplan = \"al\"",
        "stopping.plan",
        "`al`",
        "`both`",
    );
    check(
        "bayes_factor = 3\nmodels = [\"risk_aware\"]",
        "stopping.models",
        "1 models",
        "two models",
    );
    check(
        "bayes_factor = 3\nmodels = [\"risk_aware\", \"risk_aware\"]",
        "stopping.models[#2]",
        "second time",
        "another model",
    );
    check(
        "bayes_factor = 3\nmodels = [\"risk_aware\", \"bayes\"]",
        "stopping.models[#2]",
        "`bayes`",
        "`noisy_rational`",
    );
    check(
        &width("model = \"noisy_rational\", quantity = \"gamma\", below = 0.3"),
        "stopping.width.quantity",
        "`gamma`",
        "`theta`, `tau`",
    );
    check(
        &width("model = \"risk_aware\", quantity = \"gamma\", below = 0"),
        "stopping.width.below",
        "0",
        "above 0",
    );
    check(
        &format!(
            "plan = \"both\"\n{}",
            width("model = \"risk_aware\", quantity = \"gamma\", below = 0.3")
        ),
        "stopping.width",
        "plan `both` with",
        "one part",
    );
    check(
        &format!(
            "models = [\"risk_aware\", \"noisy_rational\"]\n{}",
            width("model = \"risk_aware\", quantity = \"gamma\", below = 0.3")
        ),
        "stopping.models",
        "beside `width`",
        "`bayes_factor`",
    );
    let one_model = "models = [\"risk_aware\"]";
    refused(
        "[stopping]\nbayes_factor = 3",
        one_model,
        "stopping.bayes_factor",
        "one model",
        "two models or more",
    );
}
