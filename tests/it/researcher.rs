//! The researcher's pages: how far people come, states, participants with flags, erasing, links, previews.

use reqwest::StatusCode;
use riskaware::{
    clock::Clock,
    store::{
        AuditOutcome, ParticipantFilter, Population, RunState, StudyState, WatchedParticipant,
    },
    study::{Flag, StudyId},
    web::Settings,
};

use crate::{
    app::{App, Page, Participant, START},
    conditions::BETWEEN,
};

fn driving() -> StudyId {
    StudyId::from("driving")
}

async fn post(app: &App, path: &str, form: &[(&str, &str)]) -> Page {
    let request = app.client.post(format!("{}{path}", app.url)).form(form);
    Page::of(request.send().await.unwrap()).await
}

/// What the overview says became of so many people.
fn fate(page: &Page, what: &str) -> String {
    page.text(&format!("[data-fate=\"{what}\"]")).unwrap()
}

/// The row of the funnel of a step: came to it, answered, late or timed out, there now, stopped there.
fn step(page: &Page, detail: &str) -> Vec<String> {
    let row = page
        .texts(".funnel tbody tr")
        .iter()
        .position(|text| text.contains(detail))
        .unwrap_or_else(|| panic!("no step {detail}"));
    let mut cells = page.texts(&format!(
        ".funnel tbody tr:nth-child({}) td.numeric",
        row + 1
    ));
    cells.truncate(5);
    // Where most stop, it says so.
    cells
        .iter()
        .map(|cell| cell.replace(" (most)", ""))
        .collect()
}

async fn at_first_timed(app: &App, query: &str) -> Participant {
    let mut person = app.participant(query).await;
    person
        .proceeds("stop", |person| person.block().as_deref() == Some("timed"))
        .await;
    person
}

#[tokio::test]
async fn the_overview_tells_how_far_people_come_and_where_they_stop() {
    let app = App::start().await;
    let page = app.get("/studies/driving").await;
    assert_eq!(page.status, StatusCode::OK);
    assert_eq!(fate(&page, "Started"), "0");

    let mut done = app.participant("?source=pilot").await;
    done.finishes("stop").await;
    let mut declines = app.participant("").await;
    declines.sends("consent", "decline").await;
    at_first_timed(&app, "").await;
    // What is withdrawn counts as started and as withdrawn, and in no step.
    let mut withdraws = app.participant("").await;
    withdraws.sends("consent", "agree").await;
    app.store.withdraw(&withdraws.token()).await.unwrap();

    let page = app.get("/studies/driving").await;
    let told = [
        "Started",
        "Consented",
        "Completed",
        "Under way or left",
        "Declined",
        "Withdrawn",
    ]
    .map(|what| fate(&page, what));
    assert_eq!(told, ["4", "2", "1", "1", "1", "1"]);
    assert_eq!(step(&page, "consent"), ["3", "3", "0", "0", "1"]);
    assert_eq!(step(&page, "timed · none"), ["2", "1", "0", "1", "0"]);
    assert!(page.html.contains("<th scope=\"row\">pilot</th>"));

    // After half an hour they have left, and their time has run out when they are looked after.
    app.clock.advance(31 * 60 * 1_000);
    let page = app.get("/studies/driving").await;
    assert_eq!(step(&page, "timed · none"), ["2", "1", "0", "0", "1"]);
    let part = app.get("/studies/driving/data/progress.html").await;
    assert_eq!(step(&part, "timed · none"), step(&page, "timed · none"));
    let list = app.get("/studies").await;
    assert!(list.texts(".study-card h2").len() >= 2);
    app.stop().await;
}

