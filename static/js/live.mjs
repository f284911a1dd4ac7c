import { Figures } from "./figures.mjs";
import { showNumbers } from "./numbers.mjs";
import { PartGroup } from "./part-group.mjs";
import { showWords } from "./words.mjs";

const retryMs = 3000;
const patienceMs = 15_000;
const words = {
  connecting: "Connecting…",
  live: "Live: new answers appear by themselves.",
  lost: "Connection lost. Trying again; the numbers below may be old.",
};

/**
 * Keeps the results page in step with the server: fetches what a new version changed and shows it. Curves go first, then
 * numbers; sentences and tables are read, not watched: once a second.
 */
export class Live {
  constructor(root) {
    this.root = root;
    this.connection = root.querySelector("[data-part=connection]");
    this.data = {};
    this.latest = { data_version: -1, fit_version: -1 };
    // The version of each part that is shown.
    this.held = {};
    this.figures = new Figures(root);
    // A page that hides its results has some of these only.
    const group = (parts, options) =>
      new PartGroup(parts.filter((part) => root.dataset[part]), {
        stale: (wanted) => wanted.filter((part) => !this.isCurrent(part)),
        fetch: (stale) => this.fetchParts(stale),
        show: (stale) => this.show(new Set(stale)),
        retryMs,
        ...options,
      });
    const curves = group(["curves"], { restMs: 0 });
    const numbers = group(["summary", "accuracy"], { restMs: 100, first: curves });
    const reading = group(["reading", "sequential"], { restMs: 1000, first: numbers });
    this.groups = [curves, numbers, reading];
    root.addEventListener("planchange", () => {
      delete this.held.curves;
      curves.ask();
    });
    this.say("connecting");
    this.askAll();
    this.listen();
  }

  askAll() {
    for (const group of this.groups) group.ask();
  }

  listen() {
    const events = new EventSource(this.root.dataset.events);
    this.events = events;
    events.addEventListener("open", () => this.say("live"));
    events.addEventListener("version", (event) => {
      this.latest = JSON.parse(event.data);
      this.askAll();
    });
    events.addEventListener("error", () => {
      this.say("lost");
      // The server that is found next may be another one, with another past.
      this.held = {};
      this.figures.forget();
      // After an HTTP error the browser gives up by itself.
      if (events.readyState === EventSource.CLOSED) setTimeout(() => this.listen(), retryMs);
    });
  }

  /** All but the summary moves with the fits alone. */
  isCurrent(part) {
    const held = this.held[part];
    if (!held || held.fit_version < this.latest.fit_version) return false;
    return part !== "summary" || held.data_version >= this.latest.data_version;
  }

  /** False where some could not be fetched. */
  async fetchParts(parts) {
    const results = await Promise.allSettled(parts.map((part) => this.fetchPart(part)));
    this.data.fetchedAt = new Date().toISOString();
    const isDone = results.every((result) => result.status === "fulfilled");
    if (!isDone) this.say("lost");
    else if (this.events?.readyState === EventSource.OPEN) this.say("live");
    return isDone;
  }

  async fetchPart(part) {
    const address = this.root.dataset[part];
    const plans = this.figures.plans().join();
    const data = part === "curves" ? await this.fetchCurves(address) : await fetchJson(address);
    this.data[part] = data;
    // Another plan was chosen while the curves of the old one came: they are to be fetched again.
    if (part === "curves" && this.figures.plans().join() !== plans) return;
    this.held[part] = { data_version: data.data_version, fit_version: data.fit_version };
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

  async show(changed) {
    const { summary, reading } = this.data;
    if (summary && changed.has("summary")) {
      // Hidden results appear, or vanish, as a page of their own.
      if (Boolean(summary.blind) !== Boolean(this.root.querySelector("[data-part=blind]"))) return location.reload();
      showNumbers(this.root, summary);
      this.announce(summary.stopping);
    }
    if (reading && changed.has("reading")) showWords(this.root, reading);
    await this.figures.update(this.data, changed);
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
  const response = await fetch(address, { headers: { Accept: "application/json" }, cache: "no-store", signal: AbortSignal.timeout(patienceMs) });
  if (!response.ok) throw new Error(`${address}: status ${response.status}`);
  return response.json();
}
