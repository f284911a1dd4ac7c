import { count, decimal, moment, tick } from "./format.mjs";
import { styleOf } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const rowHeight = 56;
const nothing = "Nothing to draw yet: the models have not been compared.";

/** What each richer model gains in predicting answers that it has not seen. */
export const ladder = {
  needs: ["summary", "reading"],
  nothing,

  draw({ reading }, { width, palette }) {
    const rungs = (reading.ladder?.rungs ?? []).filter((rung) => rung.per_answer !== null);
    if (rungs.length === 0) return null;
    const n = reading.ladder.n;
    return sheet({
      width,
      palette,
      columns: 1,
      panels: [{ title: "Log score per answer", draw: (panelWidth) => drawRungs(rungs, n, panelWidth, palette) }],
      label: "Log score per answer of each model, from chance to the richest; the table below holds the same numbers.",
    });
  },

  table({ reading }) {
    const columns = [
      { label: "Model" },
      { label: "Log score", numeric: true },
      { label: "Per answer", numeric: true },
      { label: "Gain over the step below ± SE", numeric: true },
      { label: "Reading" },
    ];
    const rows = (reading.ladder?.rungs ?? []).map((rung) => [
      rung.label,
      decimal(rung.score, 1),
      decimal(rung.per_answer, 3),
      gainText(rung),
      rung.distinguishable === null ? "–" : rung.distinguishable ? "beyond two standard errors" : "not distinguishable",
    ]);
    return { columns, rows };
  },

  file({ reading }) {
    const quantities = ["model", "score", "per_answer", "gain", "gain_se", "distinguishable"];
    return [quantities, ...(reading.ladder?.rungs ?? []).map((rung) => quantities.map((name) => rung[name]))];
  },

  caption({ summary, reading }) {
    const { ladder: found } = reading;
    if (!found) return null;
    return [
      ...(summary.simulated ? ["Simulated data"] : []),
      `n = ${count(found.n)} answers of ${count(found.units)} ${found.units_are}`,
      `${found.cells_left_out ? "cells" : found.units_are} left out at a time`,
      `fit: ${found.plan_label}`,
      `seed ${found.seed}`,
      moment(found.at),
    ].join(" · ");
  },
};

function gainText({ gain, gain_se: se }) {
  if (gain === null) return "–";
  return se === null ? "–" : `${decimal(gain, 1)} ± ${decimal(se, 1)}`;
}

function drawRungs(rungs, n, width, palette) {
  const rows = rungs.map((rung, index) => ({ ...rung, y: (index + 0.62) * rowHeight, style: styleOf(rung.model) }));
  const steps = rows.slice(1).map((row, index) => ({
    from: rows[index].per_answer,
    to: row.per_answer,
    y: row.y,
    y0: rows[index].y,
    se: row.gain_se === null ? 0 : (2 * row.gain_se) / n,
    color: palette[row.style.token],
    dash: row.distinguishable === false ? "3 3" : null,
    text: row.gain === null ? "" : `${row.gain >= 0 ? "+" : ""}${decimal(row.gain, 1)}${row.gain_se === null ? "" : ` ± ${decimal(row.gain_se, 1)}`}`,
  }));
  const all = [...rows.map((row) => row.per_answer), ...steps.flatMap((step) => [step.to - step.se, step.to + step.se])];
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const pad = (high - low || 0.1) * 0.06;
  const bottom = 46;
  // Half a tick's label stands out on either side.
  const side = 28;
  const ticks = width < 480 ? 3 : 5;
  const height = rows.length * rowHeight + bottom;
  const words = { frameAnchor: "left", dx: -side, textAnchor: "start", stroke: palette.paper, strokeWidth: 4 };
  return Plot.plot({
    width,
    height,
    marginLeft: side,
    marginRight: side,
    marginTop: 0,
    marginBottom: bottom,
    x: { domain: [low - pad, high + pad] },
    y: { domain: [rows.length * rowHeight, 0], axis: null },
    marks: [
      Plot.gridX({ stroke: palette.line, strokeOpacity: 1, ticks }),
      Plot.axisX({ label: "further right: better predicted", labelArrow: "none", labelAnchor: "center", labelOffset: 42, ticks, tickSize: 0, tickFormat: tick, color: palette["ink-soft"] }),
      ...steps.flatMap((step) => [
        Plot.link([step], { x1: "from", x2: "from", y1: "y0", y2: "y", stroke: palette["ink-soft"], strokeWidth: 1, strokeDasharray: "2 3" }),
        Plot.link([step], { x1: "from", x2: "to", y1: "y", y2: "y", stroke: step.color, strokeWidth: 3, strokeDasharray: step.dash }),
        Plot.link([step], { x1: (d) => d.to - d.se, x2: (d) => d.to + d.se, y1: (d) => d.y + 9, y2: (d) => d.y + 9, stroke: step.color, strokeWidth: 1.5 }),
      ]),
      ...rows.map((row) =>
        Plot.dot([row], { x: "per_answer", y: "y", r: 5, symbol: row.style.symbol, fill: row.style.filled ? palette[row.style.token] : palette.paper, stroke: palette[row.style.token], strokeWidth: 2 }),
      ),
      Plot.text(rows, { ...words, y: (d) => d.y - 22, text: "label", fill: palette.ink }),
      Plot.text(steps, { y: (d) => d.y - 22, frameAnchor: "right", dx: side, textAnchor: "end", text: "text", fill: palette["ink-soft"], stroke: palette.paper, strokeWidth: 4 }),
    ],
  });
}
