/* The front page's round: seen from above, its band beside it, over and over. A still where motion is not wanted. */
"use strict";
(() => {
  const SPEED = 11; // steps a second
  const REST_S = 2.5; // that the last step stays
  const SHOWN_S = 60; // of the band
  const TRAIL = 40; // steps
  const box = document.getElementById("film");
  const canvas = box.querySelector("canvas"), caption = box.querySelector(".caption"), pause = box.querySelector(".pause");
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  let scenario, steps, events, last, colours, pen, width, height;
  let time = 0, before = null, moving = false;

  const outage = (k) => steps.snr[k] < scenario.threshold_db;
  const between = (a, b, share) => a.map((x, i) => x + share * (b[i] - x));

  function fit() {
    ({ pen, width, height } = fpgPen.prepare(canvas));
    if (steps) draw();
  }

  const stroke = (points, ...style) => fpgPen.stroke(pen, points, ...style);

  const text = (words, x, y, colour, align) => fpgPen.note(pen, words, [x, y], colours, colour, false, align);

  /** From above: both tracks, the link, the beam of the jamming. */
  function drawMap(size) {
    const [bx, by] = scenario.box_m, margin = 14;
    const scale = Math.min((size - 2 * margin) / bx, (height - 2 * margin) / by);
    const at = ([x, y]) => [margin + x * scale, height - margin - y * scale];
    const k = Math.floor(time), share = time - k, next = Math.min(k + 1, last);
    pen.fillStyle = colours.ground;
    pen.fillRect(margin, height - margin - by * scale, bx * scale, by * scale);
    const here = {};
    for (const side of ["ally", "opponent"]) {
      here[side] = between(steps[side][k], steps[side][next], share);
      const track = [...steps[side].slice(0, k + 1), here[side]].map(at);
      stroke(track, colours[side]);
      stroke(track.slice(-TRAIL), colours[side], 3);
    }
    const [base, ally, opponent] = [scenario.base_station_m, here.ally, here.opponent].map(at);
    stroke([base, ally], outage(k) ? colours.ink : colours.ally, 1.8, outage(k) ? [2, 6] : []);
    if (steps.type[k] >= 0) stroke([opponent, ally], colours.opponent, steps.covered[k] ? 2.4 : 1.2, steps.covered[k] ? [] : [2, 6]);
    pen.fillStyle = colours.ink;
    pen.beginPath();
    pen.moveTo(base[0], base[1] - 8); pen.lineTo(base[0] + 7, base[1] + 5); pen.lineTo(base[0] - 7, base[1] + 5);
    pen.fill();
    mark(ally, "ally", 7);
    mark(opponent, "opponent", 7);
    const above = ally[1] <= opponent[1] ? -1 : 1;
    const inside = (x, room) => Math.max(room, Math.min(margin + bx * scale - room, x));
    text("ally", inside(ally[0], 18), Math.max(10, ally[1] + 17 * above), colours.ally);
    text("opponent", inside(opponent[0], 36), Math.min(height - 10, opponent[1] - 17 * above), colours.opponent);
    if ([ally, opponent].every(([x, y]) => Math.hypot(x - base[0], y - base[1]) > 60)) text("base station", base[0], base[1] + 15, colours.grey);
  }

  function mark([x, y], side, radius) {
    pen.beginPath();
    if (side === "ally") pen.arc(x, y, radius, 0, 7);
    else { pen.moveTo(x, y - radius - 1); pen.lineTo(x + radius + 1, y); pen.lineTo(x, y + radius + 1); pen.lineTo(x - radius - 1, y); pen.closePath(); }
    pen.fillStyle = colours[side];
    pen.strokeStyle = colours.panel;
    pen.lineWidth = 2;
    pen.fill();
    pen.stroke();
  }

  /** The last minute of the band: where the ally was, and what was jammed. */
  function drawBand(left) {
    const [low, high] = scenario.band_mhz, top = 26, bottom = height - 14, right = width - 14;
    const bottomMhz = low - 0.05 * (high - low), topMhz = high + 0.05 * (high - low);
    const from = Math.max(0, time - SHOWN_S * 0.85);
    const x = (k) => Math.round(left + ((k - from) / SHOWN_S) * (right - left)); // whole: without seams
    const y = (mhz) => bottom - ((mhz - bottomMhz) / (topMhz - bottomMhz)) * (bottom - top);
    text(`the band, ${low} to ${high} MHz`, left, 12, colours.grey, "left");
    pen.save();
    pen.beginPath();
    pen.rect(left, top, right - left, bottom - top);
    pen.clip();
    pen.fillStyle = colours.ground;
    pen.fillRect(left, top, right - left, bottom - top);
    const k = Math.floor(time);
    for (let i = Math.max(1, Math.floor(from)); i <= k + 1 && i <= last; i++) {
      const end = Math.min(i, time);
      if (end <= i - 1) break;
      if (steps.spreading[i]) shade(x(i - 1), top, x(end), bottom, colours.spreading, 0.25);
      const jammed = steps.type[i] < 0 ? [] : fpgPen.footprint(scenario.jamming[steps.type[i]], steps.centre[i], bottomMhz, topMhz);
      for (const [from, to] of jammed) shade(x(i - 1), y(to), x(end), y(from), colours.opponent, 0.55);
      const level = y(steps.frequency[i]), out = outage(i);
      if (steps.frequency[i] !== steps.frequency[i - 1]) stroke([[x(i - 1), y(steps.frequency[i - 1])], [x(i - 1), level]], colours.ally, 1.2);
      stroke([[x(i - 1), level], [x(end), level]], colours.panel, 7);
      stroke([[x(i - 1), level], [x(end), level]], out ? colours.ink : colours.ally, out ? 6 : 4);
    }
    pen.restore();
  }

  function shade(x0, y0, x1, y1, colour, alpha) {
    pen.globalAlpha = alpha;
    pen.fillStyle = colour;
    pen.fillRect(x0, y0, x1 - x0, y1 - y0);
    pen.globalAlpha = 1;
  }

  function draw() {
    pen.clearRect(0, 0, width, height);
    const size = Math.min(height, width * 0.5);
    drawMap(size);
    drawBand(size + 8);
    const last = events.findLast((event) => event.step <= time);
    const text = last ? `${last.step} s: ${last.text}` : "The round begins";
    if (caption.textContent !== text) caption.textContent = text;
  }

  function tick(now) {
    if (!moving) return;
    time += before === null ? 0 : (Math.min(now - before, 100) / 1000) * SPEED;
    before = now;
    if (time > last + REST_S * SPEED) time = 0;
    const at = time;
    time = Math.min(time, last);
    draw();
    time = at;
    requestAnimationFrame(tick);
  }

  function move(on) {
    moving = on;
    before = null;
    pause.textContent = on ? "❚❚" : "▶";
    pause.setAttribute("aria-label", on ? "Pause the round" : "Play the round");
    if (on) requestAnimationFrame(tick);
  }

  function recolour() {
    colours = fpgPen.readColours();
    if (steps) draw();
  }

  // What a round's script calls.
  window.fpgRound = ({ replay }) => {
    scenario = replay.scenario;
    steps = replay.rounds[0].steps;
    events = fpgEvents(replay.rounds[0], scenario);
    last = steps.snr.length - 1;
    colours = fpgPen.readColours();
    time = still ? last / 2 : 0;
    fit();
    move(!still);
  };

  pause.addEventListener("click", () => {
    time = Math.min(time, last);
    move(!moving);
  });
  new ResizeObserver(fit).observe(canvas);
  new MutationObserver(recolour).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
})();
