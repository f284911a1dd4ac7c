const restMs = 1000;
const retryMs = 3000;
const patienceMs = 15_000;
// What counts nothing makes no event: pages that only tell something, and people who go away.
const pollMs = 5000;
const words = {
  connecting: "Connecting…",
  live: "Live: the numbers follow by themselves.",
  lost: "Connection lost. Trying again; the numbers below may be old.",
};

/** Keeps a study's overview in step with the server: fetches its changing part anew, at most once a second. */
export class Watch {
  constructor(root) {
    this.root = root;
    this.connection = root.querySelector("[data-part=connection]");
    this.say("connecting");
    this.listen();
    setInterval(() => {
      if (document.visibilityState === "visible") this.ask();
    }, pollMs);
  }

  listen() {
    const events = new EventSource(this.root.dataset.events);
    this.events = events;
    events.addEventListener("open", () => this.say("live"));
    events.addEventListener("version", () => this.ask());
    events.addEventListener("error", () => {
      this.say("lost");
      // After an HTTP error the browser gives up by itself.
      if (events.readyState === EventSource.CLOSED) setTimeout(() => this.listen(), retryMs);
    });
  }

  /** Whoever asks while something is fetched, or just was, is served by the next fetch. */
  async ask() {
    this.isAsked = true;
    if (this.isBusy) return;
    this.isBusy = true;
    while (this.isAsked) {
      this.isAsked = false;
      const isDone = await this.renew();
      if (!isDone) this.isAsked = true;
      await new Promise((resolve) => setTimeout(resolve, isDone ? restMs : retryMs));
    }
    this.isBusy = false;
  }

  async renew() {
    try {
      const response = await fetch(this.root.dataset.progress, { cache: "no-store", signal: AbortSignal.timeout(patienceMs) });
      if (!response.ok) throw new Error(`status ${response.status}`);
      const page = new DOMParser().parseFromString(await response.text(), "text/html");
      this.show(page.querySelector("[data-part=progress]"));
      if (this.events.readyState === EventSource.OPEN) this.say("live");
      return true;
    } catch {
      this.say("lost");
      return false;
    }
  }

  show(fresh) {
    // Another state has other buttons.
    if (fresh.dataset.state !== this.root.dataset.state) return location.reload();
    const shown = this.root.querySelector("[data-part=progress]");
    const frames = (part) => [...part.querySelectorAll(".table-frame")];
    const before = new Map(frames(shown).map((frame) => [frame.ariaLabel, frame]));
    const focused = document.activeElement?.ariaLabel;
    shown.replaceWith(fresh);
    // Whoever reads on the right side of a table stays there.
    for (const frame of frames(fresh)) {
      frame.scrollLeft = before.get(frame.ariaLabel)?.scrollLeft ?? 0;
      if (frame.ariaLabel === focused) frame.focus({ preventScroll: true });
    }
  }

  say(state) {
    if (this.connection.dataset.state === state) return;
    this.connection.dataset.state = state;
    this.connection.textContent = words[state];
  }
}
