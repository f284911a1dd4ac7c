import { count, moment, percent, reward } from "./format.mjs";
import { rounded } from "./gap-sweep.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const widest = 760;
const spacing = 14;

/** How many people of the study chose what is best, against how much better it is. */
export const optimal = {
  needs: ["summary", "observed"],

  draw({ summary, observed: { observed } }, { width, palette }) {
    const shown = Math.min(width, widest);
    const answered = observed.filter((row) => row.share !== null);
    return sheet({
      width: shown,
      palette,
      columns: 1,
      panels: answered.length > 0 ? [{ title: "This study’s people", draw: (panelWidth) => drawPanel(summary, answered, panelWidth, palette) }] : [],
      label: "Share of optimal choices against the gap of expected rewards; the table below holds the same numbers.",
    });
  },

  caption({ summary, observed: { observed }, fetchedAt }) {
    const n = observed.reduce((sum, row) => sum + row.n, 0);
    return [...(summary.simulated ? ["Simulated data"] : []), `n = ${count(n)} answers`, `data version ${summary.data_version}`, moment(fetchedAt)].join(" · ");
  },

  table({ summary, observed: { observed } }) {
    const money = reward(summary.study.reward_unit);
    const columns = [
      { label: "Question" },
      { label: "Kind" },
      { label: "Gap", numeric: true },
      { label: "n", numeric: true },
      { label: "Optimal", numeric: true },
      { label: "95 % Wilson" },
    ];
    const rows = observed.map((row) => [
      row.label,
      row.baseline ? "baseline" : "cell",
      money(rounded(row.gap)),
      count(row.n),
      percent(row.share),
      row.low === null ? "–" : `${percent(row.low)} to ${percent(row.high)}`,
    ]);
    return { columns, rows };
  },

  file({ observed: { observed } }) {
    const header = ["question", "baseline", "gap", "optimal", "n", "n_optimal", "share", "wilson_low", "wilson_high"];
    return [header, ...observed.map((row) => [row.id, row.baseline, rounded(row.gap), row.optimal, row.n, row.n_optimal, row.share, row.low, row.high])];
  },
};

function drawPanel(summary, rows, width, palette) {
  const margins = { marginLeft: 50, marginRight: 24, marginTop: 30, marginBottom: 46 };
  const right = Math.max(...rows.map((row) => row.gap)) * 1.08 || 1;
  const unitsPerPixel = right / (width - margins.marginLeft - margins.marginRight);
  const groups = Map.groupBy([...rows], (row) => rounded(row.gap));
  const points = [...groups.values()].flatMap((group) =>
    group.map((row, index) => ({ ...row, x: row.gap + (index - (group.length - 1) / 2) * spacing * unitsPerPixel })),
  );
  const left = Math.min(0, ...points.map((point) => point.x - 8 * unitsPerPixel));
  return Plot.plot({
    width,
    height: Math.round(Math.min(340, Math.max(260, width * 0.45))),
    ...margins,
    x: { domain: [left, Math.max(right, ...points.map((point) => point.x + 8 * unitsPerPixel))] },
    y: { domain: [0, 1] },
    marks: [
      Plot.gridY([0, 0.25, 0.5, 0.75, 1], { stroke: palette.line, strokeOpacity: 1 }),
      Plot.ruleY([0.5], { stroke: palette["ink-soft"] }),
      Plot.axisX({ label: width < 480 ? "how much better it is" : "highest expected reward minus the second highest", labelArrow: "none", labelAnchor: "center", labelOffset: 42, tickFormat: reward(summary.study.reward_unit), ticks: 5, tickSize: 4, color: palette["ink-soft"] }),
      Plot.axisY([0, 0.25, 0.5, 0.75, 1], { label: "optimal choices", labelArrow: "none", labelOffset: 46, tickFormat: percent, tickSize: 0, color: palette["ink-soft"] }),
      Plot.link(points, { x1: "x", x2: "x", y1: "low", y2: "high", stroke: palette.observed, strokeWidth: 2 }),
      Plot.dot(points, { x: "x", y: "share", r: 4.5, fill: (d) => (d.baseline ? palette.paper : palette.observed), stroke: palette.observed, strokeWidth: 2 }),
    ],
  });
}
