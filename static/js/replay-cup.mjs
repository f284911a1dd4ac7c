import { towardsViewer } from "./replay-timeline.mjs";

// Light falls from the upper left, over the person's shoulder.
const light = [-0.55, -0.35, 0.75];
const shadeHalfWidth = 1.15;

// Metres along the axis, from the middle of the cup.
const stripes = { lip: [0.042, 0.05], band: [-0.014, 0.02], line: [0.024, 0.03] };

/**
 * The outlines of a cup around its middle, in picture units, as path data; `end` is the matrix that lays the unit
 * circle onto the end that can be seen, `open` says that this is the mouth.
 * @typedef {{body: string, shade: string, lip: string, band: string, line: string, end: string, open: boolean}} CupShape
 */

/**
 * What a cup looks like when turned in the tower's plane.
 * @param {{x: number[], y: number[], z: number[]}} projection picture units per metre
 * @param {import("./replay-timeline.mjs").CupSize} size a frustum, its mouth wider than its bottom
 * @param {number} tilt tenths of a degree: 0 = mouth down, clockwise as the person sees it
 * @returns {CupShape}
 */
export function cupShape({ x, y, z }, size, tilt) {
  const height = size.height / 1000;
  const mouth = size.mouth_radius / 1000;
  const bottom = size.bottom_radius / 1000;
  const wall = { middle: (mouth + bottom) / 2, widening: (mouth - bottom) / height };
  const angle = (tilt / 1800) * Math.PI;
  const [sine, cosine] = [Math.sin(angle), Math.cos(angle)];
  // The cup's own directions in the picture: from its middle to its mouth, and across.
  const axis = mix(x, -sine, z, -cosine);
  const across = mix(x, cosine, z, -sine);
  const viewer = towardsViewer({ x, y, z });
  const facing = { across: cosine * viewer[0] - sine * viewer[2], away: viewer[1], mouth: -sine * viewer[0] - cosine * viewer[2] };
  const lit = { across: cosine * light[0] - sine * light[2], away: light[1] };

  const [from, to] = visibleSide(wall, axis, across, y, facing);
  const dark = nearestTurn(Math.atan2(lit.away, lit.across) + Math.PI, (from + to) / 2);
  const surface = (low, high, start = from, end = to) =>
    start < end ? side(wall, axis, across, y, low, high, start, end) : "";

  const open = facing.mouth > 0;
  const [radius, centre] = open ? [mouth, height / 2] : [bottom, -height / 2];
  return {
    open,
    end: [...[...across, ...y].map((part) => part * radius), axis[0] * centre, axis[1] * centre].map(rounded).join(" "),
    body: surface(-height / 2, height / 2),
    shade: surface(-height / 2, height / 2, Math.max(from, dark - shadeHalfWidth), Math.min(to, dark + shadeHalfWidth)),
    lip: surface(...stripes.lip),
    band: surface(...stripes.band),
    line: surface(...stripes.line),
  };
}

/** Between which angles around its axis the side of the cup can be seen. */
function visibleSide({ widening }, axis, across, away, facing) {
  // At the edge the outline runs along the surface: a cos φ - b sin φ = c.
  const a = cross(axis, away);
  const b = cross(axis, across);
  const c = -widening * cross(across, away);
  const half = Math.acos(Math.max(-1, Math.min(1, c / Math.hypot(a, b))));
  const middle = -Math.atan2(b, a);
  const outwards = Math.cos(middle) * facing.across + Math.sin(middle) * facing.away - widening * facing.mouth;
  return outwards > 0 ? [middle - half, middle + half] : [middle + half, middle + 2 * Math.PI - half];
}

/** The surface between two heights on the axis and two angles around it. */
function side({ middle, widening }, axis, across, away, low, high, start, end) {
  const steps = Math.max(2, Math.ceil((end - start) * 5));
  const points = [];
  const add = (along, angle) => {
    const radius = middle + widening * along;
    const ring = mix(across, radius * Math.cos(angle), away, radius * Math.sin(angle));
    points.push(`${rounded(axis[0] * along + ring[0])} ${rounded(axis[1] * along + ring[1])}`);
  };
  for (let step = 0; step <= steps; step += 1) add(high, start + ((end - start) * step) / steps);
  for (let step = steps; step >= 0; step -= 1) add(low, start + ((end - start) * step) / steps);
  return `M${points.join("L")}z`;
}

function mix(one, share, other, otherShare) {
  return [one[0] * share + other[0] * otherShare, one[1] * share + other[1] * otherShare];
}

function cross(one, other) {
  return one[0] * other[1] - one[1] * other[0];
}

function nearestTurn(angle, to) {
  return angle + 2 * Math.PI * Math.round((to - angle) / (2 * Math.PI));
}

function rounded(value) {
  return Math.round(value * 100) / 100;
}
