/**
 * Puts the rows into the table inside `frame`, which the server may have filled before.
 * @param {Element} frame
 * @param {{columns: {label: string, numeric?: boolean, wraps?: boolean}[], rows: (string | {text: string, state: string})[][]}} content
 */
export function showTable(frame, { columns, rows }) {
  let table = frame.querySelector("table");
  if (!table) {
    table = document.createElement("table");
    table.className = "table";
    frame.append(table);
  }
  const head = document.createElement("thead");
  const headRow = head.insertRow();
  for (const column of columns) headRow.append(cell("th", column.label, column, "col"));
  const body = document.createElement("tbody");
  for (const row of rows) {
    const line = body.insertRow();
    row.forEach((value, index) => line.append(cell(index === 0 ? "th" : "td", value, columns[index], index === 0 ? "row" : null)));
  }
  table.tHead?.remove();
  for (const old of [...table.tBodies]) old.remove();
  table.append(head, body);
}

function cell(name, value, column, scope) {
  const element = document.createElement(name);
  if (scope) element.scope = scope;
  if (column.numeric) element.className = "numeric";
  if (column.wraps) element.className = "wraps";
  if (typeof value === "object") {
    const state = document.createElement("span");
    state.className = `state state--${value.state}`;
    state.textContent = value.text;
    element.append(state);
  } else {
    element.textContent = value;
  }
  return element;
}
