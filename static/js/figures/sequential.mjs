import { planLabel } from "./caption.mjs";
import { count, decimal, moment, tick } from "./format.mjs";
import { modelName, modelStyles, referenceDash } from "./palette.mjs";
import { Plot } from "./plot.mjs";
import { sheet } from "./sheet.mjs";

const symbols = { alpha: "α", beta: "β", gamma: "γ", delta: "δ", lambda: "λ", theta: "θ", tau: "τ", eta_gain: "η⁺", eta_loss: "η⁻", lambda_theta: "λ·θ" };

/** The Bayes factor and the width of the followed interval against the number of people. */
export const sequential = {
  needs: ["summary", "sequential"],
  nothing: "Nothing to draw yet: too few people have finished for the first look.",

  draw({ summary, sequential: found }, { width, palette }) {
    const panels = [];
    const factors = found.looks.filter((look) => look.ln_bayes_factor !== null);
    if (factors.length > 0) {
      const [first, second] = found.models.map((model) => modelName(summary, model));
      panels.push({
        title: `Bayes factor, ${first} to ${second}`,
        draw: (panelWidth) => drawFactor(factors, found, panelWidth, palette),
      });
    }
    const widths = found.looks.filter((look) => look.width !== null);
    if (widths.length > 0) {
      const { model, quantity } = found.interval;
      panels.push({
        title: `Width of the 90 % interval of ${symbols[quantity] ?? quantity}, ${modelName(summary, model)}`,
        draw: (panelWidth) => drawWidth(widths, found, panelWidth, palette),
      });
    }
    return sheet({
      width,
      palette,
      columns: 2,
      panels,
      label: "Bayes factor and width of the followed interval against the number of people; the table below holds the same numbers.",
    });
  },

  table({ sequential: found }) {
    const columns = [
      { label: "People", numeric: true },
      { label: "Answers", numeric: true },
      { label: "ln Bayes factor ± error", numeric: true },
      { label: "90 % interval", numeric: true },
      { label: "Width", numeric: true },
    ];
    const rows = found.looks.map((look) => [
      count(look.n),
      count(look.answers),
      look.ln_bayes_factor ? `${decimal(look.ln_bayes_factor.value)} ± ${decimal(look.ln_bayes_factor.se)}` : "–",
      look.q5 === null ? "–" : `${decimal(look.q5)} to ${decimal(look.q95)}`,
      decimal(look.width, 3),
    ]);
    return { columns, rows };
  },

  file({ sequential: found }) {
    const header = ["people", "answers", "ln_bayes_factor", "ln_bayes_factor_se", "q5", "q95", "width"];
    return [header, ...found.looks.map((look) => [look.n, look.answers, look.ln_bayes_factor?.value, look.ln_bayes_factor?.se, look.q5, look.q95, look.width])];
  },

  caption({ summary, sequential: found, fetchedAt }) {
    const last = found.looks.at(-1);
    return [
      ...(summary.simulated ? ["Simulated data"] : []),
      last ? `latest look at ${count(last.n)} people, n = ${count(last.answers)} answers` : "no look yet",
      `looks from ${count(found.minimum)} people on, after each further ${count(found.check_every)}`,
      `fit: ${planLabel(summary, found.plan)}`,
      `data version ${found.data_version}, fit version ${found.fit_version}`,
      ...(fetchedAt ? [moment(fetchedAt)] : []),
    ].join(" · ");
  },
};


/** Powers of ten that people read: 1 to 100, 1 to 1, 100 to 1. */
function odds(ln) {
  const power = Math.round(ln / Math.LN10);
  if (power === 0) return "1";
  const size = Math.abs(power) > 4 ? `10${[...String(Math.abs(power))].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]).join("")}` : count(10 ** Math.abs(power));
  return power > 0 ? size : `1/${size}`;
}

