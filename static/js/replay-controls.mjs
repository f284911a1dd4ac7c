import { fill } from "./fill.mjs";

const arrowMs = 500;

/** Buttons, time slider and keys of a replay player. */
export class ReplayControls {
  /**
   * @param {HTMLElement} element the player
   * @param {import("./replay-player.mjs").ReplayPlayer} player
   * @param {Record<string, string>} words in the page's language
   */
  constructor(element, player, words) {
    Object.assign(this, { element, player, words });
    const part = (name) => element.querySelector(`[data-part=${name}]`);
    this.toggle = part("toggle");
    this.restart = part("restart");
    this.range = part("range");
    this.time = part("time");
    this.notice = part("notice");
    this.stage = part("stage");

    this.toggle.addEventListener("click", () => player.toggle());
    this.restart.addEventListener("click", () => player.restart());
    this.stage.addEventListener("click", () => player.toggle());
    this.range.addEventListener("input", () => this.seek(Number(this.range.value)));
    element.addEventListener("keydown", (event) => this.key(event));
  }

  seek(ms) {
    const reached = this.player.seek(ms);
    this.notice.textContent = reached || !this.player.timeline ? "" : this.words.ahead;
    this.show();
  }

  key(event) {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const onRange = event.target === this.range;
    const usesSpace = event.target.closest("button, summary, a");
    const { timeMs, durationMs } = this.player;
    if (event.key === "k" || (event.key === " " && !usesSpace)) this.player.toggle();
    else if (event.key === "Home") this.seek(0);
    else if (onRange && event.key === "End") this.seek(durationMs);
    else if (onRange && ["ArrowLeft", "ArrowDown"].includes(event.key)) this.seek(timeMs - arrowMs);
    else if (onRange && ["ArrowRight", "ArrowUp"].includes(event.key)) this.seek(Math.min(timeMs + arrowMs, durationMs));
    else return;
    event.preventDefault();
  }

  /** Shows the player's state and time; called for every picture, but a playing slider moves ten times a second. */
  show() {
    const { state, timeMs, durationMs, frontierMs } = this.player;
    const playing = state === "playing";
    const tenth = Math.floor(timeMs / 100);
    if (playing && this.shown === state && this.tenth === tenth) return;
    this.tenth = tenth;
    const idle = !this.player.timeline;
    if (this.shown !== state) {
      this.shown = state;
      this.toggle.textContent = playing ? this.words.pause : this.words.play;
      this.toggle.dataset.icon = playing ? "pause" : "play";
      for (const control of [this.toggle, this.restart, this.range]) control.disabled = idle;
      this.range.max = String(durationMs || 1);
      if (playing) this.notice.textContent = "";
    }
    this.range.value = String(timeMs);
    this.range.style.setProperty("--watched", `${durationMs ? (100 * frontierMs) / durationMs : 0}%`);
    write(this.time, idle ? "" : `${this.seconds(timeMs)} / ${this.seconds(durationMs)} s`);
    // While it plays the slider speaks of whole seconds, so that nobody hears ten numbers a second.
    const spoken = playing ? Math.floor(timeMs / 1000) * 1000 : timeMs;
    const text = fill(this.words.seconds, { at: this.seconds(spoken), of: this.seconds(durationMs) });
    if (this.range.getAttribute("aria-valuetext") !== text) this.range.setAttribute("aria-valuetext", text);
  }

  seconds(ms) {
    return (ms / 1000).toFixed(1).replace(".", this.words.decimalMark);
  }
}

function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
