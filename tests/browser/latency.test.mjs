// How long it takes from an answer to the curves that hold it. The times are logged and not asserted: they say something
// about the machine. What is asserted is that every answer reaches the curves.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open } from "./browser.mjs";
import { Server } from "./server.mjs";

const answers = 200;
const patienceMs = 30_000;

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

/** A person without a browser: what a form posts, and nothing else. */
class Person {
  static async start() {
    const landing = await (await fetch(`${server.url}/s/driving`)).text();
    const action = landing.match(/<form[^>]*action="([^"]+)"/)[1];
    const person = new Person();
    await person.show(await fetch(`${server.url}${action}`, { method: "POST" }));
    return person;
  }

  async show(response) {
    assert.equal(response.status, 200, response.url);
    this.link = response.url;
    this.html = await response.text();
  }

  field(name) {
    return this.html.match(new RegExp(`<input[^>]*name="${name}"[^>]*value="([^"]*)"`))?.[1] ?? "";
  }

  get actions() {
    return [...this.html.matchAll(/<button[^>]*name="action"[^>]*value="([^"]*)"/g)].map((found) => found[1]);
  }

  get hasFinished() {
    return this.html.includes("completion__code");
  }

  /** Whether the question on the page is one that the models are fitted to. */
  get isFitted() {
    const block = this.html.match(/data-block="([^"]*)"/)?.[1];
    return ["timed", "untimed"].includes(block) && !this.html.includes("you do not know");
  }

  async goOn(action) {
    const answer = this.html.includes('name="consent"') ? ["consent", "agree"] : action ? ["action", action] : ["continue", "1"];
    const form = new URLSearchParams([["step", this.field("step")], ["key", this.field("key")], answer]);
    await this.show(await fetch(this.link, { method: "POST", body: form }));
  }
}

/** The version of the data: what the event stream says first. */
async function dataVersion() {
  const { body } = await fetch(`${server.url}/results/driving/events`);
  const reader = body.getReader();
  const { value } = await reader.read();
  await reader.cancel();
  return JSON.parse(new TextDecoder().decode(value).match(/^data: ?(.*)$/m)[1]).data_version;
}

/** The time at which all curves of data this new were drawn. */
function drawn(page, version) {
  return page.evaluate(([version, patienceMs]) => new Promise((resolve, reject) => {
    const figures = [...document.querySelectorAll("[data-figure][data-plan]")];
    if (figures.length === 0) throw new Error("the page has no curves");
    const isDrawn = (figure) => Number(figure.dataset.fittedVersion) >= version;
    const look = () => {
      if (!figures.every(isDrawn)) return;
      observer.disconnect();
      clearTimeout(timer);
      // Not before it can be seen.
      requestAnimationFrame(() => resolve(Date.now()));
    };
    const observer = new MutationObserver(look);
    for (const figure of figures) observer.observe(figure, { attributes: true });
    const timer = setTimeout(() => reject(new Error(`no curves of data version ${version}`)), patienceMs);
    look();
  }), [version, patienceMs]);
}

test("every answer reaches the curves", { timeout: 600_000 }, async () => {
  const page = await open(browser);
  await page.goto(`${server.url}/results/driving`);
  const times = [];
  let person = await Person.start();
  while (times.length < answers) {
    if (person.hasFinished) person = await Person.start();
    const action = person.actions.at(times.length % 5 === 0 ? 0 : -1);
    const isCounted = person.isFitted && action;
    const posted = Date.now();
    await person.goOn(action);
    if (!isCounted) continue;
    times.push(await drawn(page, await dataVersion()) - posted);
  }
  assert.equal(times.length, answers);
  assert.deepEqual(page.faults, []);
  times.sort((one, other) => one - other);
  const at = (share) => times[Math.ceil(share * times.length) - 1];
  console.log(`answer posted to curves drawn, ${answers} answers: p50 ${at(0.5)} ms, p95 ${at(0.95)} ms, longest ${times.at(-1)} ms`);
});
