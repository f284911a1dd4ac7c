//! API tokens: what a program shows instead of a password.

use sqlx::sqlite::SqliteConnection;

use super::super::token::TokenHash;
use super::super::{AccountId, ApiTokenId, Error, Role, Scope, Store, Token};
use super::change::AccountChange;
use super::{AccountName, USE_NOTED_MS};
use crate::study::Timestamp;

/// A token of the API, without what it consists of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ApiToken {
    /// Its id.
    pub id: ApiTokenId,
    /// What it is for, in its maker's words.
    pub name: String,
    /// What it may be used for, as far as its owner may.
    pub scopes: Vec<Scope>,
    /// Whose it is; none if a command made it.
    pub owner: Option<(AccountId, String, Role)>,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it stops opening anything.
    pub expires_at: Timestamp,
    /// When it was revoked.
    pub revoked_at: Option<Timestamp>,
    /// The last use, up to a minute ago.
    pub last_used_at: Option<Timestamp>,
    is_owner_disabled: bool,
    must_owner_change_password: bool,
}

/// Whether a token opens anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TokenState {
    /// It does.
    Usable,
    /// Its time is over.
    Expired,
    /// It was revoked, or its owner's account was disabled.
    Revoked,
    /// Its owner has a password that somebody else chose, and has to choose another one first.
    Waiting,
}

/// A token that is to be made.
#[derive(Debug, Clone)]
pub struct NewApiToken {
    /// What it is for.
    pub name: AccountName,
    /// What it may be used for.
    pub scopes: Vec<Scope>,
    /// Whose it is.
    pub owner: Option<AccountId>,
    /// When it stops opening anything.
    pub expires_at: Timestamp,
}

impl ApiToken {
    /// Whether it opens anything at this moment.
    pub fn state(&self, now: Timestamp) -> TokenState {
        if self.revoked_at.is_some() || self.is_owner_disabled {
            TokenState::Revoked
        } else if self.expires_at <= now {
            TokenState::Expired
        } else if self.must_owner_change_password {
            TokenState::Waiting
        } else {
            TokenState::Usable
        }
    }
}

#[derive(sqlx::FromRow)]
struct TokenRow {
    id: ApiTokenId,
    name: String,
    scopes: String,
    account_id: Option<AccountId>,
    owner_name: Option<String>,
    owner_role: Option<String>,
    is_owner_disabled: bool,
    must_owner_change_password: bool,
    created_at_ms: i64,
    expires_at_ms: i64,
    revoked_at_ms: Option<i64>,
    last_used_at_ms: Option<i64>,
}

impl TokenRow {
    fn read(self) -> Result<ApiToken, Error> {
        let unknown = |err| sqlx::Error::Decode(Box::new(err));
        let scopes = self.scopes.split_whitespace().map(str::parse);
        let owner = match (self.account_id, self.owner_name, self.owner_role) {
            (Some(id), Some(name), Some(role)) => Some((id, name, role.parse().map_err(unknown)?)),
            (None, _, _) | (_, None, _) | (_, _, None) => None,
        };
        Ok(ApiToken {
            id: self.id,
            name: self.name,
            scopes: scopes.collect::<Result<_, _>>().map_err(unknown)?,
            owner,
            created_at: Timestamp(self.created_at_ms),
            expires_at: Timestamp(self.expires_at_ms),
            revoked_at: self.revoked_at_ms.map(Timestamp),
            last_used_at: self.last_used_at_ms.map(Timestamp),
            is_owner_disabled: self.is_owner_disabled,
            must_owner_change_password: self.must_owner_change_password,
        })
    }
}

