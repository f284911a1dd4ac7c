// Nobody skips: what a person may do in the player, and when the form opens.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open } from "./browser.mjs";
import { becomes, listed, openStopped, part, playNext, playThrough, press, reachReplays, scrub, timelineOf, told } from "./replay.mjs";
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

const goOnButton = (page) => page.locator("form button[name=continue]");
const mark = (page, place) => part(page, "marks").locator("button").nth(place);

async function viewings(page) {
  const text = await page.locator("input[name=viewings]").inputValue();
  return text === "" ? [] : JSON.parse(text);
}

test("scrubbing ahead ends where the person has watched to", async () => {
  const page = await openStopped(browser, server);
  await scrub(page, 5000);
  assert.deepEqual(await told(page), { ...(await told(page)), state: "paused", timeMs: 0 });
  await press(page, "Play");
  await page.clock.runFor(3000);
  await press(page, "Pause");
  const { timeMs: watched } = await told(page);
  assert.ok(watched > 2500 && watched <= 3000, `${watched} ms`);
  await scrub(page, 1000);
  assert.equal((await told(page)).timeMs, 1000);
  await scrub(page, 6000);
  assert.equal((await told(page)).timeMs, watched);
  assert.match(await part(page, "notice").textContent(), /as far as you have watched/);
  assert.equal(Number(await part(page, "range").inputValue()).toFixed(0), String(watched));
  assert.deepEqual(await viewings(page), []);
  assert.ok(await part(page, "next").isHidden());
  await page.context().close();
});

