//! The driving survey over HTTP: order, deadlines, resubmission, resuming, withdrawal.

use std::collections::BTreeSet;

use reqwest::StatusCode;
use riskaware::store::AnswerStatus;

use crate::app::{App, Participant};

/// A person at the first question of the timed block.
async fn at_first_timed(app: &App) -> Participant {
    let mut person = app.participant("").await;
    person
        .proceeds("stop", |person| person.block().as_deref() == Some("timed"))
        .await;
    person
}

#[tokio::test]
async fn a_person_completes_the_survey_and_each_question_is_stored_once() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    person.finishes("stop").await;
    assert!(person.page.text(".completion__code").unwrap().len() >= 8);

    let answers = app.answers().await;
    let choices: Vec<_> = answers
        .iter()
        .filter(|answer| answer.action.is_some())
        .collect();
    let in_block = |block: &str| {
        choices
            .iter()
            .filter(|answer| answer.block.as_str() == block)
            .count()
    };
    assert_eq!(
        (in_block("timed"), in_block("untimed"), in_block("baseline")),
        (5, 5, 4)
    );
    assert!(
        choices
            .iter()
            .all(|answer| answer.status == AnswerStatus::Answered)
    );
    let problems: BTreeSet<_> = choices
        .iter()
        .map(|answer| (&answer.block, &answer.question))
        .collect();
    assert_eq!(problems.len(), choices.len(), "no question was asked twice");
    for block in ["timed", "untimed"] {
        let information: Vec<_> = choices
            .iter()
            .filter(|answer| answer.block.as_str() == block)
            .map(|answer| {
                answer
                    .question
                    .as_ref()
                    .unwrap()
                    .as_str()
                    .split('-')
                    .next()
                    .unwrap()
            })
            .collect();
        assert_eq!(
            information,
            ["none", "implicit", "implicit", "explicit", "explicit"],
            "order of block {block}"
        );
    }
    app.stop().await;
}

#[tokio::test]
async fn an_answer_counts_until_the_deadline_and_is_kept_as_late_afterwards() {
    let app = App::start().await;
    let mut in_time = at_first_timed(&app).await;
    app.clock.advance(7_900);
    in_time.sends("action", "stop").await;

    let mut late = at_first_timed(&app).await;
    app.clock.advance(10_000);
    late.sends("action", "stop").await;

    let timed: Vec<_> = app
        .answers()
        .await
        .into_iter()
        .filter(|answer| answer.block.as_str() == "timed")
        .collect();
    let choices: Vec<_> = timed
        .iter()
        .filter(|answer| answer.action.is_some())
        .collect();
    assert_eq!(choices.len(), 2);
    assert_eq!(
        (choices[0].status, choices[0].server_ms),
        (AnswerStatus::Answered, Some(7_900))
    );
    assert_eq!(
        (choices[1].status, choices[1].server_ms),
        (AnswerStatus::Late, Some(10_000))
    );
    let summary = app.get("/api/v1/studies/driving/summary").await;
    let summary: serde_json::Value = serde_json::from_str(&summary.html).unwrap();
    let cell = &summary["cells"]
        .as_array()
        .unwrap()
        .iter()
        .find(|cell| cell["id"] == "none/timed/unknown")
        .unwrap();
    assert_eq!(
        (cell["n"].as_u64(), cell["late"].as_u64()),
        (Some(1), Some(1))
    );
    app.stop().await;
}

#[tokio::test]
async fn reloading_does_not_restart_the_clock() {
    let app = App::start().await;
    let mut person = at_first_timed(&app).await;
    app.clock.advance(5_000);
    person.reloads().await;
    assert_eq!(
        person
            .page
            .attribute(".countdown", "data-remaining-ms")
            .as_deref(),
        Some("3000")
    );
    app.stop().await;
}

#[tokio::test]
async fn an_abandoned_question_is_closed_and_the_next_one_waits_for_the_person() {
    let app = App::start().await;
    let mut person = at_first_timed(&app).await;
    let first = person.page.field("step");
    app.clock.advance(60_000);
    person.reloads().await;
    assert_ne!(
        person.page.field("step"),
        first,
        "the next question is shown"
    );
    assert_eq!(
        person
            .page
            .attribute(".countdown", "data-remaining-ms")
            .as_deref(),
        Some("8000")
    );
    let closed = app
        .answers()
        .await
        .into_iter()
        .filter(|answer| answer.status == AnswerStatus::TimedOut)
        .count();
    assert_eq!(closed, 1);
    app.stop().await;
}

