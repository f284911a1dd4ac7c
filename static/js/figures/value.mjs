import { curvePanel } from "./curve-panel.mjs";
import { collect, curveFile, curveTable, drawnOf, extentOf, missingNote, partsOf, rangeOf } from "./curves.mjs";
import { reward, tick } from "./format.mjs";
import { sheet } from "./sheet.mjs";

const order = ["noisy_rational", "risk_aware"];

/** A figure of subjective value over reward; `name` is the series, in logits or as shape alone. */
function valueFigure(name, axis, label) {
  const entries = (curves, plan) => collect(partsOf(curves, plan), name).map((entry) => ({ ...entry, label: axis }));
  return {
    needs: ["summary", "curves"],
    byPlan: true,

    draw({ summary, curves }, { width, palette, plan, id }) {
      const parts = partsOf(curves, plan);
      const all = drawnOf(entries(curves, plan));
      const unit = summary.study.reward_unit;
      const panels = parts.map((part) => ({
        title: part.label,
        note: missingNote(part),
        draw: (panelWidth) =>
          curvePanel({
            curves: order.map((model) => ({ model, series: part.models?.[model]?.[name] ?? null })),
            x: { domain: extentOf(all), label: `reward (${unit.name})`, tickFormat: reward(unit), ticks: 3 },
            y: { domain: rangeOf(all, ["q5", "q95", "mean", "prior_mean"]), label: axis, tickFormat: tick },
            hatch: `${id}-hatch`,
            width: panelWidth,
            palette,
          }),
      }));
      return sheet({ width, palette, columns: 2, panels, label });
    },

    table: ({ summary, curves }, { plan }) => curveTable(summary, entries(curves, plan), "Reward", reward(summary.study.reward_unit)),
    file: ({ curves }, { plan }) => curveFile(entries(curves, plan)),
  };
}

export const value = valueFigure(
  "value_logits",
  "value (logits)",
  "Value of a reward in logits under both models; the table below holds the same numbers.",
);

export const valueShape = valueFigure(
  "value_shape",
  "value, shape only",
  "Shape of the value function under both models; the table below holds the same numbers.",
);
