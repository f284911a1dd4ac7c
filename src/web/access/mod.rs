//! Who may do what.
//!
//! One guard stands before every route and looks its rule up in [`ROUTES`]; a route that is not listed is refused.
//! * Before the first account exists: whoever sits at this machine, or everybody with `--open-results`.
//! * From then on: a session cookie for pages, a bearer token for the API, each ignored where the other one belongs;
//!   or the study's public switch, for aggregates of enough people.
//!
//! What is let or refused of data, changes and accounts is written to the log, and so is each look at a blind study.

mod address;
mod caller;
mod cookie;
mod credentials;
mod limits;
mod loopback;
mod public_url;
mod reader;
mod record;
mod request_id;
mod routes;
mod standing;

use std::{net::SocketAddr, sync::Arc};

use axum::{
    extract::{MatchedPath, Request, State},
    http::{HeaderMap, Method, StatusCode},
    middleware::Next,
    response::{IntoResponse, Redirect, Response},
};

use self::reader::ReleasedTo;
pub(super) use self::{
    address::{ClientAddress, PeerAddress},
    cookie::{clear_session, session_token, set_session},
    loopback::cross_site,
    reader::Reader,
    record::{Recorded, Written, entry, record},
    request_id::own_request_id,
    standing::Standing,
};
pub use self::{
    caller::Caller,
    limits::Limits,
    public_url::{PublicUrl, PublicUrlError},
    routes::{Need, ROUTES, Route, Rule},
};
use super::{ApiError, AppState, Error, query::percent_encoded};
use crate::{
    jobs::{Released, Snapshot},
    store::{AuditOutcome, Token},
    study::StudyId,
};

/// What the guard knows of the server.
#[derive(Clone)]
pub(super) struct Guard {
    pub(super) app: AppState,
    /// Where the server listens.
    pub(super) listener: SocketAddr,
    /// What strangers see of public studies.
    pub(super) released: Arc<Released>,
}

/// Why a request goes no further.
enum Refusal {
    /// There is a page for that.
    LogIn,
    /// The account's password was chosen by somebody else.
    ChangePassword,
    Error(Error),
}

impl<E: Into<Error>> From<E> for Refusal {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

/// Whether somebody is let, and to strangers, what is released.
type Admitted = Result<Option<ReleasedTo>, Refusal>;

/// A request as the rules see it.
#[derive(Clone)]
struct Asked {
    route: &'static Route,
    /// The study in the path, if there is such a study.
    study: Option<StudyId>,
    /// The path, for the way back after a login.
    path: String,
    is_get: bool,
    client: ClientAddress,
}

impl Asked {
    fn without_query(&self) -> &str {
        self.path.split('?').next().unwrap_or_default()
    }

    fn is_api(&self) -> bool {
        self.route.path.starts_with("/api/")
    }

    /// Whether the answer goes on until somebody leaves.
    fn is_for_streams(&self) -> bool {
        self.route.path.ends_with("/events")
    }

    /// Whether a script asks and not a person, who would be shown a page.
    fn is_for_scripts(&self) -> bool {
        self.is_api() || self.route.path.contains("/data/") || self.is_for_streams()
    }

