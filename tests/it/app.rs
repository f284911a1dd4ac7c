//! The real server on a port of its own and a database file of its own, and people who talk to it over HTTP.

use std::{net::SocketAddr, sync::Arc};

use reqwest::{Client, Response, StatusCode};
use riskaware::{
    chance::Chance,
    clock::Clock,
    jobs::{Catalogue, SourceFits, Sweeps},
    store::{AnswerKey, AnswerRow, Options, Population, Store, Token},
    study::{self, Timestamp},
    web::{self, AppState, Limits, Replays, Settings},
};
use scraper::{Html, Selector};
use tokio::{net::TcpListener, task::JoinHandle};
use tokio_util::sync::CancellationToken;

/// 2026-01-01T00:00:00Z: where manual clocks start.
pub const START: Timestamp = Timestamp(1_767_225_600_000);

pub struct App {
    pub url: String,
    pub client: Client,
    pub store: Store,
    pub clock: Clock,
    stop: CancellationToken,
    server: JoinHandle<std::io::Result<()>>,
    _folder: tempfile::TempDir,
}

impl App {
    /// A server whose clock only moves when the test moves it.
    pub async fn start() -> Self {
        Self::with(Clock::manual(START), Self::built_in()).await
    }

    pub async fn with(clock: Clock, studies: Vec<(String, String)>) -> Self {
        Self::started(clock, studies, Settings::default(), 60).await
    }

    /// The same where so many people may start per minute from one address.
    pub async fn with_starts(
        clock: Clock,
        studies: Vec<(String, String)>,
        starts_per_minute: u32,
    ) -> Self {
        Self::started(clock, studies, Settings::default(), starts_per_minute).await
    }

    pub async fn configured(
        clock: Clock,
        studies: Vec<(String, String)>,
        settings: Settings,
    ) -> Self {
        Self::started(clock, studies, settings, 60).await
    }

    async fn started(
        clock: Clock,
        studies: Vec<(String, String)>,
        settings: Settings,
        starts_per_minute: u32,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("riskaware.db");
        let store = Store::open(Options::at(&database), clock.clone())
            .await
            .unwrap();
        let catalogue = Arc::new(Catalogue::publish(&store, studies).await.unwrap());
        let stop = CancellationToken::new();
        let state = AppState {
            store: store.clone(),
            catalogue: catalogue.clone(),
            chance: Chance::from_seed(1),
            limits: Arc::new(Limits::new(&clock, starts_per_minute)),
            settings: Arc::new(settings),
            sweeps: Arc::new(Sweeps::new(stop.clone())),
            source_fits: Arc::new(SourceFits::new(stop.clone())),
            replays: Arc::new(Replays::of(&catalogue)),
            stop: stop.clone(),
        };
        let listener = TcpListener::bind(SocketAddr::from(([127, 0, 0, 1], 0)))
            .await
            .unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let shutdown = stop.clone().cancelled_owned();
        let server = tokio::spawn(web::serve(listener, state, shutdown));
        Self {
            url,
            client: Client::new(),
            store,
            clock,
            stop,
            server,
            _folder: folder,
        }
    }

    /// The files of the built-in studies.
    pub fn built_in() -> Vec<(String, String)> {
        study::built_in()
            .into_iter()
            .map(|(name, text)| (name.to_owned(), text.to_owned()))
            .collect()
    }

    /// Somebody who followed the study's link and pressed the button.
    pub async fn participant(&self, query: &str) -> Participant {
        self.participant_of(&format!("/s/driving{query}")).await
    }

    /// The same at the link of any study.
    pub async fn participant_of(&self, link: &str) -> Participant {
        let landing = self.get(link).await;
        let action = landing
            .attribute("form", "action")
            .expect("the landing page has a button");
        let response = self
            .client
            .post(format!("{}{action}", self.url))
            .send()
            .await
            .unwrap();
        Participant {
            client: self.client.clone(),
            link: response.url().to_string(),
            page: Page::of(response).await,
        }
    }

    pub async fn get(&self, path: &str) -> Page {
        Page::of(
            self.client
                .get(format!("{}{path}", self.url))
                .send()
                .await
                .unwrap(),
        )
        .await
    }

    /// All choices that are stored, practice included.
    pub async fn answers(&self) -> Vec<AnswerRow> {
        let study = "driving".into();
        self.store
            .answers(&study, Population::People, AnswerKey::START, 10_000)
            .await
            .unwrap()
    }

