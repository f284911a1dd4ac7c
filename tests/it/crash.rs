//! kill −9 under load: no acknowledged answer is lost, none counts twice.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex},
    time::Duration,
};

use data_encoding::BASE64URL_NOPAD;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha20Rng;
use sha2::{Digest, Sha256};
use sqlx::{Connection, Row, SqliteConnection, sqlite::SqliteConnectOptions};
use tokio::task::JoinSet;

use crate::app::{Page, Participant};

const ROUNDS: u64 = 6;
const PEOPLE: usize = 16;

/// The link of a run and the step that was answered there, with the name and the value of the button.
type Acknowledged = Arc<Mutex<BTreeMap<(String, u32), (&'static str, String)>>>;

/// The program as it is shipped, in a process of its own that can be killed.
fn serve(database: &Path) -> (Child, String) {
    let mut server = Command::new(env!("CARGO_BIN_EXE_riskaware"))
        .args(["serve", "--listen", "127.0.0.1:0", "--database"])
        .arg(database)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(server.stdout.take().unwrap()).lines();
    let port = lines
        .find_map(|line| Some(line.unwrap().split_once("http://127.0.0.1:")?.1.to_owned()))
        .expect("the server prints its address");
    // Keep the pipe open: the program writes more.
    std::thread::spawn(move || lines.count());
    (server, format!("http://127.0.0.1:{}", port.trim()))
}

/// Takes the study again and again until the server is gone; notes each answer when it is acknowledged.
async fn answer_until_killed(url: String, acknowledged: Acknowledged) -> Option<()> {
    let client = reqwest::Client::builder()
        .redirect(reqwest::redirect::Policy::none())
        .build()
        .unwrap();
    loop {
        let arrived = client.get(format!("{url}/s/driving")).send().await.ok()?;
        let landing = arrived.headers().get("location")?.to_str().ok()?.to_owned();
        let started = client.post(format!("{url}{landing}")).send().await.ok()?;
        let link = started.headers().get("location")?.to_str().ok()?.to_owned();
        let mut person = Participant {
            client: client.clone(),
            link: format!("{url}{link}"),
            page: Page {
                status: started.status(),
                html: String::new(),
            },
        };
        loop {
            let shown = client.get(&person.link).send().await.ok()?;
            person.page = Page {
                status: shown.status(),
                html: shown.text().await.ok()?,
            };
            let page = &person.page;
            if page.attribute("form", "action").is_none() {
                break;
            }
            let (name, value) = match (
                page.buttons("consent").first(),
                page.buttons("action").first(),
            ) {
                (Some(agree), _) => ("consent", agree.clone()),
                (None, Some(action)) => ("action", action.clone()),
                (None, None) => ("continue", "1".to_owned()),
            };
            let form = [
                ("step", page.field("step")),
                ("key", page.field("key")),
                (name, value.clone()),
            ];
            let response = client.post(&person.link).form(&form).send().await.ok()?;
            if response.status().is_redirection() {
                let step = page.field("step").parse().unwrap();
                acknowledged
                    .lock()
                    .unwrap()
                    .insert((link.clone(), step), (name, value));
            }
        }
    }
}

/// What is stored: the status and action of each answer, by the hash of the run's link and the step.
async fn stored(database: &Path) -> BTreeMap<(Vec<u8>, u32), (String, Option<String>)> {
    let options = SqliteConnectOptions::new()
        .filename(database)
        .read_only(true);
    let mut connection = SqliteConnection::connect_with(&options).await.unwrap();
    let check: String = sqlx::query_scalar("pragma integrity_check")
        .fetch_one(&mut connection)
        .await
        .unwrap();
    assert_eq!(check, "ok");
    let rows = sqlx::query(
        "select run_token.token_hash, answer.position, answer.status, answer.action
         from answer join run_token on run_token.run_id = answer.run_id and run_token.is_owner = 1",
    )
    .fetch_all(&mut connection)
    .await
    .unwrap();
    let count = rows.len();
    let answers: BTreeMap<_, _> = rows
        .into_iter()
        .map(|row| ((row.get(0), row.get(1)), (row.get(2), row.get(3))))
        .collect();
    assert_eq!(answers.len(), count, "no step was answered twice");
    let counted: (i64, i64) = sqlx::query_as(
        "select (select coalesce(sum(n_all), 0) from counter), (select count(*) from answer where is_counted = 1)",
    )
    .fetch_one(&mut connection)
    .await
    .unwrap();
    assert_eq!(counted.0, counted.1, "the counters agree with the answers");
    answers
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_acknowledged_answer_is_lost_when_the_server_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("riskaware.db");
    let acknowledged = Acknowledged::default();
    let mut rng = ChaCha20Rng::seed_from_u64(9);
    for _ in 0..ROUNDS {
        let (mut server, url) = serve(&database);
        let mut people = JoinSet::new();
        for _ in 0..PEOPLE {
            people.spawn(answer_until_killed(url.clone(), acknowledged.clone()));
        }
        // When it is killed is chance; that answers were under way is asserted below.
        tokio::time::sleep(Duration::from_millis(rng.random_range(500..1500))).await;
        server.kill().unwrap();
        server.wait().unwrap();
        people.join_all().await;
    }
    let acknowledged = acknowledged.lock().unwrap().clone();
    assert!(
        acknowledged.len() > 100,
        "only {} answers were acknowledged",
        acknowledged.len()
    );
    let stored = stored(&database).await;
    let hash = |link: &str| {
        let token = BASE64URL_NOPAD
            .decode(link.strip_prefix("/r/").unwrap().as_bytes())
            .unwrap();
        Sha256::digest(token).to_vec()
    };
    for ((link, step), (name, value)) in &acknowledged {
        let (status, action) = stored
            .get(&(hash(link), *step))
            .expect("an acknowledged answer is missing");
        if *name == "action" {
            assert_eq!(
                (status.as_str(), action.as_ref()),
                ("answered", Some(value))
            );
        }
    }
    println!(
        "{} acknowledged answers over {ROUNDS} kills, all stored",
        acknowledged.len()
    );
}
