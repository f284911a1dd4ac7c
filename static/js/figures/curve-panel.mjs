import { modelStyles, priorDash } from "./palette.mjs";
import { Plot } from "./plot.mjs";

const margins = { marginTop: 28, marginRight: 78, marginBottom: 46, marginLeft: 50 };
const labelHeight = 36;

/**
 * Curves of the models over one axis: posterior mean, 50 % and 90 % bands, the prior's mean dashed.
 * @param {object} options
 * @param {{model: string, series: object | null, x?: number[]}[]} options.curves
 * @param {{domain: number[], label: string, tickFormat: Function, ticks?: number}} options.x
 * @param {{domain: number[], label: string, tickFormat: Function}} options.y
 * @param {boolean} [options.identity] Noisy Rational's straight line from (0, 0) to (1, 1)
 * @param {string} options.hatch id of the pattern that fills Noisy Rational's band
 */
export function curvePanel({ curves, x, y, identity = false, hatch, width, palette }) {
  const height = Math.round(Math.min(320, Math.max(240, width * 0.72)));
  const drawn = curves.filter(({ series }) => series);
  const marks = [];
  const labels = [];

  if (y.domain[0] < 0 && y.domain[1] > 0) marks.push(Plot.ruleY([0], { stroke: palette["ink-soft"] }));
  if (x.domain[0] < 0 && x.domain[1] > 0) marks.push(Plot.ruleX([0], { stroke: palette["ink-soft"] }));

  if (identity) {
    const style = modelStyles.noisy_rational;
    marks.push(Plot.line([[0, 0], [1, 1]], { stroke: palette[style.token], strokeWidth: 2, strokeDasharray: style.dash }));
    labels.push({ style, at: 1, order: 0.8 });
  }
  for (const { model, series } of drawn) {
    const style = modelStyles[model];
    const points = rows(series);
    const color = palette[style.token];
    const outer = style.filled ? { fill: color, fillOpacity: 0.16 } : { fill: `url(#${hatch})` };
    const inner = style.filled ? { fillOpacity: 0.24 } : { fillOpacity: 0.16 };
    marks.push(
      Plot.areaY(points, { x: "x", y1: "q5", y2: "q95", ...outer }),
      Plot.areaY(points, { x: "x", y1: "q25", y2: "q75", fill: color, ...inner }),
      Plot.lineY(points.filter((point) => point.prior !== null), { x: "x", y: "prior", stroke: color, strokeWidth: 1.5, strokeDasharray: priorDash }),
      Plot.lineY(points, { x: "x", y: "mean", stroke: color, strokeWidth: 2.5, strokeDasharray: style.dash }),
    );
    const last = points.at(-1);
    labels.push({ style, at: last.mean, order: points[Math.floor(points.length * 0.8)].mean });
  }

  const plot = Plot.plot({
    width,
    height,
    ...margins,
    x: { domain: x.domain },
    y: { domain: y.domain },
    marks: [
      Plot.gridY({ stroke: palette.line, strokeOpacity: 1, ticks: 5 }),
      Plot.axisX({ label: x.label, labelArrow: "none", labelAnchor: "center", labelOffset: 42, tickFormat: x.tickFormat, ticks: x.ticks ?? 5, tickSize: 4, color: palette["ink-soft"] }),
      Plot.axisY({ label: y.label, labelArrow: "none", labelOffset: margins.marginLeft - 2, tickFormat: y.tickFormat, ticks: 5, tickSize: 0, color: palette["ink-soft"] }),
      ...marks,
      ...endLabels(labels, x.domain, y.domain, height, palette),
    ],
  });
  addHatch(plot, hatch, palette);
  return plot;
}

function rows(series) {
  return series.x.map((x, index) => ({
    x,
    mean: series.mean[index],
    q5: series.q5[index],
    q25: series.q25[index],
    q75: series.q75[index],
    q95: series.q95[index],
    prior: series.prior_mean?.[index] ?? null,
  }));
}

/** Names at the lines' ends, moved apart where the lines meet. */
function endLabels(labels, xDomain, yDomain, height, palette) {
  const top = margins.marginTop;
  const bottom = height - margins.marginBottom;
  const pixel = (value) => bottom - ((value - yDomain[0]) / (yDomain[1] - yDomain[0])) * (bottom - top);
  const placed = labels
    .map((label) => ({ ...label, wanted: pixel(label.at) }))
    .sort((a, b) => a.wanted - b.wanted || b.order - a.order);
  placed.forEach((label, index) => {
    const above = placed[index - 1];
    label.pixel = Math.max(label.wanted, above ? above.pixel + labelHeight : top + 6);
  });
  for (let index = placed.length - 1; index >= 0; index -= 1) {
    const limit = index === placed.length - 1 ? bottom - 6 : placed[index + 1].pixel - labelHeight;
    placed[index].pixel = Math.min(placed[index].pixel, limit);
  }
  return placed.map((label) =>
    Plot.text([label], {
      x: () => xDomain[1],
      y: "at",
      dx: 8,
      dy: label.pixel - label.wanted,
      text: () => label.style.shortName,
      textAnchor: "start",
      lineAnchor: "middle",
      lineHeight: 1.15,
      fill: palette[label.style.token],
      fontWeight: 600,
    }),
  );
}

/** The pattern that fills Noisy Rational's band. */
export function addHatch(plot, id, palette) {
  const space = "http://www.w3.org/2000/svg";
  const pattern = document.createElementNS(space, "pattern");
  const attributes = { id, width: 6, height: 6, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" };
  for (const [name, value] of Object.entries(attributes)) pattern.setAttribute(name, value);
  const line = document.createElementNS(space, "path");
  line.setAttribute("d", "M0 0V6");
  line.setAttribute("stroke", palette.noisy);
  line.setAttribute("stroke-width", "2");
  line.setAttribute("stroke-opacity", "0.45");
  pattern.append(line);
  const definitions = document.createElementNS(space, "defs");
  definitions.append(pattern);
  plot.prepend(definitions);
}
