import { Figures } from "./figures.mjs";
import { showNumbers } from "./numbers.mjs";
import { showWords } from "./words.mjs";

const retryMs = 3000;
const restMs = 100;
const slowMs = 1000;
const fits = ["curves", "accuracy"];
const beside = ["reading", "sequential"];
const words = {
  connecting: "Connecting…",
  live: "Live: new answers appear by themselves.",
  lost: "Connection lost. Trying again; the numbers below may be old.",
};

/** Keeps the results page in step with the server: fetches what a new version changed and shows it. */
export class Live {
  constructor(root) {
    this.root = root;
    this.connection = root.querySelector("[data-part=connection]");
    // A page that hides its results has none of these.
    this.fits = fits.filter((part) => root.dataset[part]);
    this.beside = beside.filter((part) => root.dataset[part]);
    this.data = {};
    this.latest = { data_version: -1, fit_version: -1 };
    this.wanted = null;
    this.fitsTimer = null;
    this.besideTimer = null;
    this.shownAt = -Infinity;
    this.figures = new Figures(root);
    root.addEventListener("planchange", () => this.refresh(["curves"]));
    this.say("connecting");
    this.refresh(["summary", ...this.fits]);
    this.refreshBeside(0);
    this.listen();
  }

  listen() {
    const events = new EventSource(this.root.dataset.events);
    this.events = events;
    events.addEventListener("open", () => this.say("live"));
    events.addEventListener("version", (event) => this.changed(JSON.parse(event.data)));
    events.addEventListener("error", () => {
      this.say("lost");
      // After an HTTP error the browser gives up by itself.
      if (events.readyState === EventSource.CLOSED) setTimeout(() => this.listen(), retryMs);
    });
  }

  changed(version) {
    this.latest = version;
    const newFits = !this.hasFits();
    if (newFits) this.refreshFits();
    if (!this.has(this.beside)) this.refreshBeside(slowMs);
    if (newFits || version.data_version !== this.data.summary?.data_version) this.refresh(["summary"]);
  }

  /** Figures take long to draw and change with every fit: a rest between two drawings leaves the page usable. */
  refreshFits() {
    if (this.fitsTimer !== null) return;
    this.fitsTimer = setTimeout(() => {
      this.fitsTimer = null;
      if (this.hasFits()) return;
      this.refresh(this.fits);
    }, Math.max(0, this.shownAt + restMs - performance.now()));
  }

  /** Sentences and tables are read, not watched: once a second, so that curves need not wait for them. */
  refreshBeside(delay) {
    if (this.besideTimer !== null || this.beside.length === 0) return;
    this.besideTimer = setTimeout(() => {
      this.besideTimer = null;
      this.refresh(this.beside);
    }, delay);
  }

  hasFits() {
    return this.has(this.fits);
  }

  has(parts) {
    return parts.every((part) => this.data[part]?.fit_version === this.latest.fit_version);
  }

  /** One fetch at a time; what is asked for meanwhile follows as one more. */
  async refresh(parts) {
    if (this.wanted) {
      for (const part of parts) this.wanted.add(part);
      return;
    }
    this.wanted = new Set(parts);
    while (this.wanted.size > 0) {
      const now = [...this.wanted];
      this.wanted.clear();
      const results = await Promise.allSettled(now.map((part) => this.fetchPart(part)));
      this.data.fetchedAt = new Date().toISOString();
      this.show(new Set(now));
      if (now.includes("curves")) this.shownAt = performance.now();
      const failed = now.filter((_, index) => results[index].status === "rejected");
      if (failed.length > 0) {
        this.say("lost");
        setTimeout(() => this.refresh(failed), retryMs);
      } else if (this.events?.readyState === EventSource.OPEN) {
        this.say("live");
      }
    }
    this.wanted = null;
  }

  async fetchPart(part) {
    const address = this.root.dataset[part];
    this.data[part] = part === "curves" ? await this.fetchCurves(address) : await fetchJson(address);
  }

  /** Only the curves of the plans that are drawn: those of all plans weigh ten times as much. */
  async fetchCurves(address) {
    const plans = this.figures.plans();
    if (plans.length === 0) return fetchJson(address);
    const all = await Promise.all(plans.map((plan) => fetchJson(`${address}?${new URLSearchParams({ plan })}`)));
    // The oldest says what all of them hold.
    const oldest = all.reduce((one, other) => (other.fit_version < one.fit_version ? other : one));
    return { ...oldest, plans: all.flatMap((curves) => curves.plans) };
  }

  show(changed) {
    const { summary, reading } = this.data;
    if (summary) {
      // Hidden results appear, or vanish, as a page of their own.
      if (Boolean(summary.blind) !== Boolean(this.root.querySelector("[data-part=blind]"))) return location.reload();
      showNumbers(this.root, summary);
      this.announce(summary.stopping);
    }
    if (reading && changed.has("reading")) showWords(this.root, reading);
    this.figures.update(this.data, changed);
  }

  /** That the rule for stopping was reached. */
  announce(text) {
    const banner = this.root.querySelector("[data-part=announcement]");
    if (!banner || !text || banner.textContent === text) return;
    banner.textContent = text;
    banner.hidden = false;
  }

  say(state) {
    if (!this.connection || this.connection.dataset.state === state) return;
    this.connection.dataset.state = state;
    this.connection.textContent = words[state];
  }
}

async function fetchJson(address) {
  const response = await fetch(address, { headers: { Accept: "application/json" }, cache: "no-store" });
  if (!response.ok) throw new Error(`${address}: status ${response.status}`);
  return response.json();
}
