//! What Prolific, MTurk and SONA send, and what they get back.

use std::collections::BTreeMap;

use reqwest::{Client, Response, StatusCode, redirect::Policy};
use riskaware::{
    clock::Clock,
    store::{AnswerKey, Population, StudyState},
    study::{Study, StudyId},
};

use crate::{
    app::{App, Page, Participant, START},
    program::{riskaware, stderr},
};

const STUDY: &str = include_str!("../data/recruited.toml");
const PROLIFIC: &str = "https://app.prolific.com/submissions/complete?cc=";
const FRAMED: &str = "mturk = { frame = true }\n";
const WORKER: &str =
    "/s/recruited?workerId=A1&assignmentId=3X&hitId=H1&turkSubmitTo=https%3A%2F%2Fwww.mturk.com";
const MTURK: &str =
    "https://worker.mturk.com https://www.mturk.com https://workersandbox.mturk.com";
const LOOK: &str = "/s/recruited?assignmentId=ASSIGNMENT_ID_NOT_AVAILABLE&hitId=H1&turkSubmitTo=https%3A%2F%2Fwww.mturk.com";

/// The study with more keys under `[recruiting]`.
async fn serve(keys: &str) -> App {
    let file = ("recruited.toml".to_owned(), format!("{STUDY}{keys}"));
    App::with(Clock::manual(START), vec![file]).await
}

fn study() -> StudyId {
    "recruited".into()
}

async fn fetch(app: &App, path: &str) -> Response {
    let client = Client::builder().redirect(Policy::none()).build().unwrap();
    client
        .get(format!("{}{path}", app.url))
        .send()
        .await
        .unwrap()
}

/// The part of a policy that begins with `directive`.
fn directive(response: &Response, directive: &str) -> String {
    let policy = response.headers()["content-security-policy"]
        .to_str()
        .unwrap();
    let mut parts = policy.split(';').map(str::trim);
    parts
        .find_map(|part| part.strip_prefix(directive))
        .expect("the policy names it")
        .trim()
        .to_owned()
}

async fn consents(app: &App, link: &str) -> Participant {
    let mut person = app.participant_of(link).await;
    person.sends("consent", "agree").await;
    person
}

async fn finishes(person: &mut Participant) {
    person.sends("adult", "yes").await;
    person.sends("chance", "50").await;
    person.finishes("lottery").await;
}

fn way_back(page: &Page) -> Option<String> {
    page.attribute("a.button--primary", "href")
}

/// What the form on the last page hands in, and where.
fn handed_in(page: &Page) -> (String, BTreeMap<String, String>) {
    let action = page.attribute("form", "action").unwrap();
    let names = page.attributes("form input", "name");
    let values = page.attributes("form input", "value");
    (action, names.into_iter().zip(values).collect())
}

fn fields(expected: &[(&str, &str)]) -> BTreeMap<String, String> {
    let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
    expected.iter().map(owned).collect()
}

#[tokio::test]
async fn each_ending_sends_people_back_to_prolific_with_its_own_code() {
    let app = serve("").await;
    let mut completed = consents(&app, "/s/recruited?PROLIFIC_PID=p1").await;
    finishes(&mut completed).await;
    let mut screened_out = consents(&app, "/s/recruited?PROLIFIC_PID=p2").await;
    screened_out.sends("adult", "no").await;
    let mut failed = consents(&app, "/s/recruited?PROLIFIC_PID=p3").await;
    failed.sends("adult", "yes").await;
    failed.sends("chance", "5").await;
    let mut late = consents(&app, "/s/recruited?PROLIFIC_PID=p4").await;
    app.clock.advance(1_000 * 31 * 60);
    app.store.close_overdue().await.unwrap();
    late.reloads().await;
    for (person, code) in [
        (&completed, "DONE1"),
        (&screened_out, "OUT1"),
        (&failed, "FAIL1"),
        (&late, "LATE1"),
    ] {
        let page = &person.page;
        assert_eq!(page.text(".completion__code").as_deref(), Some(code));
        assert_eq!(way_back(page), Some(format!("{PROLIFIC}{code}")));
    }
    app.stop().await;
}

