// A person in a browser: reads what is on the page and does what it asks.
import assert from "node:assert/strict";
import { watchAll } from "./replay.mjs";

/** What kind of page is shown, judged by what stands on it. */
export async function kind(page) {
  if (await page.locator(".completion__code").count()) return "thanks";
  if (await page.locator("button[name=consent]").count()) return "consent";
  if (await page.locator("button[name=action]").count()) return "choice";
  if (await page.locator(".fields").count()) return "form";
  if (await page.locator("[data-replay-player]").count()) return "replays";
  return "info";
}

/** Which step the page shows: the position in its form. */
export function position(page) {
  return page.locator("input[name=step]").first().getAttribute("value");
}

/** Clicks and waits until another step (or the last page) is shown. */
export async function goOn(page, button) {
  const before = await position(page);
  await button.click();
  await page.waitForFunction(
    (before) => {
      const step = document.querySelector("input[name=step]");
      return document.readyState !== "loading" && (!step || step.value !== before);
    },
    before,
  );
}

export async function arrive(page, url, study = "driving", query = "") {
  await page.goto(`${url}/s/${study}${query}`);
  await page.getByRole("button", { name: "Start" }).click();
  await page.waitForURL(/\/r\//);
}

/**
 * Answers everything from the current page to the last one.
 * @param {(question: {block: string, question: string}) => string} choose which action to take where it is offered
 * @param {(kind: string, position: string) => Promise<void>} seen called on each page before it is answered
 */
export async function finish(page, choose, seen = async () => {}) {
  for (let step = 0; step < 60; step += 1) {
    const shown = await kind(page);
    await seen(shown, shown === "thanks" ? "end" : await position(page));
    switch (shown) {
      case "thanks":
        return (await page.locator(".completion__code").textContent()).trim();
      case "consent":
        await goOn(page, page.locator("button[name=consent][value=agree]"));
        break;
      case "choice": {
        const { block, question } = await page.locator("form.choice").evaluate((form) => ({ ...form.dataset }));
        const wanted = page.locator(`button[name=action][value="${choose({ block, question })}"]`);
        await goOn(page, (await wanted.count()) ? wanted : page.locator("button[name=action]").first());
        break;
      }
      case "replays":
        await watchAll(page);
        await goOn(page, page.locator("form .button--primary"));
        break;
      default:
        await goOn(page, page.locator("form .button--primary"));
    }
  }
  assert.fail("the survey did not end after 60 pages");
}
