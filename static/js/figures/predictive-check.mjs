import { cellLabel } from "./cells.mjs";
import { count, decimal, percent } from "./format.mjs";
import { styleOf, modelName } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const headHeight = 22;
const rowHeight = 26;

/** What people chose beside what as many people who choose as a model says would have chosen. */
export const predictiveCheck = {
  needs: ["summary", "accuracy"],

  draw({ summary, accuracy }, { width, palette }) {
    const models = new Set((accuracy.checks ?? []).flatMap((row) => Object.keys(row.models)));
    const panels = [...models]
      .map((model) => ({ model, rows: rowsOf(summary, accuracy, model) }))
      .filter(({ rows }) => rows.length > 0)
      .map(({ model, rows }) => ({ title: modelName(summary, model), draw: (panelWidth) => drawPanel(model, rows, panelWidth, palette) }));
    return sheet({
      width,
      palette,
      columns: 2,
      panels,
      label: "Observed shares beside replicated shares of each model; the table below holds the same numbers.",
    });
  },

  table({ summary, accuracy }) {
    const columns = [
      { label: "Cell" },
      { label: "Model" },
      { label: "Action" },
      { label: "n", numeric: true },
      { label: "Chosen", numeric: true },
      { label: "50 % replicated" },
      { label: "90 % replicated" },
      { label: "mid-p", numeric: true },
      { label: "Discrepancy p", numeric: true },
    ];
    const rows = each(accuracy).map(({ row, model, check, action }) => [
      label(summary, row.id),
      modelName(summary, model),
      actionLabel(summary, action.action),
      count(check.n),
      percent(action.observed),
      `${percent(action.q25)} to ${percent(action.q75)}`,
      `${percent(action.q5)} to ${percent(action.q95)}`,
      decimal(action.p),
      decimal(check.discrepancy_p),
    ]);
    return { columns, rows };
  },

  file({ accuracy }) {
    const quantities = ["observed", "q5", "q25", "q50", "q75", "q95", "p"];
    const header = ["cell", "model", "action", "n", "replications", ...quantities, "discrepancy_p"];
    const rows = each(accuracy).map(({ row, model, check, action }) => [
      row.id, model, action.action, check.n, check.replications, ...quantities.map((name) => action[name]), check.discrepancy_p,
    ]);
    return [header, ...rows];
  },
};

function each(accuracy) {
  return (accuracy.checks ?? []).flatMap((row) =>
    Object.entries(row.models).flatMap(([model, check]) =>
      (check?.actions ?? []).map((action) => ({ row, model, check, action })),
    ),
  );
}

function label(summary, id) {
  const cell = summary.cells.find((candidate) => candidate.id === id);
  return cell ? cellLabel(summary, cell) || id : id;
}

function actionLabel(summary, id) {
  return summary.actions.find((action) => action.id === id)?.label ?? id;
}

/** With two actions one share says both. */
function rowsOf(summary, accuracy, wanted) {
  return each(accuracy)
    .filter(({ model, check, action }) => model === wanted && (check.actions.length > 2 || action === check.actions.at(-1)))
    .map(({ row, action }) => ({ ...action, text: `${label(summary, row.id)}: ${actionLabel(summary, action.action)}` }));
}

function drawPanel(model, rows, width, palette) {
  const style = styleOf(model);
  const color = palette[style.token];
  const placed = rows.map((row, index) => ({ ...row, head: index * (headHeight + rowHeight) + headHeight / 2, y: index * (headHeight + rowHeight) + headHeight + 6 }));
  const height = rows.length * (headHeight + rowHeight);
  const bottom = 32;
  return Plot.plot({
    width,
    height: height + bottom,
    marginLeft: 16,
    marginRight: 76,
    marginTop: 0,
    marginBottom: bottom,
    x: { domain: [0, 1], label: null },
    y: { domain: [height, 0], axis: null },
    marks: [
      Plot.gridX([0, 0.25, 0.5, 0.75, 1], { stroke: palette.line, strokeOpacity: 1 }),
      Plot.axisX([0, 0.5, 1], { tickFormat: percent, tickSize: 0, color: palette["ink-soft"], label: null }),
      Plot.link(placed, { x1: "q5", x2: "q95", y1: "y", y2: "y", stroke: color, strokeWidth: 2, strokeDasharray: style.dash }),
      Plot.link(placed, { x1: "q25", x2: "q75", y1: "y", y2: "y", stroke: color, strokeWidth: 8, strokeOpacity: 0.45 }),
      Plot.dot(placed, { x: "observed", y: "y", r: 4.5, fill: palette.observed, stroke: palette.paper, strokeWidth: 1 }),
      Plot.text(placed, { frameAnchor: "left", dx: -16, y: "head", textAnchor: "start", text: "text", fill: palette.ink, stroke: palette.paper, strokeWidth: 4 }),
      Plot.text(placed, { frameAnchor: "right", dx: 74, y: "y", textAnchor: "end", text: (d) => `p = ${decimal(d.p)}`, fill: palette.ink, fontVariant: "tabular-nums" }),
    ],
  });
}
