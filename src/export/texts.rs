//! What people read, as one HTML page per language: for whoever judges a study by its words.
//!
//! All texts of the study file are there, in its order. What the program itself says, such as the names of its buttons, is not;
//! notes about what a field accepts are this file's own and English.

use std::fmt::Write as _;

use crate::study::step::{ActionView, Clause, ConsentStep, Field, FieldKind};
use crate::study::{AskedQuestion, Asks, BlockContents, Ending, Study};

/// The page of one language: `study` is the study in it.
pub(super) fn page(study: &Study) -> String {
    let mut page = Page(String::new());
    let (language, title) = (escaped(study.language()), escaped(study.title()));
    page.html(&format!(
        "<!doctype html>\n<html lang=\"{language}\">\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<h1>{title}</h1>"
    ));
    page.text(study.summary());
    page.note(&format!(
        "Announced duration in minutes: {}. Contact: {}",
        study.minutes(),
        study.contact()
    ));
    for contents in study.contents() {
        page.block(&contents);
    }
    for ending in [
        Ending::Completed,
        Ending::ScreenedOut,
        Ending::FailedCheck,
        Ending::TimedOut,
    ] {
        let shown = study.ending(ending);
        page.heading(2, &shown.title);
        page.note(&format!(
            "The last page of a run that is {}.",
            ending.as_str()
        ));
        page.html(&shown.text_html);
    }
    page.html("</html>");
    page.0
}

struct Page(String);

impl Page {
    fn html(&mut self, html: &str) {
        // Writing to a text cannot fail.
        let _ = writeln!(self.0, "{html}");
    }

    fn heading(&mut self, level: u8, text: &str) {
        self.html(&format!("<h{level}>{}</h{level}>", escaped(text)));
    }

    fn text(&mut self, text: &str) {
        if !text.is_empty() {
            self.html(&format!("<p>{}</p>", escaped(text)));
        }
    }

    fn note(&mut self, text: &str) {
        self.html(&format!(
            "<p lang=\"en\"><small>{}</small></p>",
            escaped(text)
        ));
    }

    fn list<'t>(&mut self, items: impl IntoIterator<Item = &'t str>) {
        self.html("<ul>");
        for item in items {
            self.html(&format!("<li>{}</li>", escaped(item)));
        }
        self.html("</ul>");
    }

    fn block(&mut self, contents: &BlockContents<'_>) {
        self.heading(2, contents.title.unwrap_or(contents.block.as_str()));
        self.html(contents.text_html.unwrap_or(""));
        match &contents.asks {
            Asks::Nothing => {}
            Asks::Replays(replays) => self.list(replays.iter().map(|replay| replay.id.as_str())),
            Asks::Consent(consent) => self.consent(consent),
            Asks::Choices {
                limit_ms,
                questions,
            } => {
                if let Some(limit_ms) = limit_ms {
                    self.note(&format!("Each question has a limit of {limit_ms} ms."));
                }
                for question in questions {
                    self.question(question);
                }
            }
            Asks::Fields(fields) => {
                for field in *fields {
                    self.field(field);
                }
            }
        }
        if let Some(hint_html) = contents.hint_html {
            self.note("After a wrong attempt:");
            self.html(hint_html);
        }
        if let Some(button) = contents.button {
            self.list([button]);
        }
    }

    fn consent(&mut self, consent: &ConsentStep<'_>) {
        for Clause { text, required, .. } in consent.clauses {
            self.list([text.as_str()]);
            self.note(if *required {
                "To be ticked by everybody who takes part."
            } else {
                "May be left unticked."
            });
        }
        self.list([consent.agree, consent.decline]);
        self.heading(3, consent.declined.title);
        self.note("Shown to whoever declines.");
        self.html(consent.declined.text_html);
    }

    fn question(&mut self, question: &AskedQuestion<'_>) {
        self.heading(3, question.title);
        self.note(&format!("Question {}.", question.id));
        self.html(question.text_html);
        let actions: Vec<String> = question.actions.iter().map(offered).collect();
        self.list(actions.iter().map(String::as_str));
    }

    fn field(&mut self, field: &Field) {
        self.heading(3, &field.label);
        self.text(field.hint.as_deref().unwrap_or(""));
        let required = if field.required {
            "required"
        } else {
            "may be left empty"
        };
        match &field.kind {
            FieldKind::Integer { min, max } => {
                self.note(&format!("A whole number from {min} to {max}, {required}."));
            }
            FieldKind::Number { min, max, .. } => {
                self.note(&format!("A number from {min} to {max}, {required}."));
            }
            FieldKind::Text { max_length } | FieldKind::LongText { max_length } => {
                self.note(&format!(
                    "Own words, at most {max_length} characters, {required}."
                ));
            }
            FieldKind::Choice { options, other } => {
                self.list(options.iter().map(|option| option.label.as_str()));
                let other = if *other {
                    ", or another in own words"
                } else {
                    ""
                };
                self.note(&format!("One of them{other}, {required}."));
            }
            FieldKind::Choices { options, min, max } => {
                self.list(options.iter().map(|option| option.label.as_str()));
                self.note(&format!("From {min} to {max} of them, {required}."));
            }
            FieldKind::Likert { points, items } => {
                self.note(&format!("A scale with these points, {required}:"));
                self.list(points.iter().map(String::as_str));
                self.note("What is answered on it:");
                self.list(items.iter().map(|item| item.text.as_str()));
            }
        }
    }
}

fn offered(action: &ActionView) -> String {
    if action.detail.is_empty() {
        action.label.clone()
    } else {
        format!("{}. {}", action.label, action.detail)
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
