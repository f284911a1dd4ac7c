//! A folder of study files that changes while it is served.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, SystemTime},
};

use riskaware::{
    clock::Clock,
    jobs::{Catalogue, Prepare, StudyFolder},
    store::{Options, Population, Store, StudyState},
    study::{ParseError, Study, StudyId, built_in},
};
use tempfile::TempDir;

use crate::{
    app::START,
    conditions::BETWEEN,
    crowd::completes,
    program::{riskaware, stderr, stdout},
};

struct Folder {
    store: Store,
    folder: StudyFolder,
    home: TempDir,
}

impl Folder {
    async fn with(files: &[(&str, &str)]) -> Self {
        let home = tempfile::tempdir().unwrap();
        std::fs::create_dir(home.path().join("studies")).unwrap();
        let options = Options::at(home.path().join("riskaware.db"));
        let store = Store::open(options, Clock::manual(START)).await.unwrap();
        let folder = StudyFolder::new(&home.path().join("studies"));
        let folder = Self {
            store,
            folder,
            home,
        };
        for (name, text) in files {
            folder.write(name, text);
        }
        folder
    }

    fn file(&self, name: &str) -> PathBuf {
        self.home.path().join("studies").join(name)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.file(name), text).unwrap();
    }

    async fn publish(&mut self) -> Catalogue {
        self.folder.publish(&self.store).await.unwrap()
    }

    /// Two looks: a changed file is read once it has stopped changing.
    async fn look(&mut self, catalogue: &Catalogue) {
        for _ in 0..2 {
            self.look_once(catalogue).await;
        }
    }

    async fn look_once(&mut self, catalogue: &Catalogue) {
        let prepare: Prepare = Arc::new(|_: &Study| Ok(()));
        self.folder
            .look(&self.store, catalogue, &prepare)
            .await
            .unwrap();
    }

    async fn state(&self, study: &str) -> StudyState {
        self.store.study(&StudyId::from(study)).await.unwrap().state
    }
}

fn between() -> StudyId {
    StudyId::from("between")
}

fn wrong() -> String {
    BETWEEN.replace("minutes = 2", "minutes = 0")
}

fn error_of(text: &str, file: &Path) -> ParseError {
    Study::parse(&file.display().to_string(), text).unwrap_err()
}

#[tokio::test]
async fn a_changed_file_is_served_to_whoever_starts_afterwards() {
    let mut folder = Folder::with(&[("between.toml", BETWEEN)]).await;
    let catalogue = folder.publish().await;
    let (first, _) = catalogue.current(&between()).unwrap();
    folder.look(&catalogue).await;
    assert_eq!(catalogue.current(&between()).unwrap().0, first);

    folder.write(
        "between.toml",
        &BETWEEN.replace("A question of framing", "Framed"),
    );
    folder.look(&catalogue).await;
    let (second, study) = catalogue.current(&between()).unwrap();
    assert_ne!(first, second);
    assert_eq!(study.title(), "Framed");
    let earlier = catalogue.version(first).unwrap();
    assert_eq!(earlier.title(), "A question of framing");
    assert_eq!(
        folder.store.study(&between()).await.unwrap().version,
        second
    );
}

#[tokio::test]
async fn a_file_that_is_being_written_is_left_alone_until_it_is_whole() {
    let mut folder = Folder::with(&[("between.toml", BETWEEN)]).await;
    let catalogue = folder.publish().await;
    let before = catalogue.current(&between()).unwrap().0;
    let whole = BETWEEN.replace("minutes = 2", "minutes = 20");
    let half = format!("{whole}\n# a remark that makes the first half a study of its own\n");
    folder.write("between.toml", &whole);
    folder.look_once(&catalogue).await;
    assert_eq!(catalogue.current(&between()).unwrap().0, before);
    folder.write("between.toml", &half);
    folder.look_once(&catalogue).await;
    assert_eq!(catalogue.current(&between()).unwrap().0, before);
    folder.look_once(&catalogue).await;
    assert_eq!(catalogue.current(&between()).unwrap().1.text(), half);
    let versions = folder.store.study_versions(&between()).await.unwrap();
    assert_eq!(versions.len(), 2, "what was half there is no version");
}

#[tokio::test]
async fn a_broken_file_leaves_what_is_served_alone() {
    let mut folder = Folder::with(&[("between.toml", BETWEEN)]).await;
    let catalogue = folder.publish().await;
    let before = catalogue.current(&between()).unwrap().0;
    folder.write("between.toml", &wrong());
    folder.look(&catalogue).await;
    assert_eq!(catalogue.current(&between()).unwrap().0, before);
    let file = folder.file("between.toml");
    let expected = error_of(&wrong(), &file).to_string();
    let errors = catalogue.file_errors();
    assert_eq!(errors.get(&file.display().to_string()), Some(&expected));
    folder.write(
        "between.toml",
        &BETWEEN.replace("minutes = 2", "minutes = 20"),
    );
    folder.look(&catalogue).await;
    assert!(catalogue.file_errors().is_empty());
    assert_eq!(catalogue.current(&between()).unwrap().1.minutes(), 20);
}

