// The page of simulated sweeps: figures appear once they are computed, at phone and at desktop width.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { desktop, launch, open, phone, picture } from "./browser.mjs";
import { arrive, finish } from "./participant.mjs";
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

const drawn = (page, kind) => page.locator(`[data-figure="${kind}"] [data-part=plot] svg`).waitFor({ timeout: 120_000 });

test("sweeps are drawn once they are computed, with their numbers as a table", async () => {
  const person = await open(browser);
  await arrive(person, server.url);
  await finish(person, () => "stop");

  for (const [name, viewport] of [["phone", phone], ["desktop", desktop]]) {
    const page = await open(browser, { viewport });
    await page.goto(`${server.url}/results/driving/sweep?n=6&seeds=1&steps=5`);
    for (const kind of ["optimal", "sweep", "gap_sweep"]) await drawn(page, kind);
    const rows = (kind) => page.locator(`[data-figure="${kind}"] tbody tr`).count();
    assert.deepEqual([await rows("sweep"), await rows("gap_sweep"), await rows("optimal")], [7, 10, 12]);
    assert.match(await page.locator('[data-figure="sweep"] [data-part=caption]').textContent(), /n = 6 at each point/);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
    assert.ok(wide <= 0, `${wide} px wider than the screen`);
    assert.deepEqual(page.faults, []);
    await picture(page, `sweep-${name}`);
    await page.context().close();
  }
  await person.context().close();
});

test("answers beside replicated ones are drawn on the results page", async () => {
  const page = await open(browser);
  await page.goto(`${server.url}/results/driving`);
  await drawn(page, "predictive_check");
  assert.ok((await page.locator('[data-figure="predictive_check"] tbody tr').count()) >= 4);
  assert.deepEqual(page.faults, []);
  await picture(page.locator('[data-figure="predictive_check"]').page(), "predictive-check");
  await page.context().close();
});