#[tokio::test]
async fn redirects_name_what_the_link_brought_where_ids_are_plain() {
    let sona = "https://lab.sona-systems.com/credit?experiment_id=7&survey_code={survey_code}";
    let text = STUDY.replacen(
        "https://app.prolific.com/submissions/complete?cc={code}",
        sona,
        1,
    );
    let file = (
        "recruited.toml".to_owned(),
        format!("{text}ids = \"plain\"\n"),
    );
    let app = App::with(Clock::manual(START), vec![file]).await;
    let mut person = consents(&app, "/s/recruited?survey_code=47%2611").await;
    finishes(&mut person).await;
    let address = sona.replace("{survey_code}", "47%2611");
    assert_eq!(way_back(&person.page), Some(address));

    let mut other = consents(&app, "/s/recruited?pid=anna").await;
    finishes(&mut other).await;
    assert_eq!(
        way_back(&other.page),
        None,
        "there is no survey_code to name"
    );
    app.stop().await;
}

#[test]
fn a_redirect_cannot_name_what_is_stored_under_a_hash() {
    let text = STUDY.replacen("cc={code}", "cc={code}&who={PROLIFIC_PID}", 1);
    let line = 1 + text
        .lines()
        .position(|line| line.contains("{PROLIFIC_PID}"))
        .unwrap();
    let error = Study::parse("recruited.toml", &text).unwrap_err();
    assert_eq!(error.line(), Some(line));
    assert_eq!(error.key(), "completion.redirect");
    assert!(error.found().contains("{PROLIFIC_PID}"), "{error}");
    assert!(
        error.allowed().contains("recruiting.ids = \"plain\""),
        "{error}"
    );
    let plain = format!("{text}ids = \"plain\"\n");
    Study::parse("recruited.toml", &plain).unwrap();

    let unknown = STUDY.replacen("cc={code}", "cc={kode}", 1);
    let error = Study::parse("recruited.toml", &unknown).unwrap_err();
    assert!(error.found().contains("{kode}"), "{error}");
    let site = format!("{STUDY}mturk = {{ frame = true, sites = [\"http://example.org\"] }}\n");
    let error = Study::parse("recruited.toml", &site).unwrap_err();
    assert!(error.key().starts_with("recruiting.mturk.sites"), "{error}");
}

/// Each example of the document, in a study that has the same blocks.
#[test]
fn the_examples_of_the_document_parse() {
    let document = include_str!("../../docs/RECRUITING.md");
    let (blocks, endings) = STUDY.split_at(STUDY.find("[completion]").unwrap());
    let (endings, _) = endings.split_at(endings.find("[recruiting]").unwrap());
    let mut examples = 0;
    for example in document.split("```toml\n").skip(1) {
        let (example, _) = example.split_once("```").unwrap();
        let endings = if example.contains("[completion]") {
            ""
        } else {
            endings
        };
        let text = format!("{blocks}\n{endings}\n{example}");
        if let Err(error) = Study::parse("example.toml", &text) {
            panic!("{error}\n{example}");
        }
        examples += 1;
    }
    assert!(examples > 2, "{examples} examples");
}

/// What somebody gets who follows the document with the file of `study new`: the example of `[completion]` in place of the
/// one that is there, the one of `[recruiting]` at the end.
#[test]
fn the_first_steps_of_the_document_make_a_study() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("umbrella.toml");
    let made = riskaware(&["study", "new", path.to_str().unwrap()], "");
    assert!(made.status.success(), "{}", stderr(&made));
    let starter = std::fs::read_to_string(&path).unwrap();

    let document = include_str!("../../docs/RECRUITING.md");
    let mut examples = document.split("```toml\n").skip(1);
    let mut example = || {
        let (example, _) = examples.next().unwrap().split_once("```").unwrap();
        example.to_owned()
    };
    let (completion, recruiting) = (example(), example());
    assert!(
        completion.trim().starts_with("[completion]"),
        "{completion}"
    );
    let (before, rest) = starter.split_once("[completion]\n").unwrap();
    let (_, after) = rest.split_once("\n\n").unwrap();
    let text = format!("{before}{completion}\n{after}\n{recruiting}");
    let study = Study::parse("umbrella.toml", &text).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(study.recruiting().quota, Some(120));
}

