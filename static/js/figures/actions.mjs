import { cellLabel, levelLabel, panelsOfCells } from "./cells.mjs";
import { count, percent } from "./format.mjs";
import { linesOf, textWidth } from "./lines.mjs";
import { modelStyles } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const headHeight = 24;
const rowHeight = 48;
const rowHeightWithoutModels = 28;
const lineHeight = 17;
const nameGap = 8;
// Of a panel's width; longer names of actions take more lines.
const widestNames = 0.36;
const models = ["risk_aware", "noisy_rational"];

/** What people chose in each cell, beside what each fitted model predicts. */
export const actions = {
  needs: ["summary"],

  draw({ summary }, { width, palette }) {
    const panels = panelsOfCells(summary).map(({ title, cells }) => ({
      title,
      draw: (panelWidth) => drawPanel(summary, cells, panelWidth, palette),
    }));
    return sheet({
      width,
      palette,
      columns: 2,
      panels,
      key: [
        { kind: "observed", label: "people, 95 % Wilson interval" },
        { kind: "risk_aware", label: "Risk-Aware, 90 % posterior" },
        { kind: "noisy_rational", label: "Noisy Rational, 90 % posterior" },
      ],
      label: "Shares of the actions in each cell with the models' predictions; the table below holds the same numbers.",
    });
  },

  table({ summary }) {
    const columns = [
      { label: "Cell" },
      { label: "Action" },
      { label: "n", numeric: true },
      { label: "Chosen", numeric: true },
      { label: "95 % Wilson" },
      { label: "Risk-Aware (90 %)" },
      { label: "Noisy Rational (90 %)" },
    ];
    const rows = summary.cells.flatMap((cell) =>
      cell.actions.map((action) => [
        cellLabel(summary, cell),
        summary.actions.find((candidate) => candidate.id === action.id).label,
        count(cell.n),
        percent(action.share),
        action.low === null ? "–" : `${percent(action.low)} to ${percent(action.high)}`,
        ...models.map((model) => predictedText(cell.predicted?.[model]?.[action.id])),
      ]),
    );
    return { columns, rows };
  },

  file({ summary }) {
    const header = ["cell", "action", "cell_n", "late", "timed_out", "n", "share", "wilson_low", "wilson_high"];
    for (const model of models) header.push(`${model}_mean`, `${model}_q5`, `${model}_q95`);
    const rows = summary.cells.flatMap((cell) =>
      cell.actions.map((action) => [
        cell.id, action.id, cell.n, cell.late, cell.timed_out, action.n, action.share, action.low, action.high,
        ...models.flatMap((model) => {
          const predicted = cell.predicted?.[model]?.[action.id];
          return [predicted?.mean, predicted?.q5, predicted?.q95];
        }),
      ]),
    );
    return [header, ...rows];
  },
};

function predictedText(predicted) {
  return predicted ? `${percent(predicted.mean)} (${percent(predicted.q5)} to ${percent(predicted.q95)})` : "–";
}

/** Rows are laid out in pixels from the top: a head for each cell, then a row for each action. */
function drawPanel(summary, cells, width, palette) {
  const lines = new Map(summary.actions.map(({ id, label }) => [id, linesOf(label, width * widestNames)]));
  const marginLeft = Math.max(...[...lines.values()].flat().map(textWidth)) + nameGap + 2;
  const heads = [];
  const observed = [];
  const predicted = [];
  const names = [];
  let y = 0;
  for (const cell of cells) {
    heads.push({ y: y + headHeight / 2, text: headText(summary, cell) });
    y += headHeight;
    for (const action of cell.actions) {
      const name = lines.get(action.id);
      // The first row of marks stands beside the middle of the name.
      y += ((name.length - 1) * lineHeight) / 2;
      names.push({ y: y + 10, text: name.join("\n"), share: action.share });
      if (action.share !== null) observed.push({ ...action, y: y + 10 });
      models.forEach((model, index) => {
        const value = cell.predicted?.[model]?.[action.id];
        if (value) predicted.push({ ...value, model, y: y + 27 + 10 * index });
      });
      y += cell.fitted ? rowHeight : rowHeightWithoutModels + ((name.length - 1) * lineHeight) / 2;
    }
  }
  const bottom = 32;
  return Plot.plot({
    width,
    height: y + bottom,
    marginLeft,
    marginRight: 60,
    marginTop: 0,
    marginBottom: bottom,
    x: { domain: [0, 1], label: null },
    y: { domain: [y, 0], axis: null },
    marks: [
      Plot.gridX([0, 0.25, 0.5, 0.75, 1], { stroke: palette.line, strokeOpacity: 1 }),
      Plot.axisX([0, 0.5, 1], { tickFormat: percent, tickSize: 0, color: palette["ink-soft"], label: null }),
      Plot.rectX(observed, { x1: 0, x2: "share", y1: (d) => d.y - 8, y2: (d) => d.y + 8, fill: palette.observed, fillOpacity: 0.2 }),
      Plot.link(observed, { x1: "low", x2: "high", y1: "y", y2: "y", stroke: palette.observed, strokeWidth: 2 }),
      Plot.dot(observed, { x: "share", y: "y", r: 4, fill: palette.observed }),
      ...models.map((model) => interval(predicted.filter((d) => d.model === model), modelStyles[model], palette)).flat(),
      Plot.text(names, { frameAnchor: "left", y: "y", dx: -nameGap, lineHeight: lineHeight / 14, textAnchor: "end", text: "text", fill: palette.ink }),
      Plot.text(names, { frameAnchor: "right", y: "y", dx: 58, textAnchor: "end", text: (d) => percent(d.share), fill: palette.ink, fontVariant: "tabular-nums" }),
      Plot.text(heads, { frameAnchor: "left", dx: -marginLeft, y: "y", textAnchor: "start", text: "text", fill: palette["ink-soft"], stroke: palette.paper, strokeWidth: 4 }),
    ],
  });
}

function interval(data, style, palette) {
  const color = palette[style.token];
  return [
    Plot.link(data, { x1: "q5", x2: "q95", y1: "y", y2: "y", stroke: color, strokeWidth: 2, strokeDasharray: style.dash }),
    Plot.dot(data, { x: "mean", y: "y", r: 3.5, symbol: style.symbol, fill: style.filled ? color : palette.paper, stroke: color, strokeWidth: 2 }),
  ];
}

function headText(summary, cell) {
  const first = summary.factors[0];
  const parts = first ? [`${first.label}: ${levelLabel(summary, first.id, cell.levels[first.id]).toLowerCase()}`] : [];
  parts.push(`n = ${count(cell.n)}`);
  if (!cell.fitted) parts.push("not fitted");
  return parts.join(", ");
}
