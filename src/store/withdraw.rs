//! Withdrawal: the one thing that removes what a person gave, and what was computed from it.

use sqlx::sqlite::SqliteConnection;

use super::import;
use super::job::{Job, Rare};
use super::{
    Change, Error, Population, RunId, RunState, Store, Token, VersionId, json, load, runs,
};
use crate::study::{StudyId, Timestamp};

/// Of the times of a withdrawn run their days are kept.
const DAY_MS: i64 = 24 * 60 * 60 * 1_000;

impl Store {
    /// Erases everything about a run but that it was: answers, events, steps, recruiting ids, its share of the
    /// counts. Done once, it stays done.
    ///
    /// # Errors
    /// `NotFound` for an unknown link, `Refused` for one that does not belong to whoever started the run.
    pub async fn withdraw(&self, link: &Token) -> Result<(), Error> {
        let view = self.run(link).await?;
        if !view.is_owner {
            return Err(Error::Refused(
                "only the link with which the run was started can withdraw it".to_owned(),
            ));
        }
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::Withdraw(view.run, now, ticket)))
            .await
    }

    /// Erases a run as [`Store::withdraw`] does, for somebody who asked for it in another way than by their link.
    ///
    /// # Errors
    /// `NotFound` for a run that is not one of this study.
    pub async fn erase(
        &self,
        study: &StudyId,
        population: Population,
        run: RunId,
    ) -> Result<(), Error> {
        self.run_state(study, population, run).await?;
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::Withdraw(run, now, ticket)))
            .await
    }

    /// Removes arrivals of more than a day ago that started nothing. Returns how many.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn forget_arrivals(&self) -> Result<u64, Error> {
        let before = Timestamp(self.now().0 - runs::ARRIVAL_LIFE_MS);
        self.wait_for(|ticket| Job::Rare(Rare::ForgetArrivals(before, ticket)))
            .await
    }

    /// Erases the links of the runs that began under these versions of a study, and what recruiting platforms told of their
    /// people, after the retention date. Answers stay, and nobody can tell any more whose they are. Runs under way are left alone for a day. Returns how many runs were made anonymous.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn forget_people(
        &self,
        study: &StudyId,
        versions: &[VersionId],
    ) -> Result<u64, Error> {
        let before = Timestamp(self.now().0 - runs::ARRIVAL_LIFE_MS);
        if !self.is_anybody_known(study, versions, before).await? {
            return Ok(0);
        }
        let (study, versions) = (study.clone(), versions.to_vec());
        self.wait_for(|ticket| Job::Rare(Rare::ForgetPeople(study, versions, before, ticket)))
            .await
    }
}

