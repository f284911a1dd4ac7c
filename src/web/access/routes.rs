//! All routes with what they need. The guard refuses whatever is not listed here.

use super::limits::Limited;

/// What somebody must be let do to use a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// To see results: viewers, researchers, admins; tokens with scope `results`.
    Results,
    /// To see what each person answered: researchers, admins; tokens with scope `data`.
    Data,
    /// To change studies: researchers, admins; tokens with scope `manage`.
    Manage,
    /// To change accounts and read the log: admins.
    Admin,
}

impl Need {
    pub(super) fn role_text(self) -> &'static str {
        match self {
            Self::Results => "an account",
            Self::Data | Self::Manage => "a researcher's or an admin's account",
            Self::Admin => "an admin's account",
        }
    }
}

/// Who may use a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Everybody: participants, files, logging in.
    Open,
    /// Everybody; whoever is logged in is greeted.
    Greets,
    /// Whoever is logged in.
    SignedIn,
    /// Whoever is let do this.
    Needs(Need),
    /// Whoever may see results, and everybody where the study is public: aggregates alone.
    Shared,
}

/// A route of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Route {
    /// As the router has it.
    pub path: &'static str,
    /// Who may use it.
    pub rule: Rule,
    /// What using it is called in the log.
    pub action: &'static str,
    pub(super) limited: Option<Limited>,
}

impl Route {
    /// Whether participants use it. What they send is stored or not, whoever waits for the answer.
    pub(super) fn is_for_participants(&self) -> bool {
        self.path.starts_with("/s/") || self.path.starts_with("/r/")
    }
}

const fn route(path: &'static str, rule: Rule, action: &'static str) -> Route {
    Route {
        path,
        rule,
        action,
        limited: None,
    }
}

const fn limited(path: &'static str, limited: Limited) -> Route {
    Route {
        path,
        rule: Rule::Open,
        action: "",
        limited: Some(limited),
    }
}

const DATA: Rule = Rule::Needs(Need::Data);
const RESULTS: Rule = Rule::Needs(Need::Results);
const MANAGE: Rule = Rule::Needs(Need::Manage);
const ADMIN: Rule = Rule::Needs(Need::Admin);

