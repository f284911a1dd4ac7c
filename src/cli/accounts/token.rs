//! `riskaware token`: what programs show to the API.

use anyhow::bail;
use clap::{Args, Subcommand};

use super::{super::output::print, DatabaseArgs, recording, shown};
use crate::{
    chance::Chance,
    store::{Account, AccountName, ApiTokenId, NewApiToken, Scope, Store, Token, TokenState},
    study::Timestamp,
    web::access::{Caller, Need},
};

const DAY_MS: i64 = 24 * 60 * 60 * 1000;

/// What is to be done with tokens.
#[derive(Debug, Clone, Args)]
pub struct TokenArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: TokenCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum TokenCommand {
    /// Make a token and print it, this once
    Add {
        /// What it is for
        name: AccountName,
        /// What it may be used for: results, data or manage; may be repeated
        #[arg(
            long = "scope",
            value_name = "SCOPE",
            required = true,
            value_delimiter = ','
        )]
        scopes: Vec<Scope>,
        /// After how many days it stops opening anything
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=365))]
        days: u32,
        /// Whose it is: it may not more than that account, and ends with it
        #[arg(long)]
        account: Option<AccountName>,
    },
    /// List the tokens, without what they consist of
    List,
    /// Let a token open nothing any more
    Revoke {
        /// Its number in the list
        token: i64,
    },
}

/// Carries the command out.
///
/// # Errors
/// When the database cannot be opened, or the change is not allowed.
pub async fn run(args: TokenArgs) -> anyhow::Result<()> {
    let store = args.database.open().await?;
    let done = carry_out(&store, args.command).await;
    store.close().await;
    done
}

async fn carry_out(store: &Store, command: TokenCommand) -> anyhow::Result<()> {
    match command {
        TokenCommand::Add {
            name,
            mut scopes,
            days,
            account,
        } => {
            scopes.sort_unstable();
            scopes.dedup();
            let owner = match account {
                Some(account) => {
                    let account = store.account_named(account.as_str()).await?;
                    require_allowed(&account, &scopes)?;
                    Some(account.id)
                }
                None => None,
            };
            let names: Vec<&str> = scopes.iter().map(|scope| scope.as_str()).collect();
            let detail = format!("{name}: {}, {days} days", names.join(" "));
            let token = Token::random(&mut Chance::from_system().fork());
            let new = NewApiToken {
                name,
                scopes,
                owner,
                expires_at: Timestamp(store.clock().now().0 + i64::from(days) * DAY_MS),
            };
            recording(store, "make a token", detail)
                .make_api_token(&token, new)
                .await?;
            print(format!("{token}\n").as_bytes())
        }
        TokenCommand::List => list(store).await,
        TokenCommand::Revoke { token } => {
            recording(store, "revoke a token", format!("token {token}"))
                .revoke_api_token(ApiTokenId::from(token), None)
                .await?;
            Ok(())
        }
    }
}

/// Refuses what the token could never be used for.
fn require_allowed(account: &Account, scopes: &[Scope]) -> anyhow::Result<()> {
    let caller = Caller::Account(account.clone());
    let may = |scope: &Scope| {
        caller.may(match scope {
            Scope::Results => Need::Results,
            Scope::Data => Need::Data,
            Scope::Manage => Need::Manage,
        })
    };
    let names = |scopes: Vec<&Scope>| {
        let names: Vec<&str> = scopes.into_iter().map(|scope| scope.as_str()).collect();
        names.join(", ")
    };
    let beyond: Vec<&Scope> = scopes.iter().filter(|scope| !may(scope)).collect();
    if beyond.is_empty() {
        return Ok(());
    }
    let all = [Scope::Results, Scope::Data, Scope::Manage];
    bail!(
        "{} is a {}, whose tokens may not be used for {}; allowed: {}",
        account.name,
        account.role,
        names(beyond),
        names(all.iter().filter(|scope| may(scope)).collect())
    )
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let now = store.clock().now();
    let mut text = String::new();
    for token in store.api_tokens(None).await? {
        let scopes: Vec<&str> = token.scopes.iter().map(|scope| scope.as_str()).collect();
        let state = match token.state(now) {
            TokenState::Usable => format!("until {}", shown(token.expires_at)),
            TokenState::Expired => format!("expired {}", shown(token.expires_at)),
            TokenState::Revoked => "revoked".to_owned(),
            TokenState::Waiting => "waits for another password".to_owned(),
        };
        let owner = token.owner.as_ref().map_or("-", |(_, name, _)| name);
        let used = token.last_used_at.map_or_else(|| "never".to_owned(), shown);
        text.push_str(&format!(
            "{}\t{}\t{owner}\t{}\t{state}\tlast used {used}\n",
            token.id,
            token.name,
            scopes.join(",")
        ));
    }
    print(text.as_bytes())
}
