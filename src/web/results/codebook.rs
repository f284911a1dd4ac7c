//! The codebook as a page: every column of the exports.

use askama::Template;
use askama_web::WebTemplate;
use axum::extract::{Path, State};

use super::Parts;
use crate::{
    export::{Codebook, Export, Ids},
    study::StudyId,
    web::{Error, assets},
};

/// Every column of the exports, and where these are.
#[derive(Template, WebTemplate)]
#[template(path = "results/codebook.html")]
pub(super) struct CodebookPage {
    codebook: Codebook,
}

pub(super) async fn page(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
) -> Result<CodebookPage, Error> {
    let (_, study) = catalogue.current(&study).ok_or(Error::NotFound("study"))?;
    let export = Export::open(&store, study.id(), settings.population, Ids::LeftOut).await?;
    Ok(CodebookPage {
        codebook: export.codebook(),
    })
}
