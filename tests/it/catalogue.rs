//! Which study files are served together, and what happens when one goes away.

use riskaware::{
    clock::Clock,
    jobs::Catalogue,
    store::{Options, Store, StudyState},
    study::{StudyId, built_in},
};

use crate::app::START;

const GAMBLES: &str = include_str!("../data/gambles.toml");

async fn store(folder: &tempfile::TempDir) -> Store {
    let options = Options::at(folder.path().join("riskaware.db"));
    Store::open(options, Clock::manual(START)).await.unwrap()
}

fn file(name: &str, text: &str) -> (String, String) {
    (name.to_owned(), text.to_owned())
}

#[tokio::test]
async fn two_files_of_one_study_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let files = vec![file("a.toml", GAMBLES), file("b.toml", GAMBLES)];
    let error = Catalogue::publish(&store(&folder).await, files)
        .await
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("a.toml") && error.contains("b.toml"),
        "{error}"
    );
}

#[tokio::test]
async fn a_stored_version_that_nobody_reads_any_more_stops_no_other_study() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(&folder).await;
    let good = Catalogue::publish(&store, vec![file("a.toml", GAMBLES)])
        .await
        .unwrap();
    let (earlier, _) = good.current(&StudyId::from("three-gambles")).unwrap();
    for (id, text) in [("three-gambles", "format = 0"), ("of-old", "no study")] {
        let hash = format!("hash of {text}");
        store
            .publish(&StudyId::from(id), &hash, text, StudyState::Open, None)
            .await
            .unwrap();
    }
    let built_in = built_in()
        .iter()
        .map(|(name, text)| file(name, text))
        .collect();
    let served = Catalogue::publish(&store, built_in).await.unwrap();
    assert!(served.current(&StudyId::from("driving")).is_some());
    for id in ["three-gambles", "of-old"] {
        assert!(served.current(&StudyId::from(id)).is_none());
    }
    // Whoever began with a text that is readable still finishes with it.
    assert!(served.version(earlier).is_some());
}

#[tokio::test]
async fn a_study_whose_file_is_gone_is_served_as_it_was_stored() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(&folder).await;
    let id = StudyId::from("three-gambles");
    let served = Catalogue::publish(&store, vec![file("a.toml", GAMBLES)])
        .await
        .unwrap();
    let (version, _) = served.current(&id).unwrap();
    let without = Catalogue::publish(&store, Vec::new()).await.unwrap();
    let (stored, study) = without.current(&id).unwrap();
    assert_eq!((stored, study.text()), (version, GAMBLES));
    assert!(without.version(version).is_some());
}
