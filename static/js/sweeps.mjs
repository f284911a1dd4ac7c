import { Figures } from "./figures.mjs";

const pauseMs = 1500;
const retryMs = 4000;
const sweeps = ["sweep", "gap_sweep"];

/** Asks for the sweeps until they are computed, shows how far they are, and draws them. */
export class Sweeps {
  constructor(root) {
    this.root = root;
    this.data = {};
    this.figures = new Figures(root);
    this.fetchSummary();
    for (const part of sweeps) this.fetchSweep(part);
    this.listen();
  }

  /** New answers move the shares of this study; the sweeps themselves stay. */
  listen() {
    const events = new EventSource(this.root.dataset.events);
    events.addEventListener("version", (event) => {
      const { data_version: version } = JSON.parse(event.data);
      if (this.data.summary && version !== this.data.summary.data_version) this.fetchSummary();
    });
  }

  async fetchSummary() {
    try {
      const [summary, gap] = await Promise.all([this.fetchJson("summary"), this.fetchJson("gap_sweep")]);
      this.data.summary = summary.body;
      this.take("gap_sweep", gap.body);
    } catch {
      setTimeout(() => this.fetchSummary(), retryMs);
    }
  }

  async fetchSweep(part) {
    try {
      const { body, isReady } = await this.fetchJson(part);
      this.take(part, body);
      if (!isReady) setTimeout(() => this.fetchSweep(part), pauseMs);
    } catch {
      this.say(part, "The numbers could not be fetched. Trying again.");
      setTimeout(() => this.fetchSweep(part), retryMs);
    }
  }

  async fetchJson(part) {
    const response = await fetch(this.root.dataset[part], { headers: { Accept: "application/json" }, cache: "no-store" });
    if (!response.ok) throw new Error(`${part}: status ${response.status}`);
    return { body: await response.json(), isReady: response.status === 200 };
  }

  take(part, body) {
    if (body.observed) this.data.observed = body;
    if (body.state === "ready") this.data[part] = body;
    else this.say(part, progress(body));
    this.data.fetchedAt = new Date().toISOString();
    this.figures.update(this.data);
  }

  say(part, text) {
    const figure = this.root.querySelector(`[data-figure="${part}"]`);
    if (!figure || this.data[part]) return;
    figure.querySelector("[data-part=plot]").textContent = text;
    figure.querySelector("[data-part=caption]").textContent = "";
  }
}

function progress({ done, of, ahead }) {
  if (ahead > 0) return `Waiting for ${ahead === 1 ? "another sweep" : `${ahead} other sweeps`}.`;
  return `Computing: ${done} of ${of} fits.`;
}