#[tokio::test]
async fn a_broken_file_at_the_start_stops_no_other_study() {
    let mut folder = Folder::with(&[("between.toml", BETWEEN)]).await;
    let stored = folder.publish().await.current(&between()).unwrap().0;
    folder.write("between.toml", &wrong());
    folder.write("driving.toml", "id = ");
    folder.folder = StudyFolder::new(&folder.home.path().join("studies"));
    let catalogue = folder.publish().await;
    assert_eq!(catalogue.file_errors().len(), 2);
    assert_eq!(catalogue.current(&between()).unwrap().0, stored);
    for id in ["driving", "cups"] {
        assert!(catalogue.current(&StudyId::from(id)).is_some());
    }
}

#[tokio::test]
async fn a_second_file_of_a_study_keeps_the_first_one_from_nothing() {
    let mut folder = Folder::with(&[("a.toml", BETWEEN)]).await;
    let stored = folder.publish().await.current(&between()).unwrap().0;
    let longer = BETWEEN.replace("minutes = 2", "minutes = 20");
    folder.write("a.toml", &longer);
    folder.write("b.toml", BETWEEN);
    folder.folder = StudyFolder::new(&folder.home.path().join("studies"));
    let catalogue = folder.publish().await;
    let (version, study) = catalogue.current(&between()).unwrap();
    assert!(version != stored && study.minutes() == 20);
    let errors = catalogue.file_errors();
    assert_eq!(errors.len(), 1);
    assert!(errors.contains_key(&folder.file("b.toml").display().to_string()));

    // It takes the first one's place as soon as that is gone, untouched.
    std::fs::remove_file(folder.file("a.toml")).unwrap();
    folder.look(&catalogue).await;
    assert_eq!(catalogue.current(&between()).unwrap().1.minutes(), 2);
    assert!(catalogue.file_errors().is_empty());
}

#[tokio::test]
async fn a_missing_file_hands_no_study_over_to_the_built_in_text() {
    let own = built_in()[0].1.replace("limit_s = 8", "limit_s = 4");
    let mut folder = Folder::with(&[("driving.toml", &own)]).await;
    let driving = StudyId::from("driving");
    let (version, _) = folder.publish().await.current(&driving).unwrap();
    std::fs::remove_file(folder.file("driving.toml")).unwrap();
    // Started again with the empty folder, and without any.
    folder.folder = StudyFolder::new(&folder.home.path().join("studies"));
    let catalogue = folder.publish().await;
    let (served, study) = catalogue.current(&driving).unwrap();
    assert_eq!((served, study.text()), (version, own.as_str()));
    let files = built_in().into_iter();
    let files = files.map(|(name, text)| (name.to_owned(), text.to_owned()));
    let catalogue = Catalogue::publish(&folder.store, files.collect())
        .await
        .unwrap();
    assert_eq!(catalogue.current(&driving).unwrap().0, version);
    let stored = folder.store.study(&driving).await.unwrap();
    assert_eq!(stored.version, version);

    // The lab goes back to the built-in text by a file of its own.
    folder.write("driving.toml", built_in()[0].1);
    folder.folder = StudyFolder::new(&folder.home.path().join("studies"));
    let catalogue = folder.publish().await;
    assert_eq!(
        catalogue.current(&driving).unwrap().1.text(),
        built_in()[0].1
    );
}

#[tokio::test]
async fn a_newer_built_in_text_replaces_an_earlier_one_only() {
    let (name, newer) = built_in()[0];
    let driving = StudyId::from("driving");
    let earlier = Study::parse(name, &newer.replace("limit_s = 8", "limit_s = 4")).unwrap();
    for is_built_in in [true, false] {
        let mut folder = Folder::with(&[]).await;
        let (hash, text) = (earlier.hash(), earlier.text());
        let store = &folder.store;
        // As an earlier program left it; where a file had the same text at any time, it is the lab's.
        store
            .publish_built_in(&driving, hash, text, StudyState::Open, None)
            .await
            .unwrap();
        if !is_built_in {
            store
                .publish(&driving, hash, text, StudyState::Open, None)
                .await
                .unwrap();
        }
        let catalogue = folder.publish().await;
        let served = catalogue.current(&driving).unwrap().1;
        let expected = if is_built_in { newer } else { text };
        assert_eq!(served.text(), expected);
    }
}

