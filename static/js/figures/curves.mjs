import { decimal } from "./format.mjs";
import { modelName, modelStyles } from "./palette.mjs";

const order = ["risk_aware", "noisy_rational"];
const quantities = ["mean", "q5", "q25", "q75", "q95", "prior_mean"];
const tableRows = 11;

/** The fits of the chosen plan, each with its label. */
export function partsOf(curves, plan) {
  return curves.plans.filter((entry) => entry.plan === plan);
}

/** Which fits the curves of a plan are made from. */
export function fitsOf(curves, plan) {
  const parts = partsOf(curves, plan).map((part) => [part.part, ...Object.entries(part.models).map(([model, { fit }]) => `${model} ${fit}`)]);
  return [plan, ...parts].join();
}

/** Says which model has no curve because its fit is not there yet. */
export function missingNote(part, models = order) {
  const missing = models.filter((model) => !part.models?.[model]).map((model) => modelStyles[model].name);
  return missing.length > 0 ? `No converged fit yet: ${missing.join(", ")}` : undefined;
}

/** The series of one quantity in every part and model that has it. */
export function collect(parts, name) {
  return parts.flatMap((part) =>
    Object.entries(part.models)
      .filter(([, fitted]) => fitted[name])
      .map(([model, fitted]) => ({ part, model, name, series: fitted[name] })),
  );
}

/** What is drawn: the paper's two models; tables and files hold all that the study fits. */
export function drawnOf(entries) {
  return entries.filter(({ model }) => order.includes(model));
}

/** A domain that holds all values, with zero inside and a little air. */
export function rangeOf(entries, names) {
  const values = entries.flatMap(({ series }) => names.flatMap((name) => series[name] ?? [])).filter((value) => value !== null);
  const low = Math.min(0, ...values);
  const high = Math.max(0, ...values);
  const air = (high - low || 1) * 0.04;
  return [low < 0 ? low - air : 0, high > 0 ? high + air : 0];
}

export function extentOf(entries) {
  const values = entries.flatMap(({ series }) => series.x);
  return values.length > 0 ? [Math.min(...values), Math.max(...values)] : [0, 1];
}

/** The table shows some points of each curve; the file holds all. */
export function curveTable(summary, entries, xLabel, xFormat) {
  const columns = [
    { label: "Fit" },
    { label: "Model" },
    { label: "Curve" },
    { label: xLabel, numeric: true },
    { label: "Mean", numeric: true },
    { label: "50 % posterior", numeric: true },
    { label: "90 % posterior", numeric: true },
    { label: "Prior mean", numeric: true },
  ];
  const rows = entries.flatMap(({ part, model, label, series }) =>
    spread(series.x.length).map((index) => [
      part.label,
      modelName(summary, model),
      label,
      xFormat(series.x[index]),
      decimal(series.mean[index], 3),
      `${decimal(series.q25[index], 3)} to ${decimal(series.q75[index], 3)}`,
      `${decimal(series.q5[index], 3)} to ${decimal(series.q95[index], 3)}`,
      decimal(series.prior_mean?.[index], 3),
    ]),
  );
  return { columns, rows };
}

export function curveFile(entries) {
  const header = ["plan", "part", "model", "curve", "x", ...quantities];
  const rows = entries.flatMap(({ part, model, name, series }) =>
    series.x.map((x, index) => [part.plan, part.part, model, name, x, ...quantities.map((quantity) => series[quantity]?.[index])]),
  );
  return [header, ...rows];
}

function spread(length) {
  if (length <= tableRows) return [...Array(length).keys()];
  return Array.from({ length: tableRows }, (_, index) => Math.round((index * (length - 1)) / (tableRows - 1)));
}