    fn answer(&self, refusal: Refusal) -> Response {
        match refusal {
            Refusal::LogIn if self.is_for_scripts() => {
                let text = "log in first, at /login".to_owned();
                ApiError(Error::Unauthorized {
                    text,
                    challenge: None,
                })
                .into_response()
            }
            Refusal::LogIn if self.is_get => {
                let next = percent_encoded(&self.path);
                Redirect::to(&format!("/login?next={next}")).into_response()
            }
            Refusal::LogIn => Redirect::to("/login").into_response(),
            Refusal::ChangePassword => Redirect::to("/account/password").into_response(),
            Refusal::Error(error) if self.is_for_scripts() => ApiError(error).into_response(),
            Refusal::Error(error) => error.into_response(),
        }
    }
}

/// The layer before all routes.
pub(super) async fn guard(
    State(guard): State<Guard>,
    matched: Option<MatchedPath>,
    mut request: Request,
    next: Next,
) -> Response {
    let client = address::client(&request, &guard.app.settings.trusted_proxies);
    request.extensions_mut().insert(client);
    let Some(matched) = matched else {
        // Nothing has this address: the fallback says so.
        return next.run(request).await;
    };
    let Some(route) = routes::find(matched.as_str()) else {
        tracing::error!(
            route = matched.as_str(),
            "a route has no rule and is refused"
        );
        return Error::Forbidden("nobody may see this".to_owned()).into_response();
    };
    // No name in any path of ours needs an escape; written with one, it would be another name to the rules than to its handler.
    if request.uri().path().contains('%') {
        let error = Error::NotFound("address");
        return if route.path.starts_with("/api/") {
            ApiError(error).into_response()
        } else {
            error.into_response()
        };
    }
    let study = routes::segment(route.path, request.uri().path(), "{study}")
        .map(StudyId::from)
        .filter(|study| guard.app.catalogue.current(study).is_some());
    let path = request
        .uri()
        .path_and_query()
        .map_or("/", |path| path.as_str());
    let asked = Asked {
        route,
        study,
        path: path.to_owned(),
        is_get: matches!(*request.method(), Method::GET | Method::HEAD),
        client,
    };
    let (caller, admitted) = match guard.admit(&asked, request.headers()).await {
        Ok((caller, admitted)) => (caller, admitted),
        Err(refusal) => return asked.answer(refusal),
    };
    let released = match admitted {
        Ok(released) => released,
        Err(refusal) => {
            // Whoever is only asked to log in has tried nothing yet, and could fill the log.
            if !matches!(refusal, Refusal::LogIn)
                && let Err(error) = guard
                    .note(&asked, &caller, AuditOutcome::Refused, None)
                    .await
            {
                return asked.answer(error.into());
            }
            return asked.answer(refusal);
        }
    };
    request.extensions_mut().insert(caller.clone());
    if let Some(released) = released {
        request.extensions_mut().insert(released);
    }
    if asked.is_for_streams() {
        let standing = Standing::new(&guard, &asked, request.headers());
        request.extensions_mut().insert(standing);
    }
    let may_go_away = asked.is_get || asked.route.is_for_participants();
    let handled = async move {
        let response = next.run(request).await;
        let extensions = response.extensions();
        let outcome = outcome(response.status()).filter(|_| extensions.get::<Written>().is_none());
        if let Some(outcome) = outcome {
            let recorded = extensions.get::<Recorded>().cloned();
            if let Err(error) = guard.note(&asked, &caller, outcome, recorded).await {
                return asked.answer(error.into());
            }
        }
        response
    };
    if may_go_away {
        return handled.await;
    }
    // What changes something is written to the log also when whoever asked for it has gone away meanwhile.
    tokio::spawn(handled)
        .await
        .unwrap_or_else(|error| Error::Internal(error.into()).into_response())
}

/// What the log says of an answer; nothing where the request was no more than a mistake.
fn outcome(status: StatusCode) -> Option<AuditOutcome> {
    match status {
        StatusCode::FORBIDDEN | StatusCode::CONFLICT | StatusCode::UNPROCESSABLE_ENTITY => {
            Some(AuditOutcome::Refused)
        }
        status if status.is_success() || status.is_redirection() => Some(AuditOutcome::Done),
        _ => None,
    }
}

impl Guard {
    /// Who asks, and whether they are let. The outer error is one that says nothing about rights.
    async fn admit(
        &self,
        asked: &Asked,
        headers: &HeaderMap,
    ) -> Result<(Caller, Admitted), Refusal> {
        let limits = &self.app.limits;
        limits.check_participant(
            asked.route,
            asked.is_get,
            asked.without_query(),
            asked.client,
        )?;
        let need = match asked.route.rule {
            Rule::Open => return Ok((Caller::Nobody, Ok(None))),
            Rule::Greets => {
                let caller = match self.session(headers).await? {
                    Some(caller) => caller,
                    None if self.is_let_without_accounts(headers).await? => Caller::Local,
                    None => Caller::Nobody,
                };
                return Ok((caller, Ok(None)));
            }
            Rule::SignedIn => None,
            Rule::Needs(need) => Some(need),
            Rule::Shared => Some(Need::Results),
        };
        if !self.app.store.has_accounts().await? {
            if asked.is_api() && !asked.client.is_this_machine() {
                limits.check_caller(&Caller::Nobody, asked.client)?;
            }
            let admitted = self.admit_without_accounts(need, headers);
            return Ok((Caller::Local, admitted.map(|()| None)));
        }
        if asked.is_api() {
            self.admit_to_api(asked, need, headers).await
        } else {
            self.admit_to_page(asked, need, headers).await
        }
    }

    /// Whether somebody who only visits may see results, because nobody has an account yet.
    async fn is_let_without_accounts(&self, headers: &HeaderMap) -> Result<bool, Error> {
        let is_let = self
            .admit_without_accounts(Some(Need::Results), headers)
            .is_ok();
        Ok(is_let && !self.app.store.has_accounts().await?)
    }

    fn admit_without_accounts(
        &self,
        need: Option<Need>,
        headers: &HeaderMap,
    ) -> Result<(), Refusal> {
        let is_local = loopback::is_local(headers, self.listener, &self.app.settings);
        let is_let = match need {
            Some(Need::Results | Need::Data) => is_local || self.app.settings.open_results,
            Some(Need::Manage) => is_local,
            Some(Need::Admin) | None => {
                return Err(Refusal::Error(Error::Forbidden(
                    "no account exists yet; make the first one with the link that the server printed when it started"
                        .to_owned(),
                )));
            }
        };
        if is_let {
            Ok(())
        } else {
            Err(Refusal::Error(loopback::not_here()))
        }
    }

