//! `POST predict`: what a person will choose, from a fit or from given parameters (models.md, section 10).

use axum::{
    Json,
    extract::State,
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};

use super::{
    NoQuery, Parts,
    extract::{Body, Path, Query},
};
use crate::{
    inference::{ActionPrediction, predict_from_draws},
    jobs::{PartFit, PartState, Snapshot},
    model::{
        ChoiceModel, ChoiceProblem, OrderedMap, RISK_AWARE, RiskAwareOptions, model_named,
        probabilities, utilities,
    },
    store,
    study::{CellId, FitPlan, PartId, PlanId, StudyId},
    web::{ApiError, Error, results},
};

/// A problem, with parameters or with what names a fit.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Request {
    problem: ChoiceProblem,
    /// `risk_aware` if left out.
    model: Option<String>,
    parameters: Option<OrderedMap<f64>>,
    /// The plan with one part if left out.
    plan: Option<PlanId>,
    part: Option<PartId>,
    /// A cell instead of the part that holds it.
    cell: Option<CellId>,
}

#[derive(Serialize)]
struct FromParameters {
    model: &'static str,
    probabilities: OrderedMap<f64>,
    utilities: OrderedMap<f64>,
    most_likely: String,
}

#[derive(Serialize)]
struct FromFit {
    model: &'static str,
    plan: String,
    part: String,
    fit: i64,
    data_version: i64,
    /// Means over posterior draws, with 90 % intervals.
    probabilities: OrderedMap<Interval>,
    most_likely: String,
}

#[derive(Serialize)]
struct Interval {
    mean: f64,
    q5: f64,
    q95: f64,
}

pub(super) async fn predict(
    (State(store), State(catalogue), State(settings)): Parts,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
    Body(request): Body<Request>,
) -> Result<Response, ApiError> {
    let snapshot = results::snapshot(&store, &catalogue, &settings, &study).await?;
    let model = request
        .model
        .as_deref()
        .map_or(Ok(&RISK_AWARE), model_named);
    let model = model.map_err(|error| Error::Unprocessable(error.to_string()))?;
    if let Some(parameters) = &request.parameters {
        if request.plan.is_some() || request.part.is_some() || request.cell.is_some() {
            return Err(Error::Unprocessable(
                "parameters and plan, part or cell are given; allowed: parameters alone, or what names a fit".to_owned(),
            )
            .into());
        }
        let answer = from_parameters(&request.problem, model, parameters)?;
        return Ok(Json(answer).into_response());
    }
    let (part, chosen) = named_fit(&snapshot, model, &request)?;
    let draws = store.fit_draws(chosen.id).await?;
    let not_read = || {
        Error::Internal(anyhow::anyhow!(
            "the draws of fit {} are not of the announced size",
            chosen.id
        ))
    };
    let report = part.converged().ok_or_else(not_read)?;
    let draws = report.draws(&draws).ok_or_else(not_read)?;
    let (problem, options) = (request.problem, report.summary.options);
    // Thousands of draws with a large problem take long enough to hold up other requests.
    let prediction =
        tokio::task::spawn_blocking(move || predict_from_draws(&problem, &draws, options))
            .await
            .map_err(|error| Error::Internal(error.into()))?
            .ok_or_else(|| {
                Error::Unprocessable(
                    "the problem's decision weights vanish under every draw".to_owned(),
                )
            })?;
    let share = |ActionPrediction {
                     action,
                     mean,
                     q5,
                     q95,
                 }| (action, Interval { mean, q5, q95 });
    Ok(Json(FromFit {
        model: model.id,
        plan: part.plan.to_string(),
        part: part.part.to_string(),
        fit: chosen.id.get(),
        data_version: chosen.data_version,
        probabilities: prediction.actions.into_iter().map(share).collect(),
        most_likely: prediction.most_likely,
    })
    .into_response())
}

fn from_parameters(
    problem: &ChoiceProblem,
    model: &ChoiceModel,
    parameters: &OrderedMap<f64>,
) -> Result<FromParameters, Error> {
    let unprocessable = |error: &dyn std::fmt::Display| Error::Unprocessable(error.to_string());
    let entries = parameters.iter().map(|(name, value)| (name, *value));
    let parameters = model
        .parameters_from(entries)
        .map_err(|error| unprocessable(&error))?;
    let options = RiskAwareOptions::default();
    let shares =
        probabilities(problem, &parameters, options).map_err(|error| unprocessable(&error))?;
    let values = utilities(problem, &parameters, options).map_err(|error| unprocessable(&error))?;
    let named = |values: &[f64]| {
        problem
            .names()
            .map(str::to_owned)
            .zip(values.iter().copied())
            .collect()
    };
    let mut most_likely = 0;
    for (index, share) in shares.iter().enumerate() {
        if *share > shares[most_likely] {
            most_likely = index;
        }
    }
    Ok(FromParameters {
        model: model.id,
        probabilities: named(&shares),
        utilities: named(&values),
        most_likely: problem.actions()[most_likely].name.clone(),
    })
}

/// The fit that the request names, if it has converged.
fn named_fit<'a>(
    snapshot: &'a Snapshot,
    model: &ChoiceModel,
    request: &Request,
) -> Result<(&'a PartFit, &'a store::Fit), Error> {
    let plan = match &request.plan {
        Some(plan) => results::plan(snapshot, Some(plan))?,
        None => whole_plan(snapshot)?,
    };
    let of_plan = || {
        snapshot
            .fits
            .iter()
            .filter(|part| part.plan == plan.id && part.model.id == model.id)
    };
    let part = match (&request.part, &request.cell) {
        (Some(_), Some(_)) => {
            return Err(Error::Unprocessable(
                "part and cell are given; allowed: one of them".to_owned(),
            ));
        }
        (Some(id), None) => of_plan().find(|part| part.part == *id),
        (None, Some(cell)) => of_plan().find(|part| part.cells.contains(cell)),
        (None, None) if plan.parts.len() == 1 => of_plan().next(),
        (None, None) => None,
    };
    let part = part.ok_or_else(|| {
        let known: Vec<&str> = plan.parts.iter().map(|part| part.id.as_str()).collect();
        Error::Unprocessable(format!(
            "plan `{}` needs a part or one of its cells; allowed parts: {}",
            plan.id,
            known.join(", ")
        ))
    })?;
    match (part.state, &part.fit) {
        (PartState::Converged, Some(fit)) => Ok((part, fit)),
        (state, _) => Err(Error::Conflict(format!(
            "plan `{}`, part `{}` has no converged fit of {} (state: {}); try again later, or give parameters",
            part.plan,
            part.part,
            model.id,
            state.as_str()
        ))),
    }
}

/// The plan that fits all cells together.
fn whole_plan(snapshot: &Snapshot) -> Result<&FitPlan, Error> {
    let plans = snapshot.study.plans();
    plans
        .iter()
        .find(|plan| plan.parts.len() == 1)
        .ok_or_else(|| {
            let known: Vec<&str> = plans.iter().map(|plan| plan.id.as_str()).collect();
            Error::Unprocessable(format!(
                "this study has no plan for all cells together; give one of its plans: {}",
                known.join(", ")
            ))
        })
}
