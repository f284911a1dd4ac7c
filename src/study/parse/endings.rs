//! How runs end, and what is paid for them.

use super::rules;
use crate::study::definition::Endings;
use crate::study::document::{Fault, KeyPath};
use crate::study::file::{RawBonus, RawCompletion, RawEnding};
use crate::study::markup;
use crate::study::template::Scope;
use crate::study::words::Words;
use crate::study::{Bonus, CompletionCode, EndingPage};

/// The largest rate and endowment.
const LARGEST_MONEY: f64 = 1e6;

/// Reads `[completion]` with the tables in it.
pub(super) fn read(
    raw: &RawCompletion,
    scope: &Scope<'_>,
    words: &Words,
) -> Result<Endings, Fault> {
    let at = KeyPath::root().key("completion");
    let code = match &raw.code {
        Some(code) => CompletionCode::Fixed(rules::code(code, &at.key("code"))?),
        None => CompletionCode::PerRun,
    };
    if let Some(address) = &raw.redirect {
        rules::redirect(address, &at.key("redirect"))?;
    }
    let completed = EndingPage {
        title: rules::filled_line(&raw.title, scope, &at.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &at.key("text"))?,
        code,
        redirect: raw.redirect.clone(),
    };
    let other = |key: &str, raw: &RawEnding, title: &str, text: &str| {
        ending(raw, (title, text), &completed.code, scope, &at.key(key))
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
    if let Some(address) = &raw.redirect {
        rules::redirect(address, &at.key("redirect"))?;
        if address.contains("{code}") && code == CompletionCode::Absent {
            let allowed = "an address without `{code}`, or a `code` beside it";
            return Err(at.key("redirect").fault("`{code}` without a code", allowed));
        }
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
        redirect: raw.redirect.clone(),
    })
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
