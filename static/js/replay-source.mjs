/** Fetches time lines, each once; a failed one is asked for again the next time. */
export class ReplaySource {
  constructor() {
    /** @type {Map<string, Promise<import("./replay-timeline.mjs").Timeline>>} */
    this.asked = new Map();
  }

  /** @param {string} url */
  load(url) {
    if (!this.asked.has(url)) {
      const asked = get(url);
      asked.catch(() => this.asked.delete(url));
      this.asked.set(url, asked);
    }
    return this.asked.get(url);
  }

  /** Asks ahead of time; a failure shows when the time line is wanted. */
  prefetch(url) {
    this.load(url).catch(() => {});
  }
}

async function get(url) {
  const response = await fetch(url, { headers: { Accept: "application/json" } });
  if (!response.ok) throw new Error(`replay ${url}: status ${response.status}`);
  return response.json();
}
