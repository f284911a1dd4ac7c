//! Sessions: what a browser shows instead of name and password.

use sqlx::sqlite::SqliteConnection;

use super::super::token::TokenHash;
use super::super::{AccountId, Error, Store, Token};
use super::change::AccountChange;
use super::people::AccountRow;
use super::{Account, PasswordHash, USE_NOTED_MS, Verified};
use crate::study::Timestamp;

/// A session that was not used for so long is over: half a day.
pub const SESSION_IDLE_MS: i64 = 12 * 60 * 60 * 1000;

/// A session is over after so long, however much it is used: a week.
pub const SESSION_LIFE_MS: i64 = 7 * 24 * 60 * 60 * 1000;

/// A browser that is logged in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Session {
    /// Since when.
    pub created_at: Timestamp,
    /// The last use, up to a minute ago.
    pub last_used_at: Timestamp,
    /// When it ends at the latest.
    pub expires_at: Timestamp,
}

impl Session {
    fn is_over(&self, now: Timestamp) -> bool {
        self.expires_at <= now || self.last_used_at.0 + SESSION_IDLE_MS <= now.0
    }
}

#[derive(sqlx::FromRow)]
struct SessionRow {
    session_created_at_ms: i64,
    last_used_at_ms: i64,
    expires_at_ms: i64,
    #[sqlx(flatten)]
    account: AccountRow,
}

impl Store {
    /// Who is logged in with this token. Nobody once the session is over or the account disabled.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn session(&self, token: &Token) -> Result<Option<Account>, Error> {
        let Some((session, account)) = self.read_session(token).await? else {
            return Ok(None);
        };
        if self.now().0 - session.last_used_at.0 >= USE_NOTED_MS {
            self.change_account_later(AccountChange::UseSession(token.hash()));
        }
        Ok(Some(account))
    }

    /// The same without counting as use: what a page does by itself keeps no session alive.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn session_unused(&self, token: &Token) -> Result<Option<Account>, Error> {
        let found = self.read_session(token).await?;
        Ok(found.map(|(_, account)| account))
    }

    async fn read_session(&self, token: &Token) -> Result<Option<(Session, Account)>, Error> {
        let row: Option<SessionRow> = sqlx::query_as(
            r#"
            select
                session.created_at_ms as session_created_at_ms, session.last_used_at_ms, session.expires_at_ms,
                account.id, account.name, account.role, account.must_change_password, account.created_at_ms,
                account.disabled_at_ms
            from session
            join account on account.id = session.account_id
            where session.token_hash = ?
            "#,
        )
        .bind(token.hash().as_bytes())
        .fetch_optional(&self.pool)
        .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let session = Session {
            created_at: Timestamp(row.session_created_at_ms),
            last_used_at: Timestamp(row.last_used_at_ms),
            expires_at: Timestamp(row.expires_at_ms),
        };
        let account = row.account.read()?;
        let is_over = session.is_over(self.now()) || account.disabled_at.is_some();
        Ok((!is_over).then_some((session, account)))
    }

    /// The sessions of an account that are not over, the newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn sessions_of(&self, account: AccountId) -> Result<Vec<Session>, Error> {
        let rows: Vec<(i64, i64, i64)> = sqlx::query_as(
            r#"
            select created_at_ms, last_used_at_ms, expires_at_ms
            from session
            where account_id = ?
            order by created_at_ms desc
            "#,
        )
        .bind(account)
        .fetch_all(&self.pool)
        .await?;
        let now = self.now();
        let session = |(created_at, last_used_at, expires_at)| Session {
            created_at: Timestamp(created_at),
            last_used_at: Timestamp(last_used_at),
            expires_at: Timestamp(expires_at),
        };
        let sessions = rows.into_iter().map(session);
        Ok(sessions.filter(|session| !session.is_over(now)).collect())
    }

    /// Logs an account in under a new token. The session that the browser had before, of whomever, ends.
    ///
    /// # Errors
    /// `NotFound` where the account is unknown or disabled.
    pub async fn open_session(
        &self,
        account: AccountId,
        token: &Token,
        before: Option<&Token>,
    ) -> Result<(), Error> {
        let change =
            AccountChange::OpenSession(account, None, token.hash(), before.map(Token::hash));
        self.change_account(change).await.map(drop)
    }

    /// The same for an account whose password was just verified.
    ///
    /// # Errors
    /// `NotFound` where that is not the account's password any more, or the account is disabled.
    pub async fn log_in(
        &self,
        verified: Verified,
        token: &Token,
        before: Option<&Token>,
    ) -> Result<(), Error> {
        let Verified { account, password } = verified;
        let before = before.map(Token::hash);
        let change = AccountChange::OpenSession(account.id, Some(password), token.hash(), before);
        self.change_account(change).await.map(drop)
    }

    /// Logs a browser out.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn close_session(&self, token: &Token) -> Result<(), Error> {
        let change = AccountChange::CloseSession(token.hash());
        self.change_account(change).await.map(drop)
    }

    /// Logs an account out everywhere. Returns how many sessions that were.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn close_sessions(&self, account: AccountId) -> Result<i64, Error> {
        self.change_account(AccountChange::CloseSessions(account))
            .await
    }
}

pub(super) async fn open(
    connection: &mut SqliteConnection,
    account: AccountId,
    password: Option<&PasswordHash>,
    token: TokenHash,
    before: Option<TokenHash>,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    if let Some(before) = before {
        close(connection, before).await?;
    }
    sqlx::query("delete from session where expires_at_ms <= ?1 or last_used_at_ms <= ?2")
        .bind(at.0)
        .bind(at.0 - SESSION_IDLE_MS)
        .execute(&mut *connection)
        .await?;
    let opened = sqlx::query(
        r#"
        insert into session (token_hash, account_id, created_at_ms, last_used_at_ms, expires_at_ms)
        select ?1, id, ?2, ?2, ?3
        from account
        -- disabled, or given another password, between the check of the password and now
        where id = ?4 and disabled_at_ms is null and (?5 is null or password_hash = ?5)
        "#,
    )
    .bind(token.as_bytes())
    .bind(at.0)
    .bind(at.0 + SESSION_LIFE_MS)
    .bind(account)
    .bind(password.map(PasswordHash::as_str))
    .execute(connection)
    .await?
    .rows_affected();
    Ok(if opened > 0 {
        Ok(1)
    } else {
        Err(Error::NotFound("account"))
    })
}

pub(super) async fn note_use(
    connection: &mut SqliteConnection,
    token: TokenHash,
    at: Timestamp,
) -> Result<i64, sqlx::Error> {
    sqlx::query(
        "update session set last_used_at_ms = max(last_used_at_ms, ?) where token_hash = ?",
    )
    .bind(at.0)
    .bind(token.as_bytes())
    .execute(connection)
    .await?;
    Ok(1)
}

pub(super) async fn close(
    connection: &mut SqliteConnection,
    token: TokenHash,
) -> Result<i64, sqlx::Error> {
    let closed = sqlx::query("delete from session where token_hash = ?")
        .bind(token.as_bytes())
        .execute(connection)
        .await?
        .rows_affected();
    Ok(i64::try_from(closed).unwrap_or(i64::MAX))
}

pub(super) async fn close_all(
    connection: &mut SqliteConnection,
    account: AccountId,
) -> Result<i64, sqlx::Error> {
    let closed = sqlx::query("delete from session where account_id = ?")
        .bind(account)
        .execute(connection)
        .await?
        .rows_affected();
    Ok(i64::try_from(closed).unwrap_or(i64::MAX))
}
