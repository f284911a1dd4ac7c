//! Passwords from a terminal or from standard input, never from the command line, where others could read them.

use std::io::{IsTerminal, stdin};

use anyhow::{Context, ensure};

use crate::{
    chance::Chance,
    store::{Password, PasswordHash},
};

/// Asks twice on a terminal; else the first line of standard input is the password.
pub(super) async fn hashed() -> anyhow::Result<PasswordHash> {
    let text = if stdin().is_terminal() {
        let first = rpassword::prompt_password("Password: ").context("reading the password")?;
        let second = rpassword::prompt_password("Again: ").context("reading the password")?;
        ensure!(first == second, "the two passwords differ");
        first
    } else {
        let mut line = String::new();
        stdin()
            .read_line(&mut line)
            .context("reading the password from standard input")?;
        line.trim_end_matches(['\r', '\n']).to_owned()
    };
    let password: Password = text.parse()?;
    let mut salt = [0; 16];
    salt.copy_from_slice(&Chance::from_system().bytes()[..16]);
    Ok(PasswordHash::of(password, salt).await?)
}
