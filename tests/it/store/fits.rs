//! Fits and their history.

use riskaware::store::{Error, Fit, FitKey, FitOutcome, FitState, NewFit, Population};
use riskaware::study::StudyId;

use super::lab::Lab;

fn fit(lab: &Lab, part: &str, outcome: FitOutcome) -> NewFit {
    NewFit {
        study: StudyId::from("driving"),
        population: Population::People,
        key: FitKey {
            plan: "risk".into(),
            part: part.into(),
            model: "risk_aware".to_owned(),
        },
        input_hash: "of the counts".to_owned(),
        data_version: 3,
        version: lab.driving,
        seed: u64::MAX - 1,
        attempts: 1,
        is_provisional: false,
        outcome,
        draws: Some(vec![1, 2, 3]),
        cpu_ms: 40,
    }
}

/// What a page that knows nothing yet is given, by part.
async fn latest(lab: &Lab, study: &StudyId, population: Population) -> Vec<Fit> {
    let (_, mut fits) = lab.store.new_fits(study, population, &[]).await.unwrap();
    fits.sort_by_key(|fit| fit.key.part.to_string());
    fits
}

#[tokio::test]
async fn the_newest_converged_fit_is_shown_and_the_newest_of_all_is_known() {
    let lab = Lab::open().await;
    let (driving, cups) = (StudyId::from("driving"), StudyId::from("cups"));
    let mut changes = lab.store.subscribe();
    let good = lab
        .store
        .save_fits(vec![fit(
            &lab,
            "low",
            FitOutcome::Converged("{}".to_owned()),
        )])
        .await
        .unwrap()[0];
    let change = changes.recv().await.unwrap();
    assert_eq!(
        (change.study, change.data_version, change.page_version),
        (driving.clone(), 0, 2)
    );
    let high = lab
        .store
        .save_fits(vec![fit(
            &lab,
            "high",
            FitOutcome::Unconverged("{}".to_owned()),
        )])
        .await
        .unwrap()[0];
    let failed = NewFit {
        draws: None,
        ..fit(&lab, "low", FitOutcome::Failed("no counts".to_owned()))
    };
    let failed = lab.store.save_fits(vec![failed]).await.unwrap()[0];
    let other = NewFit {
        study: cups.clone(),
        version: lab.cups,
        ..fit(&lab, "low", FitOutcome::Converged("{}".to_owned()))
    };
    let other = lab.store.save_fits(vec![other]).await.unwrap()[0];

    let ids = |fits: Vec<Fit>| fits.into_iter().map(|fit| fit.id).collect::<Vec<_>>();
    assert_eq!(
        ids(latest(&lab, &driving, Population::People).await),
        [high, failed]
    );
    for (study, population, expected) in [
        (&driving, Population::Simulated, vec![]),
        (&cups, Population::People, vec![other]),
    ] {
        assert_eq!(ids(latest(&lab, study, population).await), expected);
    }
    let history = |before, limit| {
        lab.store
            .fit_history(&driving, Population::People, before, limit)
    };
    assert_eq!(ids(history(None, 2).await.unwrap()), [failed, high]);
    assert_eq!(ids(history(Some(high), 2).await.unwrap()), [good]);

    let stored = lab
        .store
        .fit(&driving, Population::People, good)
        .await
        .unwrap();
    assert_eq!(
        (stored.seed, stored.outcome.state()),
        (u64::MAX - 1, FitState::Converged)
    );
    assert_eq!(lab.store.fit_draws(good).await.unwrap(), [1, 2, 3]);
    assert!(matches!(
        lab.store.fit_draws(failed).await,
        Err(Error::NotFound("draws"))
    ));
    assert!(matches!(
        lab.store.fit(&cups, Population::People, good).await,
        Err(Error::NotFound("fit"))
    ));
}