    /// Ends the server as a supervisor would.
    pub async fn stop(self) {
        self.stop.cancel();
        self.server.await.unwrap().unwrap();
        self.store.close().await;
    }
}

/// An answer of the server with what a person sees in it.
#[derive(Debug, Clone)]
pub struct Page {
    pub status: StatusCode,
    pub html: String,
}

impl Page {
    pub async fn of(response: Response) -> Self {
        Self {
            status: response.status(),
            html: response.text().await.unwrap(),
        }
    }

    pub fn attribute(&self, selector: &str, name: &str) -> Option<String> {
        let selector = Selector::parse(selector).unwrap();
        Html::parse_document(&self.html)
            .select(&selector)
            .next()?
            .attr(name)
            .map(str::to_owned)
    }

    /// An attribute of all elements that the selector finds, in their order.
    pub fn attributes(&self, selector: &str, name: &str) -> Vec<String> {
        let selector = Selector::parse(selector).unwrap();
        Html::parse_document(&self.html)
            .select(&selector)
            .filter_map(|element| element.attr(name))
            .map(str::to_owned)
            .collect()
    }

    pub fn text(&self, selector: &str) -> Option<String> {
        let selector = Selector::parse(selector).unwrap();
        let text: String = Html::parse_document(&self.html)
            .select(&selector)
            .next()?
            .text()
            .collect();
        Some(text.trim().to_owned())
    }

    /// The texts of all elements that the selector finds.
    pub fn texts(&self, selector: &str) -> Vec<String> {
        let selector = Selector::parse(selector).unwrap();
        Html::parse_document(&self.html)
            .select(&selector)
            .map(|element| element.text().collect::<String>().trim().to_owned())
            .collect()
    }

    pub fn field(&self, name: &str) -> String {
        self.attribute(&format!("input[name={name}]"), "value")
            .unwrap_or_default()
    }

    /// The values of the buttons with this name.
    pub fn buttons(&self, name: &str) -> Vec<String> {
        let selector = Selector::parse(&format!("button[name={name}]")).unwrap();
        let document = Html::parse_document(&self.html);
        document
            .select(&selector)
            .filter_map(|button| button.attr("value"))
            .map(str::to_owned)
            .collect()
    }
}

/// One person with a run and the page that they look at.
#[derive(Debug, Clone)]
pub struct Participant {
    pub client: Client,
    pub link: String,
    pub page: Page,
}

impl Participant {
    /// Sends the form of the page with one more field, and looks at the page that follows.
    pub async fn sends(&mut self, name: &str, value: &str) -> &Page {
        let page = self.page.clone();
        self.page = Page::of(self.posts(&page, name, value).await).await;
        &self.page
    }

    /// Sends the form of any page, such as an old one, without looking at what follows.
    pub async fn posts(&self, page: &Page, name: &str, value: &str) -> Response {
        let form = [
            ("step", page.field("step")),
            ("key", page.field("key")),
            (name, value.to_owned()),
        ];
        self.client
            .post(&self.link)
            .form(&form)
            .send()
            .await
            .unwrap()
    }

    pub async fn reloads(&mut self) -> &Page {
        self.page = Page::of(self.client.get(&self.link).send().await.unwrap()).await;
        &self.page
    }

    /// What the link holds in secret.
    pub fn token(&self) -> Token {
        let (_, token) = self
            .link
            .rsplit_once('/')
            .expect("a link ends in its token");
        token.parse().expect("the server made it")
    }

    pub fn block(&self) -> Option<String> {
        self.page.attribute("form.choice", "data-block")
    }

    /// Agrees, goes on, and chooses `action` wherever it is offered, until `here` says so.
    pub async fn proceeds(&mut self, action: &str, here: impl Fn(&Self) -> bool) {
        for _ in 0..100 {
            if here(self) {
                return;
            }
            if self.page.buttons("consent").is_empty() {
                let offered = self.page.buttons("action");
                let (name, value) = match offered
                    .iter()
                    .find(|offer| *offer == action)
                    .or(offered.first())
                {
                    Some(offer) => ("action", offer.as_str()),
                    None => ("continue", "1"),
                };
                self.sends(name, value).await;
            } else {
                self.sends("consent", "agree").await;
            }
            assert_eq!(self.page.status, StatusCode::OK, "{}", self.page.html);
        }
        panic!("never got there; the last page is {}", self.page.html);
    }

    pub async fn finishes(&mut self, action: &str) {
        self.proceeds(action, |person| {
            person.page.text(".completion__code").is_some()
        })
        .await;
    }
}