    async fn admit_to_page(
        &self,
        asked: &Asked,
        need: Option<Need>,
        headers: &HeaderMap,
    ) -> Result<(Caller, Admitted), Refusal> {
        let Some(caller) = self.session(headers).await? else {
            if asked.route.rule == Rule::Shared {
                self.app
                    .limits
                    .check_caller(&Caller::Nobody, asked.client)?;
            }
            return Ok((
                Caller::Nobody,
                self.shown_to_all(asked)
                    .await?
                    .ok_or(Refusal::LogIn)
                    .map(Some),
            ));
        };
        if caller.must_change_password()
            && asked.route.path != "/account/password"
            && asked.route.path != "/logout"
        {
            return Ok((caller, Err(Refusal::ChangePassword)));
        }
        let is_let = need.is_none_or(|need| caller.may(need));
        let refusal = || {
            Refusal::Error(Error::Forbidden(format!(
                "your account may not do this; it takes {}",
                need.map_or("an account", Need::role_text)
            )))
        };
        Ok((caller, if is_let { Ok(None) } else { Err(refusal()) }))
    }

    async fn admit_to_api(
        &self,
        asked: &Asked,
        need: Option<Need>,
        headers: &HeaderMap,
    ) -> Result<(Caller, Admitted), Refusal> {
        let limits = &self.app.limits;
        let bearer = match credentials::bearer(headers) {
            None => {
                limits.check_caller(&Caller::Nobody, asked.client)?;
                let shown = self.shown_to_all(asked).await?;
                let shown = shown.ok_or_else(|| credentials::missing().into());
                return Ok((Caller::Nobody, shown.map(Some)));
            }
            Some(bearer) => bearer,
        };
        let (caller, is_valid) = match bearer.parse::<Token>() {
            Ok(token) => credentials::holder(&self.app.store, &token).await?,
            Err(_) => (Caller::Nobody, Err(credentials::unknown())),
        };
        limits.check_caller(&caller, asked.client)?;
        if let Err(error) = is_valid {
            return Ok((caller, Err(error.into())));
        }
        let admitted = match need {
            Some(need) if !caller.may(need) => Err(credentials::insufficient(need).into()),
            Some(_) | None => Ok(None),
        };
        Ok((caller, admitted))
    }

    /// Who is logged in, by the cookie.
    async fn session(&self, headers: &HeaderMap) -> Result<Option<Caller>, Error> {
        let Some(token) = session_token(headers, &self.app.settings) else {
            return Ok(None);
        };
        Ok(self.app.store.session(&token).await?.map(Caller::Account))
    }

    /// What everybody may see of this: aggregates of a study that is public, of enough people that none stands out.
    async fn shown_to_all(&self, asked: &Asked) -> Result<Option<ReleasedTo>, Error> {
        let (Rule::Shared, Some(study)) = (asked.route.rule, &asked.study) else {
            return Ok(None);
        };
        if !self.app.store.is_public(study).await? {
            return Ok(None);
        }
        let app = &self.app;
        let population = app.settings.population;
        let current = Snapshot::read(&app.store, &app.catalogue, population, study).await?;
        let released = current.and_then(|current| self.released.of(&current));
        Ok(released.map(ReleasedTo))
    }

    /// Writes down what is to be written down of this route: refusals only so many a minute, because the log is never
    /// shortened.
    async fn note(
        &self,
        asked: &Asked,
        caller: &Caller,
        outcome: AuditOutcome,
        recorded: Option<Recorded>,
    ) -> Result<(), Error> {
        let is_blind = || {
            let study = asked.study.as_ref()?;
            self.app.catalogue.current(study)?.1.blind_until()
        };
        let is_noted = match asked.route.rule {
            Rule::Open | Rule::Greets | Rule::SignedIn => recorded.is_some(),
            Rule::Needs(Need::Data | Need::Manage | Need::Admin) => true,
            // The page's own scripts ask for its numbers again and again: what is noted is that it was opened.
            Rule::Needs(Need::Results) | Rule::Shared => {
                is_blind().is_some() && (asked.is_api() || !asked.is_for_scripts())
            }
        };
        let may_be_noted = || match outcome {
            AuditOutcome::Done => true,
            AuditOutcome::Refused => self.app.limits.may_be_noted(caller, asked.client),
        };
        if !is_noted || !may_be_noted() {
            return Ok(());
        }
        let action = recorded
            .as_ref()
            .and_then(|recorded| recorded.action.clone())
            .unwrap_or_else(|| asked.route.action.to_owned());
        let detail = recorded.and_then(|recorded| recorded.detail);
        record(
            &self.app.store,
            caller,
            &action,
            asked.study.as_ref(),
            detail,
            outcome,
        )
        .await
    }
}