#[tokio::test]
async fn the_first_answer_stands_whatever_is_sent_again() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    person
        .proceeds("stop", |person| {
            person.block().as_deref() == Some("untimed")
        })
        .await;
    let asked = person.page.clone();
    let mut second_tab = person.clone();
    second_tab.reloads().await;

    person.sends("action", "stop").await;
    let next = person.page.field("step");
    // A double click, the same form with another choice, and an older tab.
    for (page, action) in [
        (&asked, "stop"),
        (&asked, "accelerate"),
        (&second_tab.page, "accelerate"),
    ] {
        let response = person.posts(page, "action", action).await;
        assert_eq!(response.status(), StatusCode::OK, "a plain form is led on");
    }
    person.reloads().await;
    assert_eq!(person.page.field("step"), next, "nothing moved on");
    let step: u32 = asked.field("step").parse().unwrap();
    let stored: Vec<_> = app
        .answers()
        .await
        .into_iter()
        .filter(|answer| answer.key.position == step)
        .collect();
    assert_eq!(stored.len(), 1);
    assert_eq!(
        stored[0].action.as_ref().map(|action| action.as_str()),
        Some("stop")
    );
    app.stop().await;
}

#[tokio::test]
async fn a_script_is_told_where_to_go_and_what_conflicts() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    person
        .proceeds("stop", |person| {
            person.block().as_deref() == Some("untimed")
        })
        .await;
    let asked = person.page.clone();
    for (action, expected) in [("stop", 200), ("stop", 200), ("accelerate", 409)] {
        let form = [
            ("step", asked.field("step")),
            ("key", asked.field("key")),
            ("action", action.to_owned()),
        ];
        let request = person
            .client
            .post(&person.link)
            .header("accept", "application/json")
            .form(&form);
        let response = request.send().await.unwrap();
        assert_eq!(response.status().as_u16(), expected);
        let receipt: serde_json::Value = response.json().await.unwrap();
        assert!(person.link.ends_with(receipt["next"].as_str().unwrap()));
        assert_eq!(
            receipt["receipt"]["verdict"], "answered",
            "the receipt is that of the first form"
        );
    }
    app.stop().await;
}

#[tokio::test]
async fn declining_leads_to_a_polite_page_and_stores_no_answer() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    person.sends("consent", "decline").await;
    assert_eq!(person.page.status, StatusCode::OK);
    assert!(person.page.buttons("consent").is_empty());
    assert!(person.page.text("h1").is_some());
    assert!(
        app.answers()
            .await
            .iter()
            .all(|answer| answer.action.is_none())
    );
    app.stop().await;
}

#[tokio::test]
async fn a_recruited_person_has_one_run_whatever_link_is_followed() {
    let app = App::start().await;
    let query = "?PROLIFIC_PID=p1&STUDY_ID=s&SESSION_ID=t";
    let mut first = app.participant(query).await;
    first
        .proceeds("stop", |person| {
            person.block().as_deref() == Some("untimed")
        })
        .await;
    let mut again = app.participant(query).await;
    assert_ne!(first.link, again.link);
    assert_eq!(
        again.page.field("step"),
        first.page.field("step"),
        "the same run goes on"
    );
    let refused = app
        .get(&format!(
            "{}/withdraw",
            again.link.strip_prefix(&app.url).unwrap()
        ))
        .await;
    assert_eq!(refused.status, StatusCode::FORBIDDEN);

    again
        .proceeds("stop", |person| person.page.text("form").is_none())
        .await;
    assert!(
        again.page.text(".completion__code").is_some(),
        "the code is for whoever finishes"
    );
    let later = app.participant(query).await;
    assert_eq!(
        later.page.text(".completion__code"),
        None,
        "a third link is told that the study was taken"
    );
    first.reloads().await;
    assert!(first.page.text(".completion__code").is_some());
    let other = app.participant("?PROLIFIC_PID=p2").await;
    assert!(
        !other.page.buttons("consent").is_empty(),
        "somebody else starts anew"
    );
    app.stop().await;
}

#[tokio::test]
async fn withdrawing_erases_the_answers_and_their_counts() {
    let app = App::start().await;
    let mut stays = app.participant("").await;
    stays.finishes("stop").await;
    let kept = app.answers().await.len();
    let mut leaves = app.participant("").await;
    leaves.finishes("accelerate").await;
    assert_eq!(app.answers().await.len(), 2 * kept);

    let response = leaves
        .client
        .post(format!("{}/withdraw", leaves.link))
        .send()
        .await
        .unwrap();
    assert_eq!(response.status(), StatusCode::OK);
    assert_eq!(app.answers().await.len(), kept);
    let summary = app.get("/api/v1/studies/driving/summary").await;
    let summary: serde_json::Value = serde_json::from_str(&summary.html).unwrap();
    assert_eq!(summary["people"]["withdrawn"], 1);
    for cell in summary["cells"].as_array().unwrap() {
        assert_eq!(cell["n"], 1, "{}", cell["id"]);
    }
    leaves.reloads().await;
    assert_eq!(leaves.page.status, StatusCode::OK);
    assert!(leaves.page.text("form").is_none());
    app.stop().await;
}

