import { d3 } from "./plot.mjs";
import { modelStyles, priorDash, referenceDash } from "./palette.mjs";

const gap = 24;
const titleHeight = 28;
const noteHeight = 20;
const keyLine = 24;
const narrowestPanel = 272;
const letter = 7.8;

/**
 * Lays panels out in a grid, with a key above them, as one drawing.
 * @param {object} options
 * @param {number} options.width
 * @param {object} options.palette
 * @param {{kind: string, label: string}[]} [options.key]
 * @param {number} options.columns at most; fewer when the width does not carry them
 * @param {{title: string, note?: string, draw: (width: number) => SVGSVGElement}[]} options.panels in reading order
 * @param {string} options.label what a screen reader says
 * @returns {SVGSVGElement | null} nothing where there is no panel
 */
export function sheet({ width, palette, key = [], columns, panels, label }) {
  if (panels.length === 0) return null;
  const fitting = Math.max(1, Math.min(columns, Math.floor((width + gap) / (narrowestPanel + gap))));
  const panelWidth = Math.floor((width - gap * (fitting - 1)) / fitting);
  const root = d3
    .create("svg")
    .attr("role", "img")
    .attr("aria-label", label)
    .attr("font-family", "system-ui, sans-serif")
    .attr("font-size", 14)
    .attr("fill", palette.ink);

  let top = key.length > 0 ? drawKey(root, key, width, palette) + 8 : 0;
  for (let start = 0; start < panels.length; start += fitting) {
    const row = panels.slice(start, start + fitting);
    const noted = row.some((panel) => panel.note);
    let tallest = 0;
    row.forEach((panel, index) => {
      const left = index * (panelWidth + gap);
      const head = root.append("g").attr("transform", `translate(${left},${top})`);
      head.append("text").attr("y", 16).attr("font-weight", 600).text(panel.title);
      if (panel.note) head.append("text").attr("y", 36).attr("fill", palette["ink-soft"]).text(panel.note);
      const drawing = panel.draw(panelWidth);
      const offset = top + titleHeight + (noted ? noteHeight : 0);
      adopt(root, drawing, left, offset, palette);
      tallest = Math.max(tallest, offset - top + Number(drawing.getAttribute("height")));
    });
    top += tallest + gap;
  }
  const height = Math.ceil(top - gap);
  return root.attr("width", width).attr("height", height).attr("viewBox", `0 0 ${width} ${height}`).node();
}

/** Moves a plot's shapes into the sheet, without the plot's own style element and root. */
function adopt(root, drawing, left, top, palette) {
  const group = root
    .append("g")
    .attr("transform", `translate(${left},${top})`)
    .attr("text-anchor", "middle")
    .attr("color", palette.ink)
    .attr("aria-hidden", "true")
    .node();
  for (const child of [...drawing.childNodes]) {
    if (child.nodeName !== "style") group.append(child);
  }
}

function drawKey(root, key, width, palette) {
  let x = 0;
  let y = 0;
  for (const item of key) {
    const needed = 40 + item.label.length * letter + 20;
    if (x > 0 && x + needed - 20 > width) {
      x = 0;
      y += keyLine;
    }
    const group = root.append("g").attr("transform", `translate(${x},${y})`);
    drawGlyph(group, item.kind, palette);
    group.append("text").attr("x", 40).attr("y", 15).text(item.label);
    x += needed;
  }
  return y + keyLine;
}

function drawGlyph(group, kind, palette) {
  const line = (color, dash, thickness) =>
    group
      .append("line")
      .attr("x1", 2)
      .attr("x2", 32)
      .attr("y1", 10)
      .attr("y2", 10)
      .attr("stroke", color)
      .attr("stroke-width", thickness)
      .attr("stroke-dasharray", dash);
  if (kind === "observed") {
    group.append("rect").attr("x", 2).attr("y", 3).attr("width", 20).attr("height", 14).attr("fill", palette.observed).attr("fill-opacity", 0.2);
    line(palette.observed, null, 2).attr("x1", 12);
    group.append("circle").attr("cx", 22).attr("cy", 10).attr("r", 4).attr("fill", palette.observed);
  } else if (kind === "prior") {
    line(palette["ink-soft"], priorDash, 1.5);
  } else if (kind === "reference") {
    group.append("line").attr("x1", 17).attr("x2", 17).attr("y1", 1).attr("y2", 19).attr("stroke", palette.reference).attr("stroke-width", 2).attr("stroke-dasharray", referenceDash).attr("stroke-linecap", "round");
  } else if (kind === "paper") {
    line(palette.reference, referenceDash, 2).attr("stroke-linecap", "round");
    group.append("path").attr("d", "M17 4l6 6-6 6-6-6z").attr("fill", palette.paper).attr("stroke", palette.reference).attr("stroke-width", 1.5);
  } else {
    const style = modelStyles[kind];
    const color = palette[style.token];
    line(color, style.dash, 2);
    const fill = style.filled ? color : palette.paper;
    if (style.symbol === "circle") group.append("circle").attr("cx", 17).attr("cy", 10).attr("r", 4.5).attr("fill", fill).attr("stroke", color);
    else group.append("rect").attr("x", 13).attr("y", 6).attr("width", 8).attr("height", 8).attr("fill", fill).attr("stroke", color).attr("stroke-width", 2);
  }
}
