//! Links for recruiting platforms, ready to copy, with the codes that belong to them.

use std::collections::BTreeMap;

use askama::Template;
use askama_web::WebTemplate;
use axum::{
    Extension,
    extract::{Path, Query},
    http::{HeaderMap, header},
};
use serde::Deserialize;

use super::{
    super::{Error, Settings, access::Caller, accounts::Who, assets},
    Head, Parts, current,
};
use crate::study::{CompletionCode, Ending, LinkParameter, RecruitingIds, Study, StudyId};
use crate::web::query;

/// Longer labels would not fit into tables.
const LONGEST_SOURCE: usize = 60;

#[derive(Template, WebTemplate)]
#[template(path = "studies/links.html")]
pub(super) struct LinksPage {
    head: Head,
    source: String,
    /// Whether the address holds on this machine alone, as far as is known.
    is_guessed: bool,
    links: Vec<Link>,
    endings: Vec<EndingLine>,
    filters: Vec<String>,
    hashes_ids: bool,
}

struct Link {
    platform: &'static str,
    id: &'static str,
    url: String,
    /// What to do with it.
    note: String,
}

struct EndingLine {
    who: &'static str,
    code: String,
    /// Where they are sent.
    redirect: String,
}

#[derive(Deserialize)]
pub(super) struct LinksQuery {
    #[serde(default)]
    source: String,
}

/// GET `/studies/STUDY/links`.
pub(super) async fn show(
    (store, catalogue, settings): Parts,
    Extension(caller): Extension<Caller>,
    Path(study): Path<StudyId>,
    headers: HeaderMap,
    Query(query): Query<LinksQuery>,
) -> Result<LinksPage, Error> {
    let served = current(&catalogue, &study)?;
    let source = query.source.trim();
    if source.chars().count() > LONGEST_SOURCE || source.chars().any(char::is_control) {
        return Err(Error::BadRequest(format!(
            "the label must hold at most {LONGEST_SOURCE} printable characters"
        )));
    }
    Ok(LinksPage {
        head: Head::new(&store, &settings, &caller, &served, "/links").await?,
        is_guessed: settings.public_url.is_none(),
        links: links(&served, &base(&settings, &headers), source),
        source: source.to_owned(),
        endings: endings(&served),
        filters: served.recruiting().filters.clone(),
        hashes_ids: served.recruiting().ids == RecruitingIds::Hashed,
    })
}

/// The public address, or the one under which this page was asked for.
fn base(settings: &Settings, headers: &HeaderMap) -> String {
    match &settings.public_url {
        Some(url) => url.to_string(),
        None => {
            let host = headers
                .get(header::HOST)
                .and_then(|host| host.to_str().ok());
            format!("http://{}", host.unwrap_or("127.0.0.1"))
        }
    }
}

fn links(study: &Study, base: &str, source: &str) -> Vec<Link> {
    let link = |query: &[&str]| {
        let source =
            (!source.is_empty()).then(|| format!("source={}", query::percent_encoded(source)));
        let query: Vec<&str> = query.iter().copied().chain(source.as_deref()).collect();
        let mark = if query.is_empty() { "" } else { "?" };
        format!("{base}/s/{}{mark}{}", study.id(), query.join("&"))
    };
    let mturk = if study.recruiting().mturk.frame {
        "As the address of an external question: MTurk adds workerId, assignmentId, hitId and turkSubmitTo itself."
    } else {
        "In MTurk’s survey-link template; workers paste the code. To show the study inside of MTurk, say frame = true under [recruiting.mturk] in the study file."
    };
    vec![
        Link {
            platform: "Prolific",
            id: "prolific",
            url: link(&[
                "PROLIFIC_PID={{%PROLIFIC_PID%}}",
                "STUDY_ID={{%STUDY_ID%}}",
                "SESSION_ID={{%SESSION_ID%}}",
            ]),
            note: "Paste it as the study’s URL and let Prolific pass the ids on as URL parameters.".to_owned(),
        },
        Link {
            platform: "MTurk",
            id: "mturk",
            url: link(&[]),
            note: mturk.to_owned(),
        },
        Link {
            platform: "SONA",
            id: "sona",
            url: link(&["survey_code=%SURVEY_CODE%"]),
            note: "Paste it as the study’s URL; SONA writes its code in place of %SURVEY_CODE%.".to_owned(),
        },
        Link {
            platform: "Anybody",
            id: "anybody",
            url: link(&[]),
            note: "For mail and posters. Each visit can start anew; who is to come back to the same run needs an id of yours, as below.".to_owned(),
        },
        Link {
            platform: "Your own list",
            id: "own",
            url: link(&["pid=ID"]),
            note: "One link per person: write any id in place of ID. The same id leads back to the same run.".to_owned(),
        },
    ]
}

fn endings(study: &Study) -> Vec<EndingLine> {
    // Each parameter stands for itself.
    let names: BTreeMap<String, String> = LinkParameter::ALL
        .into_iter()
        .map(|parameter| (parameter.name().to_owned(), parameter.name().to_owned()))
        .collect();
    [
        ("Completed", Ending::Completed),
        ("Screened out", Ending::ScreenedOut),
        ("Failed a check", Ending::FailedCheck),
        ("Timed out", Ending::TimedOut),
    ]
    .into_iter()
    .map(|(who, ending)| {
        let page = study.ending(ending);
        let (code, shown, otherwise) = match &page.code {
            CompletionCode::Fixed(code) => (
                code.clone(),
                Some(code.as_str()),
                "nowhere; is shown the code",
            ),
            CompletionCode::PerRun => (
                "another one for each person".to_owned(),
                Some("CODE"),
                "nowhere; is shown the code",
            ),
            CompletionCode::Absent => ("none".to_owned(), None, "nowhere"),
        };
        let target = page.redirect.as_ref();
        EndingLine {
            who,
            redirect: target
                .and_then(|target| target.address(shown, &names))
                .unwrap_or_else(|| otherwise.to_owned()),
            code,
        }
    })
    .collect()
}
