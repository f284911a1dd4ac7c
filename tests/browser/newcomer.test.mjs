// A researcher's first day: a study of one's own from a copy, recruited on Prolific, its data taken out, a person erased.
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdir, mkdtemp, readFile, rm, stat, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";
import { launch, open, phone, picture } from "./browser.mjs";
import { arrive, finish } from "./participant.mjs";
import { Server, program } from "./server.mjs";

let folder;
let file;
let server;
let browser;

before(async () => {
  folder = await mkdtemp(path.join(tmpdir(), "riskaware-newcomer-"));
  await mkdir(path.join(folder, "studies"));
  file = path.join(folder, "studies", "winter.toml");
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await server?.stop();
  await rm(folder, { recursive: true });
});

/** Runs a command of the program to its end. */
function riskaware(...args) {
  const { status, stdout, stderr } = spawnSync(program, args, {
    encoding: "utf8",
    env: { ...process.env, RISKAWARE_LOG: "warn" },
  });
  return { status, text: stdout + stderr };
}

/** The text with each [from, to] replaced once; what is not there is an error of the test. */
function changed(text, changes) {
  return changes.reduce((text, [from, to]) => {
    assert.ok(text.includes(from), `the study has no ${from}`);
    return text.replace(from, to);
  }, text);
}

const lineOf = (text, part) => text.slice(0, text.indexOf(part)).split("\n").length;

const json = async (path) => (await fetch(`${server.url}${path}`)).json();

test("a copied study is checked, opened, taken from Prolific, exported, and a person is erased", async () => {
  assert.equal(riskaware("study", "new", "--from", "driving", "--id", "winter", file).status, 0);
  const mine = changed(await readFile(file, "utf8"), [
    ["fine = 50", "fine = 60"],
    ['title = "At the yellow light"', 'title = "Ice on the road"'],
    ["the research team that sent you the link", "the winter lab, winter@lab.example"],
    // Each person meets one kind of questions.
    ['id = "time"\nlabel = "Time"', 'id = "time"\nlabel = "Pressure"\nassign = "between"'],
    ['title = "Thank you, that was all"', 'title = "Done"\ncode = "WINTER1"\nredirect = "https://app.prolific.com/submissions/complete?cc={code}"'],
    ['ids = "hashed"', 'ids = "plain"\nquota = 40'],
  ]);
  const mistakes = [
    ["minutes = 5 ", "minutes = 5000 ", "minutes"],
    ["limit_s = 8", "limit_s = -8", "limit_s"],
    ['include = "all"', 'include = "everybody"', "include"],
  ];
  const faulty = changed(mine, mistakes);
  await writeFile(file, faulty);
  const refused = riskaware("study", "check", file);
  assert.equal(refused.status, 1, refused.text);
  for (const [, planted, key] of mistakes) {
    const found = refused.text.split("\n").find((line) => line.includes(`line ${lineOf(faulty, planted)}, `));
    assert.ok(found?.includes(key), `${planted} is not named in\n${refused.text}`);
  }
  await writeFile(file, mine);
  const checked = riskaware("study", "check", file);
  assert.equal(checked.status, 0, checked.text);

  server = await Server.start(["--studies", path.dirname(file)]);
  assert.equal((await fetch(`${server.url}/s/winter`)).status, 410, "a draft takes nobody in");
  assert.equal(riskaware("study", "open", "winter", "--database", server.database).status, 0);

  const page = await open(browser, { viewport: phone });
  await arrive(page, server.url, "winter", "?PROLIFIC_PID=5f0a&STUDY_ID=64b1&SESSION_ID=9c2d");
  const code = await finish(page, ({ block }) => (block === "baseline" ? "stop" : "accelerate"));
  assert.equal(code, "WINTER1");
  const back = page.getByRole("link", { name: "Return to the recruiting site" });
  assert.equal(await back.getAttribute("href"), "https://app.prolific.com/submissions/complete?cc=WINTER1");
  await picture(page, "newcomer-thanks-phone");

  const api = "/api/v1/studies/winter";
  const counted = async () => (await json(`${api}/summary`)).answers.counted;
  assert.equal(await counted(), 5, "the questions of one kind");
  await until(async () => (await json(`${api}/fits`)).fits.some((fit) => fit.state === "converged" && !fit.provisional));

  const out = await mkdtemp(path.join(folder, "out-"));
  for (const form of ["long", "wide", "ndjson", "psych-ds", "codebook", "bonus", "analysis"]) {
    const target = path.join(out, form);
    const exported = riskaware("export", "winter", "--format", form, "--out", target, "--database", server.database);
    assert.equal(exported.status, 0, `${form}: ${exported.text}`);
    assert.ok((await stat(target)).size > 0, form);
  }
  const long = await readFile(path.join(out, "long"), "utf8");
  assert.ok(long.includes("explicit/") && !long.includes("5f0a"), "answers, and no id of the platform");

  await page.getByRole("link", { name: "Withdraw and delete my data" }).click();
  await page.getByRole("button").click();
  await page.getByRole("heading", { name: /erased|deleted|withdrawn/i }).waitFor();
  assert.equal(await counted(), 0);
  assert.equal((await json(`${api}/summary`)).people.withdrawn, 1);
  const rows = (await (await fetch(`${server.url}${api}/answers.csv`)).text()).trim().split("\n");
  assert.equal(rows.length, 1, "the header alone");
  const states = new Set((await json(`${api}/fits`)).fits.map((fit) => fit.state));
  assert.deepEqual([...states], ["waiting"]);
  assert.deepEqual(page.faults, []);
});

async function until(holds) {
  for (let tries = 0; tries < 300; tries += 1) {
    if (await holds()) return;
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
  assert.fail("it did not come about within a minute");
}
