const pen = document.createElement("canvas").getContext("2d");

/** How wide a text of the figures' size is, in pixels. */
export function textWidth(text) {
  pen.font = "14px system-ui, sans-serif";
  return Math.ceil(pen.measureText(text).width);
}

/**
 * A text in lines no wider than `width`, but for words that are wider themselves.
 * @returns {string[]}
 */
export function linesOf(text, width) {
  const lines = [];
  for (const word of text.split(/\s+/).filter(Boolean)) {
    const longer = lines.length > 0 ? `${lines.at(-1)} ${word}` : word;
    if (lines.length > 0 && textWidth(longer) <= width) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}