/// Erases a run: its answers, events, steps, bonus, exclusion, recruiting ids and its share of the counters. What stays is
/// an anonymous row with the state `withdrawn`, so that its links can say so, and one event that says on which day and how
/// much. Of a person who
/// took part to an end, the keyed hash of their recruiting id stays in a table of its own until the retention date: whoever
/// has seen their bonus or the answers of a check gets no second try by withdrawing.
///
/// A run that is withdrawn already, or does not exist, changes nothing.
pub(super) async fn erase(
    connection: &mut SqliteConnection,
    run: RunId,
    at: Timestamp,
) -> Result<Vec<Change>, sqlx::Error> {
    let found: Option<(String, bool, bool, u32)> = sqlx::query_as(
        r#"
        select state, is_simulated, is_preview, position
        from run
        where id = ? and state <> 'withdrawn'
        "#,
    )
    .bind(run)
    .fetch_optional(&mut *connection)
    .await?;
    let Some((state, _, is_preview, position)) = found else {
        return Ok(Vec::new());
    };
    // Taken before anything is deleted, so that ids never go backwards.
    let event = load::next_ids(connection).await?.event;
    let day = at.0 - at.0 % DAY_MS;
    subtract_counts(connection, run).await?;
    let was_counted: bool = sqlx::query_scalar(
        "select exists (select 1 from answer where run_id = ? and is_counted = 1)",
    )
    .bind(run)
    .fetch_one(&mut *connection)
    .await?;
    let answers = sqlx::query("delete from answer where run_id = ?")
        .bind(run)
        .execute(&mut *connection)
        .await?;
    let events = sqlx::query("delete from event where run_id = ?")
        .bind(run)
        .execute(&mut *connection)
        .await?;
    let steps = sqlx::query("delete from step where run_id = ?")
        .bind(run)
        .execute(&mut *connection)
        .await?;
    sqlx::query("delete from bonus where run_id = ?")
        .bind(run)
        .execute(&mut *connection)
        .await?;
    let exclusions = sqlx::query("delete from exclusion where run_id = ?")
        .bind(run)
        .execute(&mut *connection)
        .await?
        .rows_affected();
    remember_person(connection, run, state != RunState::Active.as_str()).await?;
    forget_recruiting(connection, run).await?;
    sqlx::query(
        r#"
        update run
        set
            state = 'withdrawn', position = 0, attempts = 0, shown_at_ms = null, deadline_ms = null,
            platform = null, platform_key = null, recruiting = null, source = null, language = null, condition = null,
            time_factor = 1, expires_at_ms = null, started_at_ms = started_at_ms - started_at_ms % ?1, finished_at_ms = ?2
        where id = ?3
        "#,
    )
    .bind(DAY_MS)
    .bind(day)
    .bind(run)
    .execute(&mut *connection)
    .await?;
    let erased = serde_json::json!({
        "state": state,
        "position": position,
        "answers": answers.rows_affected(),
        "events": events.rows_affected(),
        "steps": steps.rows_affected(),
    });
    sqlx::query("insert into event (id, run_id, position, kind, at_ms, body) values (?, ?, 0, 'erased', ?, ?)")
        .bind(event)
        .bind(run)
        .bind(day)
        .bind(json(&erased))
        .execute(&mut *connection)
        .await?;
    tracing::info!(run = run.get(), %erased, "a run was withdrawn and erased");
    if is_preview {
        return Ok(Vec::new());
    }
    let changed: Vec<(String, bool, i64, i64)> = sqlx::query_as(
        r#"
        update population
        set
            completed = completed - (?2 = 'completed'),
            excluded = excluded - ?4,
            excluded_completed = excluded_completed - ?4 * (?2 = 'completed'),
            declined = declined - (?2 = 'declined'),
            screened_out = screened_out - (?2 = 'screened_out'),
            failed_check = failed_check - (?2 = 'failed_check'),
            timed_out = timed_out - (?2 = 'timed_out'),
            withdrawn = withdrawn + 1,
            data_version = data_version + 1,
            page_version = page_version + 1,
            erased_version = iif(?3, data_version + 1, erased_version)
        from run
        where run.id = ?1
        and population.study_id = run.study_id
        and population.is_simulated = run.is_simulated
        returning population.study_id, population.is_simulated, data_version, page_version
        "#,
    )
    .bind(run)
    .bind(&state)
    .bind(was_counted)
    .bind(i64::from(exclusions > 0))
    .fetch_all(&mut *connection)
    .await?;
    if was_counted {
        forget_results(connection, run).await?;
    }
    Ok(changed.into_iter().map(Change::from).collect())
}

/// Keeps that the person of a run took part and withdrew: of those whose run was over, and of imported people, who have
/// answered all that they ever will.
async fn remember_person(
    connection: &mut SqliteConnection,
    run: RunId,
    is_over: bool,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        r#"
        insert into withdrawn_person (study_id, platform_key, version_id)
        select study_id, platform_key, version_id
        from run
        where id = ?1 and platform_key is not null and is_preview = 0 and (?2 or platform = ?3)
        on conflict do nothing
        "#,
    )
    .bind(run)
    .bind(is_over)
    .bind(import::PLATFORM)
    .execute(connection)
    .await?;
    Ok(())
}

