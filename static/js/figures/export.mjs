import { d3 } from "./plot.mjs";

const fileWidth = 720;
const edge = 24;
const letterAt14 = 7.1;

/** Width of the drawing inside an exported file. */
export const drawingWidth = fileWidth - 2 * edge;

/**
 * A drawing that stands alone: white page, title, subtitle and caption as text, no style sheet needed.
 * @returns {string} SVG text
 */
export function standaloneSvg(drawing, { title, subtitle, caption }) {
  const lines = [
    ...wrap(title, 64).map((text) => ({ text, size: 20, weight: 600, fill: "#1b1f24", leading: 26 })),
    ...wrap(subtitle, drawingWidth / letterAt14).map((text) => ({ text, size: 14, fill: "#59636e", leading: 20 })),
  ];
  const root = d3
    .create("svg")
    .attr("xmlns", "http://www.w3.org/2000/svg")
    .attr("font-family", "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif");
  const page = root.append("rect").attr("width", fileWidth).attr("fill", "#ffffff");
  let y = edge;
  const write = ({ text, size, weight, fill, leading }) => {
    y += leading;
    root.append("text").attr("x", edge).attr("y", y - 6).attr("font-size", size).attr("font-weight", weight ?? 400).attr("fill", fill).text(text);
  };
  lines.forEach(write);
  y += 12;
  drawing.setAttribute("x", edge);
  drawing.setAttribute("y", y);
  drawing.setAttribute("font-family", root.attr("font-family"));
  root.node().append(drawing);
  y += Number(drawing.getAttribute("height")) + 8;
  wrap(caption, drawingWidth / letterAt14).forEach((text) => write({ text, size: 14, fill: "#59636e", leading: 20 }));
  const height = Math.ceil(y + edge - 8);
  page.attr("height", height);
  root.attr("width", fileWidth).attr("height", height).attr("viewBox", `0 0 ${fileWidth} ${height}`);
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(resolved(root.node()))}\n`;
}

/** Programs without style sheets don't know `currentColor`. */
function resolved(svg) {
  for (const element of svg.querySelectorAll("*")) {
    for (const name of ["fill", "stroke", "color"]) {
      if (element.getAttribute(name) === "currentColor") element.setAttribute(name, "#1b1f24");
    }
    element.removeAttribute("class");
  }
  return svg;
}

function wrap(text, letters) {
  const lines = [];
  for (const word of (text ?? "").split(/\s+/).filter(Boolean)) {
    const last = lines.at(-1);
    if (last !== undefined && last.length + word.length + 1 <= letters) lines[lines.length - 1] = `${last} ${word}`;
    else lines.push(word);
  }
  return lines;
}

/** Rows as CSV; numbers keep their full precision, text that a spreadsheet would run is defused. */
export function csv(rows) {
  return rows.map((row) => row.map(csvField).join(",")).join("\r\n") + "\r\n";
}

function csvField(value) {
  if (value === null || value === undefined) return "";
  if (typeof value === "number" || typeof value === "boolean") return String(value);
  const text = /^[=+\-@\t]/.test(value) ? `'${value}` : value;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

export function saveText(text, type, name) {
  save(new Blob([text], { type }), name);
}

/** Draws the SVG at twice its size, sharp on dense screens and in print. */
export async function savePng(svg, name) {
  const url = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
  try {
    const image = new Image();
    image.src = url;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = image.naturalWidth * 2;
    canvas.height = image.naturalHeight * 2;
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    const blob = await new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
    if (!blob) throw new Error("the browser could not make a PNG of this size");
    save(blob, name);
  } finally {
    URL.revokeObjectURL(url);
  }
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
