// Debian's Chromium, and pages that record what must never happen.
import { execFileSync } from "node:child_process";
import { mkdir, mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { chromium } from "playwright-core";

export const phone = { width: 390, height: 844 };
export const desktop = { width: 1280, height: 800 };

const shots = path.resolve(import.meta.dirname, "../../test-output");

function options() {
  return {
    executablePath: execFileSync("which", ["chromium"], { encoding: "utf8" }).trim(),
    args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
      "--disable-background-networking", "--disable-component-update", "--disable-sync"],
  };
}

export function launch() {
  return chromium.launch(options());
}

/** A browser of its own whose settings block all cookies, and with them the storage of pages. */
export async function launchWithoutCookies(settings) {
  const profile = await mkdtemp(path.join(tmpdir(), "riskaware-profile-"));
  await mkdir(path.join(profile, "Default"));
  const preferences = { profile: { default_content_setting_values: { cookies: 2 } } };
  await writeFile(path.join(profile, "Default/Preferences"), JSON.stringify(preferences));
  const context = await chromium.launchPersistentContext(profile, { ...options(), ...settings });
  const close = async () => {
    await context.close();
    await rm(profile, { recursive: true });
  };
  return { context, close };
}

/** A page whose `faults` collects script errors and violations of the content security policy. */
export async function open(browser, options = {}) {
  const context = await browser.newContext({ viewport: desktop, ...options });
  const page = await context.newPage();
  page.faults = [];
  page.on("pageerror", (error) => page.faults.push(String(error)));
  page.on("console", (message) => {
    if (message.type() === "error" && /Content Security Policy/.test(message.text())) {
      page.faults.push(message.text());
    }
  });
  return page;
}

/** Keeps a picture in test-output/, to be looked at. */
export async function picture(page, name, options = { fullPage: true }) {
  await mkdir(shots, { recursive: true });
  await page.screenshot({ path: path.join(shots, `${name}.png`), ...options });
}
