/** The label of a level, as the study names it. */
export function levelLabel(summary, factorId, levelId) {
  const factor = summary.factors.find((candidate) => candidate.id === factorId);
  return factor?.levels.find((level) => level.id === levelId)?.label ?? levelId;
}

/** A cell in words, as the page's own tables have it: its levels in the order of the factors. */
export function cellLabel(summary, cell) {
  return summary.factors
    .filter((factor) => cell.levels[factor.id] !== undefined)
    .map((factor) => levelLabel(summary, factor.id, cell.levels[factor.id]))
    .join(" · ");
}

/**
 * Panels for small multiples: one for each combination of all factors but the first, in the study's order.
 * The first factor's levels are the rows inside a panel.
 * @returns {{title: string, cells: object[]}[]}
 */
export function panelsOfCells(summary) {
  const outer = summary.factors.slice(1);
  const panels = new Map();
  for (const cell of inStudyOrder(summary, [...outer].reverse())) {
    const title = [...outer]
      .reverse()
      .map((factor) => named(factor, cell.levels[factor.id]))
      .join(" · ");
    if (!panels.has(title)) panels.set(title, { title, cells: [] });
    panels.get(title).cells.push(cell);
  }
  for (const panel of panels.values()) {
    panel.cells.sort((a, b) => position(summary.factors[0], a) - position(summary.factors[0], b));
  }
  return [...panels.values()];
}

function inStudyOrder(summary, factors) {
  return [...summary.cells].sort((a, b) => {
    for (const factor of factors) {
      const difference = position(factor, a) - position(factor, b);
      if (difference !== 0) return difference;
    }
    return 0;
  });
}

function position(factor, cell) {
  if (!factor) return 0;
  const index = factor.levels.findIndex((level) => level.id === cell.levels[factor.id]);
  return index < 0 ? factor.levels.length : index;
}

/** A level with its factor's name: "Risk: low". */
function named(factor, levelId) {
  const label = factor.levels.find((level) => level.id === levelId)?.label ?? levelId;
  return `${factor.label}: ${label.toLowerCase()}`;
}