impl Store {
    /// The token that a program showed, whatever its state.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn api_token(&self, token: &Token) -> Result<Option<ApiToken>, Error> {
        let token = self.api_token_unused(token).await?;
        let now = self.now();
        if let Some(token) = &token
            && token.state(now) == TokenState::Usable
            && token
                .last_used_at
                .is_none_or(|used_at| now.0 - used_at.0 >= USE_NOTED_MS)
        {
            self.change_account_later(AccountChange::UseToken(token.id));
        }
        Ok(token)
    }

    /// The same without counting as use.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn api_token_unused(&self, token: &Token) -> Result<Option<ApiToken>, Error> {
        let row: Option<TokenRow> = sqlx::query_as(
            r#"
            select
                api_token.id, api_token.name, scopes, account_id, account.name as owner_name,
                account.role as owner_role, account.disabled_at_ms is not null as is_owner_disabled,
                coalesce(account.must_change_password, 0) as must_owner_change_password,
                api_token.created_at_ms, expires_at_ms, revoked_at_ms, last_used_at_ms
            from api_token
            left join account on account.id = api_token.account_id
            where token_hash = ?
            "#,
        )
        .bind(token.hash().as_bytes())
        .fetch_optional(&self.pool)
        .await?;
        row.map(TokenRow::read).transpose()
    }

    /// All tokens, revoked and expired ones too, the newest first; or those of one account.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn api_tokens(&self, owner: Option<AccountId>) -> Result<Vec<ApiToken>, Error> {
        let rows: Vec<TokenRow> = sqlx::query_as(
            r#"
            select
                api_token.id, api_token.name, scopes, account_id, account.name as owner_name,
                account.role as owner_role, account.disabled_at_ms is not null as is_owner_disabled,
                coalesce(account.must_change_password, 0) as must_owner_change_password,
                api_token.created_at_ms, expires_at_ms, revoked_at_ms, last_used_at_ms
            from api_token
            left join account on account.id = api_token.account_id
            where ?1 is null or account_id = ?1
            order by api_token.id desc
            "#,
        )
        .bind(owner)
        .fetch_all(&self.pool)
        .await?;
        rows.into_iter().map(TokenRow::read).collect()
    }

    /// Makes a token of the API.
    ///
    /// # Errors
    /// `Refused` without a scope or with an end that is over.
    pub async fn make_api_token(
        &self,
        token: &Token,
        new: NewApiToken,
    ) -> Result<ApiTokenId, Error> {
        if new.scopes.is_empty() {
            return Err(Error::Refused(
                "a token needs a scope; allowed: results, data, manage".to_owned(),
            ));
        }
        if new.expires_at <= self.now() {
            return Err(Error::Refused(
                "a token must expire later than now".to_owned(),
            ));
        }
        let change = AccountChange::MakeToken(token.hash(), new);
        self.change_account(change).await.map(ApiTokenId::from)
    }

    /// Revokes a token: any, or only if it is of the account.
    ///
    /// # Errors
    /// `NotFound` for an unknown token, and for one of another account.
    pub async fn revoke_api_token(
        &self,
        token: ApiTokenId,
        owner: Option<AccountId>,
    ) -> Result<(), Error> {
        self.change_account(AccountChange::RevokeToken(token, owner))
            .await
            .map(drop)
    }
}

pub(super) async fn make(
    connection: &mut SqliteConnection,
    token: TokenHash,
    new: &NewApiToken,
    at: Timestamp,
) -> Result<i64, sqlx::Error> {
    let scopes: Vec<&str> = new.scopes.iter().map(|scope| scope.as_str()).collect();
    sqlx::query_scalar(
        r#"
        insert into api_token (name, token_hash, scopes, account_id, created_at_ms, expires_at_ms)
        values (?, ?, ?, ?, ?, ?)
        returning id
        "#,
    )
    .bind(new.name.as_str())
    .bind(token.as_bytes())
    .bind(scopes.join(" "))
    .bind(new.owner)
    .bind(at.0)
    .bind(new.expires_at.0)
    .fetch_one(connection)
    .await
}

pub(super) async fn revoke(
    connection: &mut SqliteConnection,
    token: ApiTokenId,
    owner: Option<AccountId>,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    let changed = sqlx::query(
        r#"
        update api_token
        set revoked_at_ms = coalesce(revoked_at_ms, ?)
        where id = ?
        and (?3 is null or account_id = ?3)
        "#,
    )
    .bind(at.0)
    .bind(token)
    .bind(owner)
    .execute(connection)
    .await?
    .rows_affected();
    Ok(if changed > 0 {
        Ok(1)
    } else {
        Err(Error::NotFound("token"))
    })
}

pub(super) async fn revoke_all(
    connection: &mut SqliteConnection,
    owner: AccountId,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "update api_token set revoked_at_ms = ? where account_id = ? and revoked_at_ms is null",
    )
    .bind(at.0)
    .bind(owner)
    .execute(connection)
    .await?;
    Ok(())
}

pub(super) async fn note_use(
    connection: &mut SqliteConnection,
    token: ApiTokenId,
    at: Timestamp,
) -> Result<i64, sqlx::Error> {
    sqlx::query(
        "update api_token set last_used_at_ms = max(coalesce(last_used_at_ms, 0), ?) where id = ?",
    )
    .bind(at.0)
    .bind(token)
    .execute(connection)
    .await?;
    Ok(1)
}
