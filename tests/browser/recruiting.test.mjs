// People whom Prolific and MTurk send: the first by a link, the second inside a frame without cookies.
import assert from "node:assert/strict";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";
import { launch, launchWithoutCookies, open, phone, picture } from "./browser.mjs";
import { Mturk } from "./mturk.mjs";
import { arrive, finish, goOn, kind, position } from "./participant.mjs";
import { Server } from "./server.mjs";

const file = path.resolve(import.meta.dirname, "../data/recruited.toml");
let studies;
let mturk;
let server;
let browser;

before(async () => {
  mturk = await Mturk.start();
  studies = await mkdtemp(path.join(tmpdir(), "riskaware-studies-"));
  const text = await readFile(file, "utf8");
  const framed = `${text}\n[recruiting.mturk]\nframe = true\nsites = ["${mturk.url}", "${mturk.workersUrl}"]\n`;
  await writeFile(path.join(studies, "recruited.toml"), framed);
  server = await Server.start(["--studies", studies]);
  mturk.shows(`${server.url}/s/recruited`);
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await server?.stop();
  await mturk?.stop();
  await rm(studies, { recursive: true });
});

/** The frame in which MTurk shows the study. */
const inside = (page) => page.frameLocator("iframe");

/** Presses a button of the frame, and waits for the heading or element that follows. */
async function press(frame, name, next) {
  await frame.getByRole("button", { name }).first().click();
  await frame.locator(next).first().waitFor();
}

const heading = (text) => `h1:text-is("${text}")`;
const step = (number) => `input[name=step][value="${number}"]`;

/** Takes the whole study inside MTurk's frame, to its last page. */
async function takes(frame) {
  await press(frame, "Start", heading("Do you want to take part?"));
  await press(frame, "I agree", heading("About you"));
  await frame.getByLabel("Yes").check();
  await press(frame, "Continue", heading("One question first"));
  await frame.getByRole("textbox").fill("50");
  await frame.getByRole("button", { name: "Continue" }).click();
  await frame.locator(heading("Your decision")).waitFor();
  const first = Number(await frame.locator("input[name=step]").first().inputValue());
  await frame.getByRole("button", { name: "Take the lottery" }).click();
  await frame.locator(step(first + 1)).first().waitFor({ state: "attached" });
  await press(frame, "Take the sure points", heading("Thank you"));
}

for (const javaScriptEnabled of [false, true]) {
  const with_ = javaScriptEnabled ? "with" : "without";

  test(`a worker ${with_} JavaScript and without cookies completes the study in MTurk's frame`, async () => {
    const { context, close } = await launchWithoutCookies({ javaScriptEnabled, viewport: phone });
    try {
      const page = await context.newPage();
      const set = [];
      const faults = [];
      page.on("response", (response) => {
        if (response.url().startsWith(server.url) && response.headers()["set-cookie"]) set.push(response.url());
      });
      page.on("console", (message) => {
        if (message.type() === "error" && /Content Security Policy/.test(message.text())) faults.push(message.text());
      });
      const before = mturk.handedIn.length;
      mturk.cookies.length = 0;

      await page.goto(`${mturk.url}/look`);
      await inside(page).getByText("Accept it first").waitFor();
      assert.equal(await inside(page).getByRole("button").count(), 0);
      await picture(page, `mturk-${with_}-js-1-look`);

      await page.goto(`${mturk.url}/${with_}-js`);
      await takes(inside(page));
      await inside(page).getByText("DONE1").first().waitFor();
      await picture(page, `mturk-${with_}-js-2-thanks`);
      await inside(page).getByRole("button", { name: "Submit the HIT to MTurk" }).click();
      await inside(page).locator(heading("Handed in")).waitFor();
      assert.ok(page.frames().some((frame) => frame.url().startsWith(mturk.workersUrl)), "it was not led on");

      assert.deepEqual(mturk.handedIn.slice(before), [
        { assignmentId: `assignment-${with_}-js`, ending: "completed", code: "DONE1" },
      ]);
      assert.deepEqual(set, [], "a cookie was set");
      assert.deepEqual(faults, []);
      assert.equal(mturk.cookies.length >= 3, true);
      assert.deepEqual(mturk.cookies.filter(Boolean), [], "this browser takes cookies, so the test proves nothing");
    } finally {
      await close();
    }
  });
}

test("a page that is not MTurk's cannot show the study in its frame", async () => {
  const other = await Mturk.start();
  other.shows(`${server.url}/s/recruited`);
  try {
    const page = await browser.newPage();
    const refused = page.waitForEvent("console", (message) => /frame-ancestors/.test(message.text()));
    await page.goto(`${other.url}/stranger`);
    await refused;
    assert.equal(await inside(page).getByRole("button", { name: "Start" }).count(), 0);
    await page.close();
  } finally {
    await other.stop();
  }
});

test("a person from Prolific comes back to the same step, finishes and is sent back with the code", async () => {
  const query = "?PROLIFIC_PID=5f3a&STUDY_ID=64b1&SESSION_ID=77c2";
  const first = await open(browser, { viewport: phone });
  await arrive(first, server.url, "recruited", query);
  assert.ok(!first.url().includes("5f3a"), "the id leaves the address");
  await goOn(first, first.locator("button[name=consent][value=agree]"));
  await first.getByLabel("Yes").check();
  await goOn(first, first.getByRole("button", { name: "Continue" }));
  await first.getByRole("textbox").fill("50");
  await goOn(first, first.getByRole("button", { name: "Continue" }));
  assert.equal(await kind(first), "choice");
  const left = await position(first);
  await first.context().close();

  const second = await open(browser, { viewport: phone });
  await arrive(second, server.url, "recruited", query);
  assert.equal(await position(second), left);
  assert.equal(await finish(second, () => "lottery"), "DONE1");
  await picture(second, "prolific-thanks");

  let cameBack;
  await second.context().route("https://app.prolific.com/**", (route) => {
    cameBack = new URL(route.request().url());
    assert.equal(route.request().headers().referer, undefined);
    return route.fulfill({ contentType: "text/html", body: "<h1>Prolific</h1>" });
  });
  await second.getByRole("link", { name: "Return to the recruiting site" }).click();
  await second.getByRole("heading", { name: "Prolific" }).waitFor();
  assert.equal(cameBack.pathname, "/submissions/complete");
  assert.equal(cameBack.searchParams.get("cc"), "DONE1");
  assert.deepEqual(second.faults, []);
  await second.context().close();

  // Whoever opens the link once more has taken part, and is not shown the code.
  const third = await open(browser);
  await arrive(third, server.url, "recruited", query);
  await third.getByText("You have already taken part").waitFor();
  assert.equal(await third.locator(".completion__code").count(), 0);
  await third.context().close();
});
