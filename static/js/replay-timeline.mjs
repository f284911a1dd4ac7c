/**
 * A point of the table's world in millimetres: right, away from the person, up.
 * @typedef {[number, number, number]} Point
 *
 * What a cup measures, in millimetres.
 * @typedef {{height: number, mouth_radius: number, bottom_radius: number}} CupSize
 *
 * The time line of one replay, as the server sends it: frames at 0, `frame_ms`, … and `duration_ms`.
 * @typedef {object} Timeline
 * @property {number} duration_ms
 * @property {number} frame_ms
 * @property {{origin: number[], x: number[], y: number[], z: number[]}} projection picture units per metre
 * @property {{shoulder: Point}} arm
 * @property {CupSize} cup
 * @property {object} tracks one list of whole numbers for each part and axis
 * @property {number[]} still_ms the moments that are shown where motion is unwanted
 *
 * Where everything is at one moment; `tilt` in tenths of a degree, `opening` in millimetres.
 * @typedef {object} Moment
 * @property {Point} hand
 * @property {Point} gripper
 * @property {number} opening
 * @property {Point} elbow
 * @property {{at: Point, tilt: number}[]} cups
 */

/**
 * Where everything is at a moment, on a straight line between the two frames around it.
 * @param {Timeline} timeline
 * @returns {Moment}
 */
export function momentAt({ tracks, frame_ms }, ms) {
  const last = tracks.hand.x.length - 1;
  const index = Math.max(0, Math.min(Math.floor(ms / frame_ms), last - 1));
  const share = Math.max(0, Math.min(1, ms / frame_ms - index));
  const between = (track) => track[index] + (track[index + 1] - track[index]) * share;
  const point = (track) => [between(track.x), between(track.y), between(track.z)];
  return {
    hand: point(tracks.hand),
    gripper: point(tracks.gripper),
    opening: between(tracks.gripper.opening),
    elbow: point(tracks.elbow),
    cups: tracks.cups.map((cup) => ({ at: point(cup), tilt: between(cup.tilt) })),
  };
}

/** The still that stands for a moment: the last one before it, at first the beginning. */
export function stillAt({ still_ms }, ms) {
  return still_ms.findLast((still) => still <= ms) ?? 0;
}

/**
 * The text under the picture at a moment.
 * @param {{at_ms: number, text: string}[]} captions each holds until the next
 */
export function captionAt(captions, ms) {
  return captions.findLast((caption) => caption.at_ms <= ms)?.text ?? "";
}

/** A point in picture units. */
export function project({ origin, x, y, z }, [right, away, up]) {
  return [
    origin[0] + (x[0] * right + y[0] * away + z[0] * up) / 1000,
    origin[1] + (x[1] * right + y[1] * away + z[1] * up) / 1000,
  ];
}

/**
 * The direction towards the viewer: points along it fall onto one picture point. Its second part is -1 (towards the person).
 * @returns {Point}
 */
export function towardsViewer({ x, y, z }) {
  const away = z[0] * x[1] - x[0] * z[1];
  return [(y[0] * z[1] - z[0] * y[1]) / -away, -1, (x[0] * y[1] - y[0] * x[1]) / -away];
}

/** How near to the viewer a point is; of two that overlap in the picture, the greater one is in front. */
export function nearness(viewer, [right, away, up]) {
  return viewer[0] * right + viewer[1] * away + viewer[2] * up;
}
