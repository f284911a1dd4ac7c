//! Studies and the versions of their files.

use sqlx::sqlite::SqliteConnection;

use super::job::{Job, Publish, Rare};
use super::{
    Change, Error, Population, Store, StudyState, VersionId, VersionNumber, exclusions, import,
};
use crate::study::{ExclusionRule, StudyId, Timestamp};

/// A study as the database knows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StudyRow {
    /// Its id.
    pub id: StudyId,
    /// Whether it takes people in.
    pub state: StudyState,
    /// The version that new runs get.
    pub version: VersionId,
}

/// A version of a study file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StudyVersion {
    /// Its id.
    pub id: VersionId,
    /// Which of the study's versions it is.
    pub number: VersionNumber,
    /// The study.
    pub study: StudyId,
    /// The hash of the text.
    pub hash: String,
    /// The full text.
    pub text: String,
    /// The program that first served it.
    pub program_version: String,
    /// When that was.
    pub created_at: Timestamp,
    /// Whether it came with the program, and no file of the lab's ever had the same text.
    pub is_built_in: bool,
}

#[derive(sqlx::FromRow)]
struct VersionRow {
    id: VersionId,
    number: VersionNumber,
    study_id: String,
    hash: String,
    text: String,
    program_version: String,
    created_at_ms: i64,
    is_built_in: bool,
}

impl Store {
    /// Makes a study's text the current version, and the study itself if it is new, in the state `state_if_new`. Runs
    /// under this version are judged by `rule`, whatever later versions say. The same text again is the version that it
    /// was.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn publish(
        &self,
        study: &StudyId,
        hash: &str,
        text: &str,
        state_if_new: StudyState,
        rule: Option<&ExclusionRule>,
    ) -> Result<VersionId, Error> {
        let text = self.text(study, hash, text, state_if_new, rule);
        self.send_text(text).await
    }

    /// The same for a study that comes with the program: a later program may replace its text, unless a file of the lab's
    /// has had it.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn publish_built_in(
        &self,
        study: &StudyId,
        hash: &str,
        text: &str,
        state_if_new: StudyState,
        rule: Option<&ExclusionRule>,
    ) -> Result<VersionId, Error> {
        let text = Publish {
            is_built_in: true,
            ..self.text(study, hash, text, state_if_new, rule)
        };
        self.send_text(text).await
    }

    /// Gives everybody who is under way in a study without an end one, `time_limit_ms` from now on: a version that counts
    /// places may follow one that did not, and who began under that one holds a place too. Previews and imported people
    /// hold none. Returns how many got one.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn set_ends(&self, study: &StudyId, time_limit_ms: i64) -> Result<u64, Error> {
        let (study, ends_at) = (study.clone(), Timestamp(self.now().0 + time_limit_ms));
        self.wait_for(|ticket| Job::Rare(Rare::SetEnds(study, ends_at, ticket)))
            .await
    }

    fn text(
        &self,
        study: &StudyId,
        hash: &str,
        text: &str,
        state_if_new: StudyState,
        rule: Option<&ExclusionRule>,
    ) -> Publish {
        Publish {
            study: study.clone(),
            hash: hash.to_owned(),
            text: text.to_owned(),
            exclusion: rule.map(exclusions::rule_json),
            state_if_new,
            is_built_in: false,
            at: self.now(),
        }
    }

    async fn send_text(&self, publish: Publish) -> Result<VersionId, Error> {
        self.wait_for(|ticket| Job::Rare(Rare::Publish(publish, ticket)))
            .await
    }

    /// Opens, pauses or closes a study.
    ///
    /// # Errors
    /// `NotFound` for an unknown study.
    pub async fn set_study_state(&self, study: &StudyId, state: StudyState) -> Result<(), Error> {
        let study = study.clone();
        self.wait_for(|ticket| Job::Rare(Rare::SetState(study, state, ticket)))
            .await
    }

    /// All studies by id.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn studies(&self) -> Result<Vec<StudyRow>, Error> {
        let rows: Vec<(String, String, VersionId)> = sqlx::query_as(
            r#"
            select id, state, version_id
            from study
            order by id
            "#,
        )
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(study_row).collect()
    }

    /// One study.
    ///
    /// # Errors
    /// `NotFound` for an unknown one.
    pub async fn study(&self, id: &StudyId) -> Result<StudyRow, Error> {
        let row: Option<(String, String, VersionId)> =
            sqlx::query_as("select id, state, version_id from study where id = ?")
                .bind(id.as_str())
                .fetch_optional(&self.pool)
                .await?;
        study_row(row.ok_or(Error::NotFound("study"))?)
    }

    /// A version of a study file.
    ///
    /// # Errors
    /// `NotFound` for an unknown one.
    pub async fn study_version(&self, id: VersionId) -> Result<StudyVersion, Error> {
        let row: Option<VersionRow> = sqlx::query_as(
            r#"
            select id, number, study_id, hash, text, program_version, created_at_ms, is_built_in
            from study_version
            where id = ?
            "#,
        )
        .bind(id)
        .fetch_optional(&self.pool)
        .await?;
        row.map(StudyVersion::from)
            .ok_or(Error::NotFound("study version"))
    }

    /// All versions of a study, the oldest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn study_versions(&self, study: &StudyId) -> Result<Vec<StudyVersion>, Error> {
        let rows: Vec<VersionRow> = sqlx::query_as(
            r#"
            select id, number, study_id, hash, text, program_version, created_at_ms, is_built_in
            from study_version
            where study_id = ?
            order by id
            "#,
        )
        .bind(study.as_str())
        .fetch_all(&self.pool)
        .await?;
        Ok(rows.into_iter().map(StudyVersion::from).collect())
    }
}

