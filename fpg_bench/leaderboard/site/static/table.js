/* Tables of the front page: sorting by a column, filtering by text and kind. */
"use strict";
(() => {
  const MOST = 25; // rows that a long table shows at first

  function sortBy(table, header) {
    const first = header.querySelector("button").dataset.first;
    const now = header.getAttribute("aria-sort");
    const up = now === "none" ? first === "up" : now !== "ascending";
    const column = header.cellIndex;
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => [row, row.cells[column].dataset.v]);
    const numeric = header.classList.contains("num");
    rows.sort(([, a], [, b]) => {
      if (a === "" || b === "") return (a === "") - (b === ""); // what is missing stands last, either way
      return (numeric ? a - b : a.localeCompare(b)) * (up ? 1 : -1);
    });
    body.append(...rows.map(([row]) => row));
    for (const other of header.parentNode.cells) {
      other.setAttribute("aria-sort", other !== header ? "none" : up ? "ascending" : "descending");
    }
  }

  function begin(section) {
    const table = section.querySelector("table.board");
    if (!table) return;
    const search = section.querySelector(".filter");
    const kinds = [...section.querySelectorAll(".kind")];
    const unverified = section.querySelector(".unverified");
    const count = section.querySelector(".count");
    const all = section.querySelector(".all");
    let whole = table.tBodies[0].rows.length <= MOST;

    function show() {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      const wanted = new Set(kinds.filter((box) => box.checked).map((box) => box.value));
      let found = 0;
      let shown = 0;
      const rows = [...table.tBodies[0].rows];
      for (const row of rows) {
        const { kind, text } = row.dataset;
        const fits = wanted.has(kind) && words.every((word) => text.includes(word)) &&
          (unverified.checked || !("unverified" in row.dataset));
        found += fits;
        row.hidden = !fits || (!whole && found > MOST);
        shown += !row.hidden;
      }
      all.hidden = shown === found;
      all.textContent = `Show all ${found}`;
      const cut = shown < found ? `, the first ${shown} shown` : "";
      count.textContent = found === rows.length && !cut ? `${found} ${found === 1 ? "entry" : "entries"}`
        : `${found} of ${rows.length} entries${cut}`;
    }

    for (const header of table.tHead.rows[0].cells) {
      header.querySelector("button").addEventListener("click", () => {
        sortBy(table, header);
        show();
      });
    }
    for (const field of [search, ...kinds, unverified]) field.addEventListener("input", show);
    all.addEventListener("click", () => {
      whole = true;
      show();
    });
    show();
  }

  document.querySelectorAll("section.track").forEach(begin);
  // On a small screen the explanation stands closed, so that a table comes into sight.
  const how = document.querySelector("details.how");
  if (how && matchMedia("(max-width: 700px)").matches) how.open = false;
})();