/// All routes.
pub const ROUTES: &[Route] = &[
    route("/healthz", Rule::Open, ""),
    route("/", Rule::Greets, ""),
    route("/static/{version}/{*path}", Rule::Open, ""),
    route("/replays/{id}", Rule::Open, ""),
    // Participants.
    limited("/s/{study}", Limited::Arrival),
    limited("/s/{study}/a/{token}", Limited::Start),
    limited("/r/{token}", Limited::Answer),
    route("/r/{token}/withdraw", Rule::Open, ""),
    // Studies.
    route("/studies", RESULTS, "list the studies"),
    route("/studies/{study}", RESULTS, "watch the study"),
    route(
        "/studies/{study}/data/progress.html",
        RESULTS,
        "watch the study",
    ),
    route("/studies/{study}/state", MANAGE, "change the study's state"),
    route(
        "/studies/{study}/participants",
        DATA,
        "look at the participants",
    ),
    route(
        "/studies/{study}/participants/{run}/erase",
        MANAGE,
        "ask to erase a participant",
    ),
    route(
        "/studies/{study}/participants/{run}/exclusion",
        MANAGE,
        "ask to leave a participant out",
    ),
    route("/studies/{study}/links", DATA, "open the links"),
    route("/studies/{study}/data", DATA, "open the exports"),
    route(
        "/studies/{study}/sources",
        RESULTS,
        "look at choices by source",
    ),
    route(
        "/studies/{study}/data/sources.html",
        RESULTS,
        "look at choices by source",
    ),
    route("/studies/{study}/preview", MANAGE, "preview the study"),
    route(
        "/studies/{study}/preview/start",
        MANAGE,
        "preview the study in a condition",
    ),
    // Accounts.
    route("/setup/{token}", Rule::Open, ""),
    route("/login", Rule::Open, ""),
    route("/logout", Rule::SignedIn, ""),
    route("/account", Rule::SignedIn, ""),
    route("/account/password", Rule::SignedIn, ""),
    route("/account/sessions", Rule::SignedIn, ""),
    route("/account/tokens", Rule::SignedIn, ""),
    route("/account/tokens/{token}/revoke", Rule::SignedIn, ""),
    route("/admin/accounts", ADMIN, "look at the accounts"),
    route("/admin/accounts/{account}/role", ADMIN, "change a role"),
    route(
        "/admin/accounts/{account}/disabled",
        ADMIN,
        "disable an account",
    ),
    route(
        "/admin/accounts/{account}/password",
        ADMIN,
        "set a one-time password",
    ),
    route("/admin/tokens/{token}/revoke", ADMIN, "revoke a token"),
    route("/admin/audit", ADMIN, "look at the log"),
    // The description of the API, which tells nothing of any study.
    route("/api/v1/openapi.json", Rule::Open, ""),
    route("/api/v1/docs", Rule::Open, ""),
    // Results.
    route("/results/{study}", Rule::Shared, "look at results"),
    route("/results/{study}/sweep", Rule::Shared, "look at sweeps"),
    route("/results/{study}/public", MANAGE, "change who sees results"),
    route("/results/{study}/events", Rule::Shared, "look at events"),
    route(
        "/results/{study}/data/summary.json",
        Rule::Shared,
        "look at summary",
    ),
    route(
        "/results/{study}/data/curves.json",
        Rule::Shared,
        "look at curves",
    ),
    route(
        "/results/{study}/data/accuracy.json",
        Rule::Shared,
        "look at accuracy",
    ),
    route(
        "/results/{study}/data/comparison.json",
        Rule::Shared,
        "look at comparison",
    ),
    route(
        "/results/{study}/data/reading.json",
        Rule::Shared,
        "look at reading",
    ),
    route(
        "/results/{study}/data/sequential.json",
        Rule::Shared,
        "look at sequential",
    ),
    route("/results/{study}/data/fits.json", RESULTS, "look at fits"),
    route(
        "/results/{study}/data/sweep.json",
        Rule::Shared,
        "look at sweep",
    ),
    route(
        "/results/{study}/data/gap-sweep.json",
        Rule::Shared,
        "look at gap sweep",
    ),
    route(
        "/results/{study}/data/answers.csv",
        DATA,
        "export answers.csv",
    ),
    route(
        "/results/{study}/data/answers.ndjson",
        DATA,
        "export answers.ndjson",
    ),
    // The API.
    route("/api/v1/studies", RESULTS, "list studies"),
    route("/api/v1/studies/{study}", RESULTS, "look at the study"),
    route(
        "/api/v1/studies/{study}/summary",
        Rule::Shared,
        "look at summary",
    ),
    route("/api/v1/studies/{study}/answers", DATA, "export answers"),
    route(
        "/api/v1/studies/{study}/participants",
        DATA,
        "look at the participants",
    ),
    route("/api/v1/studies/{study}/funnel", RESULTS, "watch the study"),
    // Sources may be small, so this is no aggregate for everybody.
    route(
        "/api/v1/studies/{study}/sources",
        RESULTS,
        "look at choices by source",
    ),
    route(
        "/api/v1/studies/{study}/answers.csv",
        DATA,
        "export answers.csv",
    ),
    route(
        "/api/v1/studies/{study}/answers.ndjson",
        DATA,
        "export answers.ndjson",
    ),
    // Single fits and their history hold counts of few people: they are no aggregates for everybody.
    route("/api/v1/studies/{study}/fits", RESULTS, "look at fits"),
    route(
        "/api/v1/studies/{study}/fits/{fit}",
        RESULTS,
        "look at a fit",
    ),
    route(
        "/api/v1/studies/{study}/fits/{fit}/draws",
        RESULTS,
        "look at draws",
    ),
    route(
        "/api/v1/studies/{study}/fits/{fit}/draws.csv",
        RESULTS,
        "look at draws.csv",
    ),
    route(
        "/api/v1/studies/{study}/curves",
        Rule::Shared,
        "look at curves",
    ),
    route(
        "/api/v1/studies/{study}/accuracy",
        Rule::Shared,
        "look at accuracy",
    ),
    route(
        "/api/v1/studies/{study}/sweep",
        Rule::Shared,
        "look at sweep",
    ),
    route(
        "/api/v1/studies/{study}/gap-sweep",
        Rule::Shared,
        "look at gap sweep",
    ),
    route(
        "/api/v1/studies/{study}/comparison",
        Rule::Shared,
        "look at comparison",
    ),
    route(
        "/api/v1/studies/{study}/sequential",
        Rule::Shared,
        "look at sequential",
    ),
    route("/api/v1/studies/{study}/predict", Rule::Shared, "predict"),
    route(
        "/api/v1/studies/{study}/events",
        Rule::Shared,
        "look at events",
    ),
    // Exports.
    route(
        "/api/v1/studies/{study}/export/wide.csv",
        DATA,
        "export wide.csv",
    ),
    route(
        "/api/v1/studies/{study}/export/psych-ds.zip",
        DATA,
        "export psych-ds.zip",
    ),
    route(
        "/api/v1/studies/{study}/export/codebook.csv",
        DATA,
        "export codebook.csv",
    ),
    route(
        "/api/v1/studies/{study}/export/codebook.json",
        DATA,
        "export codebook.json",
    ),
    route(
        "/api/v1/studies/{study}/export/bonus.csv",
        DATA,
        "export bonus.csv",
    ),
    route(
        "/api/v1/studies/{study}/export/analysis.json",
        DATA,
        "export analysis.json",
    ),
    route("/results/{study}/data/wide.csv", DATA, "export wide.csv"),
    route(
        "/results/{study}/data/psych-ds.zip",
        DATA,
        "export psych-ds.zip",
    ),
    route(
        "/results/{study}/data/codebook.csv",
        DATA,
        "export codebook.csv",
    ),
    route(
        "/results/{study}/data/codebook.json",
        DATA,
        "export codebook.json",
    ),
    route("/results/{study}/data/bonus.csv", DATA, "export bonus.csv"),
    route(
        "/results/{study}/data/analysis.json",
        DATA,
        "export analysis.json",
    ),
    route("/results/{study}/codebook", RESULTS, "look at the codebook"),
];

