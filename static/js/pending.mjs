import { deliver } from "./delivery.mjs";
import { forget, keep, kept } from "./pending-store.mjs";

const quietMs = 300;

/**
 * Sends the form of a participant page once, keeps it until the server has it, and goes on to the next page. What it
 * says of it stands in the form's `data-saving`, `data-network` and `data-busy`.
 */
export class Pending {
  constructor(form) {
    this.form = form;
    this.action = new URL(form.getAttribute("action") ?? "", location.href).href;
    this.status = form.querySelector("[data-part=status]") ?? this.addStatus();
    this.busy = false;
    form.addEventListener("submit", (event) => this.submitted(event));
    // A page brought back from the browser's memory is an old step: ask for the current one.
    window.addEventListener("pageshow", (event) => event.persisted && location.reload());
    this.resume();
  }

  addStatus() {
    const status = document.createElement("p");
    status.className = "status";
    status.dataset.part = "status";
    status.setAttribute("role", "status");
    (this.form.querySelector(".actions") ?? this.form).prepend(status);
    return status;
  }

  submitted(event) {
    event.preventDefault();
    if (this.busy) return;
    const body = new URLSearchParams(new FormData(this.form, event.submitter)).toString();
    event.submitter?.setAttribute("data-chosen", "");
    const pending = { action: this.action, body };
    keep(pending);
    this.send(pending);
  }

  /** Sends what an earlier page could not. An earlier page's form that is not this one's needs no lock. */
  resume() {
    const pending = kept();
    if (!pending) return;
    if (pending.action === this.action) this.send(pending);
    else deliver(pending, () => {}).then(() => !this.busy && forget());
  }

  async send(pending) {
    this.busy = true;
    for (const button of this.form.querySelectorAll("button")) button.disabled = true;
    const timer = setTimeout(() => this.tell("saving"), quietMs);
    const outcome = await deliver(pending, (trouble) => {
      clearTimeout(timer);
      this.tell(trouble);
    });
    clearTimeout(timer);
    forget();
    if (outcome.kind === "next") location.replace(outcome.url);
    else postAsPage(pending);
  }

  tell(state) {
    this.status.textContent = this.form.dataset[state];
    this.status.dataset.state = state === "saving" ? "saving" : "waiting";
  }
}

/** Posts the same form the plain way, so that the server's page takes this one's place. */
function postAsPage({ action, body }) {
  const form = document.createElement("form");
  form.method = "post";
  form.action = action;
  for (const [name, value] of new URLSearchParams(body)) {
    const field = document.createElement("input");
    field.type = "hidden";
    field.name = name;
    field.value = value;
    form.append(field);
  }
  form.hidden = true;
  document.body.append(form);
  // A field may be called "submit" and hide the method.
  HTMLFormElement.prototype.submit.call(form);
}
