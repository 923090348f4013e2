/* What the pages with matrices share: a table whose cells are tinted by their numbers, and tables of numbers. */
"use strict";
const fpgCharts = (() => {
  const percent = (share, digits = 1) => (share === null || share === undefined ? "–" : `${(100 * share).toFixed(digits)} %`);
  const step = (value) => (value === null || value === undefined ? "–" : value.toFixed(2).replace("-", "−"));
  const one = (value) => (value === null || value === undefined ? "–" : value.toFixed(1).replace("-", "−"));
  const TINTS = 9; // of the style's, faint to strong

  function make(kind, text, attributes = {}) {
    const element = document.createElement(kind);
    if (text !== undefined) element.textContent = text;
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  }

  /** The class of a cell's tint: a share from 0 to 1 of the strongest. */
  const tint = (share) => `h${Math.max(0, Math.min(TINTS - 1, Math.floor(share * TINTS)))}`;

  function heading(text, scope) {
    const element = make("th", undefined, { scope, title: text });
    element.append(make("span", text));
    return element;
  }

  /**
   * Fill a table of who against whom.
   * `cell(i, j)` gives `text`, `notes` (small lines), `tint` (classes), `label` (its full description) and perhaps
   * `href`, or null where there is nothing. Arrow keys lead from one linked cell to the next.
   */
  function matrix(element, caption, corner, rows, columns, cell) {
    const line = document.createElement("tr");
    line.append(make("th", corner, { scope: "col" }), ...columns.map((text) => heading(text, "col")));
    const thead = make("thead"), body = make("tbody");
    thead.append(line);
    rows.forEach((name, i) => {
      const row = make("tr");
      row.append(heading(name, "row"), ...columns.map((_, j) => matrixCell(cell(i, j))));
      body.append(row);
    });
    element.replaceChildren(make("caption", caption, { class: "unseen" }), thead, body);
    const first = element.querySelector("a");
    if (first) first.tabIndex = 0;
    element.onkeydown = moved;
  }

  function matrixCell(cell) {
    if (!cell) return make("td");
    const element = make("td", undefined, { class: cell.tint });
    const inner = cell.href ? make("a", undefined, { href: cell.href, tabindex: -1, title: cell.label, "aria-label": cell.label }) : make("span", undefined, { title: cell.label });
    inner.append(make("b", cell.text), ...(cell.notes ?? []).map((text) => make("small", text)));
    element.append(inner);
    return element;
  }

  /** An arrow key in a matrix: to the cell beside. */
  function moved(event) {
    const way = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
    const place = event.target.closest("td");
    if (!way || !place) return;
    const next = event.currentTarget.rows[place.parentNode.rowIndex + way[0]]?.cells[place.cellIndex + way[1]]?.querySelector("a");
    if (!next) return;
    event.preventDefault();
    event.target.tabIndex = -1;
    next.tabIndex = 0;
    next.focus();
  }

  /** Fill a table: `head` of texts, `rows` of lists; the first of each row is its heading. */
  function table(element, caption, head, rows) {
    const line = make("tr");
    head.forEach((text, i) => line.append(make("th", text, { scope: "col", class: i ? "num" : "" })));
    const thead = make("thead"), body = make("tbody");
    thead.append(line);
    for (const [name, ...cells] of rows) {
      const row = make("tr");
      row.append(make("th", name, { scope: "row" }), ...cells.map((text) => make("td", text, { class: "num" })));
      body.append(row);
    }
    element.replaceChildren(make("caption", caption, { class: "unseen" }), thead, body);
  }

  function fill(select, names) {
    select.replaceChildren(...names.map((name, i) => new Option(name, i)));
  }

  return { percent, step, one, tint, matrix, table, fill, make };
})();
