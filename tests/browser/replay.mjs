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

/** The replays of the page, in their order: id, address, seconds, description. */
export function listed(page) {
  return part(page, "texts").locator("li").evaluateAll((items) =>
    items.map((item) => ({ ...item.dataset, text: item.textContent.trim() })));
}

/** The time lines as the server sends them. */
export async function timelineOf(page, replay) {
  const { url } = (await listed(page)).find((listed) => listed.replay === replay);
  return (await fetch(new URL(url, page.url()))).json();
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
