import { curvePanel } from "./curve-panel.mjs";
import { collect, curveFile, curveTable, missingNote, partsOf } from "./curves.mjs";
import { tick } from "./format.mjs";
import { sheet } from "./sheet.mjs";

const sides = [
  { name: "weighting_gain", label: "gains" },
  { name: "weighting_loss", label: "losses" },
];

function entries(curves, plan) {
  return sides.flatMap((side) => collect(partsOf(curves, plan), side.name).map((entry) => ({ ...entry, label: side.label })));
}

/** Probability weighting of gains and of losses; Noisy Rational takes probabilities as they are. */
export const weighting = {
  needs: ["summary", "curves"],
  byPlan: true,

  draw({ curves }, { width, palette, plan, id }) {
    const shown = sides.filter((side) => partsOf(curves, plan).some((part) => part.models?.risk_aware?.[side.name]));
    const panels = partsOf(curves, plan).flatMap((part) =>
      (shown.length > 0 ? shown : sides).map((side) => ({
        title: `${part.label}, ${side.label}`,
        note: missingNote(part, ["risk_aware"]),
        draw: (panelWidth) =>
          curvePanel({
            curves: [{ model: "risk_aware", series: part.models?.risk_aware?.[side.name] ?? null }],
            identity: true,
            x: { domain: [0, 1], label: "probability p", tickFormat: tick },
            y: { domain: [0, 1], label: "weight w(p)", tickFormat: tick },
            hatch: `${id}-hatch`,
            width: panelWidth,
            palette,
          }),
      })),
    );
    return sheet({ width, palette, columns: 2, panels, label: "Weight given to each probability, Risk-Aware beside Noisy Rational; the table below holds the same numbers." });
  },

  table: ({ summary, curves }, { plan }) => curveTable(summary, entries(curves, plan), "p", tick),
  file: ({ curves }, { plan }) => curveFile(entries(curves, plan)),
};
