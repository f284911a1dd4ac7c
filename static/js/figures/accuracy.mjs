import { cellLabel } from "./cells.mjs";
import { count, decimal, tick } from "./format.mjs";
import { modelStyles, referenceDash } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const models = ["risk_aware", "noisy_rational"];
const headHeight = 24;
const noteHeight = 18;
const lineHeight = 12;

/** How far each model's predictions are from the choices: ln KL per cell, pooled, and the paper's. */
export const accuracy = {
  needs: ["summary", "accuracy"],

  draw({ summary, accuracy }, { width, palette }) {
    const pooled = accuracy.pooled.map((row) => pooledRow(row, accuracy.paper));
    const measured = accuracy.cells.map((row) => cellRow(summary, row, accuracy.samples));
    const domain = domainOf(measured, pooled);
    const cells = measured.map((row) => (row.unanimous ? clipped(row, domain) : row));
    const panel = (title, rows) => ({ title, draw: (panelWidth) => drawPanel(rows, domain, panelWidth, palette) });
    const key = [
      { kind: "risk_aware", label: "Risk-Aware, mean ± sd" },
      { kind: "noisy_rational", label: "Noisy Rational, mean ± sd" },
    ];
    if (cells.some((row) => row.reference !== null)) key.push({ kind: "reference", label: "reference level" });
    if (pooled.some((row) => row.scores.some((score) => score.published))) key.push({ kind: "paper", label: "the paper, mean ± sd" });
    return sheet({
      width,
      palette,
      columns: 2,
      key,
      panels: [panel("Each cell", cells), panel("Pooled", pooled)].filter((_, index) => [cells, pooled][index].length > 0),
      label: "ln KL of both models in each cell and pooled; the table below holds the same numbers.",
    });
  },

  table({ summary, accuracy }) {
    const columns = [
      { label: "Cell" },
      { label: "n", numeric: true },
      { label: "Model" },
      { label: "ln KL, mean ± sd", numeric: true },
      { label: "Median", numeric: true },
      { label: "5–95 %", numeric: true },
      { label: "Exact draws", numeric: true },
      { label: "Reference", numeric: true },
    ];
    const rows = accuracy.cells.flatMap((row) =>
      models.map((model) => {
        const scored = row.models[model];
        return [
          labelOf(summary, row) + (row.unanimous ? " (unanimous)" : ""),
          count(row.n),
          modelStyles[model].name,
          meanSd(scored),
          decimal(scored?.median),
          scored && scored.q5 !== null ? `${decimal(scored.q5)} to ${decimal(scored.q95)}` : "–",
          count(scored?.zeros),
          row.unanimous ? "–" : decimal(row.reference),
        ];
      }),
    );
    return { columns, rows };
  },

  file({ accuracy }) {
    const quantities = ["mean", "sd", "median", "q5", "q95", "zeros"];
    const header = ["cell", "n", "unanimous", "reference", "model", ...quantities];
    const rows = accuracy.cells.flatMap((row) =>
      models.map((model) => [row.id, row.n, row.unanimous, row.reference, model, ...quantities.map((quantity) => row.models[model]?.[quantity])]),
    );
    return [header, ...rows];
  },
};

/** "−5.70 ± 3.30", or a dash where there is no fit. */
export function meanSd(scored, digits = 2) {
  if (!scored || scored.mean === null) return "–";
  return `${decimal(scored.mean, digits)} ± ${decimal(scored.sd, digits)}`;
}

function labelOf(summary, row) {
  const cell = summary.cells.find((candidate) => candidate.id === row.id);
  return cell ? cellLabel(summary, cell) : row.id;
}

function cellRow(summary, row, samples) {
  const notes = [];
  for (const model of models) {
    const scored = row.models[model];
    if (!scored) notes.push(`${modelStyles[model].name}: no converged fit yet`);
    else if (scored.mean === null) notes.push(`${modelStyles[model].name}: exact in ${scored.zeros} of ${samples}`);
  }
  const scores = models.map((model) => ({ model, ...row.models[model] })).filter(drawable);
  return { label: labelOf(summary, row), unanimous: row.unanimous, notes, scores, reference: row.unanimous ? null : row.reference };
}

function pooledRow(row, paper) {
  const published = paper?.find((candidate) => candidate.label === row.label);
  const scores = models.flatMap((model) => [
    { model, ...row.models[model] },
    { model, published: true, ...published?.[model] },
  ]);
  return { label: row.label, unanimous: false, notes: [], scores: scores.filter(drawable), reference: null };
}

function drawable(score) {
  return score.mean !== null && score.mean !== undefined;
}

