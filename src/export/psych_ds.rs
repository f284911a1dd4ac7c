//! One archive in the form of the Psych-DS standard (schema 1.5): `dataset_description.json` at the root, tables under
//! `data/` with names made of keyword-value pairs, every column of them described.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io;

use serde::Serialize;

use super::archive::{Archive, pretty};
use super::columns::Column;
use super::{Export, ExportError, Ids, codebook::Codebook, long, wide};
use crate::study::{Asks, Study};

/// What the archive follows.
const SCHEMA_VERSION: &str = "Psych-DS 1.5";

pub(super) fn zip(export: &Export, out: &mut dyn io::Write) -> Result<u64, ExportError> {
    let codebook = export.codebook();
    let (answers, participants) = data_files(export.study());
    let mut archive = Archive::new(out);
    archive.text(
        "dataset_description.json",
        &pretty(&Description::new(export, &codebook))?,
    )?;
    archive.text("README.md", &readme(export, &answers, &participants))?;
    archive.text("CHANGES.md", &changes(export))?;
    archive.table(&answers, |out| long::csv(export, out))?;
    archive.table(&participants, |out| wide::csv(export, out))?;
    archive.table("documentation/codebook.csv", |out| codebook.write_csv(out))?;
    archive.text("documentation/codebook.json", &pretty(&codebook)?)?;
    for version in export.versions.stored() {
        let path = format!("materials/study-version-{}.toml", version.number);
        archive.text(&path, &version.text)?;
    }
    archive.text("materials/texts.html", &texts(export.study()))?;
    archive.finish("documentation/manifest.json")
}

/// The names of the two tables. A value in a name is made of letters and digits only.
fn data_files(study: &Study) -> (String, String) {
    let id: String = study
        .id()
        .as_str()
        .chars()
        .filter(char::is_ascii_alphanumeric)
        .collect();
    (
        format!("data/study-{id}_data.csv"),
        format!("data/study-{id}_description-participants_data.csv"),
    )
}

/// `dataset_description.json`: a `Dataset` of schema.org.
#[derive(Serialize)]
struct Description<'a> {
    #[serde(rename = "@context")]
    context: &'static str,
    #[serde(rename = "@type")]
    kind: &'static str,
    name: &'a str,
    description: String,
    #[serde(rename = "schemaVersion")]
    schema_version: &'static str,
    identifier: String,
    keywords: Vec<&'static str>,
    #[serde(rename = "variableMeasured")]
    variables: Vec<Variable<'a>>,
}

#[derive(Serialize)]
struct Variable<'a> {
    #[serde(rename = "@type")]
    kind: &'static str,
    name: &'a str,
    #[serde(rename = "alternateName")]
    label: &'a str,
    description: String,
    #[serde(rename = "unitText", skip_serializing_if = "Option::is_none")]
    unit: Option<&'a str>,
    #[serde(rename = "valueReference", skip_serializing_if = "Vec::is_empty")]
    levels: Vec<Term<'a>>,
}

#[derive(Serialize)]
struct Term<'a> {
    #[serde(rename = "@type")]
    kind: &'static str,
    #[serde(rename = "termCode")]
    code: &'a str,
    name: &'a str,
}

impl<'a> Description<'a> {
    fn new(export: &'a Export, codebook: &'a Codebook) -> Self {
        let study = export.study();
        let mut seen = BTreeSet::new();
        Self {
            context: "https://schema.org/",
            kind: "Dataset",
            name: study.title(),
            description: format!(
                "{} Answers of {} to the riskaware study `{}`.",
                study.summary(),
                if export.population.is_simulated() {
                    "simulated people, who do not exist,"
                } else {
                    "people"
                },
                study.id()
            ),
            schema_version: SCHEMA_VERSION,
            identifier: format!("sha256:{}", study.hash()),
            keywords: vec!["risky choice", "decision making", "response time"],
            variables: codebook
                .tables
                .iter()
                .flat_map(|table| &table.columns)
                .filter(|column| seen.insert(column.name.as_str()))
                .map(Variable::of)
                .collect(),
        }
    }
}

impl<'a> Variable<'a> {
    fn of(column: &'a Column) -> Self {
        let mut description = column.description.clone();
        if !column.missing.is_empty() {
            let codes: Vec<&str> = column
                .missing
                .iter()
                .map(|missing| missing.code.as_str())
                .collect();
            let listed = codes.join(", ");
            // Writing to a text cannot fail.
            let _ = write!(description, ". Empty where: {listed}");
        }
        Self {
            kind: "PropertyValue",
            name: &column.name,
            label: &column.label,
            description,
            unit: column.unit.as_deref(),
            levels: column
                .levels
                .iter()
                .map(|level| Term {
                    kind: "DefinedTerm",
                    code: &level.code,
                    name: &level.label,
                })
                .collect(),
        }
    }
}

