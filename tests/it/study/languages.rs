//! Texts per language: what stands in place of the file's own, what is refused, and what is missing.

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use riskaware::study::{ParseError, Step, Study};

pub const RAIN: &str = include_str!("../../data/languages.toml");

fn rain() -> Study {
    Study::parse("rain.toml", RAIN).unwrap()
}

#[track_caller]
fn refused(from: &str, to: &str) -> ParseError {
    assert!(RAIN.contains(from), "the file does not contain {from:?}");
    let text = RAIN.replacen(from, to, 1);
    match Study::parse("rain.toml", &text) {
        Ok(_) => panic!("{to:?} is accepted"),
        Err(error) => {
            // The line is that of the change.
            let changed = text.lines().position(|line| line.contains(to.trim()));
            assert_eq!(error.line(), changed.map(|line| line + 1), "{error}");
            error
        }
    }
}

#[track_caller]
fn check(from: &str, to: &str, key: &str, found: &str, allowed: &str) {
    let error = refused(from, to);
    assert_eq!(error.key(), key, "{error}");
    assert!(error.found().contains(found), "found: {error}");
    assert!(error.allowed().contains(allowed), "allowed: {error}");
}

/// Everything that a run shows, in one text.
fn shown(study: &Study) -> String {
    let mut rng = ChaCha12Rng::seed_from_u64(1);
    study
        .draw_steps(None, &mut rng)
        .iter()
        .map(|plan| format!("{:?}\n", study.step(plan).unwrap()))
        .collect()
}

#[test]
fn a_file_without_languages_is_english_alone() {
    let text = RAIN.replacen("languages = [\"en\", \"de\"]\n", "", 1);
    let text = &text[..text.find("[text.de]").unwrap()];
    let study = Study::parse("rain.toml", text).unwrap();
    assert_eq!(study.languages(), ["en"]);
    assert_eq!(study.language(), "en");
    assert_eq!(study.in_language("de").language(), "en");
}

#[test]
fn each_text_is_the_one_of_its_language_with_the_same_placeholders() {
    let study = rain();
    let german = study.in_language("de");
    assert_eq!(study.languages(), ["en", "de"]);
    assert_eq!(
        (study.title(), german.title(), german.language()),
        ("Rain", "Regen", "de")
    );
    assert_eq!(german.factors()[0].levels[1].label, "Trocken");
    assert_eq!(german.completion().title, "Danke");
    let shown = shown(german);
    for text in [
        "Sie können sich jederzeit aus Regen zurückziehen.",
        "Ich bin volljährig.",
        "Es geht um den Regenschirm.",
        "Haben Sie einen Schirm?",
        "5 völlig",
        "Sie haben 20 Sekunden.",
        "Der Himmel ist grau.",
        "Der Himmel ist blau.",
        "Mitnehmen",
        "Mindestens eine Ihrer Antworten stimmt nicht.",
    ] {
        assert!(shown.contains(text), "{text} is not in {shown}");
    }
    for text in ["umbrella", "You have", "sky is", "Leave it", "at all"] {
        assert!(!shown.contains(text), "{text} is in {shown}");
    }
}

#[test]
fn ids_steps_and_problems_are_the_same_in_each_language() {
    let study = rain();
    let german = study.in_language("de");
    assert_eq!((study.hash(), study.id()), (german.hash(), german.id()));
    let draw = |study: &Study| study.draw_steps(None, &mut ChaCha12Rng::seed_from_u64(7));
    assert_eq!(draw(&study), draw(german));
    for plan in draw(&study) {
        let problem = |study: &Study| {
            let Step::Choice(choice) = study.step(&plan).unwrap() else {
                return None;
            };
            choice.problem.cloned()
        };
        assert_eq!(problem(&study), problem(german));
    }
}

#[test]
fn what_is_not_translated_stays_as_the_file_has_it_and_is_listed() {
    assert_eq!(rain().in_language("de").untranslated(), [""; 0]);
    let text = RAIN
        .replacen("\"block[about].title\" = \"Worum es geht\"\n", "", 1)
        .replacen("\"action[leave].label\" = \"Dalassen\"\n", "", 1);
    let study = Study::parse("rain.toml", &text).unwrap();
    let german = study.in_language("de");
    // In file order; contact and unit are names, a detail of a placeholder alone holds no words.
    assert_eq!(
        german.untranslated(),
        ["action[leave].label", "block[about].title"]
    );
    assert!(shown(german).contains("Leave it"));
    assert_eq!(study.untranslated(), [""; 0]);
}