/// The route that the router matched.
pub(super) fn find(path: &str) -> Option<&'static Route> {
    ROUTES.iter().find(|route| route.path == path)
}

/// What stands in a path where its pattern has `name`.
pub(super) fn segment<'a>(pattern: &str, path: &'a str, name: &str) -> Option<&'a str> {
    pattern
        .split('/')
        .zip(path.split('/'))
        .find(|(part, _)| *part == name)
        .map(|(_, value)| value)
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeSet, fs, path::Path};

    use super::*;

    /// The paths that the sources give to `.route(` or to a description, as far as they are under `folder`.
    fn written(folder: &Path, found: &mut BTreeSet<String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                written(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                // A path begins with a slash; this test names the calls without one. Those of the API stand with
                // their description, in a router that is nested.
                for (call, prefix) in [(".route(", ""), (", path = ", "/api/v1")] {
                    let calls = text.split(call).skip(1);
                    let calls = calls.filter_map(|call| call.trim_start().strip_prefix('"'));
                    for call in calls.filter(|call| call.starts_with('/')) {
                        let path = &call[..call.find('"').expect("a path ends")];
                        found.insert(format!("{prefix}{path}"));
                    }
                }
            }
        }
    }

    #[test]
    fn every_route_of_the_sources_is_listed_and_no_other() {
        let mut found = BTreeSet::new();
        written(
            &Path::new(env!("CARGO_MANIFEST_DIR")).join("src/web"),
            &mut found,
        );
        let listed: BTreeSet<String> = ROUTES.iter().map(|route| route.path.to_owned()).collect();
        assert_eq!(found, listed, "what is missing is refused to everybody");
        assert_eq!(listed.len(), ROUTES.len(), "a route has one rule");
    }

    #[test]
    fn what_the_log_speaks_of_has_a_name() {
        for route in ROUTES {
            let is_named = match route.rule {
                Rule::Open | Rule::Greets | Rule::SignedIn => route.action.is_empty(),
                Rule::Needs(_) | Rule::Shared => !route.action.is_empty(),
            };
            assert!(is_named, "{}", route.path);
        }
    }

    #[test]
    fn forms_of_accounts_are_no_forms_of_participants() {
        for path in ["/login", "/setup/{token}", "/account/password"] {
            assert!(!find(path).unwrap().is_for_participants(), "{path}");
        }
        assert!(find("/r/{token}").unwrap().is_for_participants());
    }

    #[test]
    fn a_segment_is_found_by_its_name() {
        let pattern = "/results/{study}/data/summary.json";
        let path = "/results/driving/data/summary.json";
        assert_eq!(segment(pattern, path, "{study}"), Some("driving"));
        assert_eq!(segment("/login", "/login", "{study}"), None);
    }
}
