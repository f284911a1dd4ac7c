// People watch all replays of the cup study in their own time, cannot skip them, answer, and the results move.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { desktop, launch, open, phone, picture } from "./browser.mjs";
import { finish, goOn, kind } from "./participant.mjs";
import { becomes, listed, part, reachReplays, watchAll } from "./replay.mjs";
import { Server } from "./server.mjs";

let server;
let browser;

before(async () => {
  server = await Server.start();
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await server?.stop();
});

async function summary() {
  const response = await fetch(`${server.url}/api/v1/studies/cups/summary`);
  assert.equal(response.status, 200);
  return response.json();
}

/** Posts the page's form as it would be if all had been watched. */
function pretends(page, replays) {
  return page.evaluate(async (replays) => {
    const form = new FormData(document.querySelector("form"));
    const viewings = replays.map(({ replay }) => ({ replay, started_ms: 0, seen_ms: 8000, plays: 1, stills: false }));
    form.set("viewings", JSON.stringify(viewings));
    const response = await fetch(location.href, { method: "POST", body: new URLSearchParams(form) });
    return { status: response.status, text: await response.text() };
  }, replays);
}

async function takesPart(name, viewport, action) {
  const page = await open(browser, { viewport, hasTouch: name === "phone" });
  await reachReplays(page, server.url);
  await becomes(page, "ready");
  await picture(page, `cups-${name}-1-replays`);
  const { status, text } = await pretends(page, await listed(page));
  assert.equal(status, 422);
  assert.match(text, /You can go on in \d+ seconds/);
  assert.ok(await page.locator("form button[name=continue]").isDisabled());

  await watchAll(page);
  await part(page, "restart").click();
  await becomes(page, "playing");
  await part(page, "toggle").click();
  await picture(page, `cups-${name}-2-watched`);
  await goOn(page, page.locator("form button[name=continue]"));
  assert.equal(await kind(page), "info");
  let shown = 3;
  const code = await finish(page, () => action, async (what) => {
    await picture(page, `cups-${name}-${shown}-${what}`);
    shown += 1;
  });
  assert.match(code, /^[A-Z0-9]{6,}$/);
  assert.deepEqual(page.faults, []);
  await page.context().close();
}

test("people on a phone and on a desktop watch, answer, and the results move", { timeout: 300_000 }, async () => {
  const results = await open(browser);
  await results.goto(`${server.url}/results/cups`);
  const counted = '[data-value="answers.counted"]';
  assert.equal(await results.locator(counted).first().textContent(), "0");

  await Promise.all([takesPart("phone", phone, "stable"), takesPart("desktop", desktop, "unstable")]);

  await results.waitForFunction((counted) => document.querySelector(counted).textContent === "4", counted);
  const { cells } = await summary();
  assert.deepEqual(cells.map(({ id, n }) => [id, n]), [["timed", 2], ["untimed", 2]]);
  // The curves follow the answers.
  await results.waitForFunction(() => Number(document.querySelector("[data-figure=weighting]").dataset.fittedVersion) > 0);
  await picture(results, "cups-results");
  assert.deepEqual(results.faults, []);
});
