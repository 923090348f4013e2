/* Tables of the ranking: sorting by a column, filtering by text and kind, a choice of columns.
   The address keeps all of it: #TRACK&columns=all&TRACK.sort=3u&TRACK.find=WORDS&TRACK.kinds=zoo,script */
"use strict";
(() => {
  const MOST = 25; // rows that a long table shows at first
  const UNVERIFIED = "unverified";
  const [place, ...words] = location.hash.slice(1).split("&");
  const asked = new URLSearchParams(words.join("&"));
  const choices = document.querySelectorAll(".columns"); // the same choice, beside each table

  /** Put a choice into the address; one that is as at first is left out. */
  function keep(name, value, usual) {
    if (value === usual) asked.delete(name);
    else asked.set(name, value);
    const kept = asked.toString();
    const here = decodeURIComponent(location.hash.slice(1).split("&")[0]);
    const wanted = kept ? `#${here}&${kept}` : here ? `#${here}` : location.pathname;
    history.replaceState(null, "", wanted);
  }

  /** What a cell is sorted by: its key, else the name or the number that it shows; empty without a number. */
  function keyOf(cell) {
    if ("v" in cell.dataset) return cell.dataset.v;
    if (cell.matches(".who")) return cell.querySelector("a").textContent.toLowerCase();
    const shown = parseFloat(cell.textContent.replace("\u2212", "-")); // a minus sign, which parseFloat does not take
    return Number.isNaN(shown) ? "" : shown;
  }

  /** What a filter finds: an entry's name, agent, algorithm and authors. */
  function textOf(row) {
    return `${row.querySelector(".who a").textContent} ${row.dataset.text}`.toLowerCase();
  }

  function sortBy(table, header, up) {
    const column = header.cellIndex;
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => [row, keyOf(row.cells[column])]);
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

  /** Whether a press on a head sorts upwards: the other way round than now, or as suits the column. */
  function upNext(header) {
    const now = header.getAttribute("aria-sort");
    return now === "none" ? header.querySelector("button").dataset.first === "up" : now !== "ascending";
  }

  function begin(section) {
    const table = section.querySelector("table.board");
    if (!table) return;
    const key = section.id;
    const search = section.querySelector(".filter");
    const kinds = [...section.querySelectorAll(".kind"), section.querySelector(".unverified")];
    const count = section.querySelector(".count");
    const all = section.querySelector(".all");
    const heads = [...table.tHead.rows[0].cells].slice(1); // the first one, of places, does not sort
    const nameOf = (box) => (box.classList.contains("unverified") ? UNVERIFIED : box.value);
    let isFull = table.tBodies[0].rows.length <= MOST;

    function show() {
      const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
      const wanted = new Set(kinds.filter((box) => box.checked).map(nameOf));
      let matching = 0;
      let shown = 0;
      const rows = [...table.tBodies[0].rows];
      for (const row of rows) {
        const text = textOf(row);
        const fits = wanted.has(row.dataset.kind) && words.every((word) => text.includes(word)) &&
          (wanted.has(UNVERIFIED) || !("unverified" in row.dataset));
        matching += fits;
        row.hidden = !fits || (!isFull && matching > MOST);
        shown += !row.hidden;
      }
      all.hidden = shown === matching;
      all.textContent = `Show all ${matching}`;
      const cut = shown < matching ? `, the first ${shown} shown` : "";
      count.textContent = matching === rows.length && !cut ? `${matching} ${matching === 1 ? "entry" : "entries"}`
        : `${matching} of ${rows.length} entries${cut}`;
    }

    /** What the address asks for. */
    function recall() {
      search.value = asked.get(`${key}.find`) ?? "";
      const shown = asked.get(`${key}.kinds`)?.split(",");
      for (const box of kinds) box.checked = !shown || shown.includes(nameOf(box));
      section.querySelector(".sift").open = Boolean(search.value || shown);
      const [, column, up] = /^(\d+)([ud])$/.exec(asked.get(`${key}.sort`) ?? "") ?? [];
      if (heads[column]) sortBy(table, heads[column], up === "u");
    }

    heads.forEach((header, column) => header.querySelector("button").addEventListener("click", () => {
      const up = upNext(header);
      sortBy(table, header, up);
      keep(`${key}.sort`, `${column}${up ? "u" : "d"}`, "1d");
      show();
    }));
    search.addEventListener("input", () => {
      keep(`${key}.find`, search.value, "");
      show();
    });
    for (const box of kinds) {
      box.addEventListener("input", () => {
        const checked = kinds.filter((one) => one.checked).map(nameOf);
        keep(`${key}.kinds`, checked.length === kinds.length ? "" : checked.join(","), "");
        show();
      });
    }
    all.addEventListener("click", () => {
      isFull = true;
      show();
    });
    recall();
    show();
  }

  function chooseColumns(wanted) {
    for (const one of choices) one.value = wanted;
    for (const table of document.querySelectorAll("table.board")) table.classList.toggle("few", wanted !== "all");
  }

  for (const one of choices) {
    one.addEventListener("change", () => {
      keep("columns", one.value, "few");
      chooseColumns(one.value);
    });
  }
  chooseColumns(asked.get("columns") === "all" ? "all" : "few");
  document.querySelectorAll("section.track").forEach(begin);
  if (words.length) document.getElementById(place)?.scrollIntoView(); // else the browser has gone there
})();
