//! `POST predict`: what a person will choose, from a fit or from given parameters (models.md, section 10).

use std::{sync::Arc, time::Duration};

use axum::{
    Json,
    extract::State,
    response::{IntoResponse, Response},
};
use serde::{Deserialize, Serialize};
use tokio::{sync::Semaphore, time::timeout};

use super::{
    NoQuery, Parts, StudyPath,
    extract::{Body, Path, Query},
    served,
};
use crate::{
    inference::{ActionPrediction, Draws, predict_from_draws},
    jobs::{PartFit, PartState, Snapshot},
    model::{
        ChoiceModel, ChoiceProblem, OrderedMap, RISK_AWARE, RiskAwareOptions, model_named,
        probabilities, utilities,
    },
    store::{self, Store},
    study::{CellId, FitPlan, PartId, PlanId, StudyId},
    web::{ApiError, Error, access::Reader, results},
};

/// More than anybody chooses among; with the limit on outcomes, what one call may cost.
const MAX_ACTIONS: usize = 20;
/// Over all actions.
const MAX_OUTCOMES: usize = 100;
/// Predictions computed at a time; answers need the processor as well.
static COMPUTING: Semaphore = Semaphore::const_new(2);
/// How long a prediction waits for its turn.
const TURN: Duration = Duration::from_secs(5);

/// A problem, with parameters or with what names a fit.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = PredictionRequest, example = json!({
    "model": "noisy_rational", "parameters": { "theta": 0.2 },
    "problem": { "stable": [[1, 20]], "unstable": [[0.2, 105], [0.8, 0]] },
}))]
pub(super) struct Request {
    problem: ChoiceProblem,
    /// `risk_aware` if left out.
    model: Option<String>,
    /// Those of the model, by name; without them a fit predicts.
    #[schema(value_type = Option<HashMap<String, f64>>)]
    parameters: Option<OrderedMap<f64>>,
    /// The plan with one part if left out.
    #[schema(value_type = Option<String>)]
    plan: Option<PlanId>,
    #[schema(value_type = Option<String>)]
    part: Option<PartId>,
    /// A cell instead of the part that holds it.
    #[schema(value_type = Option<String>)]
    cell: Option<CellId>,
}

/// A prediction, from parameters or from a fit.
#[derive(Serialize, utoipa::ToSchema)]
#[serde(untagged)]
enum Prediction {
    FromParameters(FromParameters),
    FromFit(FromFit),
}

#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = PredictionFromParameters)]
struct FromParameters {
    model: &'static str,
    /// Those of the study's own fits, but for what the model asks for.
    options: RiskAwareOptions,
    #[schema(value_type = HashMap<String, f64>)]
    probabilities: OrderedMap<f64>,
    #[schema(value_type = HashMap<String, f64>)]
    utilities: OrderedMap<f64>,
    most_likely: String,
}

#[derive(Serialize, utoipa::ToSchema)]
#[schema(as = PredictionFromFit)]
struct FromFit {
    model: &'static str,
    plan: String,
    part: String,
    fit: i64,
    /// The fit depends on the fits before it; a final one follows once the study is idle.
    provisional: bool,
    data_version: i64,
    /// Means over posterior draws, with 90 % intervals.
    #[schema(value_type = HashMap<String, Interval>)]
    probabilities: OrderedMap<Interval>,
    most_likely: String,
}

#[derive(Serialize, utoipa::ToSchema)]
struct Interval {
    mean: f64,
    q5: f64,
    q95: f64,
}

