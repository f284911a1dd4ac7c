//! Accounts, and the one-time link with which the first one is made.

use sqlx::sqlite::SqliteConnection;

use super::super::token::TokenHash;
use super::super::{AccountId, Error, Role, Store, Token};
use super::change::AccountChange;
use super::password::is_right;
use super::{AccountName, PasswordHash, sessions, tokens};
use crate::study::Timestamp;

/// Somebody who can log in, or could.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Account {
    /// Its id.
    pub id: AccountId,
    /// Under which it logs in.
    pub name: String,
    /// What it may do.
    pub role: Role,
    /// Whether its password is one that somebody else chose, only good for choosing another one.
    pub must_change_password: bool,
    /// When it was made.
    pub created_at: Timestamp,
    /// Since when it opens nothing any more.
    pub disabled_at: Option<Timestamp>,
}

/// An account that is to be made.
#[derive(Debug, Clone)]
pub struct NewAccount {
    /// Under which it logs in.
    pub name: AccountName,
    /// Its password.
    pub password: PasswordHash,
    /// What it may do.
    pub role: Role,
    /// Whether the password must be changed at the first login.
    pub must_change_password: bool,
}

/// An account with the password that was shown to be its own: what follows from that happens only while it still is.
#[derive(Debug, Clone)]
pub struct Verified {
    /// The account.
    pub account: Account,
    pub(super) password: PasswordHash,
}

#[derive(sqlx::FromRow)]
pub(super) struct AccountRow {
    id: AccountId,
    name: String,
    role: String,
    must_change_password: bool,
    created_at_ms: i64,
    disabled_at_ms: Option<i64>,
}

impl AccountRow {
    pub(super) fn read(self) -> Result<Account, Error> {
        Ok(Account {
            id: self.id,
            name: self.name,
            role: self
                .role
                .parse()
                .map_err(|err| sqlx::Error::Decode(Box::new(err)))?,
            must_change_password: self.must_change_password,
            created_at: Timestamp(self.created_at_ms),
            disabled_at: self.disabled_at_ms.map(Timestamp),
        })
    }
}