function drawFactor(looks, { stopping }, width, palette) {
  const values = looks.flatMap(({ ln_bayes_factor: { value, se } }) => [value - 2 * se, value + 2 * se]);
  const bound = stopping?.rule.bayes_factor ?? null;
  const bounds = bound === null ? [] : [Math.log(bound), -Math.log(bound)].filter((y) => Math.abs(y) < 3 * Math.max(...values.map(Math.abs), 2));
  const lowest = Math.floor(Math.min(-Math.LN10, ...values, ...bounds) / Math.LN10);
  const highest = Math.ceil(Math.max(Math.LN10, ...values, ...bounds) / Math.LN10);
  const step = Math.ceil((highest - lowest) / 6);
  const ticks = [];
  for (let power = lowest; power <= highest; power += 1) if (power % step === 0) ticks.push(power * Math.LN10);
  const points = looks.map((look) => ({ n: look.n, y: look.ln_bayes_factor.value, se: look.ln_bayes_factor.se }));
  return drawLine(points, {
    width,
    palette,
    color: palette.ink,
    domain: [lowest * Math.LN10, highest * Math.LN10],
    ticks,
    tickFormat: odds,
    zero: true,
    bounds: bounds.map((y) => ({ y, text: `bound ${y > 0 ? bound : `1/${bound}`}` })),
    reached: stopping?.rule.bayes_factor ? stopping.reached_at : null,
    label: "odds",
  });
}

function drawWidth(looks, { stopping, interval }, width, palette) {
  const bound = stopping?.rule.width_below ?? null;
  const points = looks.map((look) => ({ n: look.n, y: look.width, se: 0 }));
  const style = modelStyles[interval.model] ?? { token: "ink" };
  return drawLine(points, {
    width,
    palette,
    color: palette[style.token],
    domain: [0, Math.max(...points.map((point) => point.y), bound ?? 0) * 1.08],
    tickFormat: tick,
    bounds: bound === null ? [] : [{ y: bound, text: `bound ${bound}` }],
    reached: bound === null ? null : stopping.reached_at,
    label: "width",
  });
}

function drawLine(points, { width, palette, color, domain, ticks, tickFormat, zero, bounds, reached, label }) {
  const height = Math.round(Math.min(300, Math.max(220, width * 0.6)));
  const people = points.map((point) => point.n);
  const [from, to] = [Math.min(...people), Math.max(...people)];
  const span = to > from ? [from, to] : [Math.max(0, from - 1), to + 1];
  const past = reached !== null && reached !== undefined && reached >= span[0] && reached <= span[1];
  return Plot.plot({
    width,
    height,
    marginTop: 28,
    marginRight: 16,
    marginBottom: 46,
    marginLeft: 58,
    x: { domain: span },
    y: { domain },
    marks: [
      Plot.gridY({ stroke: palette.line, strokeOpacity: 1, ticks: ticks ?? 5 }),
      Plot.axisX({ label: "people who finished", labelArrow: "none", labelAnchor: "center", labelOffset: 42, ticks: 5, tickFormat: (n) => (Number.isInteger(n) ? count(n) : ""), tickSize: 4, color: palette["ink-soft"] }),
      Plot.axisY({ label, labelArrow: "none", labelOffset: 56, ticks: ticks ?? 5, tickFormat, tickSize: 0, color: palette["ink-soft"] }),
      ...(zero ? [Plot.ruleY([0], { stroke: palette["ink-soft"] })] : []),
      Plot.ruleY(bounds, { y: "y", stroke: palette.reference, strokeWidth: 2, strokeDasharray: referenceDash, strokeLinecap: "round" }),
      Plot.text(bounds, { y: "y", frameAnchor: "right", textAnchor: "end", dy: -8, text: "text", fill: palette.reference, stroke: palette.paper, strokeWidth: 4 }),
      ...(past ? [Plot.ruleX([reached], { stroke: palette.reference, strokeWidth: 1.5 }), Plot.text([reached], { x: (n) => n, frameAnchor: "bottom", dy: -6, dx: reached > (span[0] + span[1]) / 2 ? -6 : 6, textAnchor: reached > (span[0] + span[1]) / 2 ? "end" : "start", text: (n) => `reached at ${n}`, fill: palette.reference, stroke: palette.paper, strokeWidth: 4 })] : []),
      Plot.link(points.filter((point) => point.se > 0), { x1: "n", x2: "n", y1: (d) => Math.max(domain[0], d.y - 2 * d.se), y2: (d) => Math.min(domain[1], d.y + 2 * d.se), stroke: color, strokeWidth: 1.5 }),
      Plot.line(points, { x: "n", y: "y", stroke: color, strokeWidth: 2 }),
      Plot.dot(points, { x: "n", y: "y", r: 3.5, fill: color }),
    ],
  });
}
