/* Performance profiles as SVG: a line per entry, distinguished by colour, dashes and marks. */
"use strict";
const fpgProfile = (() => {
  const NS = "http://www.w3.org/2000/svg";
  const WIDTH = 900, HEIGHT = 380, LEFT = 82, RIGHT = 14, TOP = 18, BOTTOM = 46;
  const DASHES = ["", "9 5", "2 4", "10 4 2 4", "16 5", "5 3"];
  const MARKS = ["M-4,0a4,4 0 1,0 8,0a4,4 0 1,0 -8,0", "M-4,-4h8v8h-8z", "M0,-5l5,8h-10z", "M0,-5l5,5l-5,5l-5,-5z", "M-4,-4l8,8M4,-4l-8,8", "M0,-5v10M-5,0h10"];

  function node(parent, kind, attributes, text) {
    const element = parent.appendChild(document.createElementNS(NS, kind));
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    if (text !== undefined) element.textContent = text;
    return element;
  }

  /** The thresholds between which any line changes, as places. */
  function span(lines) {
    const some = (place) => lines.some((line) => line[place] < 1), any = (place) => lines.some((line) => line[place] > 0);
    const places = lines[0].map((_, place) => place);
    const low = places.find(some) ?? 0, high = places.findLast(any) ?? places.length - 1;
    return [Math.max(0, low - 1), Math.min(places.length - 1, high + 1)];
  }

  /** Round numbers in a range, about `count` of them. */
  function ticks(low, high, count) {
    const rough = (high - low) / count, unit = 10 ** Math.floor(Math.log10(rough));
    const size = [1, 2, 5, 10].map((k) => k * unit).find((k) => k >= rough);
    const first = Math.ceil(low / size);
    return Array.from({ length: Math.max(0, Math.floor(high / size) - first + 1) }, (_, k) => (first + k) * size);
  }

  function axes(svg, low, high, x, y) {
    for (const share of [0, 0.25, 0.5, 0.75, 1]) {
      node(svg, "line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(share), y2: y(share) });
      node(svg, "text", { x: LEFT - 8, y: y(share) + 4, "text-anchor": "end" }, `${100 * share} %`);
    }
    for (const score of ticks(low, high, 8)) {
      node(svg, "line", { class: "grid", x1: x(score), x2: x(score), y1: TOP, y2: HEIGHT - BOTTOM });
      node(svg, "text", { x: x(score), y: HEIGHT - BOTTOM + 18, "text-anchor": "middle" }, String(score).replace("-", "−"));
    }
    node(svg, "text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, "score; up: share of runs above it");
  }

  /** One line with its mark, which stands every few thresholds, elsewhere than the others'. */
  function curve(svg, k, points, every) {
    const group = node(svg, "g", { class: `line l${k}` });
    node(group, "polyline", { points: points.map((point) => point.map((value) => value.toFixed(1)).join(",")).join(" "), "stroke-dasharray": DASHES[k] });
    points.forEach(([px, py], place) => {
      if (place % every === (k * 2) % every) node(group, "path", { d: MARKS[k], transform: `translate(${px.toFixed(1)},${py.toFixed(1)})` });
    });
  }

  /** Draw `lines` (names and shares) over thresholds into a figure, with a legend; true where there was anything. */
  function draw(figure, thresholds, lines) {
    figure.replaceChildren();
    if (!lines.length || thresholds.length < 2) return [];
    const [first, last] = span(lines.map(({ share }) => share));
    const [low, high] = [thresholds[first], thresholds[last]];
    const x = (score) => LEFT + ((score - low) / (high - low || 1)) * (WIDTH - LEFT - RIGHT);
    const y = (share) => TOP + (1 - share) * (HEIGHT - TOP - BOTTOM);
    const svg = node(figure, "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "profiles", role: "img", "aria-label": "Performance profiles of the best entries; the table below says the same in numbers" });
    axes(svg, low, high, x, y);
    const every = Math.max(6, Math.ceil((last - first) / 6));
    lines.forEach(({ share }, k) => curve(svg, k, thresholds.slice(first, last + 1).map((score, i) => [x(score), y(share[first + i])]), every));
    const legend = document.createElement("ul");
    legend.className = "legend";
    lines.forEach(({ name }, k) => {
      const item = legend.appendChild(document.createElement("li"));
      const swatch = node(item, "svg", { viewBox: "0 -8 44 16", width: 44, height: 16, "aria-hidden": "true", class: "profiles" });
      curve(swatch, k, [[0, 0], [22, 0], [44, 0]], 0); // without marks but that in the middle
      node(swatch.firstChild, "path", { d: MARKS[k], transform: "translate(22,0)" });
      item.append(name);
    });
    figure.append(legend);
    return ticks(low, high, 6);
  }

  return { draw, node, ticks, MOST: MARKS.length };
})();
