//! Studies and the versions of their files.

use sqlx::sqlite::SqliteConnection;

use super::job::{Job, Publish, Rare};
use super::{Change, Error, Population, Store, StudyState, VersionId, VersionNumber};
use crate::study::{StudyId, Timestamp};

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
}

impl Store {
    /// Makes a study's text the current version, and the study itself if it is new, in the state `state_if_new`. The
    /// same text again is the version that it was.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn publish(
        &self,
        study: &StudyId,
        hash: &str,
        text: &str,
        state_if_new: StudyState,
    ) -> Result<VersionId, Error> {
        let publish = Publish {
            study: study.clone(),
            hash: hash.to_owned(),
            text: text.to_owned(),
            state_if_new,
            at: self.now(),
        };
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
            select id, number, study_id, hash, text, program_version, created_at_ms
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
            select id, number, study_id, hash, text, program_version, created_at_ms
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
        insert into study_version (study_id, number, hash, text, program_version, created_at_ms)
        values (?1, (select count(*) + 1 from study_version where study_id = ?1), ?2, ?3, ?4, ?5)
        -- the same text again is the version that it was; updating nothing makes `returning` tell its id
        on conflict (study_id, hash) do update set hash = hash
        returning id
        "#,
    )
    .bind(study)
    .bind(&publish.hash)
    .bind(&publish.text)
    .bind(env!("CARGO_PKG_VERSION"))
    .bind(publish.at.0)
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