#[tokio::test]
async fn times_are_medians_of_what_people_took() {
    let app = App::start().await;
    for seconds in [10, 40, 20] {
        let mut person = app.participant("").await;
        app.clock.advance(seconds * 1_000);
        person.finishes("stop").await;
    }
    let (study, population) = (driving(), Population::People);
    assert_eq!(
        app.store
            .median_duration_ms(&study, population)
            .await
            .unwrap(),
        Some(20_000)
    );
    let steps = app.store.step_progress(&study, population).await.unwrap();
    // To a tenth of a second.
    assert_eq!(steps[0].block, "consent");
    assert_eq!(steps[0].median_ms, Some(20_050));
    assert_eq!(steps.last().unwrap().kind, "thanks");
    assert_eq!(steps.last().unwrap().reached, 3);
    assert_eq!(
        app.store.last_answer(&study, population).await.unwrap(),
        Some(app.clock.now())
    );
    app.stop().await;
}

#[tokio::test]
async fn a_study_is_paused_and_opened_by_buttons_and_the_log_says_so() {
    let app = App::start().await;
    let page = app.get("/studies/driving").await;
    let offered = page.attributes("input[name=state]", "value");
    assert_eq!(offered, ["paused", "closed"]);
    let page = post(&app, "/studies/driving/state", &[("state", "paused")]).await;
    assert_eq!(page.status, StatusCode::OK);
    assert_eq!(page.text(".study-state").unwrap(), "Paused");
    assert_eq!(app.get("/s/driving").await.status, StatusCode::GONE);
    post(&app, "/studies/driving/state", &[("state", "open")]).await;
    assert_eq!(app.get("/s/driving").await.status, StatusCode::OK);

    for state in ["draft", "gone", ""] {
        let page = post(&app, "/studies/driving/state", &[("state", state)]).await;
        assert_eq!(page.status, StatusCode::UNPROCESSABLE_ENTITY, "{state}");
    }
    let state = app.store.study(&driving()).await.unwrap().state;
    assert_eq!(state, StudyState::Open);
    assert_eq!(
        post(&app, "/studies/none/state", &[("state", "open")])
            .await
            .status,
        StatusCode::NOT_FOUND
    );
    let log = app.store.audit(None, 10).await.unwrap();
    let refused = AuditOutcome::Refused;
    let (tried, done): (Vec<_>, Vec<_>) = log.iter().partition(|row| row.entry.outcome == refused);
    assert_eq!(tried.len(), 3, "the states that cannot be set");
    let told: Vec<(&str, Option<&str>)> = done
        .iter()
        .map(|row| (row.entry.action.as_str(), row.entry.detail.as_deref()))
        .collect();
    assert_eq!(
        told,
        [
            ("open study", Some("it was paused")),
            ("pause study", Some("it was open"))
        ]
    );
    app.stop().await;
}

async fn with_flag(app: &App, flag: Flag) -> Vec<i64> {
    let filter = ParticipantFilter {
        flag: Some(flag),
        ..ParticipantFilter::default()
    };
    let found = participants(app, &filter).await;
    found.iter().map(|row| row.run.get()).collect()
}

async fn participants(app: &App, filter: &ParticipantFilter) -> Vec<WatchedParticipant> {
    let (study, population) = (driving(), Population::People);
    let median = app
        .store
        .median_duration_ms(&study, population)
        .await
        .unwrap();
    app.store
        .participants_before((&study, population), filter, (median, &[]), None, 100)
        .await
        .unwrap()
}

