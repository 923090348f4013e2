/* The map of cross-play: a side's players placed by their scores against two kinds of rivals, as an SVG of buttons.
   Arrow keys lead from one to the next, from the left to the right. */
"use strict";
const fpgMap = (() => {
  const WIDTH = 480, HEIGHT = 430, LEFT = 50, RIGHT = 16, TOP = 16, BOTTOM = 46;
  const LEAST = -10; // lower scores stand at the edge
  const { node, ticks } = fpgProfile;

  /** Where a score stands: the domain holds all scores but those below the least. */
  function scale(values, from, to) {
    const shown = values.map((value) => Math.max(LEAST, value)), [low, high] = [Math.min(...shown), Math.max(...shown)];
    const margin = 0.06 * (high - low || 1), [first, last] = [low - margin, high + margin];
    const place = (value) => from + ((Math.max(LEAST, value) - first) / (last - first)) * (to - from);
    return { place, ticks: ticks(first, last, 6) };
  }

  function axes(svg, x, y, names) {
    const written = (score) => String(score).replace("-", "−");
    for (const score of x.ticks) {
      node(svg, "line", { class: "grid", x1: x.place(score), x2: x.place(score), y1: TOP, y2: HEIGHT - BOTTOM });
      node(svg, "text", { x: x.place(score), y: HEIGHT - BOTTOM + 17, "text-anchor": "middle" }, written(score));
    }
    for (const score of y.ticks) {
      node(svg, "line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y.place(score), y2: y.place(score) });
      node(svg, "text", { x: LEFT - 7, y: y.place(score) + 4, "text-anchor": "end" }, written(score));
    }
    node(svg, "text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 8, "text-anchor": "middle" }, `score against ${names[0]}`);
    node(svg, "text", { transform: `translate(13,${(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)`, "text-anchor": "middle" }, `score against ${names[1]}`);
  }

  /**
   * Draw a side into a figure.
   * `players` have `name`, `scores` (two), `share` (of the mixture), `flies` and `label`; `every` are all scores that
   * the axes have to hold; `chosen(place)` is called where one is clicked. Gives (place) => nothing, which marks one
   * as chosen.
   */
  function draw(figure, side, names, players, every, chosen) {
    const x = scale(every.map(([first]) => first), LEFT, WIDTH - RIGHT), y = scale(every.map(([, second]) => second), HEIGHT - BOTTOM, TOP);
    figure.replaceChildren();
    const svg = node(figure, "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: `map of-${side}`, role: "group", "aria-label": `${side === "ally" ? "Allies" : "Opponents"} by their scores against ${names.join(" and ")}` });
    axes(svg, x, y, names);
    const at = ({ scores }) => [x.place(scores[0]), y.place(scores[1])];
    for (const player of players) if (player.share > 0.0005) node(svg, "circle", { class: "halo", cx: at(player)[0], cy: at(player)[1], r: 9 + 19 * Math.sqrt(player.share) });
    const marks = players.map((player, place) => mark(svg, player, at(player), place));
    const label = node(svg, "text", { class: "name", "aria-hidden": "true", "text-anchor": "middle" }), order = [...marks.keys()].sort((a, b) => at(players[a])[0] - at(players[b])[0]);
    let held = 0;

    function say(place) {
      const [px, py] = at(players[place]);
      label.textContent = players[place].name;
      const half = label.getComputedTextLength() / 2 + 4;
      label.setAttribute("x", Math.max(half, Math.min(WIDTH - half, px)));
      label.setAttribute("y", py < TOP + 30 ? py + 28 : py - 14);
    }

    function choose(place) {
      held = place;
      marks.forEach((one, i) => {
        one.setAttribute("aria-pressed", String(i === place));
        one.setAttribute("tabindex", i === place ? 0 : -1);
      });
      say(place);
    }

    function go(event, place) {
      const way = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (way) marks[order[(order.indexOf(place) + way + order.length) % order.length]].focus();
      else if (["Enter", " "].includes(event.key)) chosen(place);
      else return;
      event.preventDefault();
    }

    marks.forEach((one, place) => {
      for (const kind of ["pointerenter", "focus"]) one.addEventListener(kind, () => say(place));
      for (const kind of ["pointerleave", "blur"]) one.addEventListener(kind, () => say(held));
      one.addEventListener("click", () => chosen(place));
      one.addEventListener("keydown", (event) => go(event, place));
    });
    return choose;
  }

  function mark(svg, { flies, label }, [px, py], place) {
    const group = node(svg, "g", { class: "mark", role: "button", tabindex: place ? -1 : 0, "aria-label": label, transform: `translate(${px.toFixed(1)},${py.toFixed(1)})` });
    node(group, "circle", { class: "reach", r: 12 });
    node(group, "path", { d: flies ? "M0,-7l7,7l-7,7l-7,-7z" : "M-6,0a6,6 0 1,0 12,0a6,6 0 1,0 -12,0" });
    return group;
  }

  return { draw };
})();
