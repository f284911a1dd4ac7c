//! The draws of a fit: all chains as ArviZ JSON, one chain as CmdStan CSV.

use axum::{
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};
use serde::Deserialize;
use utoipa::IntoParams;

use super::{
    FitPath, NoQuery, Parts,
    extract::{Path, Query},
    predict::computed,
    served,
};
use crate::{
    inference::{ChoiceData, Draws, DrawsExport, FitSummary, FittedProblem},
    jobs::FitReport,
    store::FitId,
    study::StudyId,
    web::{ApiError, Error, results},
};

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ChainQuery {
    /// Counted from 1.
    #[param(minimum = 1, maximum = 64)]
    chain: usize,
}

/// All chains in JSON, for `arviz.from_json`.
/// All chains of a converged fit as `arviz.from_json` reads them.
///
/// Arrays are by chain, draw and entry; docs/DRAWS.md says what they are. Only the newest converged fit of a part keeps
/// its draws.
#[utoipa::path(
    get, path = "/studies/{study}/fits/{fit}/draws", tag = "results", params(FitPath),
    responses(
        (status = 200, description = "Posterior and prior draws, log likelihood and what they were fitted to", body = serde_json::Value),
        (status = 409, description = "The fit has not converged", body = crate::web::problem::Problem, content_type = "application/problem+json"),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn arviz(
    parts: Parts,
    Path((study, fit)): Path<(StudyId, i64)>,
    Query(NoQuery {}): Query<NoQuery>,
) -> Result<Response, ApiError> {
    let stored = StoredDraws::read(parts, &study, fit.into()).await?;
    let name = format!("{study}-{fit}.json");
    let body = written(stored, |export, out| export.write_arviz_json(out)).await?;
    Ok(download("application/json", &name, body))
}

/// One chain as CmdStan writes it.
/// One chain of a converged fit as CmdStan writes it.
#[utoipa::path(
    get, path = "/studies/{study}/fits/{fit}/draws.csv", tag = "results", params(FitPath, ChainQuery),
    responses(
        (status = 200, description = "A row per draw", content((String = "text/csv; charset=utf-8"))),
        (status = 409, description = "The fit has not converged", body = crate::web::problem::Problem, content_type = "application/problem+json"),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn csv(
    parts: Parts,
    Path((study, fit)): Path<(StudyId, i64)>,
    Query(ChainQuery { chain }): Query<ChainQuery>,
) -> Result<Response, ApiError> {
    let stored = StoredDraws::read(parts, &study, fit.into()).await?;
    let chains = stored.draws.chains;
    if !(1..=chains).contains(&chain) {
        return Err(Error::BadRequest(format!("chain is {chain}; allowed: 1 to {chains}")).into());
    }
    let name = format!("{study}-{fit}-{chain}.csv");
    let body = written(stored, move |export, out| {
        export.write_cmdstan_csv(chain - 1, out)
    })
    .await?;
    Ok(download("text/csv; charset=utf-8", &name, body))
}

/// What is stored of a fit that has converged.
struct StoredDraws {
    summary: FitSummary,
    data: ChoiceData,
    draws: Draws,
}

impl StoredDraws {
    async fn read(
        (State(store), State(catalogue), State(settings)): Parts,
        study: &StudyId,
        id: FitId,
    ) -> Result<Self, Error> {
        results::shown(&store, &catalogue, &settings, study).await?;
        let study = served(&catalogue, study)?;
        let fit = store.fit(study.id(), settings.population, id).await?;
        let report = FitReport::read(&fit)
            .filter(|report| report.summary.converged)
            .ok_or_else(|| {
                Error::Conflict(format!(
                    "fit {id} has not converged, so its draws are not given out"
                ))
            })?;
        let blob = store.fit_draws(id).await?;
        let not_read =
            |what: &str| Error::Internal(anyhow::anyhow!("the {what} of fit {id} cannot be read"));
        let draws = report.draws(&blob).ok_or_else(|| not_read("draws"))?;
        let FitReport {
            problems,
            counts,
            summary,
            ..
        } = report;
        let problem = |(id, problem)| FittedProblem { id, problem };
        let data = ChoiceData::from_counts(problems.0.into_iter().map(problem).collect(), counts)
            .map_err(|_| not_read("counts"))?;
        Ok(Self {
            summary,
            data,
            draws,
        })
    }
}

async fn written(
    stored: StoredDraws,
    write: impl FnOnce(&DrawsExport<'_>, &mut Vec<u8>) -> std::io::Result<()> + Send + 'static,
) -> Result<Vec<u8>, Error> {
    let body = computed(move || -> anyhow::Result<Vec<u8>> {
        let export = DrawsExport::new(&stored.summary, &stored.data, &stored.draws)?;
        let mut out = Vec::new();
        write(&export, &mut out)?;
        Ok(out)
    });
    body.await?.map_err(Error::Internal)
}

fn download(kind: &'static str, name: &str, body: Vec<u8>) -> Response {
    let disposition = format!("attachment; filename=\"{name}\"");
    let headers = [
        (header::CONTENT_TYPE, kind.to_owned()),
        (header::CONTENT_DISPOSITION, disposition),
    ];
    (headers, body).into_response()
}
