// A person takes the driving survey in a browser, at phone and at desktop width, and the results page moves.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { desktop, launch, open, phone, picture } from "./browser.mjs";
import { arrive, finish, goOn, kind, position } from "./participant.mjs";
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

async function json(path) {
  const response = await fetch(`${server.url}${path}`);
  assert.equal(response.status, 200, path);
  return response.json();
}

const counts = (summary) => Object.fromEntries(summary.cells.map((cell) => [cell.id, cell.n]));

/** Goes on until a question of this block is shown. */
async function reach(page, block) {
  for (let step = 0; step < 40; step += 1) {
    if ((await kind(page)) === "choice" && (await page.locator("form.choice").getAttribute("data-block")) === block) return;
    switch (await kind(page)) {
      case "consent":
        await goOn(page, page.locator("button[name=consent][value=agree]"));
        break;
      case "choice":
        await goOn(page, page.locator("button[name=action]").first());
        break;
      default:
        await goOn(page, page.locator("form .button--primary"));
    }
  }
  assert.fail(`no question of block ${block}`);
}

/** Everything that a finger must hit is at least 48 px high; nothing is wider than the screen. */
async function fits(page) {
  const small = await page.locator("button, .button, .option, input.input, select").evaluateAll((elements) =>
    elements
      .filter((element) => element.getClientRects().length && element.getBoundingClientRect().height < 48)
      .map((element) => element.outerHTML.slice(0, 80)));
  assert.deepEqual(small, [], "smaller than 48 px");
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  assert.ok(wide <= 0, `${wide} px wider than the screen`);
}

for (const [name, viewport] of [["phone", phone], ["desktop", desktop]]) {
  test(`a person completes the survey on a ${name}, and the results move without a reload`, async () => {
    const results = await open(browser);
    await results.goto(`${server.url}/results/driving`);
    const counted = results.locator('[data-value="answers.counted"]').first();
    const atFirst = Number(await counted.textContent());
    const before = counts(await json("/api/v1/studies/driving/summary"));

    const page = await open(browser, { viewport, hasTouch: name === "phone" });
    await page.goto(`${server.url}/`);
    await picture(page, `${name}-00-home`);
    await fits(page);
    await page.goto(`${server.url}/s/driving`);
    await picture(page, `${name}-01-landing`);
    await arrive(page, server.url);
    let shown = 2;
    const code = await finish(page, () => "stop", async (what, step) => {
      await picture(page, `${name}-${String(shown).padStart(2, "0")}-${what}-${step}`);
      shown += 1;
      await fits(page);
    });
    assert.match(code, /^[A-Z0-9]{6,}$/);
    assert.deepEqual(page.faults, []);

    // Ten questions of the design; baseline and practice are not among them.
    await results.waitForFunction(
      ([selector, expected]) => Number(document.querySelector(selector).textContent) === expected,
      ['[data-value="answers.counted"]', atFirst + 10],
    );
    assert.deepEqual(results.faults, []);
    const now = counts(await json("/api/v1/studies/driving/summary"));
    for (const [cell, n] of Object.entries(now)) assert.equal(n, before[cell] + 1, cell);
    await page.context().close();
    await results.context().close();
  });
}

test("response times are measured in the page and on the server, with the kind of input", async () => {
  const page = await open(browser);
  await arrive(page, server.url, "driving", "?PROLIFIC_PID=timing");
  await reach(page, "timed");
  const step = await position(page);
  await page.keyboard.press("Tab");
  await page.locator("button[name=action][value=accelerate]").focus();
  await page.waitForTimeout(400);
  await page.keyboard.press("Enter");
  await page.waitForFunction((step) => document.querySelector("input[name=step]").value !== step, step);
  const { answers } = await json("/api/v1/studies/driving/answers?limit=1000");
  const mine = answers.filter((answer) => answer.input === "keyboard");
  assert.equal(mine.length, 1);
  assert.equal(mine[0].action, "accelerate");
  assert.ok(mine[0].client_rt_ms >= 400 && mine[0].client_rt_ms <= mine[0].server_ms, JSON.stringify(mine[0]));
  assert.equal(mine[0].limit_ms, 8000);
  await page.context().close();
});

test("a question whose time runs out locks and the next one comes", async () => {
  const page = await open(browser, { viewport: phone });
  await arrive(page, server.url);
  await reach(page, "timed");
  const step = await position(page);
  await page.waitForFunction((step) => document.querySelector("input[name=step]").value !== step, step, { timeout: 15_000 });
  assert.equal(await kind(page), "choice");
  const summary = await json("/api/v1/studies/driving/summary");
  assert.equal(summary.cells.find((cell) => cell.id === "none/timed/unknown").timed_out, 1);
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

test("an answer survives a lost network and a killed server, and counts once", async () => {
  const page = await open(browser);
  await arrive(page, server.url);
  await reach(page, "untimed");
  const step = await position(page);
  const n = () => json("/api/v1/studies/driving/summary").then((summary) => counts(summary)["none/untimed/unknown"]);
  const before = await n();
  await page.context().setOffline(true);
  await page.locator("button[name=action]").first().dblclick();
  await page.getByText("No connection").waitFor();
  await server.restart();
  await page.context().setOffline(false);
  await page.waitForFunction((step) => document.querySelector("input[name=step]").value !== step, step, { timeout: 30_000 });
  assert.equal(await n(), before + 1);
  await page.context().close();
});

test("going back shows the current question and changes no answer", async () => {
  const page = await open(browser);
  await arrive(page, server.url);
  await reach(page, "untimed");
  await goOn(page, page.locator("button[name=action][value=stop]"));
  const step = await position(page);
  // The steps of a run share one address, so what lies behind it is the landing page; pressing its button leads back.
  await page.goBack();
  await page.getByRole("button", { name: "Start" }).click();
  await page.waitForURL(/\/r\//);
  assert.equal(await position(page), step);
  await page.goBack();
  await page.goForward();
  assert.equal(await position(page), step);
  await page.context().close();
});

test("without JavaScript the survey can be completed, timed questions on the server's clock", async () => {
  const page = await open(browser, { javaScriptEnabled: false, viewport: phone });
  await page.goto(`${server.url}/s/driving`);
  await page.getByRole("button", { name: "Start" }).click();
  let waited = false;
  for (let step = 0; step < 60; step += 1) {
    if (await page.locator(".completion__code").count()) break;
    if (await page.locator("button[name=consent]").count()) await page.locator("button[value=agree]").click();
    else if (await page.locator("button[name=action]").count()) {
      if (!waited && (await page.locator(".countdown").count())) {
        // Nobody presses anything: the page itself asks for the next question.
        waited = true;
        const before = await position(page);
        await page.waitForNavigation({ timeout: 20_000 });
        assert.notEqual(await position(page), before);
      }
      await page.locator("button[name=action]").last().click();
    } else await page.locator("form .button--primary").click();
  }
  assert.equal(await page.locator(".completion__code").count(), 1);
  await page.context().close();
});
