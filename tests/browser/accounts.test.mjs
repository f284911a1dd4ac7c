// The first account: from the printed link to the results and out again, on a phone and without scripts.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open, phone, picture } from "./browser.mjs";
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

/** Nothing sticks out, and everything that can be pressed is large enough for a thumb. */
async function fits(page) {
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  assert.ok(wide <= 0, `${page.url()} is ${wide} px too wide`);
  const controls = page.locator("nav.account-bar a, nav.account-bar button, .button, .input:not([type=hidden]), .select");
  for (const box of await Promise.all((await controls.all()).map((control) => control.boundingBox()))) {
    if (box) assert.ok(box.height >= 48, `${page.url()}: ${JSON.stringify(box)}`);
  }
}

for (const javaScriptEnabled of [true, false]) {
  test(`setup link, login, results, logout on a phone, JavaScript ${javaScriptEnabled}`, async () => {
    const page = await open(browser, { viewport: phone, javaScriptEnabled });
    if (javaScriptEnabled) {
      assert.ok(server.setupLink, "the link is printed");
      await page.goto(server.setupLink);
      await fits(page);
      await page.getByLabel("Name").fill("ada");
      await page.getByLabel("Password", { exact: true }).fill("correct horse battery");
      await page.getByLabel("Password once more").fill("correct horse batter");
      await page.getByRole("button", { name: "Make the account" }).click();
      await page.getByRole("alert").getByText("The two passwords are not the same").waitFor();
      await page.getByLabel("Password", { exact: true }).fill("correct horse battery");
      await page.getByLabel("Password once more").fill("correct horse battery");
      await picture(page, "account-setup");
      await page.getByRole("button", { name: "Make the account" }).click();
      await page.getByRole("heading", { name: "Your account" }).waitFor();
      await fits(page);
      await picture(page, "account-own");
      await page.getByRole("button", { name: "Log out", exact: true }).click();
      assert.equal((await page.goto(server.setupLink)).status(), 404);
    }

    await page.goto(`${server.url}/results/driving`);
    assert.match(page.url(), /\/login\?next=/);
    await fits(page);
    await page.getByLabel("Name").fill("ada");
    await page.getByLabel("Password", { exact: true }).fill("not the password");
    await page.getByRole("button", { name: "Log in" }).click();
    await page.getByText("this name and password open no account").waitFor();
    await page.getByLabel("Password", { exact: true }).fill("correct horse battery");
    await page.getByRole("button", { name: "Log in" }).click();
    await page.waitForURL(`${server.url}/results/driving`);
    await page.getByText("Signed in as ada").waitFor();
    // The live page and its scripts read with the cookie alone.
    if (javaScriptEnabled) await page.getByText("Live", { exact: false }).first().waitFor();
    await picture(page, `account-results-${javaScriptEnabled}`, {});

    await page.getByRole("link", { name: "Accounts" }).click();
    await fits(page);
    await picture(page, "account-people");
    await page.getByRole("link", { name: "Log", exact: true }).click();
    await page.getByRole("cell", { name: "wrong password" }).first().waitFor();
    await fits(page);
    await picture(page, "account-log");

    await page.getByRole("button", { name: "Log out" }).click();
    await page.waitForURL(`${server.url}/`);
    await page.goto(`${server.url}/results/driving`);
    assert.match(page.url(), /\/login\?next=/);
    assert.deepEqual(page.faults, []);
    await page.context().close();
  });
}

test("sweeps are drawn for whoever is logged in", async () => {
  const page = await open(browser);
  await page.goto(`${server.url}/login`);
  await page.getByLabel("Name").fill("ada");
  await page.getByLabel("Password", { exact: true }).fill("correct horse battery");
  await page.getByRole("button", { name: "Log in" }).click();
  const asked = page.waitForResponse((response) => response.url().includes("/data/sweep.json"));
  await page.goto(`${server.url}/results/driving/sweep?seeds=1&n=2&steps=2`);
  assert.ok([200, 202].includes((await asked).status()));
  assert.deepEqual(page.faults, []);
  await page.context().close();
});
