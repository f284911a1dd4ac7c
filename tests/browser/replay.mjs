// The page of replays: how tests get there, play, and read what is drawn.
import { arrive, goOn, kind } from "./participant.mjs";
import { open } from "./browser.mjs";

export const part = (page, name) => page.locator(`[data-replay-player] [data-part="${name}"]`);

const player = (page, state) => page.locator(`[data-replay-player]${state ? `[data-state=${state}]` : ""}`);

/** What the player tells of itself: replay, state, time of the drawn frame. */
export async function told(page) {
  const { replay, state, timeMs } = await player(page).evaluate((element) => ({ ...element.dataset }));
  return { replay, state, timeMs: Number(timeMs) };
}

export const becomes = (page, state) => player(page, state).waitFor();

/** Takes a study as far as its replays. */
export async function reachReplays(page, url, study = "cups") {
  await arrive(page, url, study);
  while ((await kind(page)) !== "replays") {
    const consent = page.locator("button[name=consent][value=agree]");
    await goOn(page, (await consent.count()) ? consent : page.locator("form .button--primary"));
  }
  return page.url();
}

/** A page of replays whose time stands still until `page.clock.runFor`. */
export async function openStopped(browser, server, options = {}) {
  const page = await open(browser, options);
  await page.clock.install();
  await reachReplays(page, server.url);
  await becomes(page, "ready");
  await page.clock.pauseAt(Date.now() + 60_000);
  return page;
}

/** The replays of the page, in their order: id, address, description. */
export function listed(page) {
  return part(page, "texts").locator("li").evaluateAll((items) =>
    items.map((item) => ({ ...item.dataset, text: item.textContent.trim() })));
}

/** The time lines as the server sends them, with the words that the page has for them. */
export async function timelineOf(page, replay) {
  const { url, captions, text } = (await listed(page)).find((listed) => listed.replay === replay);
  const timeline = await (await fetch(new URL(url, page.url()))).json();
  return { ...timeline, captions: JSON.parse(captions), description: text };
}

export const press = (page, name) => page.getByRole("button", { name, exact: true }).click();

/** Moves the time slider, as a finger does. */
export function scrub(page, ms) {
  return part(page, "range").evaluate((range, ms) => {
    range.value = String(ms);
    range.dispatchEvent(new Event("input", { bubbles: true }));
  }, ms);
}

/** Plays what is on the stage to its end, while the page's time stands still otherwise. */
export async function playThrough(page) {
  if ((await told(page)).state !== "playing") await press(page, "Play");
  await page.clock.runFor(15_000);
  await becomes(page, "ended");
}

/** Goes on to the next replay and plays it to its end. */
export async function playNext(page) {
  await press(page, "Next replay");
  await becomes(page, "playing");
  await playThrough(page);
}

/** Watches all replays in their own time. */
export async function watchAll(page) {
  const count = (await listed(page)).length;
  await becomes(page, "ready");
  for (let index = 0; index < count; index += 1) {
    await press(page, index === 0 ? "Play" : "Next replay");
    await becomes(page, "playing");
    await becomes(page, "ended");
  }
}

/** Where each moving part stands in the picture, in picture units, as the browser laid it out. */
export function drawnAt(page) {
  return part(page, "stage").evaluate((stage) => {
    const drawing = stage.querySelector("svg");
    const toPicture = drawing.getScreenCTM().inverse();
    const names = ["hand", "gripper", "elbow", "cup-0", "cup-1", "cup-2", "cup-3", "cup-4"];
    return Object.fromEntries(names.map((name) => {
      // What turns around the point that it is placed by (the hand) stays at it.
      const { e, f } = toPicture.multiply(drawing.querySelector(`[data-part="${name}"]`).getScreenCTM());
      return [name, [e, f]];
    }));
  });
}

/**
 * What the browser draws of each cup, around its middle, in picture units: the box of its outline (left, top, right,
 * bottom), which of its ends is shown, and where that end's middle is.
 */
export function cupsDrawn(page) {
  return part(page, "stage").evaluate((stage) =>
    [0, 1, 2, 3, 4].map((index) => {
      const cup = stage.querySelector(`[data-part="cup-${index}"]`);
      const ends = ["mouth", "bottom"].filter((end) => getComputedStyle(cup.querySelector(`.cup-${end}`)).display !== "none");
      const disc = cup.querySelector(`.cup-${ends[0]} circle`);
      const { a, b, c, d, e, f } = cup.getScreenCTM().inverse().multiply(disc.getScreenCTM());
      // A browser's own box around a slanted disc is too large.
      const [right, down] = [Math.hypot(a, c), Math.hypot(b, d)].map((half) => half * disc.r.baseVal.value);
      const { x, y, width, height } = cup.querySelector(".cup-body").getBBox();
      const box = [
        Math.min(x, e - right), Math.min(y, f - down), Math.max(x + width, e + right), Math.max(y + height, f + down),
      ];
      return { box, ends, at: [e, f] };
    }));
}

/** Where the inner edges of the gripper's fingers are, left and right of its middle, in picture units. */
export function fingersDrawn(page) {
  return part(page, "gripper").evaluate((gripper) => {
    const inverse = gripper.getScreenCTM().inverse();
    return ["left", "right"].map((side) => {
      const finger = gripper.querySelector(`[data-part="finger-${side}"]`);
      const { x, width } = finger.getBBox();
      return inverse.multiply(finger.getScreenCTM()).e + (side === "left" ? x + width : x);
    });
  });
}

/** The picture as it is now, as markup. */
export const drawing = (page) => part(page, "stage").locator("svg").evaluate((svg) => svg.outerHTML);

/**
 * Puts pictures side by side in place of the page.
 * @param {{title: string, markup: string}[]} pictures
 */
export async function showStrip(page, pictures) {
  await page.evaluate((pictures) => {
    const strip = document.createElement("div");
    strip.id = "strip";
    Object.assign(strip.style, { display: "grid", gridTemplateColumns: "repeat(4, 320px)", width: "1280px" });
    for (const { title, markup } of pictures) {
      const cell = document.createElement("div");
      cell.innerHTML = markup;
      cell.append(title);
      strip.append(cell);
    }
    document.body.replaceChildren(strip);
  }, pictures);
  return page.locator("#strip");
}
