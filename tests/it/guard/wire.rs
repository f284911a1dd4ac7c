//! What is read of a request, and what an answer says of itself.

use reqwest::Method;

use super::lab::{Browser, behind_a_proxy};
use crate::app::App;

#[tokio::test]
async fn nobody_but_a_trusted_proxy_chooses_the_id_of_a_request() {
    let id_of = async |app: &App, given: &str| {
        let request = Browser::new(app).asks(Method::GET, "/api/v1/nothing");
        let answer = request.header("x-request-id", given).send().await.unwrap();
        let id = answer.headers()["x-request-id"]
            .to_str()
            .unwrap()
            .to_owned();
        let problem: serde_json::Value = answer.json().await.unwrap();
        assert_eq!(problem["request_id"], id);
        id
    };
    let app = App::start().await;
    assert_ne!(id_of(&app, "mine").await, "mine");
    let app = behind_a_proxy().await;
    assert_eq!(id_of(&app, "of-the-proxy.1").await, "of-the-proxy.1");
    let long = "a".repeat(65);
    for odd in [long.as_str(), "two words", "a=b"] {
        assert_ne!(id_of(&app, odd).await, odd);
    }
}

#[tokio::test]
async fn a_query_that_cannot_be_read_is_told_as_a_problem() {
    let app = App::start().await;
    for part in ["curves", "comparison"] {
        let path = format!("/results/driving/data/{part}.json?plan=a&plan=b");
        let answer = Browser::new(&app).gets(&path).await;
        assert_eq!(answer.status(), 400, "{part}");
        assert_eq!(answer.headers()["content-type"], "application/problem+json");
    }
}

#[test]
fn the_document_says_when_to_try_again() {
    let document: serde_json::Value = serde_json::from_str(&riskaware::web::document()).unwrap();
    for name in ["TooManyRequests", "Busy"] {
        let header = &document["components"]["responses"][name]["headers"]["Retry-After"];
        assert_eq!(header["schema"]["type"], "integer", "{name}");
    }
    let file = &document["components"]["schemas"]["StudyDetail"];
    assert!(file.to_string().contains("completion codes"), "{file}");
}