#[tokio::test]
async fn history_is_bounded_and_never_drops_what_is_shown() {
    let lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let shown = lab
        .store
        .save_fits(vec![fit(
            &lab,
            "low",
            FitOutcome::Converged("{}".to_owned()),
        )])
        .await
        .unwrap()[0];
    let mut later = tokio::task::JoinSet::new();
    for _ in 0..230 {
        let (store, fit) = (
            lab.store.clone(),
            fit(&lab, "low", FitOutcome::Unconverged("{}".to_owned())),
        );
        later.spawn(async move { store.save_fits(vec![fit]).await.unwrap() });
    }
    later.join_all().await;
    let history = lab
        .store
        .fit_history(&driving, Population::People, None, 1_000)
        .await
        .unwrap();
    assert_eq!(history.len(), 21);
    assert_eq!(history.last().unwrap().id, shown);
}

#[tokio::test]
async fn a_provisional_fit_is_gone_with_the_next_one_and_takes_nothing_final_along() {
    let lab = Lab::open().await;
    let driving = StudyId::from("driving");
    let converged = |part, is_provisional| NewFit {
        is_provisional,
        draws: (!is_provisional).then(|| vec![1, 2, 3]),
        ..fit(&lab, part, FitOutcome::Converged("{}".to_owned()))
    };
    let save = async |fits| lab.store.save_fits(fits).await.unwrap();
    let shown = async || {
        let fits = latest(&lab, &driving, Population::People).await;
        fits.into_iter()
            .map(|fit| (fit.id, fit.is_provisional))
            .collect::<Vec<_>>()
    };
    let first = save(vec![converged("low", false)]).await[0];
    let mut changes = lab.store.subscribe();
    let round = save(vec![converged("low", true), converged("high", true)]).await;
    assert_eq!(shown().await, [(round[1], true), (round[0], true)]);
    assert!(changes.try_recv().is_ok());
    assert!(changes.try_recv().is_err(), "one round turns the page once");
    // Whoever cites the final fit still finds its draws.
    assert_eq!(lab.store.fit_draws(first).await.unwrap(), [1, 2, 3]);

    let next = save(vec![converged("low", true)]).await[0];
    let last = save(vec![converged("high", false)]).await[0];
    assert_eq!(shown().await, [(last, false), (next, true)]);
    let history = lab
        .store
        .fit_history(&driving, Population::People, None, 100)
        .await
        .unwrap();
    let ids: Vec<_> = history.iter().map(|fit| fit.id).collect();
    assert_eq!(ids, [last, next, first]);
}

#[tokio::test]
async fn a_withdrawal_removes_every_fit_that_counted_the_person() {
    let mut lab = Lab::open().await;
    let mut leaves = lab.start_and_reach_timed("driving").await;
    leaves.finishes(&lab, "stop").await;
    let only_looked = lab.start("driving").await;
    let people = Population::People;
    let (driving, cups) = (StudyId::from("driving"), StudyId::from("cups"));
    let version = async || {
        lab.store
            .totals(&driving, people)
            .await
            .unwrap()
            .data_version
    };
    let with_them = version().await;
    let converged = |part: &str, data_version| NewFit {
        data_version,
        ..fit(&lab, part, FitOutcome::Converged("{}".to_owned()))
    };
    let elsewhere = NewFit {
        study: cups.clone(),
        ..converged("low", with_them)
    };
    let saved = vec![
        converged("low", with_them - 1),
        converged("low", with_them),
        elsewhere,
    ];
    let saved = lab.store.save_fits(saved).await.unwrap();
    let shown = async |study: &StudyId| {
        let fits = latest(&lab, study, people).await;
        fits.iter().map(|fit| fit.id).collect::<Vec<_>>()
    };

    // Whoever answered nothing that counts is in no fit.
    lab.store.withdraw(&only_looked.link).await.unwrap();
    assert_eq!(shown(&driving).await, [saved[1]]);

    lab.store.withdraw(&leaves.link).await.unwrap();
    assert_eq!(shown(&driving).await, []);
    assert_eq!(shown(&cups).await, [saved[2]]);
    for gone in &saved[..2] {
        let draws = lab.store.fit_draws(*gone).await;
        assert!(matches!(draws, Err(Error::NotFound(_))), "{draws:?}");
    }
    // What was under way comes too late; the next one has an id that none had.
    let late = lab.store.save_fits(vec![converged("low", with_them)]).await;
    assert_eq!(late.unwrap(), []);
    let now = version().await;
    let next = lab
        .store
        .save_fits(vec![converged("low", now)])
        .await
        .unwrap();
    assert!(next[0] > saved[2]);
}
