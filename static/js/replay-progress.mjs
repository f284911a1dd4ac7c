/**
 * One replay that was seen to the end, as the form tells it: milliseconds since the page was first opened in this tab;
 * `plays` counts how often it was played to its end, `stills` says that it was first seen as still frames.
 * @typedef {{replay: string, started_ms: number, seen_ms: number, plays: number, stills: boolean}} Viewing
 */

/** Which replays were seen, when, and how far the others; kept for this tab so that it survives a reload. */
export class ReplayProgress {
  /**
   * @param {string} slot the name under which it is kept
   * @param {string[]} replays the page's replays, in their order
   */
  constructor(slot, replays) {
    Object.assign(this, { slot, replays });
    const kept = read(slot);
    /** @type {Viewing[]} */
    this.viewings = (kept?.viewings ?? []).filter(({ replay }) => replays.includes(replay));
    /** @type {Record<string, number>} */
    this.frontiers = kept?.frontiers ?? {};
    /** @type {Record<string, number>} */
    this.starts = kept?.starts ?? {};
    this.openedAt = Math.min(kept?.openedAt ?? Date.now(), Date.now());
    // The wall clock may jump: within one page its own clock counts.
    this.before = Date.now() - this.openedAt - performance.now();
    this.keep();
  }

  /** Milliseconds since the page was first opened in this tab. */
  now() {
    return Math.round(this.before + performance.now());
  }

  started(replay) {
    if (replay in this.starts) return;
    this.starts[replay] = this.now();
    this.keep();
  }

  /** Notes how far a replay was played; written down by `keep`. */
  played(replay, frontierMs) {
    this.frontiers[replay] = Math.max(this.frontier(replay), frontierMs);
  }

  ended(replay, stills) {
    const known = this.viewings.find((viewing) => viewing.replay === replay);
    if (known) known.plays += 1;
    else this.viewings.push({ replay, started_ms: this.starts[replay] ?? 0, seen_ms: this.now(), plays: 1, stills });
    this.keep();
  }

  frontier(replay) {
    return this.frontiers[replay] ?? 0;
  }

  seen(replay) {
    return this.viewings.some((viewing) => viewing.replay === replay);
  }

  /** The place of the first replay that was not seen; how many there are when all were. */
  next() {
    const index = this.replays.findIndex((replay) => !this.seen(replay));
    return index < 0 ? this.replays.length : index;
  }

  get allSeen() {
    return this.next() === this.replays.length;
  }

  keep() {
    const { openedAt, viewings, frontiers, starts } = this;
    try {
      sessionStorage.setItem(this.slot, JSON.stringify({ openedAt, viewings, frontiers, starts }));
    } catch {
      // Storage can be switched off or full: progress then lives as long as this page.
    }
  }
}

function read(slot) {
  try {
    const kept = JSON.parse(sessionStorage.getItem(slot));
    const whole = Number.isFinite(kept?.openedAt) && Array.isArray(kept.viewings) && kept.frontiers && kept.starts;
    return whole ? kept : null;
  } catch {
    return null;
  }
}