fn study_row((id, state, version): (String, String, VersionId)) -> Result<StudyRow, Error> {
    let state = state
        .parse()
        .map_err(|err| sqlx::Error::Decode(Box::new(err)))?;
    Ok(StudyRow {
        id: id.into(),
        state,
        version,
    })
}

impl From<VersionRow> for StudyVersion {
    fn from(row: VersionRow) -> Self {
        let VersionRow {
            id,
            number,
            study_id,
            hash,
            text,
            program_version,
            created_at_ms,
            is_built_in,
        } = row;
        let created_at = Timestamp(created_at_ms);
        Self {
            id,
            number,
            study: study_id.into(),
            hash,
            text,
            program_version,
            created_at,
            is_built_in,
        }
    }
}

/// Makes a text the current version of its study.
pub(super) async fn publish(
    connection: &mut SqliteConnection,
    publish: &Publish,
) -> Result<(VersionId, Vec<Change>), sqlx::Error> {
    let study = publish.study.as_str();
    sqlx::query("insert into study (id, state) values (?, ?) on conflict do nothing")
        .bind(study)
        .bind(publish.state_if_new.as_str())
        .execute(&mut *connection)
        .await?;
    sqlx::query("insert into population (study_id, is_simulated) values (?1, 0), (?1, 1) on conflict do nothing")
        .bind(study)
        .execute(&mut *connection)
        .await?;
    let version: VersionId = sqlx::query_scalar(
        r#"
        insert into study_version (study_id, number, hash, text, exclusion, program_version, created_at_ms, is_built_in)
        values (?1, (select count(*) + 1 from study_version where study_id = ?1), ?2, ?3, ?4, ?5, ?6, ?7)
        -- the same text again is the version that it was; once a lab's file has had it, it stays the lab's
        on conflict (study_id, hash) do update set is_built_in = min(is_built_in, excluded.is_built_in)
        returning id
        "#,
    )
    .bind(study)
    .bind(&publish.hash)
    .bind(&publish.text)
    .bind(&publish.exclusion)
    .bind(env!("CARGO_PKG_VERSION"))
    .bind(publish.at.0)
    .bind(publish.is_built_in)
    .fetch_one(&mut *connection)
    .await?;
    let changed =
        sqlx::query("update study set version_id = ?2 where id = ?1 and version_id is not ?2")
            .bind(study)
            .bind(version)
            .execute(&mut *connection)
            .await?
            .rows_affected();
    let changes = if changed > 0 {
        turn_pages(connection, &publish.study).await?
    } else {
        Vec::new()
    };
    Ok((version, changes))
}

/// Sets the end of runs under way that have none. Returns how many there were.
pub(super) async fn set_ends(
    connection: &mut SqliteConnection,
    study: &StudyId,
    ends_at: Timestamp,
) -> Result<u64, sqlx::Error> {
    let set = sqlx::query(
        r#"
        update run
        set expires_at_ms = ?
        where study_id = ? and state = 'active' and is_preview = 0
        and expires_at_ms is null and platform is not ?
        "#,
    )
    .bind(ends_at.0)
    .bind(study.as_str())
    .bind(import::PLATFORM)
    .execute(connection)
    .await?;
    Ok(set.rows_affected())
}

/// Sets a study's state. No changes mean that there is no such study.
pub(super) async fn set_state(
    connection: &mut SqliteConnection,
    study: &StudyId,
    state: StudyState,
) -> Result<Vec<Change>, sqlx::Error> {
    sqlx::query("update study set state = ? where id = ?")
        .bind(state.as_str())
        .bind(study.as_str())
        .execute(&mut *connection)
        .await?;
    turn_pages(connection, study).await
}

/// Something is shown differently from now on, without any change of the data.
pub(super) async fn turn_page(
    connection: &mut SqliteConnection,
    study: &StudyId,
    population: Population,
) -> Result<Vec<Change>, sqlx::Error> {
    let rows: Vec<(String, bool, i64, i64)> = sqlx::query_as(
        r#"
        update population
        set page_version = page_version + 1
        where study_id = ? and is_simulated = ?
        returning study_id, is_simulated, data_version, page_version
        "#,
    )
    .bind(study.as_str())
    .bind(population.is_simulated())
    .fetch_all(connection)
    .await?;
    Ok(rows.into_iter().map(Change::from).collect())
}

/// Something about the study itself is shown differently from now on, in both populations.
async fn turn_pages(
    connection: &mut SqliteConnection,
    study: &StudyId,
) -> Result<Vec<Change>, sqlx::Error> {
    let rows: Vec<(String, bool, i64, i64)> = sqlx::query_as(
        r#"
        update population
        set page_version = page_version + 1
        where study_id = ?
        returning study_id, is_simulated, data_version, page_version
        "#,
    )
    .bind(study.as_str())
    .fetch_all(connection)
    .await?;
    Ok(rows.into_iter().map(Change::from).collect())
}
