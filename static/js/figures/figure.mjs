import { caption, planLabel } from "./caption.mjs";
import { fitsOf } from "./curves.mjs";
import { csv, drawingWidth, savePng, saveText, standaloneSvg } from "./export.mjs";
import { filePalette, screenPalette } from "./palette.mjs";
import { showTable } from "./table-view.mjs";

let made = 0;

/** One `<figure data-figure>`: its drawing, caption, table and downloads. */
export class Figure {
  /**
   * @param {HTMLElement} element
   * @param {object} kind what to draw: `needs`, `byPlan`, `draw`, `table`, `file`; `caption` and `nothing` where they differ
   */
  constructor(element, kind) {
    this.element = element;
    this.kind = kind;
    this.plan = element.dataset.plan ?? null;
    made += 1;
    this.id = `figure-${made}`;
    this.drawn = false;
    this.drawnFits = null;
    this.plot = this.part("plot");
    this.width = null;
    this.captionLine = this.part("caption");
    this.tools = this.part("tools");
    this.tableFrame = this.part("table");
    this.addTools();
    new ResizeObserver(() => this.resize()).observe(this.plot);
  }

  part(name) {
    const part = this.element.querySelector(`[data-part=${name}]`);
    if (!part) throw new Error(`figure "${this.element.dataset.figure}" has no part "${name}"`);
    return part;
  }

  addTools() {
    const offer = [
      ["PNG", () => savePng(this.standalone(), this.fileName("png"))],
      ["SVG", () => saveText(this.standalone(), "image/svg+xml", this.fileName("svg"))],
      ["CSV", () => saveText(csv(this.kind.file(this.data, this)), "text/csv", this.fileName("csv"))],
    ];
    this.buttons = offer.map(([label, act]) => {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "button";
      button.textContent = label;
      button.setAttribute("aria-label", `Download ${label}: ${this.title}`);
      button.disabled = true;
      button.addEventListener("click", () => act());
      return button;
    });
    this.tools.append(...this.buttons);
  }

  get title() {
    return this.element.querySelector("[data-part=title]")?.textContent.trim() ?? "";
  }

  get subtitle() {
    return this.element.querySelector("[data-part=subtitle]")?.textContent.trim().replace(/\s+/g, " ") ?? "";
  }

  update(data) {
    if (!this.kind.needs.every((name) => data[name])) return;
    this.data = data;
    if (this.kind.byPlan) this.offerPlans();
    const fits = this.kind.byPlan ? fitsOf(data.curves, this.plan) : null;
    // Fits of other plans are announced as well: they change nothing here.
    if (fits === null || fits !== this.drawnFits) {
      this.draw();
      showTable(this.tableFrame, this.kind.table(data, this));
      this.drawnFits = fits;
    }
    this.label();
    if (this.kind.byPlan) this.element.dataset.fittedVersion = data.curves.fitted_version ?? "";
  }

  label() {
    this.captionLine.textContent = this.kind.caption?.(this.data) ?? caption(this.kind, this.data, this.plan);
  }

  /** Keeps the chosen plan while it exists; offers a choice where there is more than one. */
  offerPlans() {
    const plans = this.data.summary.plans.map((plan) => plan.id);
    if (!plans.includes(this.plan)) this.plan = plans[0] ?? null;
    if (plans.length < 2 || this.offered === plans.join()) return;
    this.offered = plans.join();
    this.element.querySelector(".figure__plan")?.remove();
    const label = document.createElement("label");
    label.className = "figure__plan";
    label.append("Fitted to ");
    const select = document.createElement("select");
    select.className = "select";
    for (const plan of plans) select.add(new Option(planLabel(this.data.summary, plan), plan, false, plan === this.plan));
    select.addEventListener("change", () => {
      this.plan = select.value;
      // The curves of this plan are fetched, and then drawn.
      this.element.dispatchEvent(new CustomEvent("planchange", { bubbles: true }));
    });
    label.append(select);
    this.plot.before(label);
  }

  draw() {
    // Asking for it makes the browser lay the page out, which takes as long as a drawing.
    this.width ??= Math.floor(this.plot.clientWidth);
    if (this.width < 100) return;
    const drawing = this.drawing(this.width, screenPalette);
    this.drawn = drawing !== null;
    for (const button of this.buttons) button.disabled = !this.drawn;
    this.plot.classList.toggle("figure__plot--empty", !this.drawn);
    this.plot.replaceChildren(drawing ?? this.kind.nothing ?? "Nothing to draw yet: no fit has converged.");
  }

  drawing(width, palette) {
    return this.kind.draw(this.data, { width, palette, plan: this.plan, id: this.id });
  }

  resize() {
    const width = Math.floor(this.plot.clientWidth);
    if (width === this.width) return;
    this.width = width;
    if (this.data) this.draw();
  }

  standalone() {
    return standaloneSvg(this.drawing(drawingWidth, filePalette), {
      title: this.title,
      subtitle: this.subtitle,
      caption: this.captionLine.textContent,
    });
  }

  fileName(extension) {
    const { study, data_version: version } = this.data.summary;
    return [study.id, this.element.dataset.figure, this.plan, `v${version}`].filter(Boolean).join("-") + `.${extension}`;
  }
}
