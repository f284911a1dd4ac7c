/** @typedef {"loading" | "failed" | "ready" | "playing" | "paused" | "ended"} PlayerState */

// Longer gaps between two pictures are no watching: the replay goes on from where it was.
const longestStepMs = 250;

/**
 * Plays one time line at a time. Whoever watches can go back, but ahead no further than the replay was played before.
 */
export class ReplayPlayer {
  /**
   * @param {() => void} onChange called after every change of state or time
   * @param {() => void} onPlayed called when a replay was played to its end; moving to the end is no playing
   */
  constructor(onChange, onPlayed) {
    Object.assign(this, { onChange, onPlayed });
    /** @type {PlayerState} */
    this.state = "loading";
    this.close();
  }

  /** Leaves the replay, until another is opened. */
  close(state = "loading") {
    this.stopFrames();
    this.timeline = null;
    this.timeMs = 0;
    this.frontierMs = 0;
    this.state = state;
  }

  /**
   * @param {import("./replay-timeline.mjs").Timeline} timeline
   * @param {number} frontierMs how far it was played before
   */
  open(timeline, frontierMs) {
    this.close();
    this.timeline = timeline;
    this.frontierMs = Math.min(frontierMs, timeline.duration_ms);
    this.become("ready");
  }

  get durationMs() {
    return this.timeline?.duration_ms ?? 0;
  }

  play() {
    if (!this.timeline || this.state === "playing") return;
    if (this.timeMs >= this.durationMs) this.timeMs = 0;
    this.lastMs = null;
    this.request = requestAnimationFrame((now) => this.step(now));
    this.become("playing");
  }

  pause() {
    if (this.state !== "playing") return;
    this.stopFrames();
    this.become("paused");
  }

  toggle() {
    if (this.state === "playing") this.pause();
    else this.play();
  }

  /** Goes back to the beginning and plays. */
  restart() {
    this.seek(0);
    this.play();
  }

  /**
   * Goes to a moment, or as near to it as was played before.
   * @returns {boolean} whether it got there
   */
  seek(ms) {
    if (!this.timeline) return false;
    this.timeMs = Math.max(0, Math.min(ms, this.frontierMs));
    const atEnd = this.timeMs >= this.durationMs;
    if (atEnd) this.stopFrames();
    this.become(atEnd ? "ended" : this.state === "playing" ? "playing" : "paused");
    return ms <= this.frontierMs;
  }

  step(now) {
    const passed = this.lastMs === null ? 0 : Math.max(0, Math.min(now - this.lastMs, longestStepMs));
    this.lastMs = now;
    this.timeMs = Math.min(this.timeMs + passed, this.durationMs);
    this.frontierMs = Math.max(this.frontierMs, this.timeMs);
    if (this.timeMs >= this.durationMs) {
      this.become("ended");
      this.onPlayed();
      return;
    }
    this.request = requestAnimationFrame((next) => this.step(next));
    this.become("playing");
  }

  stopFrames() {
    if (this.request !== undefined) cancelAnimationFrame(this.request);
    this.request = undefined;
  }

  /** @param {PlayerState} state */
  become(state) {
    this.state = state;
    this.onChange();
  }
}
