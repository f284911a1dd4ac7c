import { AwayClock } from "./away-clock.mjs";

/**
 * Measures one choice in the browser: time from the frame that showed the question to the choice,
 * kind of input, and how long the page was hidden or without focus meanwhile.
 * It fills the hidden inputs `client_rt_ms`, `input` and `hidden_ms`; an empty one means "not measured".
 */
export class Trial {
  constructor(form) {
    this.form = form;
    this.shownAt = null;
    this.lastInput = "";
    this.away = new AwayClock();
    // After a reload or a step back the question was on the screen before: this page cannot know since when.
    this.firstShowing = performance.getEntriesByType("navigation")[0]?.type === "navigate";

    this.watchFirstFrame();
    window.addEventListener("pointerdown", (event) => (this.lastInput = event.pointerType), { capture: true });
    window.addEventListener("keydown", () => (this.lastInput = "keyboard"), { capture: true });
    form.addEventListener("click", (event) => this.chose(event), { capture: true });
  }

  watchFirstFrame() {
    requestAnimationFrame((time) => (this.shownAt ??= time));
    if (!PerformanceObserver.supportedEntryTypes?.includes("paint")) return;
    const observer = new PerformanceObserver((list) => {
      const paint = list.getEntriesByName("first-contentful-paint")[0];
      if (!paint) return;
      this.shownAt = paint.startTime;
      observer.disconnect();
    });
    observer.observe({ type: "paint", buffered: true });
  }

  chose(event) {
    const button = event.target.closest("button, input[type=submit]");
    if (!button || button.disabled || this.answered) return;
    this.answered = true;
    const measured = this.firstShowing && this.shownAt !== null;
    this.fill("client_rt_ms", measured ? Math.round(event.timeStamp - this.shownAt) : "");
    this.fill("hidden_ms", measured ? Math.round(this.away.total(event.timeStamp)) : "");
    // A click made by a key carries no pointer; one made by assistive software has neither.
    this.fill("input", event.detail === 0 ? this.lastInput : event.pointerType || this.lastInput);
    // Native validation may refuse the form; then the person chooses again.
    setTimeout(() => (this.answered = this.form.checkValidity()));
  }

  fill(name, value) {
    const field = this.form.elements.namedItem(name);
    if (field) field.value = String(value);
  }
}
