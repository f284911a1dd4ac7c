// A researcher runs a study: opens a draft, watches somebody take it, pauses it, erases the run, and sees it gone.
import assert from "node:assert/strict";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";
import { desktop, launch, open, phone, picture } from "./browser.mjs";
import { finish, goOn } from "./participant.mjs";
import { Server } from "./server.mjs";

const password = "correct horse battery";

let server;
let browser;
let folder;

before(async () => {
  folder = await mkdtemp(path.join(tmpdir(), "riskaware-studies-"));
  const built = await readFile(path.resolve(import.meta.dirname, "../../studies/driving.toml"), "utf8");
  const draft = built.replace(/^id = "driving"/m, 'id = "yellow"').replace(/^open = true.*$/m, "");
  await writeFile(path.join(folder, "yellow.toml"), draft);
  server = await Server.start(["--studies", folder]);
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await server?.stop();
  await rm(folder, { recursive: true });
});

/** Nothing sticks out, and everything that can be pressed is large enough for a thumb. */
async function fits(page) {
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  assert.ok(wide <= 0, `${page.url()} is ${wide} px too wide`);
  const controls = page.locator("nav a, nav button, .button, .input, .select, a.target, .study-card a");
  for (const control of await controls.all()) {
    const box = await control.boundingBox();
    if (box) assert.ok(box.height >= 48, `${page.url()}: ${await control.textContent()} ${JSON.stringify(box)}`);
  }
  const unlabelled = await page.locator(".input, .select").evaluateAll((fields) =>
    fields.filter((field) => field.labels.length === 0).map((field) => field.outerHTML));
  assert.deepEqual(unlabelled, []);
}

const fate = (page, what) => page.locator(`[data-fate="${what}"]`);

/** Waits until the open page says so by itself. */
function becomes(page, what, number) {
  return page.waitForFunction(
    ([what, number]) => document.querySelector(`[data-fate="${what}"]`)?.textContent === number,
    [what, number],
  );
}

async function logIn(page) {
  await page.goto(`${server.url}/studies`);
  assert.match(page.url(), /\/login\?next=/);
  await page.getByLabel("Name").fill("ada");
  await page.getByLabel("Password", { exact: true }).fill(password);
  await page.getByRole("button", { name: "Log in" }).click();
  await page.waitForURL(`${server.url}/studies`);
}

test("before an account exists the pages are open on this machine", async () => {
  const page = await open(browser, { viewport: phone });
  await page.goto(server.url);
  await page.getByRole("link", { name: "Run the studies" }).click();
  await page.getByRole("link", { name: /driv|yellow/i }).first().waitFor();
  for (const end of ["", "/sources", "/participants", "/links", "/preview", "/data"]) {
    const response = await page.goto(`${server.url}/studies/yellow${end}`);
    assert.equal(response.status(), 200);
    await fits(page);
  }
  assert.deepEqual(page.faults, []);
  await page.context().close();
});

