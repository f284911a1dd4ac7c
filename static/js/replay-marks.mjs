import { fill } from "./fill.mjs";

/** One mark for each replay: not seen, on the stage, or seen. Seen ones can be watched again, others only in their order. */
export class ReplayMarks {
  /**
   * @param {HTMLElement} list holds one button for each replay
   * @param {import("./replay-progress.mjs").ReplayProgress} progress
   * @param {Record<string, string>} words in the page's language
   * @param {(index: number) => void} onChoose
   */
  constructor(list, progress, words, onChoose) {
    Object.assign(this, { progress, words });
    this.buttons = [...list.querySelectorAll("button")];
    this.buttons.forEach((button, index) => button.addEventListener("click", () => onChoose(index)));
  }

  /** @param {number} current the place of the replay on the stage */
  show(current) {
    const next = this.progress.next();
    this.buttons.forEach((button, index) => {
      const seen = index < next || this.progress.seen(this.progress.replays[index]);
      const states = [seen ? this.words.seen : this.words.unseen, ...(index === current ? [this.words.shown] : [])];
      button.dataset.state = index === current ? "current" : seen ? "seen" : "unseen";
      button.dataset.seen = String(seen);
      button.disabled = !seen && index !== next;
      button.setAttribute("aria-label", fill(this.words.mark, { number: index + 1, state: states.join(", ") }));
      if (index === current) button.setAttribute("aria-current", "true");
      else button.removeAttribute("aria-current");
    });
  }
}