fn readme(export: &Export, answers: &str, participants: &str) -> String {
    let study = export.study();
    let ids = match export.ids {
        Ids::LeftOut => "Ids of recruiting platforms are left out.",
        Ids::Hashed => {
            "Ids of recruiting platforms stand in `platform_key` as keyed hashes, which nobody without the database can turn back."
        }
        Ids::Plain => {
            "`platform_id` holds ids of recruiting platforms. They are personal data: do not publish this archive."
        }
    };
    let people = if export.population.is_simulated() {
        "**These people do not exist: the program simulated them.**\n\n"
    } else {
        ""
    };
    format!(
        "# {title}\n\n{summary}\n\n{people}Study `{id}`, current file SHA-256 `{hash}`, exported by riskaware {program}.\n\n\
         ## Files\n\n\
         * `{answers}`: one row per question shown; `participant` and `position` together name a row.\n\
         * `{participants}`: one row per participant; `participant` names a row.\n\
         * `documentation/codebook.csv` and `.json`: every column with its unit, levels and missing codes.\n\
         * `documentation/manifest.json`: rows, bytes and SHA-256 of every file.\n\
         * `materials/`: the study file of every version, and the texts of the current one.\n\
         * `CHANGES.md`: the versions of the study.\n\n\
         ## Reading the tables\n\n\
         UTF-8, comma-separated, `.` as decimal sign. An empty cell is missing; the column of the status that belongs to it \
         says why (`timed_out`, `skipped`, `not_shown`, `withdrawn`). Only rows with status `answered` are choices. A text \
         that begins with `=`, `+`, `-`, `@` or a tab has an apostrophe before it, so that no spreadsheet computes it. {ids}\n\n\
         The same data give the same bytes, so the archive's own SHA-256 can be cited.\n",
        title = study.title(),
        summary = study.summary(),
        id = study.id(),
        hash = study.hash(),
        program = env!("CARGO_PKG_VERSION"),
    )
}

fn changes(export: &Export) -> String {
    let mut text = "# Versions of the study\n\nThe column `version` of the tables names the one under which a participant began.\n\n".to_owned();
    for version in export.versions.stored() {
        // Writing to a text cannot fail.
        let _ = writeln!(
            text,
            "* version {}: first served at {} ms since 1970 (UTC) by riskaware {}; study file SHA-256 {}",
            version.number, version.created_at.0, version.program_version, version.hash
        );
    }
    text
}

/// What people read, in the order of the study file.
fn texts(study: &Study) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{0}</title>\n<h1>{0}</h1>\n",
        escaped(study.title())
    );
    for contents in study.contents() {
        let mut add = |level: u8, title: &str, text: &str| {
            // Writing to a text cannot fail.
            let _ = write!(page, "<h{level}>{}</h{level}>\n{text}\n", escaped(title));
        };
        add(
            2,
            contents.title.unwrap_or(contents.block.as_str()),
            contents.text_html.unwrap_or(""),
        );
        match contents.asks {
            Asks::Nothing | Asks::Consent(_) => {}
            Asks::Choices { questions, .. } => {
                for question in questions {
                    let actions: String = question
                        .actions
                        .iter()
                        .map(|action| {
                            format!(
                                "<li>{}. {}</li>\n",
                                escaped(&action.label),
                                escaped(&action.detail)
                            )
                        })
                        .collect();
                    let text = format!("{}\n<ul>\n{actions}</ul>", question.text_html);
                    add(3, question.title, &text);
                }
            }
            Asks::Fields(fields) => {
                let fields: String = fields
                    .iter()
                    .map(|field| format!("<li>{}</li>\n", escaped(&field.label)))
                    .collect();
                let _ = write!(page, "<ul>\n{fields}</ul>\n");
            }
        }
    }
    page.push_str("</html>\n");
    page
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_data_files_are_keyword_value_pairs() {
        for (_, text) in crate::study::built_in() {
            let text = text.replacen("id = \"driving\"", "id = \"my-study-2\"", 1);
            let study = Study::parse("test.toml", &text).unwrap();
            let (answers, participants) = data_files(&study);
            for path in [answers, participants] {
                let name = path
                    .strip_prefix("data/")
                    .and_then(|name| name.strip_suffix("_data.csv"))
                    .unwrap();
                for pair in name.split('_') {
                    let (keyword, value) = pair.split_once('-').unwrap();
                    assert!(keyword.chars().all(|letter| letter.is_ascii_lowercase()));
                    assert!(
                        !value.is_empty()
                            && value.chars().all(|letter| letter.is_ascii_alphanumeric()),
                        "{path}"
                    );
                }
            }
        }
    }
}