test("a draft is opened, taken, paused, and its run erased", { timeout: 240_000 }, async () => {
  const page = await open(browser);
  page.setDefaultTimeout(10_000);
  await page.goto(server.setupLink);
  await page.getByLabel("Name").fill("ada");
  await page.getByLabel("Password", { exact: true }).fill(password);
  await page.getByLabel("Password once more").fill(password);
  await page.getByRole("button", { name: "Make the account" }).click();
  await page.getByRole("heading", { name: "Your account" }).waitFor();

  // A file that cannot be read is told with its line, and takes nothing down.
  await writeFile(path.join(folder, "broken.toml"), "format = 1\nid = 5\n");
  await page.goto(`${server.url}/studies`);
  while ((await page.getByText(/^line 2, id/).count()) === 0) await page.reload();
  await fits(page);
  await picture(page, "studies-list");
  await rm(path.join(folder, "broken.toml"));

  await page.locator('a[href="/studies/yellow"]').click();
  await page.getByText("Only previews can start it.").waitFor();
  await page.getByRole("button", { name: "Open", exact: true }).click();
  await page.getByText("People can start.").waitFor();
  await page.getByText("Live:", { exact: false }).waitFor();

  await page.getByRole("link", { name: "Links" }).click();
  await page.getByLabel("Label of the source").fill("pilot 1");
  await page.getByRole("button", { name: "Put it into the links" }).click();
  const link = await page.locator("[data-link=prolific]").textContent();
  await picture(page, "studies-links");
  await fits(page);
  await page.getByRole("link", { name: "Overview" }).click();
  await page.getByText("Live:", { exact: false }).waitFor();
  assert.equal(await fate(page, "Started").textContent(), "0");

  const filled = link
    .replace("{{%PROLIFIC_PID%}}", "5f9")
    .replace("{{%STUDY_ID%}}", "60a")
    .replace("{{%SESSION_ID%}}", "70b");
  const person = await open(browser, { viewport: phone });
  await person.goto(filled);
  await person.getByRole("button", { name: "Start" }).click();
  await becomes(page, "Started", "1");
  await goOn(person, person.locator("button[name=consent][value=agree]"));
  await becomes(page, "Consented", "1");
  await picture(page, "studies-overview-under-way");
  await finish(person, () => "stop");
  await becomes(page, "Completed", "1");
  await page.getByRole("cell", { name: "pilot 1" }).or(page.getByRole("rowheader", { name: "pilot 1" })).waitFor();
  await fits(page);
  await picture(page, "studies-overview");

  await page.getByRole("button", { name: "Pause" }).click();
  await page.getByText("Nobody new can start;").first().waitFor();
  assert.equal((await person.goto(`${server.url}/s/yellow`)).status(), 410);

  await page.getByRole("link", { name: "Data" }).click();
  await page.getByText("1 person completed the study (1 from pilot 1)").waitFor();
  await picture(page, "studies-data");
  await fits(page);
  const download = page.waitForEvent("download");
  await page.getByRole("link", { name: /Long table/ }).click();
  assert.match((await download).suggestedFilename(), /^yellow.*\.csv$/);

  await page.getByRole("link", { name: "Participants" }).click();
  await fits(page);
  await picture(page, "studies-participants");
  await page.getByLabel("State").selectOption("completed");
  await page.getByRole("button", { name: "Show" }).click();
  await page.getByRole("link", { name: "Erase participant 1" }).click();
  await picture(page, "studies-erase");
  await page.getByRole("button", { name: "Erase participant 1" }).click();
  await page.getByRole("cell", { name: "withdrawn" }).waitFor();
  await page.getByRole("link", { name: "Overview" }).click();
  assert.equal(await fate(page, "Completed").textContent(), "0");
  assert.equal(await fate(page, "Withdrawn").textContent(), "1");

  // A second tab that stays open sees the change and gets the buttons of the new state.
  const watching = await page.context().newPage();
  await watching.goto(`${server.url}/studies/yellow`);
  await watching.getByText("Live:", { exact: false }).waitFor();
  await page.getByRole("button", { name: "Open again" }).click();
  await watching.getByRole("button", { name: "Pause" }).waitFor();

  await page.getByRole("link", { name: "Preview" }).click();
  await picture(page, "studies-preview");
  await page.getByRole("button", { name: "Preview from the first page" }).click();
  await page.getByRole("button", { name: "Start" }).waitFor();
  assert.deepEqual([...page.faults, ...person.faults], []);
  await page.context().close();
  await person.context().close();
});

for (const [name, options] of [
  ["phone", { viewport: phone }],
  ["dark", { viewport: desktop, colorScheme: "dark" }],
  ["phone without scripts", { viewport: phone, javaScriptEnabled: false, colorScheme: "dark" }],
]) {
  test(`all pages fit: ${name}`, { timeout: 120_000 }, async () => {
    // Somebody under way, so that there is something to see.
    const person = await open(browser);
    await person.goto(`${server.url}/s/yellow?source=pilot`);
    await person.getByRole("button", { name: "Start" }).click();
    await goOn(person, person.locator("button[name=consent][value=agree]"));
    await person.context().close();

    const page = await open(browser, options);
    await logIn(page);
    await fits(page);
    await picture(page, `studies-list-${name}`);
    for (const end of ["", "/sources", "/participants", "/links", "/preview", "/data"]) {
      const response = await page.goto(`${server.url}/studies/yellow${end}`);
      assert.equal(response.status(), 200);
      await fits(page);
      await picture(page, `studies${end.replace("/", "-") || "-overview"}-${name}`);
    }
    assert.deepEqual(page.faults, []);
    await page.context().close();
  });
}
