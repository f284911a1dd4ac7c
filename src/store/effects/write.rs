//! Writes what a group of jobs changes, with one statement per table however many jobs there are.

use sqlx::sqlite::SqliteConnection;

use super::Effects;
use crate::store::rules::RunFacts;
use crate::store::{Change, Population, RunId, json};
use crate::store::{bonuses, exclusions, unused_arrivals};

impl Effects {
    /// Writes everything. `facts` gives the rows of the touched runs.
    pub(in crate::store) async fn write<'a>(
        &self,
        connection: &mut SqliteConnection,
        facts: impl Fn(RunId) -> Option<&'a RunFacts>,
    ) -> Result<Vec<Change>, sqlx::Error> {
        self.write_arrivals(connection).await?;
        self.write_new_runs(connection).await?;
        self.write_links(connection).await?;
        self.write_finishers(connection).await?;
        self.write_events(connection).await?;
        self.write_runs(connection, facts).await?;
        self.forget_declined(connection).await?;
        self.write_answers(connection).await?;
        bonuses::draw(connection, &self.paid).await?;
        self.write_counts(connection).await?;
        let changes = self.write_populations(connection).await?;
        exclusions::apply_rules(connection, &self.ended).await?;
        Ok(changes)
    }

    async fn write_arrivals(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if self.arrivals.is_empty() {
            return Ok(());
        }
        sqlx::query(
            r#"
            insert into arrival (
                token_hash, study_id, platform, platform_key, recruiting, source, language, is_preview,
                created_at_ms
            )
            select
                unhex(value ->> 'token'), value ->> 'study_id', value ->> 'platform', value ->> 'platform_key',
                value ->> 'recruiting', value ->> 'source', value ->> 'language', value ->> 'is_preview',
                value ->> 'at'
            from json_each(?)
            "#,
        )
        .bind(json(&self.arrivals))
        .execute(&mut *connection)
        .await?;
        let mut studies: Vec<&str> = self
            .arrivals
            .iter()
            .map(|arrival| arrival.study_id.as_str())
            .collect();
        studies.sort_unstable();
        studies.dedup();
        unused_arrivals::make_room(connection, &studies, unused_arrivals::KEPT).await
    }

    async fn write_new_runs(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if self.runs.is_empty() {
            return Ok(());
        }
        sqlx::query(
            r#"
            insert into run (
                id, study_id, version_id, state, position, platform, platform_key, recruiting, source, language,
                is_simulated, is_preview, time_factor, condition, expires_at_ms, has_times, program_version,
                started_at_ms
            )
            select
                new.value ->> 'id', new.value ->> 'study_id',
                -- a version of another study is none: the row is then refused
                (
                    select study_version.id
                    from study_version
                    where study_version.id = new.value ->> 'version_id'
                    and study_version.study_id = new.value ->> 'study_id'
                ),
                'active', 0, new.value ->> 'platform', new.value ->> 'platform_key', new.value ->> 'recruiting',
                new.value ->> 'source', new.value ->> 'language', new.value ->> 'is_simulated', new.value ->> 'is_preview',
                new.value ->> 'time_factor', new.value ->> 'condition', new.value ->> 'expires_at',
                new.value ->> 'has_times', new.value ->> 'program_version', new.value ->> 'at'
            from json_each(?) as new
            "#,
        )
        .bind(json(&self.runs))
        .execute(&mut *connection)
        .await?;
        sqlx::query(
            r#"
            insert into problem (study_id, cell, hash, prospects)
            select value ->> 0, value ->> 1 ->> 'cell', value ->> 1 ->> 'hash', value ->> 1 ->> 'prospects'
            from json_each(?)
            where true
            on conflict do nothing
            "#,
        )
        .bind(json(&self.problems))
        .execute(&mut *connection)
        .await?;
        sqlx::query(
            r#"
            insert into step (
                run_id, position, kind, block, question, limit_ms, problem_id, is_fitted, is_practice, data
            )
            select
                new.value ->> 'run_id', new.value ->> 'position', new.value ->> 'kind', new.value ->> 'block',
                new.value ->> 'question', new.value ->> 'limit_ms', problem.id, new.value ->> 'is_fitted',
                new.value ->> 'is_practice', new.value ->> 'data'
            from json_each(?) as new
            left join problem
                on problem.study_id = new.value ->> 'study_id'
                and problem.cell = new.value ->> 'cell'
                and problem.hash = new.value ->> 'hash'
            "#,
        )
        .bind(json(&self.steps))
        .execute(connection)
        .await?;
        Ok(())
    }

    async fn write_links(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if self.links.is_empty() {
            return Ok(());
        }
        let links = json(&self.links);
        sqlx::query(
            r#"
            insert into run_token (token_hash, run_id, is_owner, made_at_ms)
            select unhex(value ->> 'link'), value ->> 'run_id', value ->> 'is_owner', value ->> 'at'
            from json_each(?)
            "#,
        )
        .bind(&links)
        .execute(&mut *connection)
        .await?;
        sqlx::query(
            r#"
            update arrival
            set run_id = new.value ->> 'run_id'
            from json_each(?) as new
            where arrival.token_hash = unhex(new.value ->> 'arrival')
            "#,
        )
        .bind(&links)
        .execute(connection)
        .await?;
        Ok(())
    }

    /// Of somebody who declined only that is kept: no id, and nothing that the link brought.
    async fn forget_declined(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if self.declined.is_empty() {
            return Ok(());
        }
        for statement in [
            r#"
            update run
            set platform = null, platform_key = null, recruiting = null
            where id in (select value from json_each(?))
            "#,
            r#"
            update arrival
            set platform = null, platform_key = null, recruiting = null
            where run_id in (select value from json_each(?))
            "#,
        ] {
            sqlx::query(statement)
                .bind(json(&self.declined))
                .execute(&mut *connection)
                .await?;
        }
        Ok(())
    }

    async fn write_finishers(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if !self.finishers.is_empty() {
            sqlx::query(
                r#"
                update run_token
                set is_finisher = 1
                from json_each(?) as new
                where run_token.token_hash = unhex(new.value ->> 1)
                and run_token.run_id = new.value ->> 0
                "#,
            )
            .bind(json(&self.finishers))
            .execute(&mut *connection)
            .await?;
        }
        if !self.ended_alone.is_empty() {
            sqlx::query(
                r#"
                update run_token
                set is_finisher = 1
                where token_hash in (
                    select (
                        select token_hash
                        from run_token
                        where run_id = ended.value
                        order by made_at_ms desc, is_owner
                        limit 1
                    )
                    from json_each(?) as ended
                )
                "#,
            )
            .bind(json(&self.ended_alone))
            .execute(connection)
            .await?;
        }
        Ok(())
    }

    async fn write_events(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if self.events.is_empty() {
            return Ok(());
        }
        sqlx::query(
            r#"
            insert into event (id, run_id, position, kind, key, repeat_of, body_hash, verdict, at_ms, body)
            select
                value ->> 'id', value ->> 'run_id', value ->> 'position', value ->> 'kind', value ->> 'key',
                value ->> 'repeat_of', unhex(value ->> 'body_hash'), value ->> 'verdict', value ->> 'at',
                value ->> 'body'
            from json_each(?)
            "#,
        )
        .bind(json(&self.events))
        .execute(connection)
        .await?;
        Ok(())
    }

    async fn write_runs<'a>(
        &self,
        connection: &mut SqliteConnection,
        facts: impl Fn(RunId) -> Option<&'a RunFacts>,
    ) -> Result<(), sqlx::Error> {
        if self.touched.is_empty() {
            return Ok(());
        }
        let rows: Vec<_> = self
            .touched
            .iter()
            .filter_map(|run| {
                let facts = facts(*run)?;
                let (shown_at, deadline) = (facts.shown_at, facts.deadline);
                Some((
                    run,
                    facts.state,
                    facts.position,
                    shown_at,
                    deadline,
                    facts.ended_at,
                    facts.attempts,
                ))
            })
            .collect();
        sqlx::query(
            r#"
            update run
            set
                state = new.value ->> 1,
                position = new.value ->> 2,
                shown_at_ms = new.value ->> 3,
                deadline_ms = new.value ->> 4,
                finished_at_ms = ifnull(finished_at_ms, new.value ->> 5),
                attempts = new.value ->> 6
            from json_each(?) as new
            where run.id = new.value ->> 0
            "#,
        )
        .bind(json(&rows))
        .execute(connection)
        .await?;
        Ok(())
    }

    async fn write_answers(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if self.answers.is_empty() {
            return Ok(());
        }
        sqlx::query(
            r#"
            insert into answer (
                event_id, run_id, position, status, problem_id, action, is_counted, shown_at_ms, answered_at_ms,
                server_ms, client_rt_ms, limit_ms, deadline_ms, input, hidden_ms, value
            )
            select
                value ->> 'event_id', value ->> 'run_id', value ->> 'position', value ->> 'status',
                value ->> 'problem_id', value ->> 'action', value ->> 'is_counted', value ->> 'shown_at_ms',
                value ->> 'answered_at_ms', value ->> 'server_ms', value ->> 'client_rt_ms', value ->> 'limit_ms',
                value ->> 'deadline_ms', value ->> 'input', value ->> 'hidden_ms', value ->> 'value'
            from json_each(?)
            "#,
        )
        .bind(json(&self.answers))
        .execute(connection)
        .await?;
        Ok(())
    }

    async fn write_counts(&self, connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
        if !self.counts.is_empty() {
            let rows: Vec<_> = self
                .counts
                .iter()
                .map(|(key, counted)| {
                    let simulated = key.population.is_simulated();
                    (
                        &key.study,
                        simulated,
                        key.problem,
                        key.status,
                        &key.action,
                        counted.n,
                        counted.excluded,
                    )
                })
                .collect();
            sqlx::query(
                r#"
                insert into counter (study_id, is_simulated, problem_id, status, action, n_all, excluded_all)
                select value ->> 0, value ->> 1, value ->> 2, value ->> 3, value ->> 4, value ->> 5, value ->> 6
                from json_each(?)
                where true
                on conflict do update set
                    n_all = n_all + excluded.n_all, excluded_all = excluded_all + excluded.excluded_all
                "#,
            )
            .bind(json(&rows))
            .execute(&mut *connection)
            .await?;
        }
        if !self.completed.is_empty() {
            sqlx::query(
                r#"
                update counter
                set
                    n_completed = n_completed + done.n, excluded_completed = excluded_completed + done.n_excluded
                from (
                    select
                        run.study_id, run.is_simulated, answer.problem_id, answer.status,
                        ifnull(answer.action, '') as action, count(*) as n,
                        count(*) filter (
                            where exists (select 1 from exclusion where exclusion.run_id = run.id)
                        ) as n_excluded
                    from json_each(?) as new
                    join run on run.id = new.value
                    join answer on answer.run_id = run.id
                    where answer.is_counted = 1
                    group by 1, 2, 3, 4, 5
                ) as done
                where counter.study_id = done.study_id
                and counter.is_simulated = done.is_simulated
                and counter.problem_id = done.problem_id
                and counter.status = done.status
                and counter.action = done.action
                "#,
            )
            .bind(json(&self.completed))
            .execute(connection)
            .await?;
        }
        Ok(())
    }

    async fn write_populations(
        &self,
        connection: &mut SqliteConnection,
    ) -> Result<Vec<Change>, sqlx::Error> {
        if self.populations.is_empty() {
            return Ok(Vec::new());
        }
        let rows: Vec<_> = self
            .populations
            .iter()
            .map(|((study, population), delta)| {
                (
                    study,
                    population.is_simulated(),
                    delta.started,
                    delta.completed,
                    delta.declined,
                    delta.screened_out,
                    delta.failed_check,
                    delta.timed_out,
                    delta.excluded_completed,
                )
            })
            .collect();
        let changed: Vec<(String, bool, i64, i64)> = sqlx::query_as(
            r#"
            update population
            set
                started = started + (new.value ->> 2),
                completed = completed + (new.value ->> 3),
                declined = declined + (new.value ->> 4),
                screened_out = screened_out + (new.value ->> 5),
                failed_check = failed_check + (new.value ->> 6),
                timed_out = timed_out + (new.value ->> 7),
                excluded_completed = excluded_completed + (new.value ->> 8),
                data_version = data_version + 1,
                page_version = page_version + 1
            from json_each(?) as new
            where population.study_id = new.value ->> 0
            and population.is_simulated = new.value ->> 1
            returning study_id, is_simulated, data_version, page_version
            "#,
        )
        .bind(json(&rows))
        .fetch_all(connection)
        .await?;
        Ok(changed.into_iter().map(Change::from).collect())
    }
}

impl From<(String, bool, i64, i64)> for Change {
    fn from((study, is_simulated, data_version, page_version): (String, bool, i64, i64)) -> Self {
        let population = Population::from_flag(is_simulated);
        Self {
            study: study.into(),
            population,
            data_version,
            page_version,
        }
    }
}
