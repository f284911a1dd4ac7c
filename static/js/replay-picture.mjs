import { cupShape } from "./replay-cup.mjs";
import { momentAt, nearness, project, towardsViewer } from "./replay-timeline.mjs";

// Millimetres and picture units of what the time line leaves to the picture.
const wristAbove = 130;
const graspReach = 70;
const elbowOffPicture = [540, 860];
const handNearer = 45;

/** Draws moments of time lines into the scene of the table. The drawing stands in the page; this only moves its parts. */
export class ReplayPicture {
  /** @param {SVGElement} drawing */
  constructor(drawing) {
    const part = (name) => drawing.querySelector(`[data-part="${name}"]`);
    this.layers = part("layers");
    this.base = part("base");
    this.shoulder = part("shoulder");
    this.upperArm = part("upper-arm");
    this.upperLink = part("upper-link");
    this.forearm = part("forearm");
    this.foreLink = part("fore-link");
    this.elbow = part("elbow");
    this.gripper = part("gripper");
    this.fingers = [part("finger-left"), part("finger-right")];
    this.hand = part("hand");
    this.handBehind = part("hand-behind");
    this.thumb = part("thumb");
    this.handFingers = part("hand-fingers");
    this.shadows = { hand: part("hand-shadow"), gripper: part("gripper-shadow") };
    this.cups = [0, 1, 2, 3, 4].map((index) => new DrawnCup(part(`cup-${index}`), part(`cup-${index}-shadow`)));
    this.order = [...this.layers.children];
  }

  /** @param {import("./replay-timeline.mjs").Timeline} timeline */
  open(timeline) {
    this.timeline = timeline;
    this.viewer = towardsViewer(timeline.projection);
    const shoulder = project(timeline.projection, timeline.arm.shoulder);
    move(this.base, shoulder);
    move(this.shoulder, shoulder);
    for (const cup of this.cups) cup.open(timeline);
  }

  draw(ms) {
    const moment = momentAt(this.timeline, ms);
    const { projection } = this.timeline;
    moment.cups.forEach((cup, index) => this.cups[index].draw(cup));
    this.drawArm(projection, moment);
    this.drawHand(projection, moment);
    this.arrange(moment);
  }

  drawArm(projection, { gripper, elbow, opening }) {
    const shoulder = project(projection, this.timeline.arm.shoulder);
    const wrist = project(projection, [gripper[0], gripper[1], gripper[2] + wristAbove]);
    const bend = project(projection, elbow);
    this.upperLink.setAttribute("d", limb(shoulder, bend, 15, 11));
    this.foreLink.setAttribute("d", limb(bend, wrist, 11, 8));
    move(this.elbow, bend);
    move(this.gripper, project(projection, gripper));
    const half = (projection.x[0] * opening) / 2000;
    move(this.fingers[0], [-half, 0]);
    move(this.fingers[1], [half, 0]);
    move(this.shadows.gripper, project(projection, [gripper[0], gripper[1], 0]));
  }

  drawHand(projection, { hand, cups }) {
    const grip = project(projection, hand);
    const turn = (Math.atan2(grip[0] - elbowOffPicture[0], elbowOffPicture[1] - grip[1]) * 180) / Math.PI;
    const turned = `rotate(${turn.toFixed(2)})`;
    move(this.hand, grip, turned);
    move(this.handBehind, grip, turned);
    // The hand closes around a cup as it comes near.
    const nearest = Math.min(...cups.map(({ at }) => Math.hypot(at[0] - hand[0], at[1] - hand[1], at[2] - hand[2])));
    const open = Math.min(1, nearest / graspReach);
    this.thumb.setAttribute("transform", `rotate(${(-22 * open).toFixed(1)})`);
    this.handFingers.setAttribute("transform", `rotate(${(20 * open).toFixed(1)})`);
    move(this.shadows.hand, project(projection, [hand[0], hand[1], 0]));
  }

  /** Puts what is nearer in front; the document changes only where the order did. */
  arrange({ hand, gripper, elbow, cups }) {
    const near = (point) => nearness(this.viewer, point);
    const depth = new Map([
      [this.upperArm, Math.min(near(elbow), near(this.timeline.arm.shoulder))],
      [this.forearm, near(gripper) + handNearer],
      [this.handBehind, near(hand) - handNearer],
      [this.hand, near(hand) + handNearer],
      ...cups.map(({ at }, index) => [this.cups[index].element, near(at)]),
    ]);
    const order = [...depth.keys()].sort((one, other) => depth.get(one) - depth.get(other));
    if (order.every((element, index) => element === this.order[index])) return;
    order.forEach((element, index) => {
      if (this.layers.children[index] !== element) this.layers.insertBefore(element, this.layers.children[index]);
    });
    this.order = order;
  }
}

/** One cup: moved each frame, its outlines made anew only when it turned. */
class DrawnCup {
  constructor(element, shadow) {
    Object.assign(this, { element, shadow });
    this.parts = ["body", "shade", "lip", "band", "line"].map((name) => [name, element.querySelector(`.cup-${name}`)]);
    this.ends = element.querySelectorAll(".cup-mouth, .cup-bottom");
  }

  open({ projection, cup }) {
    Object.assign(this, { projection, size: cup, tilt: null });
  }

  draw({ at, tilt }) {
    const { projection, size } = this;
    move(this.element, project(projection, at));
    move(this.shadow, project(projection, [at[0], at[1], 0]));
    if (tilt === this.tilt) return;
    this.tilt = tilt;
    const shape = cupShape(projection, size, tilt);
    for (const [name, path] of this.parts) path?.setAttribute("d", shape[name]);
    for (const end of this.ends) end.setAttribute("transform", `matrix(${shape.end})`);
    this.element.classList.toggle("cup--open", shape.open);
  }
}

/** What stands still is left alone: each write costs the browser style and layout. */
function move(element, [right, down], more = "") {
  const transform = `translate(${right.toFixed(3)} ${down.toFixed(3)})${more}`;
  if (element.getAttribute("transform") !== transform) element.setAttribute("transform", transform);
}

/** A link of the arm: wider where it starts. */
function limb(from, to, startHalf, endHalf) {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
  const [right, down] = [(from[1] - to[1]) / length, (to[0] - from[0]) / length];
  const corner = ([x, y], half) => `${(x + right * half).toFixed(2)} ${(y + down * half).toFixed(2)}`;
  return `M${corner(from, startHalf)}L${corner(to, endHalf)}L${corner(to, -endHalf)}L${corner(from, -startHalf)}z`;
}
