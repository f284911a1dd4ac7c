import { accuracy } from "./figures/accuracy.mjs";
import { actions } from "./figures/actions.mjs";
import { Figure } from "./figures/figure.mjs";
import { gapSweep } from "./figures/gap-sweep.mjs";
import { ladder } from "./figures/ladder.mjs";
import { optimal } from "./figures/optimal.mjs";
import { predictiveCheck } from "./figures/predictive-check.mjs";
import { sequential } from "./figures/sequential.mjs";
import { sweep } from "./figures/sweep.mjs";
import { showTable } from "./figures/table-view.mjs";
import { tables } from "./figures/tables.mjs";
import { value, valueShape } from "./figures/value.mjs";
import { weightOfRisk } from "./figures/weight-of-risk.mjs";
import { weighting } from "./figures/weighting.mjs";

const kinds = {
  actions,
  weighting,
  weight_of_risk: weightOfRisk,
  value,
  value_shape: valueShape,
  accuracy,
  predictive_check: predictiveCheck,
  sweep,
  gap_sweep: gapSweep,
  optimal,
  ladder,
  sequential,
};

/** All figures and live tables below `root`; a figure that fails leaves the others alone. */
export class Figures {
  constructor(root) {
    this.figures = [];
    for (const element of root.querySelectorAll("[data-figure]")) {
      guarded(element, () => this.figures.push(new Figure(element, kinds[element.dataset.figure])));
    }
    this.tables = [...root.querySelectorAll("[data-table]")];
  }

  /** @param {{summary?: object, curves?: object, accuracy?: object, fetchedAt?: string}} data */
  update(data) {
    for (const figure of this.figures) guarded(figure.element, () => figure.update(data));
    for (const frame of this.tables) {
      guarded(frame, () => {
        const content = contentOf(frame.dataset.table, data);
        if (content) showTable(frame, content);
      });
    }
  }
}

/** What is built here from numbers, or what the server built. */
function contentOf(name, data) {
  const table = tables[name];
  if (!table) return data.reading?.tables[name];
  return table.needs.every((part) => data[part]) ? table.build(data) : null;
}

function guarded(element, act) {
  try {
    act();
  } catch (error) {
    console.error("not drawn", element, error);
  }
}
