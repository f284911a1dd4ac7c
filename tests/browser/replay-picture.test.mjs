// The frames on the screen are the frames of the time line.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { get } from "node:http";
import { launch, open, phone, picture } from "./browser.mjs";
import {
  becomes, cupsDrawn, drawing, drawnAt, fingersDrawn, listed, openStopped, part, playNext, playThrough, press, reachReplays,
  scrub, showStrip, timelineOf, told,
} from "./replay.mjs";
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

// What should be drawn is computed here from the documents' meaning, not by the player.

/** One number of a track at a moment. */
function valueAt({ frame_ms: frameMs }, numbers, ms) {
  const after = numbers.findIndex((_, index) => index * frameMs >= ms);
  const before = Math.max(0, after - 1);
  const share = after === before ? 0 : ms / frameMs - before;
  return numbers[before] * (1 - share) + numbers[after] * share;
}

/** A direction in picture units, from metres. */
const onPicture = ({ projection }, [x, y, z]) =>
  [0, 1].map((axis) => projection.x[axis] * x + projection.y[axis] * y + projection.z[axis] * z);

/** The place of a track's point at a moment, in picture units. */
function expected(timeline, track, ms) {
  const metres = ["x", "y", "z"].map((axis) => valueAt(timeline, track[axis], ms) / 1000);
  return onPicture(timeline, metres).map((part, axis) => part + timeline.projection.origin[axis]);
}

/** The box around a cup, and which of its ends is seen, where: two discs around an axis that was turned clockwise. */
function expectedCup(timeline, tilt) {
  const { projection, cup } = timeline;
  const angle = (tilt / 1800) * Math.PI;
  const mouthwards = [-Math.sin(angle), 0, -Math.cos(angle)];
  const across = onPicture(timeline, [Math.cos(angle), 0, -Math.sin(angle)]);
  const ends = [["mouth", 1, cup.mouth_radius], ["bottom", -1, cup.bottom_radius]].map(([end, sign, radius]) => ({
    end,
    at: onPicture(timeline, mouthwards.map((part) => (sign * part * cup.height) / 2000)),
    half: [0, 1].map((axis) => (Math.hypot(across[axis], projection.y[axis]) * radius) / 1000),
  }));
  const edge = (pick, sign) => [0, 1].map((axis) => pick(...ends.map(({ at, half }) => at[axis] + sign * half[axis])));
  // What lies this way from a point falls onto the same point of the picture, but nearer.
  const towardsViewer = [projection.y[0] / projection.x[0], -1, projection.y[1] / projection.z[1]];
  const open = mouthwards.reduce((sum, part, axis) => sum + part * towardsViewer[axis], 0) > 0;
  return { box: [...edge(Math.min, -1), ...edge(Math.max, 1)], ...ends[open ? 0 : 1] };
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
  const { cups, gripper } = timeline.tracks;
  const tilts = cups.map((cup) => valueAt(timeline, cup.tilt, timeMs));
  for (const [index, { box, ends, at }] of (await cupsDrawn(page)).entries()) {
    const wanted = expectedCup(timeline, tilts[index]);
    const what = `cup ${index}, turned by ${tilts[index] / 10} degrees at ${timeMs} ms`;
    assert.deepEqual(ends, [wanted.end], `the end that is seen of ${what}`);
    assertNear(at, wanted.at, 0.02, `the ${wanted.end} of ${what}`);
    // The outline is drawn in short straight lines.
    assertNear(box, wanted.box, 0.3, what);
  }
  const half = (valueAt(timeline, gripper.opening, timeMs) * timeline.projection.x[0]) / 2000;
  assertNear(await fingersDrawn(page), [-half, half], 0.01, `the gripper's opening at ${timeMs} ms`);
  return tilts;
}

