//! Reads the one form of a participant page.
//!
//! These are the server's own pages, so the reader knows their habits: attributes in double quotes, one form, submit
//! buttons, and the block by which the study knows a form's fields. A parser for all of HTML would only slow down a load
//! generator.

use crate::study::step::ConsentStep;

/// What a page asks.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Page {
    /// Where the form is sent; none on a page that asks nothing.
    pub action: Option<String>,
    /// The block and the question of a choice.
    pub question: Option<(String, String)>,
    /// Hidden fields with their values.
    pub hidden: Vec<(String, String)>,
    /// Submit buttons: name and value.
    pub buttons: Vec<(String, String)>,
    /// The block of a form with fields.
    pub form: Option<String>,
    /// Clauses of a consent: name and value.
    pub clauses: Vec<(String, String)>,
    /// Whether it is the last one.
    pub is_finished: bool,
}

impl Page {
    pub(super) fn read(html: &str) -> Self {
        let mut page = Self {
            is_finished: html.contains("data-part=\"ending\""),
            ..Self::default()
        };
        for tag in html
            .split('<')
            .skip(1)
            .filter_map(|rest| rest.split_once('>').map(|(tag, _)| tag))
        {
            let named = || {
                Some((
                    attribute(tag, "name")?,
                    attribute(tag, "value").unwrap_or_default(),
                ))
            };
            match tag.split_whitespace().next() {
                Some("form") => {
                    page.action = attribute(tag, "action");
                    let block = attribute(tag, "data-block");
                    match attribute(tag, "data-question") {
                        Some(question) => page.question = block.zip(Some(question)),
                        None => page.form = block,
                    }
                }
                Some("button") => page.buttons.extend(named()),
                Some("input") => match attribute(tag, "type").as_deref() {
                    Some("hidden") => page.hidden.extend(named()),
                    Some("checkbox") => {
                        let is_clause = |(name, _): &(String, String)| name == ConsentStep::CLAUSE;
                        page.clauses.extend(named().filter(is_clause));
                    }
                    _ => {}
                },
                _ => {}
            }
        }
        page
    }
}

fn attribute(tag: &str, name: &str) -> Option<String> {
    let start = tag.match_indices(name).find_map(|(at, _)| {
        let rest = tag[at + name.len()..].strip_prefix("=\"")?;
        tag[..at].ends_with(char::is_whitespace).then_some(rest)
    })?;
    let value = start.split('"').next()?;
    Some(value.replace("&#38;", "&").replace("&amp;", "&"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_page_is_read() {
        let page = Page::read(
            r#"<form class="choice" method="post" action="/r/abc" data-block="timed" data-question="low">
               <input type="hidden" name="step" value="4"><input type="hidden" name="input">
               <button class="button" name="action" value="stop">Stop</button></form>"#,
        );
        assert_eq!(page.action.as_deref(), Some("/r/abc"));
        assert_eq!(page.question, Some(("timed".into(), "low".into())));
        assert_eq!(
            page.hidden,
            [("step".into(), "4".into()), ("input".into(), String::new())]
        );
        assert_eq!(page.buttons, [("action".into(), "stop".into())]);
        assert!(!page.is_finished);
    }

    #[test]
    fn a_page_without_a_form_asks_nothing() {
        let page = Page::read(r#"<h1 data-part="ending">Thank you</h1>"#);
        assert_eq!(
            page,
            Page {
                is_finished: true,
                ..Page::default()
            }
        );
    }
}
