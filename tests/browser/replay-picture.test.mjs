// The frames on the screen are the frames of the time line.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { gzipSync } from "node:zlib";
import { launch, open, phone, picture } from "./browser.mjs";
import { becomes, drawnAt, listed, openStopped, part, playNext, playThrough, press, reachReplays, scrub, timelineOf, told } from "./replay.mjs";
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

/** The place of a track's point at a moment, in picture units: computed here from the contract, not by the player. */
function expected({ projection, frame_ms: frameMs, duration_ms: durationMs }, track, ms) {
  const times = track.x.map((_, index) => Math.min(index * frameMs, durationMs));
  const after = times.findIndex((time) => time >= ms);
  const [low, high] = [Math.max(0, after - 1), after];
  const share = low === high ? 0 : (ms - times[low]) / (times[high] - times[low]);
  const [x, y, z] = ["x", "y", "z"].map((axis) => (track[axis][low] * (1 - share) + track[axis][high] * share) / 1000);
  return [0, 1].map((axis) =>
    projection.origin[axis] + projection.x[axis] * x + projection.y[axis] * y + projection.z[axis] * z);
}

const tracksOf = ({ tracks }) => ({
  hand: tracks.hand,
  gripper: tracks.gripper,
  elbow: tracks.elbow,
  ...Object.fromEntries(tracks.cups.map((cup, index) => [`cup-${index}`, cup])),
});

async function assertDrawn(page, timeline) {
  const { timeMs } = await told(page);
  const drawn = await drawnAt(page);
  for (const [name, track] of Object.entries(tracksOf(timeline))) {
    const wanted = expected(timeline, track, timeMs);
    const off = Math.hypot(drawn[name][0] - wanted[0], drawn[name][1] - wanted[1]);
    assert.ok(off < 0.01, `${name} at ${timeMs} ms: drawn ${drawn[name]}, time line ${wanted}`);
  }
}

test("at any moment everything stands where the time line has it", async () => {
  const page = await openStopped(browser, server);
  for (let index = 0; index < 3; index += 1) {
    const { replay } = await told(page);
    const timeline = await timelineOf(page, replay);
    await press(page, "Play");
    await page.clock.runFor(2345);
    assert.equal((await told(page)).state, "playing");
    await assertDrawn(page, timeline);
    await playThrough(page);
    await assertDrawn(page, timeline);

    const moments = Array.from({ length: 10 }, (_, place) => Math.round((timeline.duration_ms * (place + 0.37)) / 10));
    for (const moment of moments) {
      await scrub(page, moment);
      assert.equal((await told(page)).timeMs, moment);
      await assertDrawn(page, timeline);
    }
    await press(page, "Next replay");
    await becomes(page, "playing");
    await press(page, "Pause");
  }
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

test("every replay is told in under 60 kB", async () => {
  const page = await openStopped(browser, server);
  for (const { replay } of await listed(page)) {
    const size = gzipSync(JSON.stringify(await timelineOf(page, replay))).length;
    assert.ok(size < 60_000, `${replay}: ${size} bytes`);
  }
  await page.context().close();
});

test("the captions follow the picture, the transcript opens after the replay", async () => {
  const page = await openStopped(browser, server);
  const { replay } = await told(page);
  const { captions, description } = await timelineOf(page, replay);
  await part(page, "transcript").locator("summary").click();
  assert.equal(await part(page, "description").isVisible(), false);
  await playThrough(page);
  for (const { at_ms: at, text } of captions) {
    await scrub(page, at);
    assert.equal(await part(page, "caption").textContent(), text);
  }
  await part(page, "transcript").locator("summary").click();
  assert.equal(await part(page, "description").textContent(), description);
  assert.ok(await part(page, "description").isVisible());
  await page.context().close();
});

test("under reduced motion the picture goes from still to still, the captions as ever", async () => {
  const page = await openStopped(browser, server, { reducedMotion: "reduce" });
  const { replay } = await told(page);
  const timeline = await timelineOf(page, replay);
  const drawn = new Set();
  const said = [];
  await press(page, "Play");
  for (let ms = 0; ms < timeline.duration_ms + 200; ms += 50) {
    await page.clock.runFor(50);
    drawn.add((await told(page)).timeMs);
    const caption = await part(page, "caption").textContent();
    if (caption !== said.at(-1)) said.push(caption);
  }
  await becomes(page, "ended");
  assert.deepEqual([...drawn].sort((a, b) => a - b), [...new Set([0, ...timeline.still_ms])]);
  assert.deepEqual(said, timeline.captions.map(({ text }) => text));
  await assertDrawn(page, timeline);
  const viewings = JSON.parse(await page.locator("input[name=viewings]").inputValue());
  assert.equal(viewings[0].stills, true);
  await page.context().close();
});

for (const [name, options] of [["phone", { viewport: phone }], ["dark", { colorScheme: "dark" }], ["desktop", {}]]) {
  test(`the replays have their pictures kept: ${name}`, async () => {
    const page = await openStopped(browser, server, options);
    await playThrough(page);
    await playNext(page);
    await picture(page, `replays-${name}`);
    const small = await page.locator("button, summary, input[type=range]").evaluateAll((elements) =>
      elements
        .filter((element) => element.getClientRects().length && element.getBoundingClientRect().height < 48)
        .map((element) => element.outerHTML.slice(0, 80)));
    assert.deepEqual(small, [], "smaller than 48 px");
    assert.ok((await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth)) <= 0);
    await page.context().close();
  });
}

test("a slow device plays a replay (the longest task is told, not judged)", async (t) => {
  const page = await open(browser, { viewport: phone });
  await reachReplays(page, server.url);
  const session = await page.context().newCDPSession(page);
  await session.send("Emulation.setCPUThrottlingRate", { rate: 6 });
  await page.reload();
  await page.evaluate(() => {
    window.longTasks = [];
    new PerformanceObserver((list) => window.longTasks.push(...list.getEntries().map(({ duration }) => duration)))
      .observe({ type: "longtask", buffered: true });
  });
  await becomes(page, "ready");
  const loading = await page.evaluate(() => window.longTasks.splice(0));
  await press(page, "Play");
  await becomes(page, "ended");
  const playing = await page.evaluate(() => window.longTasks);
  const told = (tasks) => (tasks.length ? `${Math.max(...tasks)} ms, ${tasks.length} over 50 ms` : "none over 50 ms");
  t.diagnostic(`tasks at sixfold throttling: while loading ${told(loading)}; while playing ${told(playing)}`);
  await page.context().close();
});