function assertNear(drawn, wanted, tolerance, what) {
  const near = drawn.every((value, index) => Math.abs(value - wanted[index]) <= tolerance);
  assert.ok(near, `${what}: drawn ${drawn}, time line ${wanted}`);
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

test("the drawing at rest is the first frame of every replay: nothing jumps when the player opens", async () => {
  const page = await openStopped(browser, server);
  const served = await page.evaluate(async () => {
    const text = await (await fetch(location.href)).text();
    return new DOMParser().parseFromString(text, "text/html").querySelector("[data-part=stage] svg").outerHTML;
  });
  assert.equal((await told(page)).timeMs, 0);
  assert.equal(await drawing(page), served);
  const first = ({ tracks }) => JSON.stringify(tracks, (_, value) => (Number.isFinite(value?.[0]) ? value[0] : value));
  const { replay } = await told(page);
  const drawn = first(await timelineOf(page, replay));
  for (const other of await listed(page)) assert.equal(first(await timelineOf(page, other.replay)), drawn, other.replay);
  await page.context().close();
});

test("all replays as strips, every picture where the time line has it", { timeout: 300_000 }, async () => {
  const page = await openStopped(browser, server);
  const replays = await listed(page);
  const strips = [];
  const turned = [];
  for (let index = 0; index < replays.length; index += 1) {
    const timeline = await timelineOf(page, replays[index].replay);
    if (index === 0) await playThrough(page);
    else await playNext(page);
    const pictures = [];
    for (const moment of stripMoments(timeline)) {
      await scrub(page, moment);
      turned.push(...(await assertDrawn(page, timeline)));
      pictures.push({ title: `${replays[index].replay}: ${(moment / 1000).toFixed(2)} s`, markup: await drawing(page) });
    }
    strips.push({ ...timeline, replay: replays[index].replay, pictures });
  }
  // Cups on their side, to the left and to the right: only they show the sign of a turn.
  const aslant = turned.map((tilt) => Math.sin((tilt / 1800) * Math.PI));
  assert.ok(Math.min(...aslant) < -0.3 && Math.max(...aslant) > 0.3, `turned by ${turned}`);
  const kept = strips.filter(({ tower }) => tower === "unstable");
  kept.push(strips.find(({ tower }) => tower === "stable"));
  for (const { replay, pictures } of kept) {
    await picture(await showStrip(page, pictures), `strip-${replay}`, {});
  }
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

/** Eight moments of a build; where the tower falls, most of them of the fall. */
function stripMoments({ outcome, duration_ms: lasts, captions }) {
  if (outcome === "stands") return Array.from({ length: 8 }, (_, place) => Math.round((lasts * place) / 7));
  const falls = captions.at(-1).at_ms;
  return [falls * 0.35, falls * 0.7, falls, falls + 200, falls + 350, falls + 500, falls + 750, lasts].map(Math.round);
}

/** How many bytes of a body come over the wire, as a browser asks for it, and how they are packed. */
function sent(url) {
  return new Promise((resolve, reject) => {
    get(url, { headers: { "Accept-Encoding": "gzip, deflate, br" } }, (response) => {
      let bytes = 0;
      response.on("data", (part) => { bytes += part.length; });
      response.on("end", () => resolve({ bytes, packed: response.headers["content-encoding"], status: response.statusCode }));
    }).on("error", reject);
  });
}

test("every replay comes in under 60 kB", async (t) => {
  const page = await openStopped(browser, server);
  for (const { replay, url } of await listed(page)) {
    const { bytes, packed, status } = await sent(new URL(url, page.url()));
    assert.equal(status, 200);
    assert.ok(bytes > 1000 && bytes < 60_000, `${replay}: ${bytes} bytes, ${packed ?? "not packed"}`);
    t.diagnostic(`${replay}: ${bytes} bytes (${packed ?? "not packed"})`);
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

for (const [name, options] of [["phone", { viewport: phone }], ["dark", { colorScheme: "dark" }], ["grey", { viewport: phone }], ["desktop", {}]]) {
  test(`the replays have their pictures kept: ${name}`, async () => {
    const page = await openStopped(browser, server, options);
    if (name === "grey") {
      const session = await page.context().newCDPSession(page);
      await session.send("Emulation.setEmulatedVisionDeficiency", { type: "achromatopsia" });
    }
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
