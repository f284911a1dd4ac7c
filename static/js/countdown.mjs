const spoken = [5, 3];

/**
 * Shows the time left (the server's remaining time, counted from the first frame) and, at zero,
 * locks the form and sends it without an action. The server alone decides what was in time.
 */
export class Countdown {
  constructor(element) {
    this.element = element;
    this.form = element.closest("form");
    this.bar = element.querySelector("[data-part=bar]");
    this.seconds = element.querySelector("[data-part=seconds]");
    this.announcer = element.querySelector("[data-part=announcer]");
    this.remaining = Number(element.dataset.remainingMs);
    this.limit = Number(element.dataset.limitMs);
    if (!(this.limit > 0) || !Number.isFinite(this.remaining)) throw new Error("countdown without its times");
    this.stepped = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.unspoken = spoken.filter((second) => second * 1000 < this.remaining);
    this.words = element.dataset;
    this.done = false;

    this.form.addEventListener("submit", () => (this.done = true));
    // A page in the background gets no frames: the timer starts and ends the countdown there.
    const begin = () => this.begin();
    requestAnimationFrame(begin);
    if (document.visibilityState === "hidden") setTimeout(begin);
  }

  begin() {
    if (this.endsAt !== undefined) return;
    this.endsAt = performance.now() + this.remaining;
    setTimeout(() => this.end(), this.remaining);
    this.draw();
  }

  draw() {
    if (this.done) return;
    const left = Math.max(0, this.endsAt - performance.now());
    const whole = Math.ceil(left / 1000);
    const shown = this.stepped ? whole * 1000 : left;
    this.bar.style.setProperty("--fraction", String(Math.min(1, shown / this.limit)));
    const text = `${whole} s`;
    if (this.seconds.textContent !== text) this.seconds.textContent = text;
    this.announce(whole);
    requestAnimationFrame(() => this.draw());
  }

  announce(whole) {
    if (this.unspoken.length === 0 || whole > this.unspoken[0]) return;
    const second = this.unspoken.shift();
    this.say(this.words.secondsLeft.replace("{seconds}", String(second)));
  }

  say(text) {
    if (this.announcer) this.announcer.textContent = text;
  }

  end() {
    if (this.done) return;
    this.seconds.textContent = "0 s";
    this.bar.style.setProperty("--fraction", "0");
    this.element.dataset.ended = "";
    this.say(this.words.timeUp);
    const field = document.createElement("input");
    field.type = "hidden";
    field.name = "timed_out";
    field.value = "1";
    this.form.append(field);
    for (const control of this.form.querySelectorAll("button, input:not([type=hidden])")) control.disabled = true;
    this.form.noValidate = true;
    this.form.requestSubmit();
  }
}
