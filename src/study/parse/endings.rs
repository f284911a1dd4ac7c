//! How runs end, and what is paid for them.

use super::rules;
use crate::study::definition::Endings;
use crate::study::document::{Fault, KeyPath, list};
use crate::study::file::{RawBonus, RawCompletion, RawEnding};
use crate::study::markup;
use crate::study::recruiting::redirect::RedirectFault;
use crate::study::template::Scope;
use crate::study::words::Words;
use crate::study::{
    Bonus, CompletionCode, EndingPage, LinkParameter, RecruitingIds, RedirectTarget,
};

/// The largest rate and endowment.
const LARGEST_MONEY: f64 = 1e6;

/// Reads `[completion]` with the tables in it.
pub(super) fn read(
    raw: &RawCompletion,
    ids: RecruitingIds,
    scope: &Scope<'_>,
    words: &Words,
) -> Result<Endings, Fault> {
    let at = KeyPath::root().key("completion");
    let code = match &raw.code {
        Some(code) => CompletionCode::Fixed(rules::code(code, &at.key("code"))?),
        None => CompletionCode::PerRun,
    };
    let completed = EndingPage {
        title: rules::filled_line(&raw.title, scope, &at.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &at.key("text"))?,
        code,
        redirect: redirect(raw.redirect.as_deref(), ids, &at)?,
    };
    let other = |key: &str, raw: &RawEnding, title: &str, text: &str| {
        let at = at.key(key);
        let redirect = redirect(raw.redirect.as_deref(), ids, &at)?;
        ending(raw, redirect, (title, text), &completed.code, scope, &at)
    };
    Ok(Endings {
        screened_out: other(
            "screened_out",
            &raw.screened_out,
            &words.screened_out_title,
            &words.screened_out_text,
        )?,
        failed_check: other(
            "failed_check",
            &raw.failed_check,
            &words.failed_check_title,
            &words.failed_check_text,
        )?,
        timed_out: other(
            "timed_out",
            &raw.timed_out,
            &words.timed_out_title,
            &words.timed_out_text,
        )?,
        completed,
    })
}

/// An ending before the last step. It has a code only if the file gives one: nobody is paid by mistake.
fn ending(
    raw: &RawEnding,
    redirect: Option<RedirectTarget>,
    (title, text): (&str, &str),
    completion: &CompletionCode,
    scope: &Scope<'_>,
    at: &KeyPath,
) -> Result<EndingPage, Fault> {
    let code = match &raw.code {
        Some(code) => {
            let code = CompletionCode::Fixed(rules::code(code, &at.key("code"))?);
            if code == *completion {
                return Err(at.key("code").fault(
                    "the code of completed runs",
                    "another code: the platform could not tell the runs apart",
                ));
            }
            code
        }
        None => CompletionCode::Absent,
    };
    let names_code = redirect.as_ref().is_some_and(RedirectTarget::names_code);
    if names_code && code == CompletionCode::Absent {
        let allowed = "an address without `{code}`, or a `code` beside it";
        return Err(at.key("redirect").fault("`{code}` without a code", allowed));
    }
    Ok(EndingPage {
        title: match &raw.title {
            Some(title) => rules::filled_line(title, scope, &at.key("title"))?,
            None => title.to_owned(),
        },
        text_html: match &raw.text {
            Some(text) => rules::filled_markdown(text, scope, &at.key("text"))?,
            None => markup::to_html(text),
        },
        code,
        redirect,
    })
}

/// The address that people are sent to from an ending, whose table stands `at`.
fn redirect(
    address: Option<&str>,
    ids: RecruitingIds,
    at: &KeyPath,
) -> Result<Option<RedirectTarget>, Fault> {
    let at = at.key("redirect");
    let Some(address) = address else {
        return Ok(None);
    };
    let parameters = |is_named: &dyn Fn(LinkParameter) -> bool| {
        let named = LinkParameter::ALL.into_iter().filter(|one| is_named(*one));
        list(named.map(|one| format!("{{{}}}", one.name())))
    };
    let target = RedirectTarget::parse(address, ids).map_err(|fault| match fault {
        RedirectFault::Address => at.fault(
            rules::shown(address),
            "an address that starts with https://, with placeholders such as `{code}` only after the host",
        ),
        RedirectFault::Unknown(name) => at.fault(
            format!("`{{{name}}}`"),
            format!("`{{code}}`, {}", parameters(&|_| true)),
        ),
        RedirectFault::Hashed(parameter) => at.fault(
            format!("`{{{}}}`, which is stored under a keyed hash", parameter.name()),
            format!(
                "`recruiting.ids = \"plain\"`, or none but `{{code}}`, {}",
                parameters(&|one| one.is_plain(ids))
            ),
        ),
    })?;
    Ok(Some(target))
}

/// Reads `[bonus]`.
pub(super) fn bonus(raw: &RawBonus) -> Result<Bonus, Fault> {
    let at = KeyPath::root().key("bonus");
    let is_code =
        raw.currency.len() == 3 && raw.currency.bytes().all(|byte| byte.is_ascii_uppercase());
    if !is_code {
        return Err(at.key("currency").fault(
            rules::shown(&raw.currency),
            "three capital letters of ISO 4217, such as `GBP`",
        ));
    }
    if !(raw.rate > 0.0 && raw.rate <= LARGEST_MONEY) {
        let allowed = format!("more than 0 and at most {LARGEST_MONEY} {}", raw.currency);
        return Err(at.key("rate").fault(raw.rate, allowed));
    }
    if !(0.0..=LARGEST_MONEY).contains(&raw.endowment) {
        let allowed = format!("0 to {LARGEST_MONEY} {}", raw.currency);
        return Err(at.key("endowment").fault(raw.endowment, allowed));
    }
    Ok(Bonus {
        currency: raw.currency.clone(),
        rate: raw.rate,
        endowment: raw.endowment,
    })
}
