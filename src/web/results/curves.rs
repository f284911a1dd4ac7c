//! `curves.json`: what each converged fit says about value and probability (models.md, section 8).

use serde::Serialize;

use crate::{
    inference::curves::{Band, Curve, Curves as Fitted},
    jobs::{PartFit, Snapshot},
    model::OrderedMap,
    study::{PartId, PlanId, RewardUnit},
    web::results::format::rfc3339,
};

/// The curves of all plans.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Curves {
    pub data_version: i64,
    pub fit_version: i64,
    /// The newest data that one of these fits has read.
    pub fitted_version: Option<i64>,
    /// Draws per fit, where all fits keep equally many.
    pub draws: Option<u64>,
    /// When the latest of the fits was made.
    pub at: Option<String>,
    pub plans: Vec<PartCurves>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct PartCurves {
    pub plan: String,
    pub part: String,
    pub label: String,
    /// Only models whose fit has converged.
    #[schema(value_type = HashMap<String, ModelCurves>)]
    pub models: OrderedMap<ModelCurves>,
}

/// The curves of one fit.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct ModelCurves {
    /// The id of the fit.
    pub fit: i64,
    pub seed: u64,
    /// The fit started from the one before it; a final one follows once the study is idle.
    pub provisional: bool,
    /// w⁺ over probability; null for a model that takes probabilities as they are.
    pub weighting_gain: Option<Series>,
    /// w⁻ over probability.
    pub weighting_loss: Option<Series>,
    /// The normalised decision weight of the study's risky outcome over its true probability.
    pub decision_weight: Option<DecisionWeight>,
    /// θ·v(R) over reward.
    pub value_logits: Series,
    /// v(R)/|v(R_ref)| over reward.
    pub value_shape: Series,
    /// Each action against the sure one, in logits.
    pub gaps: Vec<Gap>,
}

/// One curve, column by column; null where no draw has a value.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct Series {
    pub x: Vec<f64>,
    pub mean: Vec<Option<f64>>,
    pub q5: Vec<Option<f64>>,
    pub q25: Vec<Option<f64>>,
    pub q75: Vec<Option<f64>>,
    pub q95: Vec<Option<f64>>,
    /// The prior's mean, save in `value_logits`, where it is the prior's median: the product of θ and a power of the
    /// reward has so heavy a tail that its mean may not exist.
    pub prior_mean: Vec<Option<f64>>,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(in crate::web) struct DecisionWeight {
    /// Which outcome, with its reward.
    pub label: String,
    /// What limits the reading of the curve.
    #[schema(value_type = Option<String>)]
    pub note: Option<&'static str>,
    #[serde(flatten)]
    pub series: Series,
}

#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = CurveGap)]
pub(in crate::web) struct Gap {
    pub cell: String,
    pub action: String,
    pub than: String,
    pub mean: Option<f64>,
    pub q5: Option<f64>,
    pub q95: Option<f64>,
}

impl Curves {
    /// The curves of all plans, of one plan, or of one part of one.
    pub(in crate::web) fn new(
        snapshot: &Snapshot,
        plan: Option<&PlanId>,
        part: Option<&PartId>,
    ) -> Self {
        let fits: Vec<&PartFit> = snapshot
            .fits
            .iter()
            .filter(|fit| {
                plan.is_none_or(|plan| fit.plan == *plan)
                    && part.is_none_or(|part| fit.part == *part)
            })
            .collect();
        let unit = snapshot.study.reward_unit();
        let mut plans: Vec<PartCurves> = Vec::new();
        // Models of one part stand next to each other.
        for of_part in
            fits.chunk_by(|left, right| left.plan == right.plan && left.part == right.part)
        {
            plans.push(PartCurves {
                plan: of_part[0].plan.to_string(),
                part: of_part[0].part.to_string(),
                label: of_part[0].part_label.clone(),
                models: of_part
                    .iter()
                    .filter_map(|part| model(part, unit))
                    .collect(),
            });
        }
        let mut draws = fits.iter().filter_map(|part| {
            let summary = &part.converged()?.summary;
            Some((summary.chains * summary.draws) as u64)
        });
        let first = draws.next();
        Self {
            data_version: snapshot.version.data_version,
            fit_version: snapshot.version.fit_version,
            fitted_version: fitted_version(snapshot, &fits),
            draws: first.filter(|first| draws.all(|other| other == *first)),
            at: fits
                .iter()
                .filter_map(|part| Some(part.fit.as_ref()?.created_at))
                .max()
                .map(rfc3339),
            plans,
        }
    }
}

