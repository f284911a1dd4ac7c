/**
 * Replaces the sentences that the server makes: `[data-text]`, `[data-list]`, and hides `[data-shown]` whose table is empty.
 * What did not change is left alone, so that nobody loses their place.
 */
export function showWords(root, reading) {
  for (const element of root.querySelectorAll("[data-text]")) {
    const text = reading.texts[element.dataset.text] ?? "";
    if (element.textContent !== text) element.textContent = text;
    element.hidden = text === "";
  }
  for (const element of root.querySelectorAll("[data-list]")) {
    const lines = reading.lists[element.dataset.list] ?? [];
    const known = [...element.children].map((item) => item.textContent);
    if (known.length !== lines.length || lines.some((line, index) => line !== known[index])) {
      element.replaceChildren(
        ...lines.map((line) => {
          const item = document.createElement("li");
          item.textContent = line;
          return item;
        }),
      );
    }
    element.hidden = lines.length === 0;
  }
  for (const element of root.querySelectorAll("[data-shown]")) {
    element.hidden = (reading.tables[element.dataset.shown]?.rows ?? []).length === 0;
  }
}
