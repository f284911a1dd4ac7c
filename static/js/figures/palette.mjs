/**
 * Colours of a drawing. On the screen they are the page's tokens, so that light and dark need no redrawing;
 * a file that leaves the page carries the light values themselves.
 */
const light = {
  ink: "#1b1f24",
  "ink-soft": "#59636e",
  paper: "#ffffff",
  line: "#d5dae0",
  noisy: "#5b6b7b",
  aware: "#c4500a",
  observed: "#1b1f24",
  reference: "#8a6d00",
};

const tokens = Object.keys(light);

export const screenPalette = Object.fromEntries(tokens.map((token) => [token, `var(--${token})`]));
export const filePalette = light;

/** How each model looks in every figure of every study. */
export const modelStyles = {
  risk_aware: { token: "aware", name: "Risk-Aware", shortName: "Risk-\nAware", dash: null, symbol: "circle", filled: true },
  noisy_rational: { token: "noisy", name: "Noisy Rational", shortName: "Noisy\nRational", dash: "5 3", symbol: "square", filled: false },
};

/** What a model is called: the page knows the paper's two, the study names its others. */
export function modelName(summary, model) {
  return modelStyles[model]?.name ?? summary.models?.find((known) => known.id === model)?.label ?? model;
}

/** How any model looks, and chance: the paper's two as everywhere, all others in ink. */
export function styleOf(model) {
  return modelStyles[model] ?? { token: model === "random" ? "ink-soft" : "ink", symbol: "diamond", filled: model !== "random" };
}

export const priorDash = "2 4";
export const referenceDash = "1 4";