/// Removes everything that was computed from the study's answers, since the person's were among them. It is computed
/// again without them. That a rule for stopping was reached stays, because it was announced and names nobody.
async fn forget_results(connection: &mut SqliteConnection, run: RunId) -> Result<(), sqlx::Error> {
    for statement in [
        "delete from fit where (study_id, is_simulated) = (select study_id, is_simulated from run where id = ?)",
        "delete from comparison where (study_id, is_simulated) = (select study_id, is_simulated from run where id = ?)",
        "delete from checkpoint where (study_id, is_simulated) = (select study_id, is_simulated from run where id = ?)",
    ] {
        sqlx::query(statement)
            .bind(run)
            .execute(&mut *connection)
            .await?;
    }
    Ok(())
}

/// Erases links and recruiting ids of the runs under these versions of a study that are over or began before `before`.
/// Returns how many had any. The keys of imported people stay, so that the same file is not imported twice: they came by no link.
pub(super) async fn forget_people(
    connection: &mut SqliteConnection,
    study: &StudyId,
    versions: &[VersionId],
    before: Timestamp,
) -> Result<u64, sqlx::Error> {
    let versions = json(&versions);
    let runs: Vec<RunId> = sqlx::query_scalar(
        r#"
        select id
        from run
        where study_id = ?
        and version_id in (select value from json_each(?))
        and (state <> 'active' or started_at_ms < ?)
        and (
            (platform is not null and platform <> ?) or recruiting is not null
            or exists (select 1 from run_token where run_token.run_id = run.id)
        )
        "#,
    )
    .bind(study.as_str())
    .bind(&versions)
    .bind(before.0)
    .bind(import::PLATFORM)
    .fetch_all(&mut *connection)
    .await?;
    for statement in [
        "delete from arrival where run_id in (select value from json_each(?))",
        "delete from run_token where run_id in (select value from json_each(?))",
        r#"
        update run
        set platform = null, platform_key = null, recruiting = null
        where id in (select value from json_each(?))
        "#,
    ] {
        sqlx::query(statement)
            .bind(json(&runs))
            .execute(&mut *connection)
            .await?;
    }
    sqlx::query(
        "delete from withdrawn_person where version_id in (select value from json_each(?))",
    )
    .bind(&versions)
    .execute(connection)
    .await?;
    Ok(runs.len() as u64)
}

async fn subtract_counts(connection: &mut SqliteConnection, run: RunId) -> Result<(), sqlx::Error> {
    sqlx::query(
        r#"
        update counter
        set
            n_all = n_all - own.n,
            n_completed = n_completed - own.n * own.is_completed,
            excluded_all = excluded_all - own.n * own.is_excluded,
            excluded_completed = excluded_completed - own.n * own.is_completed * own.is_excluded
        from (
            select
                run.study_id, run.is_simulated, run.state = 'completed' as is_completed,
                exists (select 1 from exclusion where exclusion.run_id = run.id) as is_excluded, answer.problem_id,
                answer.status, ifnull(answer.action, '') as action, count(*) as n
            from run
            join answer on answer.run_id = run.id
            where run.id = ? and answer.is_counted = 1
            group by answer.problem_id, answer.status, answer.action
        ) as own
        where counter.study_id = own.study_id
        and counter.is_simulated = own.is_simulated
        and counter.problem_id = own.problem_id
        and counter.status = own.status
        and counter.action = own.action
        "#,
    )
    .bind(run)
    .execute(connection)
    .await?;
    Ok(())
}

/// Empties the arrivals and links that led to the run, and removes other ones of the same person that led nowhere.
async fn forget_recruiting(
    connection: &mut SqliteConnection,
    run: RunId,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        r#"
        delete from arrival
        where run_id is null
        and (study_id, platform, platform_key) = (select study_id, platform, platform_key from run where id = ?)
        "#,
    )
    .bind(run)
    .execute(&mut *connection)
    .await?;
    sqlx::query(
        r#"
        update arrival
        set
            platform = null, platform_key = null, recruiting = null, source = null, language = null,
            created_at_ms = created_at_ms - created_at_ms % ?
        where run_id = ?
        "#,
    )
    .bind(DAY_MS)
    .bind(run)
    .execute(&mut *connection)
    .await?;
    sqlx::query("update run_token set made_at_ms = made_at_ms - made_at_ms % ? where run_id = ?")
        .bind(DAY_MS)
        .bind(run)
        .execute(connection)
        .await?;
    Ok(())
}
