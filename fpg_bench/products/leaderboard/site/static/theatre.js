/* Rounds of one policy from random play to the end of its training, side by side as waterfalls: frequencies across,
   the newest second on top. A still where motion is not wanted. The rounds are loaded when a visitor comes near. */
"use strict";
// What the rounds' script calls.
window.fpgTheatre = ({ band: [low, high], jamming, rounds }) => {
  const SHOWN_S = 60, SPEED = 10, STILL_S = 150; // seconds of a waterfall; seconds a second; where the still stands
  const box = document.getElementById("theatre"), pause = document.getElementById("theatre-pause");
  const canvases = rounds.map(figure), last = rounds[0].frequency.length;
  let time = STILL_S, before = null, moving = false, seen = false, colours = fpgPen.readColours();

  function figure({ steps, jammed, earned }) {
    const element = box.appendChild(document.createElement("figure")), canvas = element.appendChild(document.createElement("canvas"));
    const name = steps ? `After ${steps.toLocaleString("en")} steps` : "Random play";
    const figures = `jamming success rate ${(100 * jammed).toFixed(0)} %; the ally earns ${earned.toFixed(1).replace("-", "−")} per step`;
    const [title, note] = ["b", "small"].map((kind) => document.createElement(kind));
    [title.textContent, note.textContent] = [name, figures];
    element.appendChild(document.createElement("figcaption")).append(title, note);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${name}: the band over time`);
    return canvas;
  }

  function drawOne(canvas, round) {
    const { pen, width, height } = fpgPen.prepare(canvas);
    const x = (mhz) => ((mhz - low + 4) / (high - low + 8)) * width, row = height / SHOWN_S, newest = Math.min(last, Math.floor(time));
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, width, height);
    for (let k = Math.max(0, newest - SHOWN_S); k < newest; k++) {
      const y = Math.round((newest - 1 - k) * row), tall = Math.round((newest - k) * row) - y;
      pen.globalAlpha = 0.62;
      pen.fillStyle = colours.opponent;
      for (const [from, to] of fpgPen.footprint(jamming[round.type[k]], round.centre[k], low - 4, high + 4)) pen.fillRect(x((from + to) / 2) - Math.max(3, x(to) - x(from)) / 2, y, Math.max(3, x(to) - x(from)), tall);
      pen.globalAlpha = 1;
      pen.fillStyle = round.out[k] ? colours.ink : colours.ally;
      pen.fillRect(x(round.frequency[k]) - 4, y, 8, tall);
    }
  }

  const draw = () => canvases.forEach((canvas, i) => drawOne(canvas, rounds[i]));

  function tick(now) {
    if (!moving || !seen) return;
    const [old, passed] = [Math.floor(time), before === null ? 0 : Math.min(now - before, 100) / 1000];
    before = now;
    time = (time + passed * SPEED) % (last + SPEED);
    if (Math.floor(time) !== old) draw();
    requestAnimationFrame(tick);
  }

  function move(on) {
    [moving, before] = [on, null];
    pause.textContent = on ? "❚❚" : "▶";
    pause.setAttribute("aria-label", on ? "Pause the waterfalls" : "Play the waterfalls");
    if (on) requestAnimationFrame(tick);
  }

  const recolour = () => {
    colours = fpgPen.readColours();
    draw();
  };
  pause.addEventListener("click", () => move(!moving));
  new ResizeObserver(draw).observe(box);
  new MutationObserver(recolour).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  new IntersectionObserver(([entry]) => { // it rests while nobody sees it
    seen = entry.isIntersecting;
    if (seen && moving) move(true);
  }).observe(box);
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) move(true);
  else move(false);
  draw();
};
(() => {
  const box = document.getElementById("theatre");
  const near = new IntersectionObserver(([entry]) => {
    if (!entry.isIntersecting) return;
    near.disconnect();
    const script = document.createElement("script");
    script.src = box.dataset.file;
    document.head.append(script);
  }, { rootMargin: "400px" });
  near.observe(box);
})();
