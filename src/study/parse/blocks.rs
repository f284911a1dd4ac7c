//! The blocks of a run, each read as its kind says.

use serde::de::DeserializeOwned;

use super::cells::AskedCell;
use super::design::Design;
use super::{choices, forms, replays, rules};
use crate::study::definition::{Block, BlockBody};
use crate::study::document::{Document, Fault, KeyPath, did_you_mean, list};
use crate::study::draw::THANKS_BLOCK;
use crate::study::file::{
    RawChoices, RawClause, RawConsent, RawForm, RawInfo, RawReplays, RawStudy,
};
use crate::study::step::{Clause, ConsentText, InfoText};
use crate::study::template::Scope;
use crate::study::words::Words;
use crate::study::{Baseline, BlockId, ParseError};

/// The kinds of blocks.
const KINDS: [&str; 5] = ["consent", "info", "replays", "choice", "form"];

/// What all blocks together ask.
#[derive(Default)]
pub(super) struct Asked {
    pub(super) blocks: Vec<Block>,
    pub(super) baseline: Vec<Baseline>,
    pub(super) baseline_share: Option<f64>,
    /// The questions that belong to cells, in file order.
    pub(super) asked: Vec<AskedCell>,
}

/// What reading a block needs.
pub(super) struct Reader<'a> {
    pub(super) document: &'a Document<'a>,
    pub(super) raw: &'a RawStudy,
    pub(super) design: &'a Design<'a>,
    pub(super) words: &'a Words,
}

/// Reads every block. What is wrong with one hides nothing of the others.
pub(super) fn read(
    document: &Document<'_>,
    raw: &RawStudy,
    design: &Design<'_>,
    words: &Words,
) -> Result<Asked, Vec<ParseError>> {
    let reader = Reader {
        document,
        raw,
        design,
        words,
    };
    let list = KeyPath::root().key("block");
    let mut asked = Asked::default();
    let mut errors = Vec::new();
    for index in 0..raw.block.len() {
        let at = list.index(index);
        let (id, body) = match reader.block(&at, &mut asked) {
            Ok(block) => block,
            Err(error) => {
                errors.push(error);
                continue;
            }
        };
        if asked.blocks.iter().any(|block| block.id == *id) {
            let fault = at.key("id").fault(
                format!("`{id}` for the second time"),
                "another id for each block",
            );
            errors.push(document.refuse(&fault));
            continue;
        }
        asked.blocks.push(Block {
            id: BlockId::from(id),
            body,
        });
    }
    if raw.block.is_empty() {
        errors.push(document.refuse(&list.fault("no block", "one block or more")));
    }
    if errors.is_empty() {
        Ok(asked)
    } else {
        Err(errors)
    }
}

/// What is wrong with keys and values of single blocks, where the rest of the file cannot be read.
pub(super) fn unreadable(document: &Document<'_>) -> Vec<ParseError> {
    let list = KeyPath::root().key("block");
    let mut errors = Vec::new();
    for index in 0..document.length_at(&list) {
        let at = list.index(index);
        let error = match document.text_at(&at.key("kind")) {
            Some("consent") => document.read_table::<RawConsent>(&at, "kind").err(),
            Some("info") => document.read_table::<RawInfo>(&at, "kind").err(),
            Some("replays") => document.read_table::<RawReplays>(&at, "kind").err(),
            Some("form") => document.read_table::<RawForm>(&at, "kind").err(),
            Some("choice") => document.read_table::<RawChoices>(&at, "kind").err(),
            Some(_) | None => None,
        };
        errors.extend(error);
    }
    errors
}

