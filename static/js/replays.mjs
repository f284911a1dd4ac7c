import { fill } from "./fill.mjs";
import { ReplayControls } from "./replay-controls.mjs";
import { ReplayMarks } from "./replay-marks.mjs";
import { ReplayPicture } from "./replay-picture.mjs";
import { ReplayPlayer } from "./replay-player.mjs";
import { ReplayProgress } from "./replay-progress.mjs";
import { ReplaySource } from "./replay-source.mjs";
import { captionAt, stillAt } from "./replay-timeline.mjs";

/**
 * The page of replays: shows one after the other in the given order, lets nobody skip, and unlocks the form when all
 * were seen to the end. Without it the page holds their descriptions and an open form.
 */
export class Replays {
  constructor(element) {
    this.element = element;
    this.part = (name) => element.querySelector(`[data-part=${name}]`);
    this.form = element.querySelector("form");
    this.button = this.form.querySelector("[name=continue]");
    this.replays = [...this.part("texts").querySelectorAll("li")].map((item) => ({
      ...item.dataset,
      captions: JSON.parse(item.dataset.captions),
      text: item.textContent.trim(),
    }));
    const { run, step } = element.dataset;
    this.words = JSON.parse(element.dataset.words);
    this.progress = new ReplayProgress(`riskaware.replays.${run}.${step}`, this.replays.map(({ replay }) => replay));
    this.source = new ReplaySource();
    this.stills = matchMedia("(prefers-reduced-motion: reduce)");
    this.picture = new ReplayPicture(this.part("stage").querySelector("svg"));
    this.player = new ReplayPlayer(() => this.changed(), () => this.played());
    this.controls = new ReplayControls(this.part("player"), this.player, this.words);
    this.marks = new ReplayMarks(this.part("marks"), this.progress, this.words, (index) => this.show(index, true));

    this.part("next").addEventListener("click", () => this.show(this.progress.next(), true));
    this.part("again").addEventListener("click", () => this.show(this.index, false));
    this.part("transcript").addEventListener("click", (event) => this.guardTranscript(event));
    this.stills.addEventListener("change", () => this.player.timeline && this.changed());
    document.addEventListener("visibilitychange", () => document.visibilityState === "hidden" && this.player.pause());
    window.addEventListener("pagehide", () => this.progress.keep());

    this.lock();
    this.part("texts").hidden = true;
    this.part("player").hidden = false;
    this.show(Math.min(this.progress.next(), this.replays.length - 1), false);
  }

  get current() {
    return this.replays[this.index];
  }

  /** Puts a replay onto the stage, and plays it where the person asked for it. */
  async show(index, play) {
    this.index = index;
    const { replay, url } = this.current;
    this.element.dataset.replay = replay;
    this.player.close();
    this.part("trouble").hidden = true;
    this.part("transcript").open = false;
    this.part("description").textContent = this.current.text;
    this.part("place").textContent = fill(this.words.place, { number: index + 1, of: this.replays.length });
    this.changed();
    this.showProgress();
    // The pressed button may be gone: keep the keyboard in the player.
    if (play) this.part("stage").focus({ preventScroll: true });
    try {
      const timeline = await this.source.load(url);
      if (this.index !== index || this.player.timeline) return;
      this.picture.open(timeline);
      this.player.open(timeline, this.progress.frontier(replay));
      if (play) this.player.play();
    } catch (error) {
      console.error(error);
      if (this.index !== index) return;
      this.player.close("failed");
      this.part("trouble").hidden = false;
      this.changed();
    }
  }

  /** Follows the player: draws, and notes what was watched. */
  changed() {
    const { state, timeline, timeMs, frontierMs } = this.player;
    const before = this.element.dataset.state;
    if (before !== state) this.element.dataset.state = state;
    if (timeline) {
      this.draw(timeline, Math.round(timeMs));
      this.progress.played(this.current.replay, frontierMs);
    }
    this.controls.show();
    if (before === state) return;
    if (state === "playing") this.started();
    if (state === "paused") this.progress.keep();
    if (state === "loading") this.say(this.words.loading);
    if (state === "failed") this.say("");
  }

  draw(timeline, ms) {
    this.say(captionAt(this.current.captions, ms));
    const drawn = this.stills.matches ? stillAt(timeline, ms) : ms;
    if (this.drawn?.timeline === timeline && this.drawn.ms === drawn) return;
    this.drawn = { timeline, ms: drawn };
    this.picture.draw(drawn);
    this.element.dataset.timeMs = String(drawn);
  }

  say(text) {
    const caption = this.part("caption");
    if (caption.textContent !== text) caption.textContent = text;
  }

  started() {
    this.progress.started(this.current.replay);
    const following = this.replays[this.index + 1];
    if (following) this.source.prefetch(following.url);
  }

  played() {
    this.progress.ended(this.current.replay, this.stills.matches);
    this.showProgress();
  }

  showProgress() {
    const seen = this.progress.seen(this.current.replay);
    this.marks.show(this.index);
    this.part("next").hidden = !seen || this.progress.allSeen;
    this.part("transcript").dataset.locked = String(!seen);
    this.part("transcript").querySelector("summary").setAttribute("aria-disabled", String(!seen));
    this.part("later").hidden = seen;
    this.form.elements.viewings.value = this.progress.viewings.length ? JSON.stringify(this.progress.viewings) : "";
    this.lock();
  }

  /** What happened is read after it was watched. */
  guardTranscript(event) {
    if (event.currentTarget.dataset.locked === "true") event.preventDefault();
  }

  lock() {
    const { viewings, allSeen } = this.progress;
    const watched = fill(this.words.watched, { watched: viewings.length, of: this.replays.length });
    const text = `${watched} ${allSeen ? this.words.open : this.words.locked}`;
    if (this.part("lock").textContent !== text) this.part("lock").textContent = text;
    // A form that is being sent has locked its own button: unlock once, not on every call.
    if (this.open !== allSeen) this.button.disabled = !allSeen;
    this.open = allSeen;
  }
}
