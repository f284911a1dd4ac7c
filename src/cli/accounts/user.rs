//! `riskaware user`: who can log in.

use anyhow::Context;
use clap::{Args, Subcommand};

use super::{super::output::print, DatabaseArgs, password, recording, shown};
use crate::store::{AccountName, NewAccount, Role, Store};

/// What is to be done with accounts.
#[derive(Debug, Clone, Args)]
pub struct UserArgs {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: UserCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum UserCommand {
    /// Make an account; the password is asked for, or read from standard input
    Add {
        /// Under which it logs in
        name: AccountName,
        /// What it may do: admin, researcher or viewer
        #[arg(long, default_value = "researcher")]
        role: Role,
    },
    /// List the accounts
    List,
    /// Let an account open nothing any more, or let it again
    Disable {
        /// Its name
        name: AccountName,
        /// Let it again
        #[arg(long)]
        undo: bool,
    },
    /// Set an account's password, asked for or read from standard input, end its sessions and revoke its tokens
    Password {
        /// Its name
        name: AccountName,
    },
    /// Change what an account may do
    Role {
        /// Its name
        name: AccountName,
        /// What it may do: admin, researcher or viewer
        role: Role,
    },
}

/// Carries the command out.
///
/// # Errors
/// When the database cannot be opened, or the change is not allowed.
pub async fn run(args: UserArgs) -> anyhow::Result<()> {
    let store = args.database.open().await?;
    let done = carry_out(&store, args.command).await;
    store.close().await;
    done
}

async fn carry_out(store: &Store, command: UserCommand) -> anyhow::Result<()> {
    match command {
        UserCommand::Add { name, role } => {
            // Making it ends the setup link, and whoever is no admin cannot make another account.
            if role != Role::Admin && store.accounts().await?.is_empty() {
                anyhow::bail!(
                    "{name} would be the first account, which has to be an admin, or nobody could manage the others; add --role admin"
                );
            }
            let account = NewAccount {
                name: name.clone(),
                password: password::hashed().await?,
                role,
                must_change_password: false,
            };
            recording(store, "make an account", format!("{name}: {role}"))
                .make_account(account)
                .await
                .with_context(|| format!("making the account {name}"))?;
            Ok(())
        }
        UserCommand::List => list(store).await,
        UserCommand::Disable { name, undo } => {
            let id = store.account_named(name.as_str()).await?.id;
            let action = if undo {
                "enable an account"
            } else {
                "disable an account"
            };
            let recording = recording(store, action, name.to_string());
            Ok(recording.set_disabled(id, !undo).await?)
        }
        UserCommand::Password { name } => {
            let id = store.account_named(name.as_str()).await?.id;
            let password = password::hashed().await?;
            let recording = recording(store, "set a password", name.to_string());
            Ok(recording.set_password(id, password, true).await?)
        }
        UserCommand::Role { name, role } => {
            let id = store.account_named(name.as_str()).await?.id;
            let recording = recording(store, "change a role", format!("{name}: {role}"));
            Ok(recording.set_role(id, role).await?)
        }
    }
}

async fn list(store: &Store) -> anyhow::Result<()> {
    let mut text = String::new();
    for account in store.accounts().await? {
        let state = match account.disabled_at {
            Some(at) => format!("disabled {}", shown(at)),
            None => "can log in".to_owned(),
        };
        text.push_str(&format!(
            "{}\t{}\t{state}\tmade {}\n",
            account.name,
            account.role,
            shown(account.created_at)
        ));
    }
    print(text.as_bytes())
}
