/* Two entries side by side; the address keeps which. All texts are set as text, never as markup.
   The figures of a track, and the scores behind the intervals of an entry, are scripts that are loaded when they are chosen. */
"use strict";
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const { measures } = window.fpgData;
  const parts = {}, loads = {}; // what is loaded by name, TRACK or TRACK/ENTRY, and its promise
  const { between, against } = fpgDifferences;
  const select = Object.fromEntries(["track", "a", "b"].map((id) => [id, document.getElementById(id)]));
  const number = (value) => (value === null || value === undefined ? "–" : value.toFixed(1).replace("-", "−"));
  const percent = (share) => (share === null || share === undefined ? "–" : `${(100 * share).toFixed(1)} %`);

  function styled(value, style) {
    if (value === null || value === undefined) return "–";
    if (style === "share") return percent(value);
    if (style === "whole") return Math.round(value).toLocaleString("en").replace("-", "−");
    if (style === "step") return value.toFixed(2).replace("-", "−");
    return style === "score" ? number(value) : `${number(value)} ${style}`;
  }

  function make(kind, text, name) {
    const element = document.createElement(kind);
    if (text !== undefined) element.textContent = text;
    if (name) element.className = name;
    return element;
  }

  // What a script of data calls.
  window.fpgCompared = (name, content) => {
    parts[name] = content;
  };

  function load(name) {
    loads[name] ??= new Promise((done) => {
      const script = document.createElement("script");
      script.src = `data/compare/${name}.js`;
      script.addEventListener("load", () => done(script.remove()));
      document.head.append(script);
    });
    return loads[name];
  }

  const track = () => parts[select.track.value];
  const entry = (side) => track().rows.find((row) => row.slug === select[side].value);
  const choice = () => ["track", "a", "b"].map((id) => select[id].value).join();

  function fillEntries(wanted) {
    const rows = track().rows;
    for (const [index, side] of ["a", "b"].entries()) {
      select[side].replaceChildren(...rows.map((row) => new Option(`${row.name} (${row.kind})`, row.slug)));
      const slug = wanted[side];
      const exists = rows.some((row) => row.slug === slug);
      const other = rows.findIndex((row) => row.slug !== select.a.value);
      const fallback = index ? Math.max(0, other) : 0;
      if (rows.length) select[side].value = exists ? slug : rows[fallback].slug;
    }
  }

  async function read() {
    const asked = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
    if ([...select.track.options].some(({ value }) => value === asked.track)) select.track.value = asked.track;
    if (await entries(asked)) show();
  }

  /** Offer the entries of the track, once they are there; false if another track has been chosen meanwhile. */
  async function entries(wanted) {
    const key = select.track.value;
    await load(key);
    if (key !== select.track.value) return false;
    fillEntries(wanted);
    return true;
  }

  function keep() {
    const address = new URLSearchParams({ track: select.track.value, a: select.a.value, b: select.b.value });
    history.replaceState(null, "", `#${address}`);
    show();
  }

  /** Both intervals on one axis. */
  function picture(domain, pair) {
    const width = 190, margin = 6;
    const x = (value) => margin + ((value - domain[0]) / (domain[1] - domain[0])) * (width - 2 * margin);
    const svg = document.createElementNS(NS, "svg");
    const draw = (kind, attributes) => {
      const element = svg.appendChild(document.createElementNS(NS, kind));
      for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    };
    for (const [name, value] of Object.entries({ width, height: 28, "aria-hidden": "true", class: "interval both" })) svg.setAttribute(name, value);
    for (const mark of [0, 100]) draw("line", { class: "mark", x1: x(mark), x2: x(mark), y1: 1, y2: 27 });
    pair.forEach(([value, low, high], i) => {
      if (value === null) return;
      const y = i ? 20 : 8, name = i ? "second" : "first";
      draw("line", { class: `range ${name}`, x1: x(low ?? value), x2: x(high ?? value), y1: y, y2: y });
      draw("path", { class: `dot ${name}`, d: `M${x(value)} ${y - 6}v3m0 6v3` });
    });
    return svg;
  }

  function section(title, head, rows) {
    const box = make("section");
    const heading = make("h2", title);
    heading.id = `part-${title.toLowerCase().replace(/\W+/g, "-")}`;
    box.setAttribute("aria-labelledby", heading.id);
    const scroll = make("div", undefined, "scroll");
    scroll.tabIndex = 0;
    scroll.setAttribute("role", "group");
    scroll.setAttribute("aria-labelledby", heading.id);
    const table = make("table", undefined, "plaintable compared");
    table.append(make("caption", title, "unseen"));
    const line = table.createTHead().insertRow();
    head.forEach((text, i) => {
      const cell = make("th", text, ["", "num first", "num second", "num", "picture"][i]);
      cell.scope = "col";
      line.append(cell);
    });
    const body = table.createTBody();
    for (const [name, ...cells] of rows) {
      const row = body.insertRow();
      const first = make("th", name);
      first.scope = "row";
      row.append(first);
      for (const cell of cells) {
        const place = make("td", undefined, cell instanceof SVGElement ? "" : "num");
        place.append(cell);
        row.append(place);
      }
    }
    scroll.append(table);
    box.append(heading, scroll);
    return box;
  }

  /** A difference with its interval, bold where that excludes 0; `k`: the rival, null: all of them. */
  function apart(role, k, a, b, one, two) {
    if (one[0] === null || two[0] === null) return "–";
    const units = [a.units[role], b.units[role]];
    if (units.includes(null)) return signed(one[0] - two[0]);
    const [value, half] = between(...units.map((of) => against(of, k)), track().student[role]);
    if (half === null) return signed(value);
    return make(Math.abs(value) > half ? "b" : "span", `${signed(value)}  (${signed(value - half)} to ${signed(value + half)})`);
  }

  /** Scores of both over a suite: all of it where it has several rivals, then each. */
  function scored(suite, domain, a, b) {
    const text = ([value, low, high]) => (low === null || value === null ? number(value) : `${number(value)}  (${number(low)} to ${number(high)})`);
    const each = suite.rivals.map((name, k) => [name, k, a.by_rival[suite.role][k], b.by_rival[suite.role][k]]);
    const pairs = each.length === 1 ? each : [["All rivals", null, a.scores[suite.role], b.scores[suite.role]], ...each];
    return pairs.map(([name, k, one, two]) => [name, text(one), text(two), apart(suite.role, k, a, b, one, two), picture(domain, [one, two])]);
  }

  /** The suites that either has played, and the domain of their pictures. */
  function shown(a, b) {
    const suites = track().suites.filter(({ role }) => a.scores[role][0] !== null || b.scores[role][0] !== null);
    const intervals = suites.flatMap(({ role }) => [a, b].flatMap((row) => [row.scores[role], ...row.by_rival[role]]));
    const numbers = intervals.flat().filter((value) => value !== null);
    return [suites, [Math.min(0, ...numbers), Math.max(100, ...numbers)]];
  }

  const signed = (value) => (value >= 0 ? "+" : "−") + Math.abs(value).toFixed(1);

  const gaps = (a, b) => (a.gap === null && b.gap === null ? [] : [["Gap, public - held-out", number(a.gap), number(b.gap)]]);

  function facts(a, b) {
    const budget = ({ steps }) => (steps === null ? "–" : `${steps.toLocaleString("en")} steps`);
    return [
      ["Rank", a.rank, b.rank], ...gaps(a, b),
      ["Algorithm", a.algorithm, b.algorithm], ["Authors", a.authors, b.authors], ["Learning budget per seed", budget(a), budget(b)],
    ];
  }

  function measured(a, b) {
    const shown = Object.keys(measures).filter((name) => (a.measures[name] ?? null) !== null || (b.measures[name] ?? null) !== null);
    return shown.map((name) => [measures[name].label, ...[a, b].map((of) => styled(of.measures[name], measures[name].style))]);
  }

  /** In a sentence: the difference over a field, with its interval and what that is over. */
  function sure(role, a, b) {
    const units = [a.units[role], b.units[role]];
    if (units.includes(null)) return "";
    const [value, half] = between(...units.map((of) => against(of, null)), track().student[role]);
    if (half === null) return "";
    const enough = Math.abs(value) > half ? "beyond chance" : "which chance may have made";
    return ` They are ${number(Math.abs(value))} apart, ${enough}: the interval of the difference, match by match, is ${signed(value - half)} to ${signed(value + half)}; with 95 % those of all pairs hold together.`;
  }

  /** In a sentence: who is ahead, and how sure that is. */
  function verdict(a, b) {
    const both = (role) => a.scores[role][0] !== null && b.scores[role][0] !== null;
    const { role, label } = track().suites.find((suite) => suite.role === track().ranked_by && both(suite.role)) ?? track().suites[0];
    const pairs = a.by_rival[role].map(([one], k) => [one, b.by_rival[role][k][0]]).filter(([one, two]) => one !== null && two !== null);
    const wins = pairs.filter(([one, two]) => one > two).length;
    let text = `Over the ${label.toLowerCase()} suite ${a.name} scores ${number(a.scores[role][0])}, ${b.name} ${number(b.scores[role][0])}; the first is ahead against ${wins} of ${pairs.length} rivals.`;
    text += sure(role, a, b);
    return text;
  }

  async function show() {
    const place = document.getElementById("comparison");
    const a = entry("a"), b = entry("b");
    if (!a || !b) {
      document.getElementById("verdict").textContent = "This track has no ranked entries yet.";
      place.replaceChildren();
      return;
    }
    const now = choice();
    const names = [a, b].map(({ slug }) => `${select.track.value}/${slug}`);
    await Promise.all(names.map(load));
    if (now !== choice()) return;
    [a.units, b.units] = names.map((name) => parts[name]);
    document.getElementById("verdict").textContent = a === b ? "Choose two different entries." : verdict(a, b);
    const heads = [a.name, b.name];
    const links = make("p", "Their pages: ");
    for (const [index, row] of [a, b].entries()) {
      const link = make("a", row.name);
      link.href = row.page;
      links.append(index ? " · " : "", link);
    }
    const columns = make("div", undefined, "columns");
    columns.append(
      section("At a glance", ["Fact", ...heads], facts(a, b)),
      section("What happens in their games", ["Measure", ...heads], measured(a, b)),
    );
    const [suites, domain] = shown(a, b);
    const scores = suites.map((suite) => section(`${suite.label}: ${suite.about}`, ["Rival", ...heads, "Difference", "Picture"], scored(suite, domain, a, b)));
    place.replaceChildren(...scores, columns, links);
  }

  select.track.addEventListener("change", async () => {
    if (await entries({})) keep();
  });
  for (const side of ["a", "b"]) select[side].addEventListener("change", keep);
  document.getElementById("swap").addEventListener("click", () => {
    [select.a.value, select.b.value] = [select.b.value, select.a.value];
    keep();
  });
  window.addEventListener("hashchange", read);
  read();
})();