fn model(part: &PartFit, unit: &RewardUnit) -> Option<(String, ModelCurves)> {
    let fitted = part.converged()?.curves.as_ref()?;
    let fit = part.fit.as_ref()?;
    let curves = ModelCurves {
        fit: fit.id.get(),
        seed: fit.seed,
        provisional: part.is_provisional(),
        weighting_gain: fitted.weighting_gains.as_ref().map(series),
        weighting_loss: fitted.weighting_losses.as_ref().map(series),
        decision_weight: decision_weight(fitted, unit),
        value_logits: series(&fitted.value_logits),
        value_shape: series(&fitted.value_shape),
        gaps: fitted
            .gaps
            .iter()
            .map(|gap| Gap {
                cell: gap.problem.clone(),
                action: gap.action.clone(),
                than: gap.than.clone(),
                mean: gap.logits.map(|band| band.mean),
                q5: gap.logits.map(|band| band.q5),
                q95: gap.logits.map(|band| band.q95),
            })
            .collect(),
    };
    Some((part.model.id.to_owned(), curves))
}

/// The risky outcome is the first whose size is largest; a study has one as a rule.
fn decision_weight(fitted: &Fitted, unit: &RewardUnit) -> Option<DecisionWeight> {
    let risky = fitted
        .risky_weights
        .iter()
        .rev()
        .max_by(|a, b| a.reward.abs().total_cmp(&b.reward.abs()))?;
    Some(DecisionWeight {
        label: format!(
            "{} or else {}",
            unit.format(risky.reward),
            unit.format(risky.otherwise)
        ),
        note: fitted
            .gains_through_normalisation_only
            .then_some("γ enters through the normalisation only"),
        series: series(&risky.curve),
    })
}

fn series(curve: &Curve) -> Series {
    let column = |of: fn(&Band) -> Option<f64>| {
        let bands = curve.bands.iter();
        bands
            .map(|band| band.as_ref().and_then(of).map(short))
            .collect()
    };
    Series {
        x: curve.x.clone(),
        mean: column(|band| Some(band.mean)),
        q5: column(|band| Some(band.q5)),
        q25: column(|band| Some(band.q25)),
        q75: column(|band| Some(band.q75)),
        q95: column(|band| Some(band.q95)),
        prior_mean: column(|band| band.prior),
    }
}

/// A number with five significant digits: finer than any drawing, and a third of the text. Draws have all digits.
fn short(number: f64) -> f64 {
    let digits_behind = 4.0 - number.abs().log10().floor();
    // Powers of ten up to here are exact, and so a quotient is the number that is written with these digits.
    if digits_behind.abs() > 22.0 {
        return number;
    }
    let scale = 10_f64.powi(digits_behind.abs() as i32);
    if digits_behind >= 0.0 {
        (number * scale).round() / scale
    } else {
        (number / scale).round() * scale
    }
}

/// Up to which data version the curves hold every answer that concerns them: the present one, unless a fit is behind.
fn fitted_version(snapshot: &Snapshot, fits: &[&PartFit]) -> Option<i64> {
    let behind = fits.iter().filter(|part| part.is_behind);
    behind
        .map(|part| Some(part.fit.as_ref()?.data_version))
        .min()
        .unwrap_or(Some(snapshot.version.data_version))
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_keep_five_digits_at_any_size() {
        for (number, expected) in [
            (0.123_456_789, 0.12346),
            (-98_765.432_1, -98_765.0),
            (1.234_56e-12, 1.2346e-12),
            (99_999.6, 100_000.0),
            (-123_456_789.0, -123_460_000.0),
            (0.3, 0.3),
            (1e-300, 1e-300),
            (0.0, 0.0),
            (1.0, 1.0),
        ] {
            assert_eq!(short(number), expected);
        }
    }
}