#[tokio::test]
async fn what_is_notable_about_people_is_flagged_and_excludes_nobody() {
    let app = App::start().await;
    // Someone slow, so that the median is above nothing.
    for _ in 0..2 {
        let mut person = app.participant("").await;
        app.clock.advance(60_000);
        person.finishes("stop").await;
    }
    let mut short = app.participant("?source=pilot").await;
    short.finishes("stop").await;
    assert_eq!(with_flag(&app, Flag::ShortRun).await, [3]);

    let mut late = at_first_timed(&app, "").await;
    app.clock.advance(10_000);
    late.sends("action", "stop").await;
    assert_eq!(with_flag(&app, Flag::LateAnswer).await, [4]);

    let hasty = at_first_timed(&app, "").await;
    let form = [
        ("step", hasty.page.field("step")),
        ("key", hasty.page.field("key")),
        ("action", "stop".to_owned()),
        ("client_rt_ms", "120".to_owned()),
        ("hidden_ms", "900".to_owned()),
    ];
    hasty
        .client
        .post(&hasty.link)
        .form(&form)
        .send()
        .await
        .unwrap();
    assert_eq!(with_flag(&app, Flag::FastChoice).await, [5]);
    assert_eq!(with_flag(&app, Flag::HiddenPage).await, [5]);

    app.participant("?PROLIFIC_PID=abc").await;
    assert_eq!(with_flag(&app, Flag::SeveralArrivals).await, [0_i64; 0]);
    app.participant("?PROLIFIC_PID=abc").await;
    assert_eq!(with_flag(&app, Flag::SeveralArrivals).await, [6]);
    assert_eq!(with_flag(&app, Flag::FailedCheck).await, [0_i64; 0]);

    let completed = ParticipantFilter {
        state: Some(RunState::Completed),
        source: Some("pilot".to_owned()),
        ..ParticipantFilter::default()
    };
    assert_eq!(participants(&app, &completed).await.len(), 1);
    let people = app
        .store
        .totals(&driving(), Population::People)
        .await
        .unwrap();
    assert_eq!(people.completed, 3, "flags exclude nobody");

    let page = app
        .get("/studies/driving/participants?state=completed&flag=short-run&source=")
        .await;
    assert_eq!(page.texts("tbody th"), ["3"]);
    assert_eq!(page.texts(".flag"), ["under a third of the median time"]);
    for query in ["?state=finished", "?flag=slow"] {
        let page = app
            .get(&format!("/studies/driving/participants{query}"))
            .await;
        assert_eq!(page.status, StatusCode::BAD_REQUEST);
    }
    app.stop().await;
}

#[tokio::test]
async fn the_list_of_participants_goes_on_where_a_page_ends() {
    let app = App::start().await;
    for _ in 0..52 {
        app.participant("?source=a%20b").await;
    }
    let page = app.get("/studies/driving/participants?source=a+b").await;
    let numbers = page.texts("tbody th");
    assert_eq!((numbers.len(), numbers[0].as_str()), (50, "52"));
    let older = page.attribute(".more a", "href").unwrap();
    let page = app.get(&older).await;
    assert_eq!(page.texts("tbody th"), ["2", "1"]);
    assert!(page.attribute(".more a", "href").is_none());
    app.stop().await;
}

#[tokio::test]
async fn a_participant_is_erased_after_a_question_and_the_log_says_who() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    person.finishes("stop").await;
    let page = app.get("/studies/driving/participants").await;
    let ask = page.attribute("td a.target", "href").unwrap();
    let page = app.get(&ask).await;
    assert_eq!(page.text("h2").unwrap(), "Erase participant 1?");
    assert_eq!(app.answers().await.len(), 15, "asking erases nothing");

    // One of another study, and one that there is not.
    for path in [
        "/studies/cups/participants/1/erase",
        "/studies/driving/participants/2/erase",
    ] {
        assert_eq!(post(&app, path, &[]).await.status, StatusCode::NOT_FOUND);
    }
    assert_eq!(app.answers().await.len(), 15);

    let action = page.attribute("form[method=post]", "action").unwrap();
    let page = post(&app, &action, &[]).await;
    assert!(page.html.contains("erased"), "{}", page.html);
    assert!(app.answers().await.is_empty());
    let people = app
        .store
        .totals(&driving(), Population::People)
        .await
        .unwrap();
    assert_eq!((people.completed, people.withdrawn), (0, 1));
    assert_eq!(
        person.reloads().await.text("h1").unwrap(),
        "Your answers are erased"
    );
    let log = app.store.audit(None, 10).await.unwrap();
    let erased = log
        .iter()
        .find(|row| row.entry.action == "erase a participant")
        .unwrap();
    assert_eq!(erased.entry.detail.as_deref(), Some("participant 1"));
    app.stop().await;
}