impl Store {
    /// Whether anybody can log in, or could: from then on nothing is open to everybody on this machine.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn has_accounts(&self) -> Result<bool, Error> {
        Ok(sqlx::query_scalar("select exists (select 1 from account)")
            .fetch_one(&self.pool)
            .await?)
    }

    /// All accounts by name.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn accounts(&self) -> Result<Vec<Account>, Error> {
        let rows: Vec<AccountRow> = sqlx::query_as(
            r#"
            select id, name, role, must_change_password, created_at_ms, disabled_at_ms
            from account
            order by name
            "#,
        )
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(AccountRow::read).collect()
    }

    /// The account of this name.
    ///
    /// # Errors
    /// `NotFound` for an unknown one.
    pub async fn account_named(&self, name: &str) -> Result<Account, Error> {
        let row: Option<AccountRow> = sqlx::query_as(
            r#"
            select id, name, role, must_change_password, created_at_ms, disabled_at_ms
            from account
            where name = ?
            "#,
        )
        .bind(name)
        .fetch_optional(&self.pool)
        .await?;
        row.ok_or(Error::NotFound("account"))?.read()
    }

    /// The account that this name and password open, if there is one and it is not disabled. Takes equally long for
    /// unknown names.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn check_password(
        &self,
        name: &str,
        password: &str,
    ) -> Result<Option<Verified>, Error> {
        let stored: Option<String> =
            sqlx::query_scalar("select password_hash from account where name = ?")
                .bind(name.trim())
                .fetch_optional(&self.pool)
                .await?;
        let is_right = is_right(password.to_owned(), stored.clone()).await?;
        let Some(password) = stored.filter(|_| is_right) else {
            return Ok(None);
        };
        let account = self.account_named(name.trim()).await?;
        let password = PasswordHash::stored(password);
        Ok(account
            .disabled_at
            .is_none()
            .then_some(Verified { account, password }))
    }

    /// Makes the link with which the first account can be made, and the one before it useless. Says whether it opens
    /// something: none is made once an account exists.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn renew_setup_link(&self, link: &Token) -> Result<bool, Error> {
        let made = self
            .change_account(AccountChange::RenewSetupLink(link.hash()))
            .await?;
        Ok(made > 0)
    }

    /// Whether this is the link with which the first account can be made.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn is_setup_link(&self, link: &Token) -> Result<bool, Error> {
        Ok(sqlx::query_scalar(
            "select exists (select 1 from setup_link where token_hash = ?) and not exists (select 1 from account)",
        )
        .bind(link.hash().as_bytes())
        .fetch_one(&self.pool)
        .await?)
    }

    /// Makes the first account with its one-time link.
    ///
    /// # Errors
    /// `NotFound` where the link is not, or no longer, the one that was printed.
    pub async fn make_first_account(
        &self,
        link: &Token,
        account: NewAccount,
    ) -> Result<AccountId, Error> {
        let change = AccountChange::MakeFirst(link.hash(), account);
        self.change_account(change).await.map(AccountId::from)
    }

    /// Makes an account.
    ///
    /// # Errors
    /// `Conflict` where the name is taken.
    pub async fn make_account(&self, account: NewAccount) -> Result<AccountId, Error> {
        let change = AccountChange::Make(account);
        self.change_account(change).await.map(AccountId::from)
    }

    /// Gives an account another password and ends its sessions. One that must be changed was chosen by somebody else, because
    /// the one before may be known to others: then the account's tokens are revoked too.
    ///
    /// # Errors
    /// `NotFound` for an unknown account.
    pub async fn set_password(
        &self,
        account: AccountId,
        password: PasswordHash,
        must_change: bool,
    ) -> Result<(), Error> {
        self.change_account(AccountChange::SetPassword(account, password, must_change))
            .await
            .map(drop)
    }

    /// Gives an account the password that its owner chose. All its sessions end, and one begins under `session`; its tokens
    /// end where it says so.
    ///
    /// # Errors
    /// `Refused` where the password that was verified is not the account's any more, or the account is disabled.
    pub async fn change_password(
        &self,
        verified: Verified,
        password: PasswordHash,
        ends_tokens: bool,
        session: &Token,
    ) -> Result<(), Error> {
        let change = AccountChange::ChangePassword(verified, password, ends_tokens, session.hash());
        self.change_account(change).await.map(drop)
    }

    /// Gives an account another role.
    ///
    /// # Errors
    /// `NotFound` for an unknown account, `Refused` where no admin would be left.
    pub async fn set_role(&self, account: AccountId, role: Role) -> Result<(), Error> {
        self.change_account(AccountChange::SetRole(account, role))
            .await
            .map(drop)
    }

    /// Disables an account, which ends its sessions and makes its tokens useless, or enables it again.
    ///
    /// # Errors
    /// `NotFound` for an unknown account, `Refused` where no admin would be left.
    pub async fn set_disabled(&self, account: AccountId, is_disabled: bool) -> Result<(), Error> {
        self.change_account(AccountChange::SetDisabled(account, is_disabled))
            .await
            .map(drop)
    }
}

pub(super) async fn renew_setup_link(
    connection: &mut SqliteConnection,
    link: TokenHash,
    at: Timestamp,
) -> Result<i64, sqlx::Error> {
    let made = sqlx::query(
        r#"
        insert or replace into setup_link (id, token_hash, created_at_ms)
        select 1, ?, ?
        where not exists (select 1 from account)
        "#,
    )
    .bind(link.as_bytes())
    .bind(at.0)
    .execute(connection)
    .await?
    .rows_affected();
    Ok(i64::from(made > 0))
}

pub(super) async fn make_first(
    connection: &mut SqliteConnection,
    link: TokenHash,
    account: &NewAccount,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    let is_open: bool = sqlx::query_scalar(
        "select exists (select 1 from setup_link where token_hash = ?) and not exists (select 1 from account)",
    )
    .bind(link.as_bytes())
    .fetch_one(&mut *connection)
    .await?;
    if !is_open {
        return Ok(Err(Error::NotFound("setup link")));
    }
    make(connection, account, at).await
}