#[tokio::test]
async fn a_look_at_a_hit_shows_the_landing_page_and_takes_nothing() {
    let app = serve(FRAMED).await;
    let response = fetch(&app, LOOK).await;
    assert_eq!(
        response.status(),
        StatusCode::OK,
        "no redirect: there is no arrival"
    );
    assert!(directive(&response, "frame-ancestors").contains("https://worker.mturk.com"));
    let page = Page::of(response).await;
    assert_eq!(page.text("h1").as_deref(), Some("Two lotteries"));
    assert_eq!(page.attribute("form", "action"), None);
    assert!(page.texts("button").is_empty());
    assert!(page.text(".banner").unwrap().contains("Accept it first"));
    app.clock.advance(1_000 * 3 * 24 * 60 * 60);
    let unused = app.store.forget_arrivals().await.unwrap();
    assert_eq!(unused, 0, "nothing was stored");

    app.store
        .set_study_state(&study(), StudyState::Paused)
        .await
        .unwrap();
    let closed = app.get(LOOK).await;
    assert_eq!(closed.status, StatusCode::GONE, "{}", closed.html);
    app.stop().await;
}

#[tokio::test]
async fn a_worker_hands_the_assignment_in_by_a_form_to_mturk_alone() {
    let app = serve(FRAMED).await;
    let mut person = consents(&app, WORKER).await;
    finishes(&mut person).await;
    let (action, sent) = handed_in(&person.page);
    assert_eq!(action, "https://www.mturk.com/mturk/externalSubmit");
    let expected = [
        ("assignmentId", "3X"),
        ("ending", "completed"),
        ("code", "DONE1"),
    ];
    assert_eq!(sent, fields(&expected));
    assert_eq!(way_back(&person.page), None, "one way back, not two");

    let last = app.client.get(&person.link).send().await.unwrap();
    // MTurk may lead the form on from the host that takes it to another of its own.
    assert_eq!(directive(&last, "form-action"), format!("'self' {MTURK}"));

    let mut out = consents(&app, &WORKER.replace("A1", "A2").replace("3X", "3Y")).await;
    out.sends("adult", "no").await;
    let (_, sent) = handed_in(&out.page);
    let expected = [
        ("assignmentId", "3Y"),
        ("ending", "screened_out"),
        ("code", "OUT1"),
    ];
    assert_eq!(sent, fields(&expected));
    app.stop().await;
}

#[tokio::test]
async fn whoever_accepts_a_hit_again_goes_on_and_hands_in_the_new_assignment() {
    let app = serve(FRAMED).await;
    let mut first = consents(&app, WORKER).await;
    first.sends("adult", "yes").await;
    app.clock.advance(1_000 * 60);
    let mut second = app.participant_of(&WORKER.replace("3X", "3Z")).await;
    assert!(
        second.page.html.contains("What is the chance"),
        "the same run"
    );
    second.sends("chance", "50").await;
    second.finishes("sure").await;
    let (_, sent) = handed_in(&second.page);
    assert_eq!(sent["assignmentId"], "3Z");

    // Accepted once more after the end: that is another assignment, for which nothing was done.
    app.clock.advance(1_000 * 60);
    let third = app.participant_of(&WORKER.replace("3X", "3W")).await;
    assert_eq!(third.page.attribute("form", "action"), None);
    second.reloads().await;
    assert_eq!(handed_in(&second.page).1["assignmentId"], "3Z");
    app.stop().await;
}

#[tokio::test]
async fn assignments_go_nowhere_but_to_mturk_and_sites_that_the_file_names() {
    let app = serve("mturk = { frame = true, sites = [\"http://localhost:4000\"] }\n").await;
    for site in [
        "https%3A%2F%2Fwww.mturk.com.evil.example",
        "https%3A%2F%2Fevil.example",
        "http%3A%2F%2Flocalhost%3A4001",
        "javascript%3Aalert(1)",
    ] {
        let link = WORKER.replace("https%3A%2F%2Fwww.mturk.com", site);
        let page = app.get(&link).await;
        assert_eq!(page.status, StatusCode::BAD_REQUEST, "{site}");
        assert!(
            page.html.contains("https://workersandbox.mturk.com"),
            "{}",
            page.html
        );
    }
    let link = WORKER.replace(
        "https%3A%2F%2Fwww.mturk.com",
        "http%3A%2F%2Flocalhost%3A4000",
    );
    let response = fetch(&app, &link).await;
    assert_eq!(response.status(), StatusCode::SEE_OTHER);
    assert!(directive(&response, "frame-ancestors").ends_with(" http://localhost:4000"));
    app.stop().await;
}

