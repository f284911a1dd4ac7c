//! Sweeps as a drawing that stands alone: the results page's figures, for papers and slides.

use std::fmt::Write;

use super::sweep::Report;
use crate::model::{ChoiceModel, NOISY_RATIONAL, RISK_AWARE, model_named};

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 440.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 150.0;
const TOP: f64 = 84.0;
const BOTTOM: f64 = 76.0;
const INK: &str = "#1b1f24";
const SOFT: &str = "#59636e";
const LINE: &str = "#d5dae0";
const REFERENCE: &str = "#8a6d00";
/// For models that have no colour of their own on pages.
const OTHERS: [&str; 3] = ["#0b5cad", "#1a7f37", "#7a3e9d"];

/// One curve with its spread.
struct Curve {
    label: String,
    colour: String,
    dash: &'static str,
    points: Vec<Mark>,
}

struct Mark {
    x: f64,
    mean: f64,
    spread: f64,
    hollow: bool,
}

struct Figure {
    title: String,
    subtitle: String,
    caption: String,
    x_label: String,
    y_label: &'static str,
    level: Option<(f64, &'static str)>,
    curves: Vec<Curve>,
}

/// The sweep as SVG.
pub(super) fn svg(report: &Report) -> String {
    draw(&figure(report))
}

fn figure(report: &Report) -> Figure {
    match report {
        Report::Share(report) => {
            let curve = |(index, id): (usize, &String)| {
                let (label, colour, dash) = style(id, index);
                let marks = report.points.iter().filter_map(|point| {
                    let score = point.models.get(id)?;
                    Some(Mark {
                        x: point.share,
                        mean: score.ln_kl.mean?,
                        spread: score.ln_kl.sd?,
                        hollow: point.unanimous,
                    })
                });
                Curve {
                    label,
                    colour,
                    dash,
                    points: marks.collect(),
                }
            };
            Figure {
                title: "Which model follows people who do not choose what is best?".to_owned(),
                subtitle: "ln KL from simulated answers to each model’s predictions (lower is closer), mean ± sd; hollow: all answers the same, smoothed".to_owned(),
                caption: format!(
                    "{} · n = {} · {} seeds from {} · {} draws each · riskaware {}",
                    report.problem, report.n, report.head.seeds, report.head.seed, report.head.samples, env!("CARGO_PKG_VERSION")
                ),
                x_label: format!("share of {} (the rest: {})", report.action, report.rest),
                y_label: "ln KL",
                level: Some((report.reference_level, "reference level")),
                curves: report.head.models.iter().enumerate().map(curve).collect(),
            }
        }
        Report::Gap(report) => {
            let first = report.head.models.first().map_or("", String::as_str);
            let mut curves = Vec::new();
            for series in &report.series {
                for (index, id) in report.head.models.iter().enumerate().skip(1) {
                    let (label, colour, dash) = style(id, index);
                    let marks = series.points.iter().filter_map(|point| {
                        let difference = point.difference.get(id)?;
                        Some(Mark {
                            x: point.gap,
                            mean: difference.mean?,
                            spread: difference.sd?,
                            hollow: point.unanimous,
                        })
                    });
                    let place = if report.series.len() > 1 {
                        format!("{label}, {}", series.problem)
                    } else {
                        label
                    };
                    curves.push(Curve {
                        label: place,
                        colour,
                        dash,
                        points: marks.collect(),
                    });
                }
            }
            let held = report
                .series
                .first()
                .map_or("", |series| series.held.as_str());
            Figure {
                title: "Where does it matter which model one takes?".to_owned(),
                subtitle: format!(
                    "ln KL of {first} minus ln KL of the other (above 0 the other is closer), mean ± sd"
                ),
                caption: format!(
                    "{} · {} seeds from {} · {} draws each · riskaware {}",
                    report.vary,
                    report.head.seeds,
                    report.head.seed,
                    report.head.samples,
                    env!("CARGO_PKG_VERSION")
                ),
                x_label: format!("expected reward of {held} minus the best other"),
                y_label: "difference in ln KL",
                level: Some((0.0, "equally close")),
                curves,
            }
        }
    }
}

fn style(id: &str, index: usize) -> (String, String, &'static str) {
    let label = model_named(id).map_or_else(
        |_| id.to_owned(),
        |model: &ChoiceModel| model.label.to_owned(),
    );
    if id == RISK_AWARE.id {
        (label, "#c4500a".to_owned(), "none")
    } else if id == NOISY_RATIONAL.id {
        (label, "#5b6b7b".to_owned(), "5 3")
    } else {
        (label, OTHERS[index % OTHERS.len()].to_owned(), "8 2")
    }
}

fn draw(figure: &Figure) -> String {
    let marks = || figure.curves.iter().flat_map(|curve| &curve.points);
    let span = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if low < high {
            (low, high)
        } else {
            (low.min(0.0), low.min(0.0) + 1.0)
        }
    };
    let xs = span(marks().map(|mark| mark.x).collect());
    let level = figure.level.iter().map(|(y, _)| *y);
    let ys = span(
        marks()
            .flat_map(|mark| [mark.mean - mark.spread, mark.mean + mark.spread])
            .chain(level)
            .collect(),
    );
    let x = |value: f64| LEFT + (value - xs.0) / (xs.1 - xs.0) * (WIDTH - LEFT - RIGHT);
    let y = |value: f64| HEIGHT - BOTTOM - (value - ys.0) / (ys.1 - ys.0) * (HEIGHT - TOP - BOTTOM);
    let mut svg = format!(
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif" font-size="13" fill="{INK}"><rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>"##
    );
    let mut words = |x: f64, y: f64, attributes: &str, text: &str| {
        let _ = write!(
            svg,
            r#"<text x="{x:.1}" y="{y:.1}" {attributes}>{}</text>"#,
            escaped(text)
        );
    };
    words(
        24.0,
        34.0,
        r#"font-size="19" font-weight="600""#,
        &figure.title,
    );
    words(
        24.0,
        56.0,
        &format!(r#"fill="{SOFT}" font-size="12""#),
        &figure.subtitle,
    );
    words(
        24.0,
        HEIGHT - 14.0,
        &format!(r#"fill="{SOFT}" font-size="12""#),
        &figure.caption,
    );
    let middle = (LEFT + WIDTH - RIGHT) / 2.0;
    words(
        middle,
        HEIGHT - 38.0,
        &format!(r#"fill="{SOFT}" text-anchor="middle""#),
        &figure.x_label,
    );
    words(
        24.0,
        TOP - 10.0,
        &format!(r#"fill="{SOFT}""#),
        figure.y_label,
    );
    for tick in ticks(xs) {
        let label = format!("{}", (tick * 1e6).round() / 1e6).replace('-', "\u{2212}");
        words(
            x(tick),
            HEIGHT - BOTTOM + 18.0,
            &format!(r#"fill="{SOFT}" text-anchor="middle""#),
            &label,
        );
    }
    for tick in ticks(ys) {
        let label = format!("{}", (tick * 1e6).round() / 1e6).replace('-', "\u{2212}");
        words(
            LEFT - 8.0,
            y(tick) + 4.0,
            &format!(r#"fill="{SOFT}" text-anchor="end""#),
            &label,
        );
    }
    // Names at the ends of the curves, moved apart.
    let mut ends: Vec<(f64, f64, String, String)> = figure
        .curves
        .iter()
        .filter_map(|curve| {
            let last = curve
                .points
                .iter()
                .max_by(|left, right| left.x.total_cmp(&right.x))?;
            Some((
                y(last.mean),
                x(last.x),
                curve.label.clone(),
                curve.colour.clone(),
            ))
        })
        .collect();
    if let Some((value, name)) = figure.level {
        ends.push((
            y(value),
            WIDTH - RIGHT,
            name.to_owned(),
            REFERENCE.to_owned(),
        ));
    }
    ends.sort_by(|left, right| left.0.total_cmp(&right.0));
    let mut above = f64::NEG_INFINITY;
    for (at, from, label, colour) in ends {
        let at = at.max(above + 16.0);
        above = at;
        words(
            from + 8.0,
            at + 4.0,
            &format!(r#"fill="{colour}" font-weight="600" font-size="12""#),
            &label,
        );
    }
    for tick in ticks(ys) {
        let _ = write!(
            svg,
            r#"<path d="M{LEFT} {0:.1}H{1}" stroke="{LINE}"/>"#,
            y(tick),
            WIDTH - RIGHT
        );
    }
    if let Some((value, _)) = figure.level {
        let _ = write!(
            svg,
            r#"<path d="M{LEFT} {:.1}H{}" stroke="{REFERENCE}" stroke-width="2" stroke-dasharray="1 4" stroke-linecap="round"/>"#,
            y(value),
            WIDTH - RIGHT
        );
    }
    for curve in &figure.curves {
        let colour = &curve.colour;
        let inner: Vec<&Mark> = curve.points.iter().filter(|mark| !mark.hollow).collect();
        if let (Some(first), false) = (inner.first(), inner.len() < 2) {
            let mut band = format!("M{:.1} {:.1}", x(first.x), y(first.mean - first.spread));
            let lower = inner
                .iter()
                .skip(1)
                .map(|mark| (mark.x, mark.mean - mark.spread));
            let upper = inner
                .iter()
                .rev()
                .map(|mark| (mark.x, mark.mean + mark.spread));
            for (at, value) in lower.chain(upper) {
                let _ = write!(band, "L{:.1} {:.1}", x(at), y(value));
            }
            let _ = write!(
                svg,
                r#"<path d="{band}Z" fill="{colour}" fill-opacity="0.14"/>"#
            );
            let points: Vec<String> = inner
                .iter()
                .map(|mark| format!("{:.1},{:.1}", x(mark.x), y(mark.mean)))
                .collect();
            let _ = write!(
                svg,
                r#"<polyline points="{}" fill="none" stroke="{colour}" stroke-width="2.5" stroke-dasharray="{}"/>"#,
                points.join(" "),
                curve.dash
            );
        }
        for mark in curve.points.iter().filter(|mark| mark.hollow) {
            let _ = write!(
                svg,
                r##"<circle cx="{:.1}" cy="{:.1}" r="4.5" fill="#ffffff" stroke="{colour}" stroke-width="2"/>"##,
                x(mark.x),
                y(mark.mean)
            );
        }
    }
    svg.push_str("</svg>\n");
    svg
}

/// About five round numbers within a range.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let rough = (high - low) / 5.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(rough);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|index| index as f64 * step).collect()
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
    fn ticks_are_round_and_inside() {
        assert_eq!(
            ticks((0.0, 1.0)),
            [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]
        );
        assert_eq!(ticks((-449.0, 449.0)), [-400.0, -200.0, 0.0, 200.0, 400.0]);
    }

    #[test]
    fn names_from_files_cannot_break_the_drawing() {
        assert_eq!(escaped("<a & b>"), "&lt;a &amp; b&gt;");
    }
}
