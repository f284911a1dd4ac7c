/** Adds up the time in which the page was hidden or its window had lost focus. */
export class AwayClock {
  constructor() {
    this.sum = 0;
    this.since = null;
    this.hidden = document.visibilityState === "hidden";
    this.blurred = false;
    if (this.hidden) this.since = performance.now();

    document.addEventListener("visibilitychange", (event) => {
      this.hidden = document.visibilityState === "hidden";
      this.note(event.timeStamp);
    });
    window.addEventListener("blur", (event) => {
      this.blurred = true;
      this.note(event.timeStamp);
    });
    window.addEventListener("focus", (event) => {
      this.blurred = false;
      this.note(event.timeStamp);
    });
  }

  note(now) {
    const away = this.hidden || this.blurred;
    if (away && this.since === null) this.since = now;
    if (!away && this.since !== null) {
      this.sum += now - this.since;
      this.since = null;
    }
  }

  /** Milliseconds away until `now`. */
  total(now) {
    return this.sum + (this.since === null ? 0 : Math.max(0, now - this.since));
  }
}