test("the form opens when all were seen to the end, and tells when", async () => {
  const page = await openStopped(browser, server);
  const replays = await listed(page);
  for (let index = 0; index < replays.length; index += 1) {
    assert.ok(await goOnButton(page).isDisabled());
    assert.match(await part(page, "lock").textContent(), new RegExp(`^${index} of ${replays.length} replays watched`));
    assert.equal(await part(page, "place").textContent(), `Replay ${index + 1} of ${replays.length}`);
    assert.equal((await told(page)).replay, replays[index].replay);
    for (let later = index + 1; later < replays.length; later += 1) assert.ok(await mark(page, later).isDisabled());
    if (index < replays.length - 1) {
      await playThrough(page);
      await press(page, "Next replay");
      await becomes(page, "playing");
    }
  }
  await playThrough(page);
  assert.ok(await goOnButton(page).isEnabled());
  assert.ok(await part(page, "next").isHidden());
  const seen = await viewings(page);
  assert.deepEqual(seen.map(({ replay }) => replay), replays.map(({ replay }) => replay));
  for (const [index, viewing] of seen.entries()) {
    assert.deepEqual(Object.keys(viewing).sort(), ["plays", "replay", "seen_ms", "started_ms", "stills"]);
    assert.equal(viewing.plays, 1);
    assert.equal(viewing.stills, false);
    assert.ok(viewing.started_ms >= (seen[index - 1]?.seen_ms ?? 0) && viewing.seen_ms > viewing.started_ms);
    const { duration_ms: lasts } = await timelineOf(page, viewing.replay);
    assert.ok(viewing.seen_ms - viewing.started_ms >= lasts - 20, `${JSON.stringify(viewing)} of ${lasts} ms`);
  }
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

test("a seen replay can be watched again by its mark, one to come cannot", async () => {
  const page = await openStopped(browser, server);
  assert.match(await mark(page, 0).getAttribute("aria-label"), /^Replay 1: not seen yet, shown now$/);
  await playThrough(page);
  await playNext(page);
  assert.equal(await mark(page, 0).getAttribute("aria-label"), "Replay 1: seen");
  assert.equal(await mark(page, 3).getAttribute("aria-label"), "Replay 4: not seen yet");
  assert.ok(await mark(page, 3).isDisabled());
  await mark(page, 0).click();
  await becomes(page, "playing");
  await playThrough(page);
  assert.deepEqual((await viewings(page)).map(({ plays }) => plays), [2, 1]);
  await press(page, "Next replay");
  await becomes(page, "playing");
  assert.equal(await part(page, "place").textContent(), "Replay 3 of 10");
  await page.context().close();
});

test("moving to the end of a seen replay is no play", async () => {
  const page = await openStopped(browser, server);
  await playThrough(page);
  const plays = async () => (await viewings(page)).map((viewing) => viewing.plays);
  const { timeMs: end } = await told(page);
  await press(page, "Restart");
  await page.clock.runFor(1000);
  assert.equal((await told(page)).state, "playing");
  await scrub(page, end);
  assert.equal((await told(page)).state, "ended");
  assert.deepEqual(await plays(), [1]);
  await scrub(page, 1000);
  await scrub(page, end);
  assert.deepEqual(await plays(), [1]);
  await playThrough(page);
  assert.deepEqual(await plays(), [2]);
  await page.context().close();
});

test("keys play, pause, go back and move along the slider", async () => {
  const page = await openStopped(browser, server);
  const state = async () => (await told(page)).state;
  const time = async () => (await told(page)).timeMs;
  await part(page, "stage").focus();
  await page.keyboard.press("Space");
  assert.equal(await state(), "playing");
  await page.clock.runFor(2000);
  await page.keyboard.press("k");
  assert.equal(await state(), "paused");
  const watched = await time();
  await part(page, "range").focus();
  await page.keyboard.press("ArrowLeft");
  assert.equal(await time(), watched - 500);
  assert.match(await part(page, "range").getAttribute("aria-valuetext"), /^1\.\d of \d+\.\d seconds$/);
  for (let times = 0; times < 3; times += 1) await page.keyboard.press("ArrowRight");
  assert.equal(await time(), watched);
  await page.keyboard.press("End");
  assert.equal(await time(), watched);
  await page.keyboard.press("Home");
  assert.equal(await time(), 0);
  await part(page, "toggle").focus();
  await page.keyboard.press("Space");
  assert.equal(await state(), "playing");
  await page.keyboard.press("k");
  assert.equal(await state(), "paused");
  // A key outside the player is none of its business.
  await goOnButton(page).evaluate(() => document.activeElement.blur());
  await page.keyboard.press("k");
  assert.equal(await state(), "paused");
  await page.context().close();
});

test("a reload keeps what was seen and how far", async () => {
  const page = await openStopped(browser, server);
  await playThrough(page);
  await press(page, "Next replay");
  await becomes(page, "playing");
  await page.clock.runFor(1500);
  await press(page, "Pause");
  const { timeMs: watched } = await told(page);
  const before = await viewings(page);
  assert.equal(before.length, 1);

  await page.reload();
  await page.clock.runFor(1000);
  await becomes(page, "ready");
  assert.deepEqual(await viewings(page), before);
  assert.equal(await part(page, "place").textContent(), "Replay 2 of 10");
  await scrub(page, 7000);
  assert.equal((await told(page)).timeMs, watched);
  await playThrough(page);
  const after = await viewings(page);
  assert.deepEqual(after[0], before[0]);
  assert.ok(after[1].started_ms > before[0].seen_ms && after[1].seen_ms > after[1].started_ms);
  await page.context().close();
});

test("a hidden page pauses", async () => {
  const page = await openStopped(browser, server);
  await press(page, "Play");
  await page.clock.runFor(1000);
  await page.evaluate(() => {
    Object.defineProperty(document, "visibilityState", { value: "hidden", configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  });
  const { state, timeMs } = await told(page);
  assert.equal(state, "paused");
  await page.clock.runFor(2000);
  assert.equal((await told(page)).timeMs, timeMs);
  await page.context().close();
});

test("a long gap between two pictures is not watched", async () => {
  const page = await openStopped(browser, server);
  await press(page, "Play");
  await page.clock.runFor(1000);
  await page.clock.fastForward(6000);
  const { state, timeMs } = await told(page);
  assert.equal(state, "playing");
  assert.ok(timeMs < 1500, `${timeMs} ms`);
  await page.context().close();
});

test("a replay that cannot be loaded is offered again", async () => {
  const page = await open(browser);
  await page.route("**/replays/**", (route) => route.abort());
  await reachReplays(page, server.url);
  await becomes(page, "failed");
  assert.ok(await part(page, "trouble").isVisible());
  await page.unroute("**/replays/**");
  await press(page, "Try again");
  await becomes(page, "ready");
  assert.ok(await part(page, "trouble").isHidden());
  await page.context().close();
});

test("without storage the player works for as long as the page is open", async () => {
  const page = await open(browser);
  await page.addInitScript(() => Object.defineProperty(window, "sessionStorage", { get() { throw new Error("switched off"); } }));
  await page.clock.install();
  await reachReplays(page, server.url);
  await becomes(page, "ready");
  await playThrough(page);
  assert.equal((await viewings(page)).length, 1);
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

test("without scripts the page holds the descriptions, the time they take, and an open form", async () => {
  const page = await open(browser, { javaScriptEnabled: false });
  await reachReplays(page, server.url);
  assert.ok(await part(page, "texts").isVisible());
  const replays = await listed(page);
  assert.ok(replays.length >= 10);
  const durations = await Promise.all(replays.map(async ({ replay }) => (await timelineOf(page, replay)).duration_ms));
  const seconds = Math.ceil(durations.reduce((sum, ms) => sum + ms, 0) / 1000);
  assert.match(await part(page, "texts").locator("p").textContent(), new RegExp(`go on ${seconds} seconds after`));
  assert.ok(await part(page, "player").isHidden());
  assert.ok(await goOnButton(page).isEnabled());
  assert.equal(await page.locator("input[name=viewings]").inputValue(), "");
  await goOnButton(page).click();
  assert.match(await page.locator("main").textContent(), new RegExp(`last ${seconds} seconds`));
  await page.context().close();
});
