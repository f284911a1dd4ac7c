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

  /** Draws everything anew at the next update, whatever it was drawn from. */
  forget() {
    for (const figure of this.figures) figure.drawnFits = null;
  }

  /** The plans whose curves are drawn. */
  plans() {
    const chosen = this.figures.filter((figure) => figure.kind.byPlan).map((figure) => figure.plan);
    return [...new Set(chosen)].filter(Boolean);
  }

  /**
   * Curves are drawn at once, and other figures one by one, so that the page stays usable between them.
   * @param {{summary?: object, curves?: object, accuracy?: object, fetchedAt?: string}} data
   * @param {Set<string>} [changed] which parts of `data` are new; all of them if left out
   */
  async update(data, changed) {
    for (const figure of this.figures) {
      if (figure.data && !isTouched(figure.kind.needs, changed)) {
        if (figure.kind.needs.some((name) => changed.has(name))) guarded(figure.element, () => figure.label());
        continue;
      }
      if (!figure.kind.byPlan) await nextTask();
      guarded(figure.element, () => figure.update(data));
    }
    for (const frame of this.tables) {
      if (!isTouched(tables[frame.dataset.table]?.needs ?? ["reading"], changed)) continue;
      guarded(frame, () => {
        const content = contentOf(frame.dataset.table, data);
        if (content) showTable(frame, content);
      });
    }
  }
}

function nextTask() {
  return new Promise((resolve) => setTimeout(resolve));
}

/** The summary moves with every answer: where something else is drawn, that alone decides. */
function isTouched(needs, changed) {
  if (!changed) return true;
  const own = needs.length > 1 ? needs.filter((name) => name !== "summary") : needs;
  return own.some((name) => changed.has(name));
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