#[tokio::test]
async fn a_refused_file_stays_refused_when_it_is_only_touched() {
    let mut folder = Folder::with(&[]).await;
    let catalogue = folder.publish().await;
    folder.write("between.toml", BETWEEN);
    let refuses: Prepare = Arc::new(|_: &Study| Err("no replay".to_owned()));
    let file = folder.file("between.toml");
    for second in 1..=2 {
        let touched = std::fs::File::options().append(true).open(&file).unwrap();
        touched
            .set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(second))
            .unwrap();
        for _ in 0..2 {
            folder
                .folder
                .look(&folder.store, &catalogue, &refuses)
                .await
                .unwrap();
        }
        assert_eq!(catalogue.file_errors().len(), 1, "look {second}");
    }
    let touched = std::fs::File::options().append(true).open(&file).unwrap();
    touched.set_modified(SystemTime::UNIX_EPOCH).unwrap();
    folder.look(&catalogue).await;
    assert!(catalogue.file_errors().is_empty());
    assert!(catalogue.current(&between()).is_some());
}

#[tokio::test]
async fn a_new_file_begins_as_a_draft_unless_it_says_otherwise() {
    let mut folder = Folder::with(&[]).await;
    let catalogue = folder.publish().await;
    assert!(catalogue.current(&between()).is_none());
    folder.write("between.toml", &BETWEEN.replace("open = true\n", ""));
    folder.write(
        "other.toml",
        &BETWEEN.replace("id = \"between\"", "id = \"other\""),
    );
    folder.write("twice.toml", BETWEEN);
    folder.look(&catalogue).await;
    assert_eq!(folder.state("between").await, StudyState::Draft);
    assert_eq!(folder.state("other").await, StudyState::Open);
    let errors = catalogue.file_errors();
    let (file, error) = errors.first_key_value().unwrap();
    assert!(file.ends_with("twice.toml") && error.contains("between.toml"));
}

#[tokio::test]
async fn a_study_is_opened_and_closed_by_command() {
    let mut folder = Folder::with(&[]).await;
    folder.publish().await;
    let database = folder.home.path().join("riskaware.db");
    let database = database.to_str().unwrap();
    // The store stays open, as a server's would.
    for (command, state) in [
        ("pause", StudyState::Paused),
        ("close", StudyState::Closed),
        ("open", StudyState::Open),
    ] {
        let output = riskaware(&["study", command, "driving", "--database", database], "");
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(stdout(&output).contains(state.as_str()));
        assert_eq!(folder.state("driving").await, state);
    }
    let unknown = riskaware(&["study", "open", "drivin", "--database", database], "");
    assert_eq!(unknown.status.code(), Some(1));
    assert!(
        stderr(&unknown).contains("cups, driving"),
        "{}",
        stderr(&unknown)
    );
    let totals = folder
        .store
        .totals(&StudyId::from("driving"), Population::People)
        .await;
    assert_eq!(totals.unwrap().started, 0);
}

#[tokio::test]
async fn what_was_refused_is_read_again_when_the_folder_changes_and_forgotten_when_it_goes() {
    let other = BETWEEN.replace("id = \"between\"", "id = \"other\"");
    let mut folder = Folder::with(&[("z.toml", BETWEEN)]).await;
    let catalogue = folder.publish().await;
    // By name it comes before the file that it waits for.
    folder.write("a.toml", BETWEEN);
    folder.write("broken.toml", "id = ");
    folder.look(&catalogue).await;
    assert_eq!(catalogue.file_errors().len(), 2);
    folder.write("z.toml", &other);
    folder.look(&catalogue).await;
    let wrong: Vec<String> = catalogue.file_errors().into_keys().collect();
    assert_eq!(wrong, [folder.file("broken.toml").display().to_string()]);
    std::fs::remove_file(folder.file("broken.toml")).unwrap();
    folder.look(&catalogue).await;
    assert!(catalogue.file_errors().is_empty());
    folder.store.close().await;
}

#[tokio::test]
async fn without_built_in_studies_only_those_that_somebody_began_are_served() {
    let mut folder = Folder::with(&[("between.toml", BETWEEN)]).await;
    // A server with them ran on this database before, and one person took part in one.
    let catalogue = folder.publish().await;
    let driving = StudyId::from("driving");
    completes(
        &folder.store,
        &catalogue,
        &driving,
        1,
        None,
        |_, actions| actions[0].clone(),
    )
    .await;
    folder.folder = StudyFolder::new(&folder.home.path().join("studies")).without_built_in();
    let catalogue = folder.publish().await;
    let served =
        ["between", "cups", "driving"].map(|id| catalogue.current(&StudyId::from(id)).is_some());
    assert_eq!(served, [true, false, true]);
    // A file of the lab's with the id of a built-in study is the lab's.
    let (name, cups) = built_in()[1];
    folder.write(name, cups);
    folder.look(&catalogue).await;
    assert!(catalogue.current(&StudyId::from("cups")).is_some());
    let alone = Catalogue::publish_without_built_in(&folder.store)
        .await
        .unwrap();
    // With the file gone, that one is served as the file described it: it is no built-in study any more.
    assert_eq!(alone.studies().len(), 3);
    folder.store.close().await;
}
