/** Parts of a page that are fetched and shown together: once at a time, with a rest after each. */
export class PartGroup {
  /**
   * @param {string[]} parts
   * @param {object} options
   * @param {(parts: string[]) => string[]} options.stale those of `parts` that are to be fetched
   * @param {(parts: string[]) => Promise<boolean>} options.fetch fetches them; false where some failed
   * @param {(parts: string[]) => Promise<void>} options.show
   * @param {number} options.restMs the least rest
   * @param {number} options.retryMs the rest after a failure
   * @param {PartGroup} [options.first] what goes first when both are asked for
   */
  constructor(parts, options) {
    this.parts = parts;
    Object.assign(this, options);
    this.isWanted = false;
    this.running = null;
    this.restUntil = 0;
    this.waiting = [];
  }

  /** What is asked for while something is fetched, follows as one more. */
  ask() {
    if (this.parts.length === 0) return;
    this.isWanted = true;
    this.running ??= this.run();
  }

  async run() {
    while (this.isWanted) {
      await pause(this.restUntil - performance.now());
      await this.first?.turn();
      this.isWanted = false;
      const stale = this.stale(this.parts);
      if (stale.length > 0) {
        const isDone = await this.fetch(stale);
        const started = performance.now();
        // What cannot be shown must not keep the page from what comes next.
        await this.show(stale).catch((error) => console.error("not shown", stale, error));
        const now = performance.now();
        // As long as showing it took, so that half of the time is left to whoever uses the page.
        this.restUntil = now + (isDone ? Math.max(this.restMs, now - started) : this.retryMs);
        this.isWanted ||= !isDone;
      }
      for (const goOn of this.waiting.splice(0)) goOn();
    }
    this.running = null;
  }

  /** Lets this group have one turn before, if it wants one. */
  turn() {
    return this.running && new Promise((resolve) => this.waiting.push(resolve));
  }
}

function pause(ms) {
  return ms > 0 && new Promise((resolve) => setTimeout(resolve, ms));
}