/// What a person will choose, from given parameters or from a fit.
///
/// A problem has at most 20 actions and 100 outcomes in total. Two predictions are computed at a time.
#[utoipa::path(
    post, path = "/studies/{study}/predict", tag = "predict", params(StudyPath), request_body = Request,
    responses(
        (status = 200, description = "Probability of each action", body = Prediction),
        (status = 409, description = "The fit that is named has not converged", body = crate::web::problem::Problem, content_type = "application/problem+json"),
        (status = 413, description = "The body is too large", body = crate::web::problem::Problem, content_type = "application/problem+json"),
        (status = 415, description = "The body is not JSON", body = crate::web::problem::Problem, content_type = "application/problem+json"),
        (status = 422, description = "A value is not allowed", body = crate::web::problem::Problem, content_type = "application/problem+json"),
    ),
    security((), ("token" = ["results"])),
)]
pub(super) async fn predict(
    (State(store), State(catalogue), State(settings)): Parts,
    reader: Reader,
    Path(study): Path<StudyId>,
    Query(NoQuery {}): Query<NoQuery>,
    Body(request): Body<Request>,
) -> Result<Response, ApiError> {
    let served = served(&catalogue, &study)?;
    check_size(&request.problem)?;
    let model = request
        .model
        .as_deref()
        .map_or(Ok(&RISK_AWARE), model_named);
    let model = model.map_err(|error| Error::Unprocessable(error.to_string()))?;
    if let Some(parameters) = request.parameters {
        if request.plan.is_some() || request.part.is_some() || request.cell.is_some() {
            return Err(Error::Unprocessable(
                "parameters and plan, part or cell are given; allowed: parameters alone, or what names a fit".to_owned(),
            )
            .into());
        }
        let (problem, options) = (request.problem, model.options(served.fit().options));
        let answer =
            computed(move || from_parameters(&problem, model, &parameters, options)).await??;
        return Ok(Json(Prediction::FromParameters(answer)).into_response());
    }
    let mut snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
    let mut draws = draws_of(&store, &snapshot, model, &request).await?;
    if draws.is_none() {
        // A newer fit was made since, and only the newest keeps its draws.
        snapshot = reader.shown(&store, &catalogue, &settings, &study).await?;
        draws = draws_of(&store, &snapshot, model, &request).await?;
    }
    let (part, chosen) = named_fit(&snapshot, model, &request)?;
    let (Some(report), Some(draws)) = (part.converged(), draws) else {
        return Err(Error::Conflict(format!(
            "fit {} is provisional and was made before the server started; the final one follows, try again in a moment",
            chosen.id
        ))
        .into());
    };
    let (problem, options) = (request.problem, report.summary.options);
    let prediction = computed(move || predict_from_draws(&problem, &draws, options))
        .await?
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
    Ok(Json(Prediction::FromFit(FromFit {
        model: model.id,
        plan: part.plan.to_string(),
        part: part.part.to_string(),
        fit: chosen.id.get(),
        provisional: chosen.is_provisional,
        data_version: chosen.data_version,
        probabilities: prediction.actions.into_iter().map(share).collect(),
        most_likely: prediction.most_likely,
    }))
    .into_response())
}

fn check_size(problem: &ChoiceProblem) -> Result<(), Error> {
    let actions = problem.actions().len();
    if actions > MAX_ACTIONS {
        return Err(Error::Unprocessable(format!(
            "problem has {actions} actions; allowed: at most {MAX_ACTIONS}"
        )));
    }
    let outcomes: usize = problem
        .actions()
        .iter()
        .map(|action| action.prospect.outcomes().len())
        .sum();
    if outcomes > MAX_OUTCOMES {
        return Err(Error::Unprocessable(format!(
            "problem has {outcomes} outcomes over all actions; allowed: at most {MAX_OUTCOMES}"
        )));
    }
    Ok(())
}

/// Computes on a thread where it holds up no other request, once it is its turn.
pub(super) async fn computed<T: Send + 'static>(
    compute: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Error> {
    let turn = match timeout(TURN, COMPUTING.acquire()).await {
        Ok(turn) => turn.map_err(|error| Error::Internal(error.into()))?,
        Err(_) => return Err(Error::Busy),
    };
    // The turn goes with the work: a client that leaves does not end what is being computed.
    tokio::task::spawn_blocking(move || {
        let _turn = turn;
        compute()
    })
    .await
    .map_err(|error| Error::Internal(error.into()))
}

fn from_parameters(
    problem: &ChoiceProblem,
    model: &ChoiceModel,
    parameters: &OrderedMap<f64>,
    options: RiskAwareOptions,
) -> Result<FromParameters, Error> {
    let unprocessable = |error: &dyn std::fmt::Display| Error::Unprocessable(error.to_string());
    let entries = parameters.iter().map(|(name, value)| (name, *value));
    let parameters = model
        .parameters_from(entries)
        .map_err(|error| unprocessable(&error))?;
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
        options,
        probabilities: named(&shares),
        utilities: named(&values),
        most_likely: problem.actions()[most_likely].name.clone(),
    })
}

/// The draws of the fit that the request names; none where they are gone.
async fn draws_of(
    store: &Store,
    snapshot: &Snapshot,
    model: &ChoiceModel,
    request: &Request,
) -> Result<Option<Arc<Draws>>, Error> {
    let (part, fit) = named_fit(snapshot, model, request)?;
    if let Some(draws) = part.draws() {
        return Ok(Some(draws.clone()));
    }
    match store.fit_draws(fit.id).await {
        Ok(blob) => {
            let draws = part.report().and_then(|report| report.draws(&blob));
            Ok(draws.map(Arc::new))
        }
        Err(store::Error::NotFound(_)) => Ok(None),
        Err(error) => Err(error.into()),
    }
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