#[tokio::test]
async fn a_form_with_a_wrong_value_comes_back_filled_in() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    person
        .proceeds("stop", |person| person.page.text(".fields").is_some())
        .await;
    person.sends("age", "two hundred").await;
    assert_eq!(person.page.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert_eq!(person.page.field("age"), "two hundred");
    assert!(person.page.text("title").unwrap().starts_with("Error:"));
    assert!(person.page.text("#error-age").is_some());
    person.sends("age", "33").await;
    assert!(person.page.text(".completion__code").is_some());
    app.stop().await;
}

#[tokio::test]
async fn nonsense_is_answered_with_what_is_wrong() {
    let app = App::start().await;
    let person = app.participant("").await;
    let link = person.link.strip_prefix(&app.url).unwrap().to_owned();
    let unknown = format!("/r/{}", "A".repeat(43));
    let post = |path: &str, body: &str| {
        app.client
            .post(format!("{}{path}", app.url))
            .header("content-type", "application/x-www-form-urlencoded")
            .body(body.to_owned())
            .send()
    };
    for (path, status) in [
        ("/nowhere", 404),
        ("/s/nothing", 404),
        ("/r/short", 404),
        (unknown.as_str(), 404),
        ("/s/driving/a/short", 404),
        ("/s/driving?PROLIFIC_PID=%00", 400),
        ("/s/driving?PROLIFIC_PID=a&workerId=b", 400),
    ] {
        assert_eq!(app.get(path).await.status.as_u16(), status, "{path}");
    }
    let huge = "x".repeat(600_000);
    // What a form may hold, in letters that are sent as nine bytes each.
    let long = format!("step=0&key=k&words={}", "%E6%B0%B4".repeat(50_000));
    for (path, body, status) in [
        (link.as_str(), "", 400),
        (link.as_str(), "step=0", 400),
        (link.as_str(), "step=no&key=k", 400),
        (link.as_str(), "step=0&key=k", 422),
        (link.as_str(), "step=0&key=k&consent=maybe", 422),
        (link.as_str(), "step=7&key=k&action=stop", 409),
        (link.as_str(), "step=999&key=k&action=stop", 404),
        (link.as_str(), long.as_str(), 422),
        (link.as_str(), huge.as_str(), 413),
        ("/", "", 405),
        (unknown.as_str(), "step=0&key=k", 404),
    ] {
        let response = post(path, body).await.unwrap();
        assert_eq!(
            response.status().as_u16(),
            status,
            "POST {path} {:.40}",
            body
        );
        assert!(
            response.text().await.unwrap().contains("<h1>"),
            "a page says so"
        );
    }
    let crossed = app
        .client
        .post(&person.link)
        .header("sec-fetch-site", "cross-site")
        .send()
        .await
        .unwrap();
    assert_eq!(crossed.status(), StatusCode::FORBIDDEN);
    let ahead = app
        .client
        .get(&person.link)
        .header("sec-purpose", "prefetch")
        .send()
        .await
        .unwrap();
    assert_eq!(ahead.status(), StatusCode::SERVICE_UNAVAILABLE);
    let probed = app.client.head(&person.link).send().await.unwrap();
    assert_eq!(probed.status(), StatusCode::METHOD_NOT_ALLOWED);
    let results = app.client.get(format!("{}/results/driving", app.url));
    let forwarded = results
        .header("x-forwarded-for", "10.0.0.1")
        .send()
        .await
        .unwrap();
    assert_eq!(forwarded.status(), StatusCode::FORBIDDEN);
    assert!(app.answers().await.is_empty(), "nothing was stored of it");
    app.stop().await;
}

#[tokio::test]
async fn a_closed_study_takes_nobody_in_and_lets_those_under_way_finish() {
    let app = App::start().await;
    let mut person = app.participant("").await;
    app.store
        .set_study_state(&"driving".into(), riskaware::store::StudyState::Closed)
        .await
        .unwrap();
    let closed = app.get("/s/driving").await;
    assert_eq!(closed.status, StatusCode::GONE);
    person.finishes("stop").await;
    app.stop().await;
}