#[tokio::test]
async fn links_hold_the_label_and_begin_with_the_public_address() {
    let settings = Settings {
        public_url: Some("https://study.example".parse().unwrap()),
        // Where others reach the server, nobody counts as sitting at this machine.
        open_results: true,
        ..Settings::default()
    };
    let app = App::configured(Clock::manual(START), App::built_in(), settings).await;
    let page = app.get("/studies/driving/links?source=a%26b").await;
    let link = page.text("[data-link=prolific]").unwrap();
    assert_eq!(
        link,
        "https://study.example/s/driving?PROLIFIC_PID={{%PROLIFIC_PID%}}&STUDY_ID={{%STUDY_ID%}}\
         &SESSION_ID={{%SESSION_ID%}}&source=a%26b"
    );
    assert_eq!(
        page.text("[data-link=anybody]").unwrap(),
        "https://study.example/s/driving?source=a%26b"
    );
    let long = format!("/studies/driving/links?source={}", "x".repeat(61));
    assert_eq!(app.get(&long).await.status, StatusCode::BAD_REQUEST);
    app.stop().await;
}

#[tokio::test]
async fn a_preview_begins_in_the_condition_that_was_chosen_and_takes_no_place() {
    let file = ("between.toml".to_owned(), BETWEEN.to_owned());
    let app = App::with(Clock::manual(START), vec![file]).await;
    let page = app.get("/studies/between/preview").await;
    let offered = page.texts("option");
    assert_eq!(
        offered,
        ["gain/small", "gain/large", "keep/small", "keep/large"]
    );
    let start = "/studies/between/preview/start";
    for condition in &offered {
        let page = post(&app, start, &[("condition", condition)]).await;
        assert_eq!(page.status, StatusCode::OK);
        assert!(page.html.contains("review"), "previews are marked");
    }
    let page = post(&app, start, &[("condition", "gain/none")]).await;
    assert_eq!(page.status, StatusCode::UNPROCESSABLE_ENTITY);
    let study = StudyId::from("between");
    let people = app.store.totals(&study, Population::People).await.unwrap();
    assert_eq!(people.started, 0);
    let page = app.get("/studies/between").await;
    assert_eq!(fate(&page, "Started"), "0");
    assert_eq!(page.texts(".funnel tbody tr").len(), 0);
    app.stop().await;
}

#[tokio::test]
async fn a_blind_study_says_how_many_are_missing_and_who_looked() {
    let mut studies = App::built_in();
    for (_, text) in &mut studies {
        *text = text.replace("# blind_until = 30 ", "blind_until = 3 #");
    }
    let app = App::with(Clock::manual(START), studies).await;
    let mut person = app.participant("").await;
    person.finishes("stop").await;
    app.get("/results/driving").await;
    app.get("/studies/driving/participants").await;
    let page = app.get("/studies/driving").await;
    assert_eq!(
        page.text("[data-part=missing]").unwrap(),
        "2 people are missing"
    );
    assert_eq!(page.texts(".banner tbody tr").len(), 1);
    assert_eq!(page.texts(".banner tbody td")[2], "look at results");
    app.stop().await;
}

