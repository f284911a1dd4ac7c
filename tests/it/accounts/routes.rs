//! Every route for every kind of caller.

use reqwest::{Method, header};
use riskaware::{
    store::{Role, Scope},
    web::access::{Need, ROUTES, Route, Rule},
};

use crate::app::App;

use super::lab::{Browser, account, api_token, location, token};

/// Who asks, in the test of all routes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asker {
    Nobody,
    Viewer,
    Researcher,
    Admin,
    /// A token without any scope that the API's data need.
    ResultsToken,
    FullToken,
    ExpiredToken,
}

/// The status that a route must answer with; none where it is the handler's business, as long as it lets the asker in.
fn expected(route: &Route, asker: Asker) -> Option<u16> {
    let is_api = route.path.starts_with("/api/");
    let is_for_scripts = route.path.contains("/data/") || route.path.ends_with("/events");
    let need = match route.rule {
        Rule::Open | Rule::Greets => return None,
        Rule::SignedIn => None,
        Rule::Needs(need) => Some(need),
        Rule::Shared => Some(Need::Results),
    };
    if is_api {
        return match asker {
            // Cookies are nothing to the API.
            Asker::Nobody | Asker::Viewer | Asker::Researcher | Asker::Admin => Some(401),
            Asker::ExpiredToken => Some(401),
            Asker::ResultsToken => (need != Some(Need::Results)).then_some(403),
            Asker::FullToken => (need == Some(Need::Admin)).then_some(403),
        };
    }
    let is_let = match asker {
        // And tokens are nothing to pages.
        Asker::Nobody | Asker::ResultsToken | Asker::FullToken | Asker::ExpiredToken => {
            return Some(if is_for_scripts { 401 } else { 303 });
        }
        Asker::Viewer => matches!(need, None | Some(Need::Results)),
        Asker::Researcher => need != Some(Need::Admin),
        Asker::Admin => true,
    };
    (!is_let).then_some(403)
}

#[tokio::test]
async fn every_route_answers_each_asker_as_its_need_says() {
    let app = App::start().await;
    account(&app, "viktor", Role::Viewer).await;
    account(&app, "anna", Role::Researcher).await;
    let admin = account(&app, "ada", Role::Admin).await;
    let viewer = Browser::logged_in(&app, "viktor").await;
    let researcher = Browser::logged_in(&app, "anna").await;
    let nobody = Browser::new(&app);
    let expired = api_token(&app, 1, Some(admin), &[Scope::Results]).await;
    app.clock.advance(86_400_000);
    // The half-day without use has ended their sessions.
    assert_eq!(viewer.gets("/account").await.status(), 303);
    drop((viewer, researcher));
    let viewer = Browser::logged_in(&app, "viktor").await;
    let researcher = Browser::logged_in(&app, "anna").await;
    let results = api_token(&app, 2, Some(admin), &[Scope::Results]).await;
    let full = api_token(
        &app,
        3,
        Some(admin),
        &[Scope::Results, Scope::Data, Scope::Manage],
    )
    .await;

    for route in ROUTES {
        let path = route
            .path
            .replace("{study}", "driving")
            .replace("{fit}", "1")
            .replace("{account}", "999")
            .replace("{run}", "999")
            .replace("{token}", "999");
        let is_post = path.ends_with("/predict") || path.ends_with("/public");
        for asker in [
            Asker::Nobody,
            Asker::Viewer,
            Asker::Researcher,
            Asker::Admin,
            Asker::ResultsToken,
            Asker::FullToken,
            Asker::ExpiredToken,
        ] {
            // An admin of its own each time: logging out is one of the routes.
            let admin;
            let browser = match asker {
                Asker::Viewer => &viewer,
                Asker::Researcher => &researcher,
                Asker::Admin => {
                    let mut browser = Browser::new(&app);
                    let session = token(200);
                    let ada = app.store.account_named("ada").await.unwrap();
                    app.store.close_session(&session).await.unwrap();
                    app.store
                        .open_session(ada.id, &session, None)
                        .await
                        .unwrap();
                    browser.cookie = Some(format!("riskaware={session}"));
                    admin = browser;
                    &admin
                }
                Asker::Nobody | Asker::ResultsToken | Asker::FullToken | Asker::ExpiredToken => {
                    &nobody
                }
            };
            let method = if is_post { Method::POST } else { Method::GET };
            let mut request = browser.asks(method, &path);
            request = match asker {
                Asker::ResultsToken => request.bearer_auth(&results),
                Asker::FullToken => request.bearer_auth(&full),
                Asker::ExpiredToken => request.bearer_auth(&expired),
                Asker::Nobody | Asker::Viewer | Asker::Researcher | Asker::Admin => request,
            };
            // Of a stream only the head is waited for.
            let response = request.send().await.unwrap();
            let status = response.status().as_u16();
            match expected(route, asker) {
                Some(expected) => assert_eq!(status, expected, "{asker:?} at {path}"),
                None => assert!(
                    !matches!(status, 401 | 403) && !(300..400).contains(&status)
                        || status == 303 && !location(&response).starts_with("/login")
                        || route.rule == Rule::Open,
                    "{asker:?} at {path}: {status}"
                ),
            }
            let is_problem = response
                .headers()
                .get(header::CONTENT_TYPE)
                .is_some_and(|found| found == "application/problem+json");
            if path.starts_with("/api/") && status >= 400 {
                assert!(is_problem, "{asker:?} at {path}: {status}");
            }
            if status == 401 && path.starts_with("/api/") {
                let challenge = response.headers()[header::WWW_AUTHENTICATE]
                    .to_str()
                    .unwrap();
                assert!(challenge.starts_with("Bearer "), "{challenge}");
            }
            // What has an entity tag may be kept by its reader, who asks each time whether it still holds.
            let kept = &response.headers()[header::CACHE_CONTROL];
            let is_asked_for_anew =
                kept == "private, no-cache" && response.headers().contains_key(header::ETAG);
            assert!(
                kept == "no-store" || is_asked_for_anew,
                "only files with their hash in their path are kept: {path}"
            );
        }
    }
}