#[tokio::test]
async fn only_pages_of_a_study_that_says_so_may_be_framed_and_none_sets_a_cookie() {
    let app = serve(FRAMED).await;
    let client = Client::builder().redirect(Policy::none()).build().unwrap();
    let bare = |response: &Response| {
        assert!(
            !response.headers().contains_key("set-cookie"),
            "{}",
            response.url()
        );
    };
    let arrived = fetch(&app, WORKER).await;
    bare(&arrived);
    let landing = arrived.headers()["location"].to_str().unwrap().to_owned();
    let shown = fetch(&app, &landing).await;
    bare(&shown);
    assert_eq!(directive(&shown, "frame-ancestors"), MTURK);
    assert_eq!(directive(&shown, "form-action"), "'self'");
    let started = client
        .post(format!("{}{landing}", app.url))
        .send()
        .await
        .unwrap();
    bare(&started);
    let run = started.headers()["location"].to_str().unwrap().to_owned();
    for path in [run.clone(), format!("{run}/withdraw")] {
        let page = fetch(&app, &path).await;
        bare(&page);
        assert_eq!(directive(&page, "frame-ancestors"), MTURK, "{path}");
        assert_eq!(directive(&page, "form-action"), "'self'", "{path}");
    }
    // What is wrong with a form has to be seen in the frame as well.
    let refused = client
        .post(format!("{}{run}", app.url))
        .form(&[("step", "x")])
        .send()
        .await
        .unwrap();
    assert_eq!(refused.status(), StatusCode::BAD_REQUEST);
    assert_eq!(directive(&refused, "frame-ancestors"), MTURK);
    for path in ["/", "/results/recruited", "/login"] {
        let page = fetch(&app, path).await;
        assert_eq!(directive(&page, "frame-ancestors"), "'none'", "{path}");
    }
    app.stop().await;

    let unframed = serve("").await;
    let page = fetch(&unframed, LOOK).await;
    assert_eq!(directive(&page, "frame-ancestors"), "'none'");
    unframed.stop().await;
}

#[tokio::test]
async fn a_form_in_a_frame_of_another_site_is_let_through_and_one_from_there_is_not() {
    let app = serve(FRAMED).await;
    let person = app.participant_of(WORKER).await;
    let form = [
        ("step", person.page.field("step")),
        ("key", person.page.field("key")),
        ("consent", "agree".to_owned()),
    ];
    let send = async |site: &str, origin: &str| {
        app.client
            .post(&person.link)
            .header("sec-fetch-site", site)
            .header("sec-fetch-dest", "iframe")
            .header("origin", origin)
            .form(&form)
            .send()
            .await
            .unwrap()
    };
    let foreign = send("cross-site", "https://worker.mturk.com").await;
    assert_eq!(foreign.status(), StatusCode::FORBIDDEN);
    // A frame's form is as same-origin as its page, whatever stands around it.
    let own = send("same-origin", &app.url).await;
    assert_eq!(own.status(), StatusCode::OK);
    assert!(own.text().await.unwrap().contains("Are you 18 or older?"));
    app.stop().await;
}

#[tokio::test]
async fn ids_are_hashed_but_for_the_assignment_and_retention_erases_that_too() {
    let app = serve("mturk = { frame = true }\nretention = 2026-06-30\n").await;
    let mut person = consents(&app, WORKER).await;
    finishes(&mut person).await;
    let run = app.store.run(&person.token()).await.unwrap().run;
    let kept = app.store.recruiting_parameters(run).await.unwrap();
    assert_eq!(kept["assignmentId"], "3X");
    assert_eq!(kept["turkSubmitTo"], "https://www.mturk.com");
    assert_ne!(kept["workerId"], "A1");
    assert_ne!(kept["hitId"], "H1");

    app.clock.advance(1_000 * 200 * 24 * 60 * 60);
    app.store.forget_people(&study()).await.unwrap();
    assert!(
        app.store
            .recruiting_parameters(run)
            .await
            .unwrap()
            .is_empty()
    );
    let answers = app
        .store
        .answers(&study(), Population::People, AnswerKey::START, 100)
        .await
        .unwrap();
    assert_eq!(answers.len(), 2, "the answers stay");
    app.stop().await;
}

#[tokio::test]
async fn the_same_person_of_sona_goes_on_under_either_name_of_the_code() {
    let app = serve("").await;
    let mut person = consents(&app, "/s/recruited?survey_code=4711").await;
    person.sends("adult", "yes").await;
    let again = app.participant_of("/s/recruited?id=4711").await;
    assert!(again.page.html.contains("What is the chance"));
    let other = app.participant_of("/s/recruited?id=4712").await;
    assert!(!other.page.buttons("consent").is_empty());
    app.stop().await;
}
