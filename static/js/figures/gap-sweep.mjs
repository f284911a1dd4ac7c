import { decimal, reward, tick } from "./format.mjs";
import { modelStyles } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";
import { actionLabel, made, meanSd } from "./sweep.mjs";

const model = "risk_aware";
const widest = 760;

/** How much closer Risk-Aware comes than Noisy Rational, against the gap of expected rewards. */
export const gapSweep = {
  needs: ["summary", "gap_sweep"],

  draw({ summary, gap_sweep: { result, labels } }, { width, palette }) {
    const shown = Math.min(width, widest);
    const held = actionLabel(summary, result.series[0].held);
    return sheet({
      width: shown,
      palette,
      columns: 1,
      panels: [{ title: `Held fixed: ${pattern(summary, result)}`, draw: (panelWidth) => drawPanel(summary, result, labels, held, panelWidth, palette) }],
      label: "Difference in ln KL between the models against the gap of expected rewards; the table below holds the same numbers.",
    });
  },

  caption: ({ summary, gap_sweep: { result } }) => ["Simulated answers", pattern(summary, result), `varies: ${result.vary}`, ...made(result)].join(" · "),

  table({ summary, gap_sweep: { result, labels } }) {
    const money = reward(summary.study.reward_unit);
    const columns = [
      { label: "Problem" },
      { label: "Value", numeric: true },
      { label: "Gap", numeric: true },
      { label: "Risk-Aware, ln KL", numeric: true },
      { label: "Noisy Rational, ln KL", numeric: true },
      { label: "Risk-Aware closer by", numeric: true },
    ];
    const rows = result.series.flatMap((series) =>
      series.points.map((point) => [
        labels[series.problem] ?? series.problem,
        money(rounded(point.value)),
        money(rounded(point.gap)),
        meanSd(point.models.risk_aware?.ln_kl),
        meanSd(point.models.noisy_rational?.ln_kl),
        meanSd(point.difference[model]),
      ]),
    );
    return { columns, rows };
  },

  file({ gap_sweep: { result } }) {
    const header = ["problem", "held", "value", "gap", "answers", "model", "mean", "sd", "standard_error", "unconverged", "closer_by", "closer_by_sd", "closer_by_standard_error"];
    const rows = result.series.flatMap((series) =>
      series.points.flatMap((point) =>
        Object.entries(point.models).map(([id, score]) => {
          const difference = point.difference[id];
          return [
            series.problem, series.held, rounded(point.value), rounded(point.gap), point.counts.join(":"), id,
            score.ln_kl.mean, score.ln_kl.sd, score.standard_error, score.unconverged, difference?.mean, difference?.sd, difference?.standard_error,
          ];
        }),
      ),
    );
    return [header, ...rows];
  },
};

export function rounded(value) {
  return Math.round(value * 1e6) / 1e6 + 0;
}

/** "25 of 30 choose Stop", from the first point. */
function pattern(summary, result) {
  const { held, points } = result.series[0];
  const counts = points[0].counts;
  const most = Math.max(...counts);
  return `${most} of ${counts.reduce((sum, count) => sum + count, 0)} choose ${actionLabel(summary, held)}`;
}

function drawPanel(summary, result, labels, held, width, palette) {
  const height = Math.round(Math.min(380, Math.max(280, width * 0.5)));
  const style = modelStyles[model];
  const color = palette[style.token];
  const money = reward(summary.study.reward_unit);
  const marks = [];
  for (const series of result.series) {
    const points = series.points
      .map((point) => ({ gap: point.gap, ...point.difference[model] }))
      .filter((point) => typeof point.mean === "number")
      .sort((a, b) => a.gap - b.gap);
    if (points.length === 0) continue;
    marks.push(
      Plot.areaY(points, { x: "gap", y1: (d) => d.mean - d.sd, y2: (d) => d.mean + d.sd, fill: color, fillOpacity: 0.16 }),
      Plot.lineY(points, { x: "gap", y: "mean", stroke: color, strokeWidth: 2.5 }),
      Plot.dot(points, { x: "gap", y: "mean", r: 3, fill: color }),
    );
    const isLeft = points[0].gap + points.at(-1).gap < 0;
    marks.push(
      Plot.text([labels[series.problem] ?? series.problem], { frameAnchor: isLeft ? "top-left" : "top-right", dx: isLeft ? 6 : -6, dy: 4, textAnchor: isLeft ? "start" : "end", fill: palette.ink, stroke: palette.paper, strokeWidth: 4 }),
    );
  }
  return Plot.plot({
    width,
    height,
    marginLeft: 50,
    marginRight: 24,
    marginTop: 30,
    marginBottom: 46,
    y: { nice: true },
    marks: [
      Plot.gridY({ stroke: palette.line, strokeOpacity: 1, ticks: 6 }),
      Plot.ruleY([0], { stroke: palette["ink-soft"] }),
      Plot.ruleX([0], { stroke: palette["ink-soft"] }),
      Plot.axisX({ label: width < 480 ? `gap: ${held} minus the other` : `gap: expected reward of ${held} minus that of the other`, labelArrow: "none", labelAnchor: "center", labelOffset: 42, tickFormat: money, ticks: width < 480 ? 4 : 8, tickSize: 4, color: palette["ink-soft"] }),
      Plot.axisY({ label: "Risk-Aware closer by (ln KL)", labelArrow: "none", labelOffset: 46, tickFormat: tick, ticks: 6, tickSize: 0, color: palette["ink-soft"] }),
      ...marks,
    ],
  });
}
