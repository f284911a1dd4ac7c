import { curvePanel } from "./curve-panel.mjs";
import { collect, curveFile, curveTable, missingNote, partsOf } from "./curves.mjs";
import { tick } from "./format.mjs";
import { sheet } from "./sheet.mjs";

function entries(curves, plan) {
  return collect(partsOf(curves, plan), "decision_weight").map((entry) => ({ ...entry, label: entry.series.label }));
}

/** The decision weight of the study's risky outcome against its true probability. */
export const weightOfRisk = {
  needs: ["summary", "curves"],
  byPlan: true,

  draw({ curves }, { width, palette, plan, id }) {
    const panels = partsOf(curves, plan).map((part) => {
      const series = part.models?.risk_aware?.decision_weight ?? null;
      return {
        title: part.label,
        note: series?.note ?? missingNote(part, ["risk_aware"]),
        draw: (panelWidth) =>
          curvePanel({
            curves: [{ model: "risk_aware", series }],
            identity: true,
            x: { domain: [0, 1], label: "true probability", tickFormat: tick },
            y: { domain: [0, 1], label: "decision weight", tickFormat: tick },
            hatch: `${id}-hatch`,
            width: panelWidth,
            palette,
          }),
      };
    });
    return sheet({ width, palette, columns: 2, panels, label: "Decision weight of the risky outcome against its true probability; the table below holds the same numbers." });
  },

  table: ({ summary, curves }, { plan }) => curveTable(summary, entries(curves, plan), "p", tick),
  file: ({ curves }, { plan }) => curveFile(entries(curves, plan)),
};
