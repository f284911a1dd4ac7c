//! P1 to P4: riskaware's sampler beside nuts-rs with a gradient written by hand, in one run, per CPU second of one core.
//!
//! ```sh
//! cargo run --release --manifest-path benches/peers/Cargo.toml            # the table
//! cargo run --release --manifest-path benches/peers/Cargo.toml -- --check # only whether both mean the same density
//! ```

#[path = "../../cpu_time/mod.rs"]
mod cpu_time;
mod density;
mod nuts;
mod ours;
#[path = "../../posteriors/mod.rs"]
mod posteriors;

use anyhow::{bail, ensure};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use riskaware::inference::LnPosterior;

use crate::density::{Density, Sensitivity};
use crate::posteriors::{Case, cases};

/// Draws per chain of the runs that are usual, and of those whose rate is measured.
const USUAL_DRAWS: usize = 1_000;
const MANY_DRAWS: usize = 20_000;
const OUR_DRAWS: usize = 20_000;

/// Seeds of each kind of run.
const REPEATS: usize = 5;

fn main() -> anyhow::Result<()> {
    let only_check = match std::env::args().skip(1).collect::<Vec<_>>().as_slice() {
        [] => false,
        [flag] if flag == "--check" => true,
        other => bail!("unknown arguments {other:?}, allowed is --check"),
    };
    for case in cases() {
        check(&case)?;
    }
    println!("densities agree with LnPosterior and gradients with finite differences");
    if only_check {
        return Ok(());
    }
    println!(
        "rates: least bulk ESS over parameters and predicted probabilities per CPU second, warm-up not counted; ours 8 x {OUR_DRAWS} draws, nuts-rs 4 x {MANY_DRAWS} after its default 400 steps of tuning"
    );
    println!("times: the least of {REPEATS} seeds, everything included\n");
    println!(
        "| | ours: ln posterior/s, one | in lanes | cold fit, ms | warm refit, ms | its largest R-hat, least ESS | ESS/s | R-hat | nuts-rs, funnel removed: ESS/s | 4 x 1000 | nuts-rs, plain: ESS/s | 4 x 1000 | ours / best nuts-rs |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for case in cases() {
        let ours = ours::measure(&case, REPEATS, OUR_DRAWS)?;
        let (removed, removed_usual) = peer(&case, Sensitivity::FunnelRemoved)?;
        let (plain, plain_usual) = peer(&case, Sensitivity::Plain)?;
        println!(
            "| {} | {:.2e} | {:.2e} | {:.2} | {:.3} | {:.4}, {:.0} | {:.0} | {:.4} | {} | {} | {} | {} | {:.1} |",
            case.name,
            ours.evaluations,
            ours.lane_evaluations,
            ours.cold * 1e3,
            ours.warm * 1e3,
            ours.refit_rhat,
            ours.refit_ess,
            ours.rate,
            ours.rhat,
            rate(&removed),
            removed_usual,
            rate(&plain),
            plain_usual,
            ours.rate / removed.rate().max(plain.rate()),
        );
    }
    Ok(())
}

/// The rate of a run; one whose chains disagree has none that means anything.
fn rate(run: &nuts::Run) -> String {
    let mut text = format!("{:.0}", run.rate());
    if run.rhat >= 1.01 {
        text.push_str(&format!(" (R-hat {:.2})", run.rhat));
    }
    if run.divergences > 0 {
        text.push_str(&format!(" ({} divergences)", run.divergences));
    }
    text
}

/// The run of many draws with the highest rate, and how usual runs went.
fn peer(case: &Case, sensitivity: Sensitivity) -> anyhow::Result<(nuts::Run, String)> {
    let density = Density::of(case, sensitivity);
    let mut best: Option<nuts::Run> = None;
    let mut reached = 0;
    let mut largest = 1.0_f64;
    for seed in 1..=REPEATS as u64 {
        let usual = nuts::run(&density, USUAL_DRAWS, seed)?;
        reached += usize::from(usual.rhat < 1.01 && usual.ess > 400.0);
        largest = largest.max(usual.rhat);
        let many = nuts::run(&density, MANY_DRAWS, seed)?;
        if best.is_none_or(|best| many.rate() > best.rate()) {
            best = Some(many);
        }
    }
    let Some(best) = best else { bail!("no run") };
    Ok((
        best,
        format!("{reached} of {REPEATS} converged, largest {largest:.3}"),
    ))
}

/// That both samplers are given the same density, and that the gradient is that of the density.
fn check(case: &Case) -> anyhow::Result<()> {
    let mut theirs = Density::of(case, Sensitivity::FunnelRemoved);
    let mut ours = LnPosterior::new(case.model, &case.data, &case.settings)?;
    ensure!(
        ours.dimension() == theirs.dimension(),
        "{}: {} coordinates here, {} in riskaware",
        case.name,
        theirs.dimension(),
        ours.dimension()
    );
    let mut rng = ChaCha12Rng::seed_from_u64(1);
    let mut constant = None;
    for _ in 0..200 {
        let position: Vec<f64> = (0..theirs.dimension())
            .map(|_| rng.random_range(-3.0..3.0))
            .collect();
        let mut gradient = vec![0.0; position.len()];
        let here = theirs.evaluate(&position, &mut gradient);
        let difference = ours.at(&position) - here;
        let expected = *constant.get_or_insert(difference);
        ensure!(
            (difference - expected).abs() < 1e-9 * (1.0 + here.abs()),
            "{}: the densities differ by {difference} at {position:?}, and by {expected} elsewhere",
            case.name
        );
    }
    for sensitivity in [Sensitivity::Plain, Sensitivity::FunnelRemoved] {
        let mut density = Density::of(case, sensitivity);
        for _ in 0..50 {
            let position: Vec<f64> = (0..density.dimension())
                .map(|_| rng.random_range(-2.0..2.0))
                .collect();
            check_gradient(&mut density, &position)?;
        }
    }
    Ok(())
}

fn check_gradient(density: &mut Density, position: &[f64]) -> anyhow::Result<()> {
    const STEP: f64 = 1e-5;
    let mut gradient = vec![0.0; position.len()];
    let mut unused = vec![0.0; position.len()];
    density.evaluate(position, &mut gradient);
    for (coordinate, slope) in gradient.iter().enumerate() {
        let mut at = |distance: f64| {
            let mut moved = position.to_vec();
            moved[coordinate] += distance;
            density.evaluate(&moved, &mut unused)
        };
        let expected = (at(STEP) - at(-STEP)) / (2.0 * STEP);
        ensure!(
            (slope - expected).abs() < 1e-5 * (1.0 + expected.abs()),
            "slope {slope} by coordinate {coordinate} at {position:?}, finite differences give {expected}"
        );
    }
    Ok(())
}
