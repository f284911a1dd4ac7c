//! All changes of accounts as jobs of the writer.

use sqlx::sqlite::SqliteConnection;

use super::super::job::{Job, Rare, Ticket};
use super::super::token::TokenHash;
use super::super::{AccountId, ApiTokenId, Error, Role, Store, sharing};
use super::{
    AuditEntry, NewAccount, NewApiToken, PasswordHash, Verified, audit, people, sessions, tokens,
};
use crate::study::{StudyId, Timestamp};

/// Something about accounts that is to be written. Each is answered with a number: an id, or how many rows changed.
#[derive(Debug)]
pub(in crate::store) enum AccountChange {
    RenewSetupLink(TokenHash),
    MakeFirst(TokenHash, NewAccount),
    Make(NewAccount),
    SetPassword(AccountId, PasswordHash, bool),
    /// Account, the password that it had, the new one, whether its tokens end too, and the session that goes on.
    ChangePassword(Verified, PasswordHash, bool, TokenHash),
    SetRole(AccountId, Role),
    SetDisabled(AccountId, bool),
    OpenSession(
        AccountId,
        Option<PasswordHash>,
        TokenHash,
        Option<TokenHash>,
    ),
    UseSession(TokenHash),
    CloseSession(TokenHash),
    CloseSessions(AccountId),
    MakeToken(TokenHash, NewApiToken),
    RevokeToken(ApiTokenId, Option<AccountId>),
    UseToken(ApiTokenId),
    SetPublic(StudyId, bool),
    Log(AuditEntry),
}

/// Carries a change out. The outer error is the database's and rolls the batch back; the inner one is a refusal, before
/// which nothing was written that must not stay.
pub(in crate::store) async fn write(
    connection: &mut SqliteConnection,
    change: &AccountChange,
    at: Timestamp,
) -> Result<Result<i64, Error>, sqlx::Error> {
    match change {
        AccountChange::RenewSetupLink(link) => people::renew_setup_link(connection, *link, at)
            .await
            .map(Ok),
        AccountChange::MakeFirst(link, account) => {
            people::make_first(connection, *link, account, at).await
        }
        AccountChange::Make(account) => people::make(connection, account, at).await,
        AccountChange::SetPassword(account, password, must_change) => {
            people::set_password(connection, *account, password, *must_change, at).await
        }
        AccountChange::ChangePassword(verified, password, ends_tokens, session) => {
            people::change_password(connection, verified, password, *ends_tokens, *session, at)
                .await
        }
        AccountChange::SetRole(account, role) => {
            people::set_role(connection, *account, *role).await
        }
        AccountChange::SetDisabled(account, is_disabled) => {
            people::set_disabled(connection, *account, *is_disabled, at).await
        }
        AccountChange::OpenSession(account, password, token, before) => {
            sessions::open(connection, *account, password.as_ref(), *token, *before, at).await
        }
        AccountChange::UseSession(token) => {
            sessions::note_use(connection, *token, at).await.map(Ok)
        }
        AccountChange::CloseSession(token) => sessions::close(connection, *token).await.map(Ok),
        AccountChange::CloseSessions(account) => {
            sessions::close_all(connection, *account).await.map(Ok)
        }
        AccountChange::MakeToken(token, new) => {
            tokens::make(connection, *token, new, at).await.map(Ok)
        }
        AccountChange::RevokeToken(token, owner) => {
            tokens::revoke(connection, *token, *owner, at).await
        }
        AccountChange::UseToken(token) => tokens::note_use(connection, *token, at).await.map(Ok),
        AccountChange::SetPublic(study, is_public) => {
            sharing::set_public(connection, study, *is_public).await
        }
        AccountChange::Log(entry) => audit::append(connection, entry, at).await.map(Ok),
    }
}

impl Store {
    pub(in crate::store) async fn change_account(
        &self,
        change: AccountChange,
    ) -> Result<i64, Error> {
        let now = self.now();
        self.wait_for(|ticket| Job::Rare(Rare::Account(Box::new(change), now, ticket)))
            .await
    }

    /// With some later commit, and not at all where the queue is full: for what is only nice to know.
    pub(in crate::store) fn change_account_later(&self, change: AccountChange) {
        let (ticket, _) = Ticket::new();
        let job = Job::Rare(Rare::Account(Box::new(change), self.now(), ticket));
        if let Err(err) = self.enqueue(job) {
            tracing::debug!(error = %err, "a use was not noted");
        }
    }
}