/**
 * Where everybody chose the same, ln KL falls without limit as a model comes closer: such cells would squeeze
 * all others into a corner, so they set the scale only where there are no others.
 */
function domainOf(cells, pooled) {
  const contested = cells.filter((row) => !row.unanimous);
  const rows = contested.length > 0 ? [...contested, ...pooled] : [...cells, ...pooled];
  const values = rows.flatMap((row) => [
    ...row.scores.flatMap(({ mean, sd }) => [mean - sd, mean + sd]),
    ...(row.reference === null ? [] : [row.reference]),
  ]);
  return [Math.min(-1, ...values) - 0.5, Math.max(0, ...values)];
}

/** A unanimous cell cut at the ends of the scale; says so where something of it lies beyond. */
function clipped(row, [left, right]) {
  const beyond = row.scores.some(({ mean, sd }) => mean - sd < left || mean + sd > right);
  const scores = row.scores.map((score) => {
    const low = score.mean - score.sd;
    const high = score.mean + score.sd;
    const cut = [...(low < left ? [left] : []), ...(high > right ? [right] : [])];
    return { ...score, low: Math.max(low, left), high: Math.max(left, Math.min(high, right)), outside: score.mean < left, cut };
  });
  return { ...row, scores, notes: [beyond ? "unanimous: off the scale" : "unanimous: no reference level", ...row.notes] };
}

function drawPanel(rows, domain, width, palette) {
  const heads = [];
  const notes = [];
  const scores = [];
  const references = [];
  let y = 0;
  for (const row of rows) {
    heads.push({ y: y + headHeight / 2 + 1, text: row.label });
    row.notes.forEach((text, index) => notes.push({ y: y + headHeight + noteHeight * (index + 0.4), text }));
    const top = y + headHeight + noteHeight * row.notes.length;
    row.scores.forEach((score, index) => scores.push({ ...score, y: top + lineHeight * (index + 0.5) }));
    const lines = Math.max(2, row.scores.length);
    if (row.reference !== null) references.push({ x: row.reference, y1: top, y2: top + lineHeight * lines + 2 });
    y = top + lineHeight * lines + 12;
  }
  const bottom = 46;
  const options = (style, published) => {
    const color = palette[style.token];
    const data = scores.filter((score) => modelStyles[score.model] === style && Boolean(score.published) === published);
    const line = published
      ? { stroke: palette.reference, strokeDasharray: referenceDash, strokeLinecap: "round" }
      : { stroke: color, strokeDasharray: style.dash };
    const dot = published
      ? { symbol: "diamond", fill: palette.paper, stroke: color, r: 4 }
      : { symbol: style.symbol, fill: style.filled ? color : palette.paper, stroke: color, r: 4 };
    const arrows = data.flatMap((score) => (score.cut ?? []).map((x) => ({ x, y: score.y, turn: x === domain[0] ? -90 : 90 })));
    return [
      Plot.link(data, { x1: (d) => d.low ?? d.mean - d.sd, x2: (d) => d.high ?? d.mean + d.sd, y1: "y", y2: "y", strokeWidth: 2, ...line }),
      Plot.dot(arrows, { x: "x", y: "y", symbol: "triangle", rotate: "turn", r: 4, fill: dot.fill, stroke: color, strokeWidth: 2 }),
      Plot.dot(data.filter((score) => !score.outside), { x: "mean", y: "y", strokeWidth: 2, ...dot }),
    ];
  };
  const words = { frameAnchor: "left", dx: -8, y: "y", textAnchor: "start", text: "text", stroke: palette.paper, strokeWidth: 4 };
  return Plot.plot({
    width,
    height: y + bottom,
    marginLeft: 8,
    marginRight: 12,
    marginTop: 0,
    marginBottom: bottom,
    x: { domain },
    y: { domain: [y, 0], axis: null },
    marks: [
      Plot.gridX({ stroke: palette.line, strokeOpacity: 1, ticks: 5 }),
      Plot.axisX({ label: "ln KL (further left: closer to the choices)", labelArrow: "none", labelAnchor: "center", labelOffset: 42, ticks: 5, tickSize: 0, tickFormat: tick, color: palette["ink-soft"] }),
      Plot.link(references, { x1: "x", x2: "x", y1: "y1", y2: "y2", stroke: palette.reference, strokeWidth: 2.5, strokeDasharray: referenceDash, strokeLinecap: "round" }),
      ...models.flatMap((model) => [...options(modelStyles[model], false), ...options(modelStyles[model], true)]),
      Plot.text(heads, { ...words, fill: palette.ink }),
      Plot.text(notes, { ...words, fill: palette["ink-soft"] }),
    ],
  });
}
