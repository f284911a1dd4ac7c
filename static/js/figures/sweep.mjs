import { addHatch } from "./curve-panel.mjs";
import { decimal, percent, tick } from "./format.mjs";
import { modelStyles, referenceDash } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const models = ["risk_aware", "noisy_rational"];
const widest = 760;

/** ln KL of both models against the share of the suboptimal action. */
export const sweep = {
  needs: ["summary", "sweep"],

  draw({ summary, sweep: { result, labels } }, { width, palette, id }) {
    const shown = Math.min(width, widest);
    const name = actionLabel(summary, result.action);
    return sheet({
      width: shown,
      palette,
      columns: 1,
      key: [
        { kind: "risk_aware", label: "Risk-Aware, mean ± sd" },
        { kind: "noisy_rational", label: "Noisy Rational, mean ± sd" },
        { kind: "reference", label: "reference level" },
      ],
      panels: [{ title: labels[result.problem] ?? result.problem, draw: (panelWidth) => drawPanel(result, name, panelWidth, palette, id) }],
      label: `ln KL of both models against the share of ${name}; the table below holds the same numbers.`,
    });
  },

  caption({ sweep: { result } }) {
    const left = result.points.reduce((sum, point) => sum + models.reduce((of, model) => of + (point.models[model]?.unconverged ?? 0), 0), 0);
    return [`Simulated answers, n = ${result.n} at each point`, ...made(result), ...(left > 0 ? [`${left} fits without convergence left out`] : [])].join(" · ");
  },

  table({ sweep: { result } }) {
    const columns = [
      { label: "Share" },
      { label: "Answers", numeric: true },
      { label: "Risk-Aware, ln KL", numeric: true },
      { label: "Noisy Rational, ln KL", numeric: true },
      { label: "Reference", numeric: true },
    ];
    const rows = result.points.map((point) => [
      percent(point.share) + (point.unanimous ? " (smoothed)" : ""),
      `${point.count} of ${result.n}`,
      ...models.map((model) => meanSd(point.models[model]?.ln_kl)),
      point.unanimous ? "–" : decimal(result.reference_level),
    ]);
    return { columns, rows };
  },

  file({ sweep: { result } }) {
    const header = ["problem", "action", "n", "count", "share", "unanimous", "reference", "model", "mean", "sd", "standard_error", "unconverged"];
    const rows = result.points.flatMap((point) =>
      Object.entries(point.models).map(([model, score]) => [
        result.problem, result.action, result.n, point.count, point.share, point.unanimous, point.unanimous ? null : result.reference_level,
        model, score.ln_kl.mean, score.ln_kl.sd, score.standard_error, score.unconverged,
      ]),
    );
    return [header, ...rows];
  },
};

/** How a sweep was made, for captions. */
export function made(result) {
  return [`${result.seeds} seeds from ${result.seed}`, `${result.samples} draws of each fit`];
}

export function meanSd(score) {
  return score && score.mean !== null ? `${decimal(score.mean)} ± ${decimal(score.sd)}` : "–";
}

export function actionLabel(summary, id) {
  return summary.actions.find((action) => action.id === id)?.label ?? id;
}

function drawPanel(result, name, width, palette, id) {
  const height = Math.round(Math.min(400, Math.max(280, width * 0.55)));
  const marks = [];
  for (const model of models) {
    const style = modelStyles[model];
    const color = palette[style.token];
    const points = result.points
      .map((point) => ({ ...point.models[model]?.ln_kl, share: point.share, hollow: point.unanimous }))
      .filter((point) => typeof point.mean === "number");
    const inner = points.filter((point) => !point.hollow);
    const outer = points.filter((point) => point.hollow);
    const fill = style.filled ? { fill: color, fillOpacity: 0.16 } : { fill: `url(#${id}-hatch)` };
    marks.push(
      Plot.areaY(inner, { x: "share", y1: (d) => d.mean - d.sd, y2: (d) => d.mean + d.sd, ...fill }),
      Plot.lineY(inner, { x: "share", y: "mean", stroke: color, strokeWidth: 2.5, strokeDasharray: style.dash }),
      Plot.link(outer, { x1: "share", x2: "share", y1: (d) => d.mean - d.sd, y2: (d) => d.mean + d.sd, stroke: color, strokeWidth: 2, strokeDasharray: style.dash }),
      Plot.dot(outer, { x: "share", y: "mean", r: 4.5, symbol: style.symbol, fill: palette.paper, stroke: color, strokeWidth: 2 }),
    );
    const last = inner.at(-1);
    if (last) {
      marks.push(Plot.text([last], { x: () => 1, y: "mean", dx: 12, text: () => style.shortName, textAnchor: "start", lineAnchor: "middle", lineHeight: 1.15, fill: color, fontWeight: 600 }));
    }
  }
  const plot = Plot.plot({
    width,
    height,
    marginLeft: 50,
    marginRight: 92,
    marginTop: 12,
    marginBottom: 46,
    x: { domain: [0, 1] },
    y: { nice: true },
    marks: [
      Plot.gridY({ stroke: palette.line, strokeOpacity: 1, ticks: 6 }),
      Plot.axisX({ label: `share of people who choose “${name}”`, labelArrow: "none", labelAnchor: "center", labelOffset: 42, tickFormat: percent, ticks: 5, tickSize: 4, color: palette["ink-soft"] }),
      Plot.axisY({ label: "ln KL", labelArrow: "none", labelOffset: 46, tickFormat: tick, ticks: 6, tickSize: 0, color: palette["ink-soft"] }),
      ...marks,
      Plot.link([result.reference_level], { x1: 0, x2: 1, y1: (d) => d, y2: (d) => d, stroke: palette.reference, strokeWidth: 2.5, strokeDasharray: referenceDash, strokeLinecap: "round" }),
    ],
  });
  addHatch(plot, `${id}-hatch`, palette);
  return plot;
}
