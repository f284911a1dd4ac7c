import { count, percent } from "./figures/format.mjs";

const formats = {
  count,
  percent,
  text: (value) => value ?? "–",
};

/** Refreshes every `[data-value]` below `root`, a dotted path into the summary, fading only what changed. */
export function showNumbers(root, summary) {
  for (const element of root.querySelectorAll("[data-value]")) {
    const value = element.dataset.value.split(".").reduce((inner, key) => inner?.[key], summary);
    if (value === undefined) continue;
    const format = formats[element.dataset.format ?? (typeof value === "number" ? "count" : "text")];
    const text = format(value);
    if (element.textContent.trim() === text) continue;
    element.textContent = text;
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
      element.animate([{ opacity: 0.2 }, { opacity: 1 }], { duration: 180 });
    }
  }
}
