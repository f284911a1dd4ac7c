//! The figure of a design and model: for each quantity by how much its ranks stray from uniform ones.

use std::fmt::Write;

use super::report::Calibrated;
use crate::inference::calibration::{Bands, LEVEL, QuantityJudgement, UniformRanks};
use crate::model::{NOISY_RATIONAL, RISK_AWARE};

const COLUMNS: usize = 3;
const WIDTH: f64 = 720.0;
const HEAD: f64 = 62.0;
const FOOT: f64 = 34.0;
const PANEL: (f64, f64) = (228.0, 128.0);
/// Left, top, right and bottom of a panel: room for its title and axes.
const MARGINS: (f64, f64, f64, f64) = (38.0, 20.0, 6.0, 22.0);

const INK: &str = "#1b1f24";
const INK_SOFT: &str = "#59636e";
const LINE: &str = "#d5dae0";
const SURFACE: &str = "#eceff2";
const REFERENCE: &str = "#8a6d00";

/// The name of the file that the figure goes to.
pub(super) fn file_name(calibrated: &Calibrated<'_>) -> String {
    format!(
        "{}-{}.svg",
        calibrated.design.id(),
        calibrated.experiment.model.id.replace('_', "-")
    )
}

/// A stand-alone SVG with one panel for each quantity.
///
/// Each panel has the share of ranks below a value less that value's share, over the value's share: a line for each
/// seed in front of the band of one seed, and a bold line for all seeds together with its own, narrower band.
pub(super) fn figure(calibrated: &Calibrated<'_>) -> String {
    let values = calibrated.experiment.rank_values();
    let single = Band::new(calibrated.replicates, values);
    let together = (calibrated.seeds.len() > 1)
        .then(|| Band::new(calibrated.replicates * calibrated.seeds.len(), values));
    let scale = Scale {
        values,
        reach: 1.15 * widest(calibrated, &single),
    };
    let rows = calibrated.quantities.len().div_ceil(COLUMNS);
    let height = HEAD + rows as f64 * PANEL.1 + FOOT;
    let mut svg = format!(
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" role="img" font-family="system-ui, sans-serif" font-size="11" fill="{INK}">
<rect width="100%" height="100%" fill="#ffffff"/>
"##
    );
    let is_uniform = |quantity: &QuantityJudgement| {
        let mut tests = quantity.seeds.iter().chain(&quantity.together);
        tests.all(|test| test.corrected_p > 1.0 - LEVEL)
    };
    let strays = calibrated
        .quantities
        .iter()
        .filter(|quantity| !is_uniform(quantity))
        .count();
    let finding = if strays == 0 {
        "the truth ranks uniformly among the draws".to_owned()
    } else {
        format!(
            "{strays} of {} quantities do not rank uniformly",
            calibrated.quantities.len()
        )
    };
    let title = format!(
        "{}, {}: {finding}",
        calibrated.design.id(),
        calibrated.experiment.model.label
    );
    text(
        &mut svg,
        (16.0, 22.0),
        "font-size=\"16\" font-weight=\"600\"",
        &title,
    );
    let subtitle = "Share of ranks below a value, less that value's share. Thin lines: one seed each, grey: their 99 % band.";
    text(
        &mut svg,
        (16.0, 40.0),
        &format!("fill=\"{INK_SOFT}\""),
        subtitle,
    );
    if together.is_some() {
        let second = "Bold line: all seeds together, dotted: its 99 % band.";
        text(
            &mut svg,
            (16.0, 54.0),
            &format!("fill=\"{INK_SOFT}\""),
            second,
        );
    }
    for (place, quantity) in calibrated.quantities.iter().enumerate() {
        let left = 16.0 + (place % COLUMNS) as f64 * PANEL.0;
        let top = HEAD + (place / COLUMNS) as f64 * PANEL.1;
        let _ = writeln!(svg, r#"<g transform="translate({left} {top})">"#);
        panel(
            &mut svg,
            calibrated,
            quantity,
            &scale,
            &single,
            together.as_ref(),
        );
        svg.push_str("</g>\n");
    }
    let seeds: Vec<String> = calibrated.seeds.iter().map(u64::to_string).collect();
    let caption = format!(
        "{} answers to each of {} problems, {} simulated studies for each of the seeds {}, {} draws each.",
        calibrated.experiment.people,
        calibrated.experiment.problems.len(),
        calibrated.replicates,
        seeds.join(", "),
        calibrated.experiment.settings.samples
    );
    text(
        &mut svg,
        (16.0, height - 12.0),
        &format!("fill=\"{INK_SOFT}\""),
        &caption,
    );
    svg.push_str("</svg>\n");
    svg
}

/// The bands of a number of ranks.
struct Band {
    size: usize,
    bands: Bands,
}

impl Band {
    fn new(size: usize, values: usize) -> Self {
        let bands = UniformRanks::new(size, values).bands(LEVEL);
        Self { size, bands }
    }
}

/// From ranks to places in a panel.
struct Scale {
    values: usize,
    /// The difference at the panel's upper edge.
    reach: f64,
}

impl Scale {
    const LEFT: f64 = MARGINS.0;
    const RIGHT: f64 = PANEL.0 - MARGINS.2;
    const TOP: f64 = MARGINS.1;
    const BOTTOM: f64 = PANEL.1 - MARGINS.3;

    fn x(&self, share: f64) -> f64 {
        Self::LEFT + share * (Self::RIGHT - Self::LEFT)
    }

    fn y(&self, difference: f64) -> f64 {
        let middle = 0.5 * (Self::TOP + Self::BOTTOM);
        middle - difference / self.reach * 0.5 * (Self::BOTTOM - Self::TOP)
    }

    /// The points of a line through counts of `size` ranks, from (0, 0) to (1, 0).
    fn points(&self, counts: &[usize], size: usize) -> Vec<String> {
        let inner = counts.iter().enumerate().map(|(place, count)| {
            let share = (place + 1) as f64 / self.values as f64;
            let difference = *count as f64 / size as f64 - share;
            format!("{:.1},{:.1}", self.x(share), self.y(difference))
        });
        let end = |share| format!("{:.1},{:.1}", self.x(share), self.y(0.0));
        std::iter::once(end(0.0))
            .chain(inner)
            .chain([end(1.0)])
            .collect()
    }
}

fn panel(
    svg: &mut String,
    calibrated: &Calibrated<'_>,
    quantity: &QuantityJudgement,
    scale: &Scale,
    single: &Band,
    together: Option<&Band>,
) {
    let model = calibrated.experiment.model;
    // The two models of the paper keep their colour and style in every figure.
    let (colour, dashes) = if model == &NOISY_RATIONAL {
        ("#5b6b7b", r#" stroke-dasharray="5 3""#)
    } else if model == &RISK_AWARE {
        ("#c4500a", "")
    } else {
        ("#0b5cad", "")
    };
    let name = quantity.quantity.to_string();
    text(svg, (Scale::LEFT, 12.0), "font-weight=\"600\"", &name);
    let mut outline = scale.points(&single.bands.high, single.size);
    outline.extend(
        scale
            .points(&single.bands.low, single.size)
            .into_iter()
            .rev(),
    );
    let _ = writeln!(
        svg,
        r#"<polygon points="{}" fill="{SURFACE}"/>"#,
        outline.join(" ")
    );
    let mut line = |points: Vec<String>, style: &str| {
        let _ = writeln!(
            svg,
            r#"<polyline points="{}" fill="none" {style}/>"#,
            points.join(" ")
        );
    };
    line(scale.points(&[], 1), &format!("stroke=\"{LINE}\""));
    for test in &quantity.seeds {
        let style = format!("stroke=\"{colour}\" stroke-opacity=\"0.6\"{dashes}");
        line(scale.points(&test.counts, single.size), &style);
    }
    if let Some((band, test)) = together.zip(quantity.together.as_ref()) {
        let style = format!("stroke=\"{REFERENCE}\" stroke-dasharray=\"1 3\"");
        line(scale.points(&band.bands.low, band.size), &style);
        line(scale.points(&band.bands.high, band.size), &style);
        let style = format!("stroke=\"{colour}\" stroke-width=\"2\"{dashes}");
        line(scale.points(&test.counts, band.size), &style);
    }
    let soft = format!("fill=\"{INK_SOFT}\" font-size=\"10\"");
    let tick = nice_tick(scale.reach);
    for (difference, label) in [
        (tick, format!("+{tick}")),
        (0.0, "0".to_owned()),
        (-tick, format!("\u{2212}{tick}")),
    ] {
        let style = format!("{soft} text-anchor=\"end\"");
        text(
            svg,
            (Scale::LEFT - 4.0, scale.y(difference) + 3.5),
            &style,
            &label,
        );
    }
    for (share, label) in [(0.0, "0"), (0.5, "0.5"), (1.0, "1")] {
        let style = format!("{soft} text-anchor=\"middle\"");
        text(svg, (scale.x(share), Scale::BOTTOM + 13.0), &style, label);
    }
}

/// The largest difference that a figure has to hold.
fn widest(calibrated: &Calibrated<'_>, single: &Band) -> f64 {
    let values = calibrated.experiment.rank_values() as f64;
    let lines = calibrated
        .quantities
        .iter()
        .flat_map(|quantity| &quantity.seeds);
    let lines = lines.map(|test| &test.counts);
    lines
        .chain([&single.bands.low, &single.bands.high])
        .flat_map(|counts| counts.iter().enumerate())
        .map(|(place, count)| {
            (*count as f64 / single.size as f64 - (place + 1) as f64 / values).abs()
        })
        .fold(0.0, f64::max)
}

/// The largest of 1, 2 and 5 times a power of ten that is at most 9/10 of the reach.
fn nice_tick(reach: f64) -> f64 {
    let power = 10_f64.powf((0.9 * reach).log10().floor());
    let times = 0.9 * reach / power;
    let step = [5.0, 2.0]
        .into_iter()
        .find(|step| *step <= times)
        .unwrap_or(1.0);
    // Rounded so that 0.05 is written as such.
    (step * power * 1e9).round() / 1e9
}

fn text(svg: &mut String, (x, y): (f64, f64), style: &str, text: &str) {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    let _ = writeln!(svg, r#"<text x="{x:.1}" y="{y:.1}" {style}>{text}</text>"#);
}