#[tokio::test]
async fn each_form_of_export_is_linked_and_opens_and_the_paragraph_adds_up() {
    let app = App::start().await;
    let mut person = app.participant("?source=pilot").await;
    person
        .proceeds("stop", |person| person.page.text(".fields").is_some())
        .await;
    let form = [
        ("step", person.page.field("step")),
        ("key", person.page.field("key")),
        ("age", "33".to_owned()),
        ("gender", "woman".to_owned()),
        ("continue", "1".to_owned()),
    ];
    let request = person.client.post(&person.link).form(&form);
    let end = Page::of(request.send().await.unwrap()).await;
    assert!(end.text(".completion__code").is_some(), "{}", end.html);
    app.participant("").await;

    let page = app.get("/studies/driving/data").await;
    assert_eq!(
        page.text("[data-part=paragraph]").unwrap(),
        "1 person completed the study (1 from pilot). Gender: Woman 100 %. The median age was 33 years (range 33 to \
         33). Of 2 who started, 1 did not finish. The median time from start to end was 0.0 minutes."
    );
    let files = page.attributes(".exports a.button", "href");
    assert_eq!(files.len(), 7);
    for file in files {
        assert_eq!(app.get(&file).await.status, StatusCode::OK, "{file}");
    }
    for file in page.attributes(".exports form", "action") {
        let page = app.get(&format!("{file}?ids=hashed")).await;
        assert_eq!(page.status, StatusCode::OK, "{file}");
    }
    app.stop().await;
}

#[tokio::test]
async fn choices_are_told_apart_by_source_unless_the_study_is_blind() {
    let app = App::start().await;
    for (query, action) in [
        ("?source=lab", "stop"),
        ("?source=lab", "stop"),
        ("?source=web", "accelerate"),
    ] {
        let mut person = app.participant(query).await;
        person.finishes(action).await;
    }
    let page = app.get("/studies/driving/sources").await;
    assert_eq!(page.status, StatusCode::OK);
    // Ten cells, two of them without information, each with two sources.
    let table = "[aria-label=\"Choices by source\"] tbody";
    let rows = page.texts(&format!("{table} tr"));
    assert_eq!(rows.len(), 20);
    let cells = page.texts(&format!("{table} tr:first-child td"));
    assert_eq!(
        cells[..5],
        ["lab", "2", "Accelerate", "0", "0 %"].map(str::to_owned)
    );
    let cells = page.texts(&format!("{table} tr:nth-child(2) td"));
    assert_eq!(
        cells[..5],
        ["web", "1", "Accelerate", "1", "100 %"].map(str::to_owned)
    );
    app.stop().await;

    let mut studies = App::built_in();
    for (_, text) in &mut studies {
        *text = text.replace("# blind_until = 30 ", "blind_until = 3 #");
    }
    let app = App::with(Clock::manual(START), studies).await;
    let page = app.get("/studies/driving/sources").await;
    assert_eq!(page.status, StatusCode::FORBIDDEN);
    app.stop().await;
}

#[tokio::test]
async fn programs_read_the_same_funnel_and_participants() {
    let app = App::start().await;
    let mut person = app.participant("?source=pilot").await;
    person.finishes("stop").await;
    at_first_timed(&app, "").await;
    let read = async |path: &str| -> serde_json::Value {
        let page = app.get(&format!("/api/v1/studies/driving/{path}")).await;
        assert_eq!(page.status, StatusCode::OK, "{}", page.html);
        serde_json::from_str(&page.html).unwrap()
    };
    let funnel = read("funnel").await;
    assert_eq!(
        (&funnel["started"], &funnel["completed"]),
        (&2.into(), &1.into())
    );
    let steps = funnel["steps"].as_array().unwrap();
    assert_eq!(steps[0]["block"], "consent");
    assert_eq!(steps[0]["answered"], 2);
    assert_eq!(
        steps
            .iter()
            .map(|step| step["here"].as_u64().unwrap())
            .sum::<u64>(),
        1
    );

    let first = read("participants?limit=1").await;
    assert_eq!(first["participants"][0]["participant"], 2);
    assert_eq!(first["participants"][0]["state"], "active");
    let next = first["next"].as_str().unwrap();
    let last = read(&format!("participants?limit=1&after={next}")).await;
    assert_eq!(last["participants"][0]["source"], "pilot");
    assert!(last["next"].is_null());
    app.stop().await;
}