pub(super) async fn make(
    connection: &mut SqliteConnection,
    account: &NewAccount,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    let id: Option<i64> = sqlx::query_scalar(
        r#"
        insert into account (name, password_hash, role, must_change_password, created_at_ms)
        values (?, ?, ?, ?, ?)
        on conflict do nothing
        returning id
        "#,
    )
    .bind(account.name.as_str())
    .bind(account.password.as_str())
    .bind(account.role.as_str())
    .bind(account.must_change_password)
    .bind(at.0)
    .fetch_optional(&mut *connection)
    .await?;
    // Whoever comes first sets the server up, by link or by command.
    sqlx::query("delete from setup_link")
        .execute(connection)
        .await?;
    Ok(id.ok_or(Error::Conflict("an account of this name")))
}

pub(super) async fn set_password(
    connection: &mut SqliteConnection,
    account: AccountId,
    password: &PasswordHash,
    must_change: bool,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    let changed =
        sqlx::query("update account set password_hash = ?, must_change_password = ? where id = ?")
            .bind(password.as_str())
            .bind(must_change)
            .bind(account)
            .execute(&mut *connection)
            .await?
            .rows_affected();
    sessions::close_all(&mut *connection, account).await?;
    if must_change {
        tokens::revoke_all(connection, account, at).await?;
    }
    Ok(found(changed))
}

pub(super) async fn change_password(
    connection: &mut SqliteConnection,
    verified: &Verified,
    password: &PasswordHash,
    ends_tokens: bool,
    session: TokenHash,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    let account = verified.account.id;
    let changed = sqlx::query(
        r#"
        update account
        set password_hash = ?, must_change_password = 0
        where id = ?
        -- somebody else chose another one between the check of the password and now
        and password_hash = ?
        and disabled_at_ms is null
        "#,
    )
    .bind(password.as_str())
    .bind(account)
    .bind(verified.password.as_str())
    .execute(&mut *connection)
    .await?
    .rows_affected();
    if changed == 0 {
        return Ok(Err(Error::Refused(
            "the password was changed meanwhile; log in anew".to_owned(),
        )));
    }
    sessions::close_all(&mut *connection, account).await?;
    if ends_tokens {
        tokens::revoke_all(&mut *connection, account, at).await?;
    }
    sessions::open(connection, account, Some(password), session, None, at).await
}

pub(super) async fn set_role(
    connection: &mut SqliteConnection,
    account: AccountId,
    role: Role,
) -> Result<Result<i64, Error>, sqlx::Error> {
    if role != Role::Admin && !has_other_admin(connection, account).await? {
        return Ok(Err(last_admin()));
    }
    let changed = sqlx::query("update account set role = ? where id = ?")
        .bind(role.as_str())
        .bind(account)
        .execute(connection)
        .await?
        .rows_affected();
    Ok(found(changed))
}

pub(super) async fn set_disabled(
    connection: &mut SqliteConnection,
    account: AccountId,
    is_disabled: bool,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    if is_disabled && !has_other_admin(connection, account).await? {
        return Ok(Err(last_admin()));
    }
    let changed = sqlx::query("update account set disabled_at_ms = ? where id = ?")
        .bind(is_disabled.then_some(at.0))
        .bind(account)
        .execute(&mut *connection)
        .await?
        .rows_affected();
    if is_disabled {
        sessions::close_all(connection, account).await?;
    }
    Ok(found(changed))
}

/// Whether somebody else could still manage accounts, or this account could not anyway.
async fn has_other_admin(
    connection: &mut SqliteConnection,
    account: AccountId,
) -> Result<bool, sqlx::Error> {
    sqlx::query_scalar(
        r#"
        select
            exists (select 1 from account where role = 'admin' and disabled_at_ms is null and id <> ?1)
            or not exists (select 1 from account where role = 'admin' and disabled_at_ms is null and id = ?1)
        "#,
    )
    .bind(account)
    .fetch_one(connection)
    .await
}

fn last_admin() -> Error {
    Error::Refused("this is the last admin; make another account an admin first".to_owned())
}

fn found(changed: u64) -> Result<i64, Error> {
    if changed > 0 {
        Ok(1)
    } else {
        Err(Error::NotFound("account"))
    }
}
