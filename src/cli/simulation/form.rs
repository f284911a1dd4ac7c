//! What a simulated person writes into a form.

use rand::{Rng, RngExt, seq::IndexedRandom};
use serde_json::Value;

use crate::study::step::{Field, FieldKind, FieldOption};

/// The fields of a form, filled in: checks as they ask for it, everything else at random. Nobody is screened out, and
/// words are written only where they are required.
pub(super) fn fill_in(fields: &[Field], rng: &mut impl Rng) -> Vec<(String, String)> {
    fields.iter().flat_map(|field| answer(field, rng)).collect()
}

fn answer(field: &Field, rng: &mut impl Rng) -> Vec<(String, String)> {
    if let FieldKind::Likert { points, items } = &field.kind {
        return items
            .iter()
            .map(|item| {
                let drawn = rng.random_range(1..=points.len().max(1)).to_string();
                let point = item.expected.map_or(drawn, |point| point.to_string());
                (item.id.clone(), point)
            })
            .collect();
    }
    let asked_for = field.correct.as_ref().or(field.expected.as_ref());
    let values = match asked_for {
        Some(value) => texts(value),
        None => drawn(field, rng),
    };
    values
        .into_iter()
        .map(|value| (field.id.clone(), value))
        .collect()
}

fn texts(value: &Value) -> Vec<String> {
    match value {
        Value::Array(values) => values.iter().flat_map(texts).collect(),
        Value::String(text) => vec![text.clone()],
        other => vec![other.to_string()],
    }
}

fn drawn(field: &Field, rng: &mut impl Rng) -> Vec<String> {
    // Most ages and numbers of years lie in the lower part of what may be entered.
    let low_part = rng.random::<f64>().powi(3);
    match &field.kind {
        FieldKind::Integer { min, max } => {
            let number = *min as f64 + low_part * (*max as f64 - *min as f64);
            vec![(number as i64).clamp(*min, *max).to_string()]
        }
        FieldKind::Number { min, max, digits } => {
            let number = min + low_part * (max - min);
            vec![format!("{number:.*}", *digits as usize)]
        }
        FieldKind::Text { .. } | FieldKind::LongText { .. } if field.required => {
            vec!["simulated".to_owned()]
        }
        FieldKind::Text { .. } | FieldKind::LongText { .. } => Vec::new(),
        FieldKind::Choice { options, .. } => several(options, 1, rng),
        FieldKind::Choices { options, min, .. } => several(options, (*min).max(1), rng),
        // Its items are answered one by one.
        FieldKind::Likert { .. } => Vec::new(),
    }
}

fn several(options: &[FieldOption], count: usize, rng: &mut impl Rng) -> Vec<String> {
    let open: Vec<&FieldOption> = options
        .iter()
        .filter(|option| !option.screens_out)
        .collect();
    let chosen = open.sample(rng, count);
    chosen.map(|option| option.id.clone()).collect()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;

    use super::*;
    use crate::study::{Step, StepPlan, Study, starter};

    #[test]
    fn the_starter_study_takes_what_simulated_people_write() {
        let study = Study::parse("starter.toml", starter()).unwrap();
        let mut rng = ChaCha12Rng::seed_from_u64(5);
        let steps: Vec<StepPlan> = study.draw_steps(study.conditions().first(), &mut rng);
        let mut forms = 0;
        for plan in &steps {
            let step = study.step(plan).unwrap();
            let Step::Form(form) = &step else { continue };
            forms += 1;
            for _ in 0..50 {
                let fields = fill_in(form.fields, &mut rng).into_iter().collect();
                let reply = step.read(&fields, &crate::study::Words::english()).unwrap();
                assert!(step.assess(&reply).passes(), "{reply:?}");
            }
        }
        assert!(forms > 0);
    }
}