#[test]
fn paths_that_lead_to_no_text_are_refused() {
    check(
        "\"title\" = \"Regen\"",
        "\"titel\" = \"Regen\"",
        "text.de.titel",
        "no text at `titel`, did you mean `title`?",
        "the path of a text",
    );
    check(
        "\"block[about].button\"",
        "\"block[abuot].button\"",
        "text.de.\"block[abuot].button\"",
        "did you mean `block[about].button`?",
        "block[consent].title",
    );
    for path in ["minutes", "block[about].id", "block[consent].version"] {
        check(
            "\"title\" = \"Regen\"",
            &format!("\"{path}\" = \"Regen\""),
            &match path.contains('.') {
                true => format!("text.de.\"{path}\""),
                false => format!("text.de.{path}"),
            },
            "which is no text for people",
            "the path of a text",
        );
    }
    check(
        "\"title\" = \"Regen\"",
        "\"title\" = 3",
        "text.de.title",
        "another value",
        "a text",
    );
}

#[test]
fn languages_are_named_first_and_once() {
    check(
        "[\"en\", \"de\"]",
        "[\"en\", \"de\", \"DE\"]",
        "languages[#3]",
        "`DE`",
        "language tags",
    );
    check(
        "[\"en\", \"de\"]",
        "[\"en\", \"de\", \"de\"]",
        "languages[#3]",
        "second time",
        "once",
    );
    check(
        "[\"en\", \"de\"]",
        "[]",
        "languages",
        "no such list",
        "1 to 20",
    );
    check(
        "[text.de]",
        "[text.dee]",
        "text.dee",
        "`languages` does not name, did you mean `de`?",
        "`en`, `de`",
    );
}

#[test]
fn errors_inside_translations_point_there() {
    check(
        "\"Es geht um den {object}.\"",
        "\"Es geht um den {objekt}.\"",
        "text.de.\"block[about].text\"",
        "objekt",
        "object",
    );
    check(
        "\"Das war alles.\"",
        "\"{limit} Sekunden.\"",
        "text.de.\"completion.text\"",
        "limit",
        "",
    );
    check(
        "\"Worum es geht\"",
        "\"\"",
        "text.de.\"block[about].title\"",
        "an empty text",
        "a line of text",
    );
}

#[test]
fn the_programs_own_words_can_be_worded_anew() {
    check(
        "\"page.return_to_site\"",
        "\"page.return_to_sight\"",
        "text.de.\"page.return_to_sight\"",
        "did you mean `return_to_site`?",
        "STUDY-FORMAT",
    );
    check(
        "\"page.return_to_site\" = \"Zurück\"",
        "\"page.question_place\" = \"Frage {zahl}\"",
        "text.de.\"page.question_place\"",
        "`{zahl}`",
        "`{number}`, `{of}`",
    );
}

#[test]
fn several_mistakes_are_named_at_once() {
    let text = RAIN
        .replacen("minutes = 2", "minutes = 0", 1)
        .replacen("\"title\" = \"Regen\"", "\"titel\" = \"Regen\"", 1)
        .replacen("\"summary\" = \"Was", "\"sumary\" = \"Was", 1);
    let errors = Study::check("rain.toml", &text).unwrap_err();
    let keys: Vec<&str> = errors.iter().map(ParseError::key).collect();
    assert_eq!(keys, ["minutes", "text.de.titel", "text.de.sumary"]);
}

#[test]
fn the_files_own_language_takes_page_words_alone() {
    let own = "\n[text.en]\n\"page.start\" = \"Off you go\"\n";
    let study = Study::parse("rain.toml", &format!("{RAIN}{own}")).unwrap();
    assert_eq!(study.untranslated(), [""; 0]);
    let own = "\n[text.en]\n\"title\" = \"Drizzle\"\n";
    let error = Study::parse("rain.toml", &format!("{RAIN}{own}"))
        .err()
        .unwrap();
    assert_eq!(error.key(), "text.en.title");
    assert!(
        error
            .found()
            .contains("the language of the file's own texts")
    );
    assert_eq!(error.line(), Some(RAIN.lines().count() + 3));
}

#[test]
fn every_page_word_is_in_the_document() {
    let document = include_str!("../../../docs/STUDY-FORMAT.md");
    let words: toml::Table = include_str!("../../../src/study/words/en.toml")
        .parse()
        .unwrap();
    assert!(words.len() > 60, "{} words", words.len());
    for key in words.keys() {
        assert!(
            document.contains(&format!("`{key}`")),
            "the document does not name `{key}`"
        );
    }
}
