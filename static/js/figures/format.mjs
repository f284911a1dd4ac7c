const minus = "−";

/** A number with a fixed count of decimals and a real minus sign; "–" when there is none. */
export function decimal(value, digits = 2) {
  if (value === null || value === undefined) return "–";
  return value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1").replace("-", minus);
}

/** A share as a whole percentage. */
export function percent(share) {
  return share === null || share === undefined ? "–" : `${Math.round(share * 100)} %`;
}

export function count(value) {
  return value === null || value === undefined ? "–" : String(value).replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

/** A reward in the study's unit, the sign before the unit. */
export function reward(unit) {
  return (value) => `${value < 0 ? minus : ""}${unit.prefix}${Math.abs(value)}${unit.suffix}`;
}

/** A tick of an axis without unit. */
export function tick(value) {
  return String(Math.round(value * 1e6) / 1e6).replace("-", minus);
}

export function moment(iso) {
  return new Date(iso).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}