impl Reader<'_> {
    fn block(&self, at: &KeyPath, asked: &mut Asked) -> Result<(String, BlockBody), ParseError> {
        let scope = self.design.scope();
        let refuse = |fault: Fault| self.document.refuse(&fault);
        match self.document.text_at(&at.key("kind")) {
            Some("consent") => {
                let raw: RawConsent = self.table(at)?;
                let id = block_id(&raw.id, at).map_err(refuse)?;
                Ok((
                    id,
                    BlockBody::Consent(consent(&raw, &scope, at).map_err(refuse)?),
                ))
            }
            Some("info") => {
                let raw: RawInfo = self.table(at)?;
                let id = block_id(&raw.id, at).map_err(refuse)?;
                let text = self.info(&raw, &scope, at).map_err(refuse)?;
                Ok((id, BlockBody::Info(text)))
            }
            Some("replays") => {
                let raw = self.table(at)?;
                let (id, replays) = replays::read(&raw, &scope, at).map_err(refuse)?;
                Ok((id, BlockBody::Replays(replays)))
            }
            Some("form") => {
                let raw = self.table(at)?;
                let (id, form) = forms::read(&raw, &scope, self.words, at).map_err(refuse)?;
                Ok((id, BlockBody::Form(form)))
            }
            Some("choice") => {
                let raw = self.table(at)?;
                let (id, choices) = choices::read(self, &raw, at, asked).map_err(refuse)?;
                Ok((id, BlockBody::Choice(choices)))
            }
            Some(other) => {
                let found = format!(
                    "unknown kind {}{}",
                    rules::shown(other),
                    did_you_mean(other, KINDS)
                );
                Err(refuse(at.key("kind").fault(found, list(KINDS))))
            }
            None => Err(refuse(
                at.key("kind").fault("no kind of block", list(KINDS)),
            )),
        }
    }

    /// A text that only some conditions meet can use the values of their levels.
    fn info(&self, raw: &RawInfo, scope: &Scope<'_>, at: &KeyPath) -> Result<InfoText, Fault> {
        let levels = self.design.condition_levels(&raw.when, &at.key("when"))?;
        let scope = self.design.scope_with(scope, &levels);
        Ok(InfoText {
            title: rules::filled_line(&raw.title, &scope, &at.key("title"))?,
            text_html: rules::filled_markdown(&raw.text, &scope, &at.key("text"))?,
            scene: scene(raw.scene.as_ref(), at)?,
            button: rules::filled_line(&raw.button, &scope, &at.key("button"))?,
            when: self.design.named(&levels),
        })
    }

    fn table<T: DeserializeOwned>(&self, at: &KeyPath) -> Result<T, ParseError> {
        self.document.read_table(at, "kind")
    }
}

/// A block's id.
pub(super) fn block_id(id: &str, at: &KeyPath) -> Result<String, Fault> {
    let at = at.key("id");
    if id == THANKS_BLOCK {
        return Err(at.fault("`thanks`", "another id: this one is the end of every run"));
    }
    rules::id(id, &at)
}

/// The name of a drawn scene.
pub(super) fn scene(scene: Option<&String>, at: &KeyPath) -> Result<Option<String>, Fault> {
    scene
        .map(|scene| rules::id(scene, &at.key("scene")))
        .transpose()
}

fn consent(raw: &RawConsent, scope: &Scope<'_>, at: &KeyPath) -> Result<ConsentText, Fault> {
    rules::line(&raw.version, &at.key("version"))?;
    Ok(ConsentText {
        version: raw.version.clone(),
        title: rules::filled_line(&raw.title, scope, &at.key("title"))?,
        text_html: rules::filled_markdown(&raw.text, scope, &at.key("text"))?,
        agree: rules::filled_line(&raw.agree, scope, &at.key("agree"))?,
        decline: rules::filled_line(&raw.decline, scope, &at.key("decline"))?,
        declined_title: rules::filled_line(&raw.declined_title, scope, &at.key("declined_title"))?,
        declined_text_html: rules::filled_markdown(
            &raw.declined_text,
            scope,
            &at.key("declined_text"),
        )?,
        clauses: clauses(&raw.clause, scope, &at.key("clause"))?,
    })
}

fn clauses(raw: &[RawClause], scope: &Scope<'_>, list: &KeyPath) -> Result<Vec<Clause>, Fault> {
    rules::distinct_ids(raw.iter().map(|clause| clause.id.as_str()), list, "clause")?;
    raw.iter()
        .enumerate()
        .map(|(index, raw)| {
            Ok(Clause {
                id: raw.id.clone(),
                text: rules::filled_line(&raw.text, scope, &list.index(index).key("text"))?,
                required: raw.required,
            })
        })
        .collect()
}
