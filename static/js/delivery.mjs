const attemptLimitMs = 15_000;
const longestWaitMs = 15_000;
const longestAskedWaitMs = 60_000;

/**
 * What became of a form.
 * @typedef {{kind: "next", url: string} | {kind: "page"}} Outcome
 * `next`: the server has it (or had it before) and names the page that follows;
 * `page`: the server has something to say, which only its own page can show.
 */

/**
 * Posts a form until the server has answered it, however long that takes.
 * @param {import("./pending-store.mjs").PendingForm} form
 * @param {(trouble: "network" | "busy") => void} onTrouble called before each wait
 * @returns {Promise<Outcome>}
 */
export async function deliver(form, onTrouble) {
  for (let attempt = 0; ; attempt += 1) {
    let response = null;
    try {
      response = await post(form);
      if (!mayRetry(response.status)) return await outcome(response);
    } catch {
      response = null;
    }
    onTrouble(response ? "busy" : "network");
    await pause(waitMs(attempt, response));
  }
}

function post(form) {
  return fetch(form.action, {
    method: "POST",
    headers: { Accept: "application/json", "Content-Type": "application/x-www-form-urlencoded" },
    body: form.body,
    cache: "no-store",
    signal: AbortSignal.timeout(attemptLimitMs),
  });
}

function mayRetry(status) {
  return status >= 500 || status === 408 || status === 425 || status === 429;
}

async function outcome(response) {
  if (response.redirected) return { kind: "next", url: response.url };
  if (!response.ok && response.status !== 409) return { kind: "page" };
  const text = await response.text();
  try {
    const { next } = JSON.parse(text);
    if (typeof next === "string") return { kind: "next", url: next };
  } catch {
    // Not the agreed answer: let the server's own page speak.
  }
  return { kind: "page" };
}

function waitMs(attempt, response) {
  const asked = Number(response?.headers.get("Retry-After"));
  if (asked > 0) return Math.min(asked * 1000, longestAskedWaitMs) * (1 + Math.random() / 4);
  return Math.min(500 * 2 ** attempt, longestWaitMs) * (0.75 + Math.random() / 2);
}

/** Waits, but no longer than until the network is back. */
function pause(ms) {
  return new Promise((resolve) => {
    const over = () => {
      clearTimeout(timer);
      window.removeEventListener("online", over);
      resolve();
    };
    const timer = setTimeout(over, ms);
    window.addEventListener("online", over);
  });
}
