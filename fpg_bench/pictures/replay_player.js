/** The player of replays, in the markup of replay_player.html.
 *  root: the element that holds that markup; keys: the element whose key presses steer it. */
function fpgReplay(root, keys) {
  "use strict";
  const byId = (id) => root.querySelector("#replay-" + id);
  const view = { round: 0, time: 0, playing: false, azimuth: -62, elevation: 38, zoom: 1, dirty: true };
  let data, scenario, round, steps, last, totals, colours;

  /* ---- what is shown ---- */

  function chooseRound(index) {
    view.round = index;
    round = data.rounds[index];
    steps = round.steps;
    last = steps.snr.length - 1;
    totals = {};
    for (const side of ["ally", "opponent"]) {
      let sum = 0;
      totals[side] = steps[side + "_reward"].map((reward) => (sum += reward));
    }
    byId("subtitle").textContent =
      `seed ${round.seed}, match ${round.match}, round ${round.round}, opponent's path: ${round.path}`;
    byId("step").max = last;
    goTo(0);
  }

  const now = () => Math.min(last, Math.floor(view.time + 1e-9));

  function goTo(time) {
    view.time = Math.max(0, Math.min(last, time));
    view.dirty = true;
  }

  function play(on) {
    if (on && view.time >= last) goTo(0);
    view.playing = on;
    byId("play").textContent = on ? "❚❚ pause" : "▶ play";
  }

  /** [first, last] step of the time axis. */
  function timeSpan() {
    const wanted = Number(byId("span").value);
    if (!wanted || wanted >= last) return [0, last];
    const from = Math.max(0, Math.min(last - wanted, view.time - wanted * 0.75));
    return [from, from + wanted];
  }

  /* ---- figures ---- */

  const FIGURES = [ // name, style, text, room in characters
    ["step, s", "", (k) => `${k} / ${last}`, 9],
    ["ally's reward", "ally", (k) => signed(totals.ally[k], 0) + "  (" + signed(steps.ally_reward[k], 1) + ")", 15],
    ["opponent's reward", "opponent", (k) => signed(totals.opponent[k], 0) + "  (" + signed(steps.opponent_reward[k], 1) + ")", 15],
    ["link", "link", (k) => `${steps.snr[k].toFixed(1)} dB ${outage(k) ? "outage" : "up"}`, 15],
    ["ally", "ally", (k) => `${steps.frequency[k].toFixed(1)} MHz` + (steps.spreading[k] ? `, spread ${steps.spreading[k]} s` : ""), 22],
    ["jamming", "opponent", (k) => steps.type[k] < 0 ? "none yet" : `${scenario.jamming[steps.type[k]].name} ${steps.centre[k].toFixed(1)} MHz`, 21],
    ["known to the opponent", "", (k) => `${steps.known[k].toFixed(1)} MHz, ${steps.age[k]} s old`, 20],
    ["distance", "", (k) => `${steps.distance[k].toFixed(0)} m`, 8],
  ];
  const signed = (value, digits) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
  const outage = (k) => steps.snr[k] < scenario.threshold_db;

  function buildFigures() {
    for (const [name, style, , room] of FIGURES) {
      const box = document.createElement("div");
      box.style.flex = `1 0 ${room}ch`;
      const term = box.appendChild(document.createElement("dt"));
      const value = box.appendChild(document.createElement("dd"));
      term.textContent = name;
      if (style && style !== "link") value.className = style;
      byId("figures").append(box);
    }
  }

  function showFigures() {
    const k = now();
    byId("figures").querySelectorAll("dd").forEach((value, i) => {
      value.textContent = FIGURES[i][2](k);
      if (FIGURES[i][1] === "link") value.className = outage(k) ? "out" : "";
    });
    byId("step").value = k;
  }

  /* ---- canvases ---- */

  function prepare(id) {
    const canvas = byId(id);
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = '11.5px system-ui, "DejaVu Sans", sans-serif';
    pen.lineJoin = "round";
    return { pen, width, height };
  }

  function stroke(pen, points, colour, width = 1, dash = [], alpha = 1) {
    pen.globalAlpha = alpha;
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const names = ["page", "panel", "ground", "ink", "grey", "pale", "ally", "opponent", "spreading", "veil"];
    colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
  }

  /* ---- arena ---- */

  const ground = (p) => [p[0], p[1], 0];
  const between = (a, b, share) => a.map((x, i) => x + share * (b[i] - x));

  /** The projection of places in m to pixels: turned about the box's middle, parallel. */
  function projection(width, height) {
    const [bx, by, bz] = scenario.box_m;
    const azimuth = (view.azimuth * Math.PI) / 180, elevation = (view.elevation * Math.PI) / 180;
    const scale = (view.zoom * Math.min(width * 0.92, height * 1.1)) / Math.hypot(bx, by);
    return ([x, y, z]) => {
      const u = x - bx / 2, v = y - by / 2, w = z - bz / 2;
      const across = v * Math.cos(azimuth) - u * Math.sin(azimuth);
      const deep = u * Math.cos(azimuth) + v * Math.sin(azimuth);
      const up = w * Math.cos(elevation) - deep * Math.sin(elevation);
      return [width / 2 + scale * across, height / 2 - scale * up];
    };
  }

  function bezier(points) {
    return Array.from({ length: 81 }, (_, i) => {
      const t = i / 80, u = 1 - t;
      return [0, 1, 2].map((a) => u ** 3 * points[0][a] + 3 * u * u * t * points[1][a] + 3 * u * t * t * points[2][a] + t ** 3 * points[3][a]);
    });
  }

  function drawBox(pen, at) {
    const [bx, by, bz] = scenario.box_m;
    const corners = [[0, 0], [bx, 0], [bx, by], [0, by]];
    pen.fillStyle = colours.ground;
    pen.beginPath();
    corners.forEach(([x, y], i) => (i ? pen.lineTo(...at([x, y, 0])) : pen.moveTo(...at([x, y, 0]))));
    pen.fill();
    for (let i = 1; i < 5; i++) {
      stroke(pen, [at([(i * bx) / 5, 0, 0]), at([(i * bx) / 5, by, 0])], colours.panel);
      stroke(pen, [at([0, (i * by) / 5, 0]), at([bx, (i * by) / 5, 0])], colours.panel);
    }
    for (const z of [0, bz]) stroke(pen, [...corners, corners[0]].map(([x, y]) => at([x, y, z])), z ? colours.pale : colours.grey);
    for (const [x, y] of corners) stroke(pen, [at([x, y, 0]), at([x, y, bz])], colours.pale);
    note(pen, `x ${bx} m`, at([bx / 2, -0.05 * by, 0]), colours.grey);
    note(pen, `y ${by} m`, at([1.06 * bx, by / 2, 0]), colours.grey);
    note(pen, `${bz} m`, at([0, -0.05 * by, bz / 2]), colours.grey);
  }

  function note(pen, text, [x, y], colour, bold = false) {
    pen.font = (bold ? "600 " : "") + '12px system-ui, "DejaVu Sans", sans-serif';
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 3;
    pen.strokeStyle = colours.panel;
    pen.strokeText(text, x, y);
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
  }

  function drawArena() {
    const { pen, width, height } = prepare("arena");
    const at = projection(width, height);
    const k = now(), share = view.time - k;
    drawBox(pen, at);
    stroke(pen, bezier(round.control_points).map(at), colours.ally, 1.2, [2, 4], 0.6);
    if (round.waypoints) stroke(pen, round.waypoints.map(at), colours.opponent, 1, [2, 4], 0.6);
    const base = scenario.base_station_m, here = {};
    for (const side of ["ally", "opponent"]) {
      const track = steps[side].slice(0, k + 1);
      here[side] = share > 0 ? between(steps[side][k], steps[side][Math.min(k + 1, last)], share) : steps[side][k];
      track.push(here[side]);
      stroke(pen, track.map((p) => at(ground(p))), colours.grey, 1.4, [], 0.35);
      stroke(pen, track.map(at), colours[side], 1.4, [], 0.5);
      stroke(pen, track.slice(-30).map(at), colours[side], 3);
      stroke(pen, [at(here[side]), at(ground(here[side]))], colours.grey);
    }
    const { ally, opponent } = here;
    stroke(pen, [at(base), at(ally)], colours.ally, 1.4, outage(k) ? [2, 6] : []);
    stroke(pen, [at(opponent), at(ally)], colours.opponent, 1.6, steps.covered[k] ? [] : [2, 6]);
    const ring = Array.from({ length: 41 }, (_, i) => {
      const turn = (i * Math.PI) / 20, r = scenario.distance_reward_m;
      return at([ally[0] + r * Math.cos(turn), ally[1] + r * Math.sin(turn), ally[2]]);
    });
    stroke(pen, ring, colours.opponent, 1.2);
    drawTower(pen, at(base));
    drawMarker(pen, at(ally), colours.ally, 0);
    drawMarker(pen, at(opponent), colours.opponent, 1);
    nameBoth(pen, at, ally, opponent, width, k);
  }

  function drawTower(pen, [x, y]) {
    pen.fillStyle = colours.ink;
    pen.beginPath();
    pen.moveTo(x, y - 9); pen.lineTo(x + 7, y + 4); pen.lineTo(x - 7, y + 4);
    pen.fill();
    note(pen, "base station", [x, y + 14], colours.ink);
  }

  function drawMarker(pen, [x, y], colour, diamond) {
    pen.save();
    pen.translate(x, y);
    pen.beginPath();
    if (diamond) { pen.rotate(Math.PI / 4); pen.rect(-5.5, -5.5, 11, 11); } else pen.arc(0, 0, 6.5, 0, 7);
    pen.fillStyle = colour;
    pen.strokeStyle = colours.panel;
    pen.lineWidth = 2;
    pen.fill();
    pen.stroke();
    pen.restore();
  }

  function nameBoth(pen, at, ally, opponent, width, k) {
    const a = at(ally), o = at(opponent), upward = a[1] <= o[1] ? -1 : 1;
    const inside = (x) => Math.max(75, Math.min(width - 75, x));
    note(pen, `ally, ${ally[2].toFixed(0)} m high`, [inside(a[0]), a[1] + 18 * upward], colours.ally, true);
    note(pen, `opponent, ${opponent[2].toFixed(0)} m high`, [inside(o[0]), o[1] - 18 * upward], colours.opponent, true);
    note(pen, `${steps.distance[k].toFixed(0)} m`, [(a[0] + o[0]) / 2 + 30, (a[1] + o[1]) / 2], colours.ink, true);
  }

  /* ---- the panels over time ---- */

  const MARGIN = { left: 46, right: 42, top: 24, bottom: 8 };

  /** Axes over time: `x` of a step, `y` of a value by `scale`, frame and ticks drawn. */
  function timeAxes(id, scale, ticks, labels) {
    const { pen, width, height } = prepare(id);
    const bottom = height - MARGIN.bottom - (labels ? 14 : 0);
    const [from, to] = timeSpan();
    const x = (step) => MARGIN.left + ((step - from) / (to - from)) * (width - MARGIN.left - MARGIN.right);
    const y = (value) => bottom - scale(value) * (bottom - MARGIN.top);
    const axes = { pen, x, y, from: Math.max(1, Math.floor(from)), to: Math.ceil(to), top: MARGIN.top, bottom, left: MARGIN.left, right: width - MARGIN.right };
    pen.fillStyle = colours.grey;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const tick of ticks) {
      stroke(pen, [[axes.left, y(tick)], [axes.right, y(tick)]], colours.pale, 1, [], 0.5);
      pen.fillText(String(+tick.toFixed(1)), axes.left - 6, y(tick));
    }
    if (labels) timeLabels(axes, from, to);
    pen.save();
    pen.beginPath();
    pen.rect(axes.left, axes.top - 2, axes.right - axes.left, bottom - axes.top + 4);
    pen.clip();
    shadeSpreading(axes);
    return axes;
  }

  function timeLabels({ pen, x, bottom }, from, to) {
    const gap = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 5000, 20000].find((size) => (to - from) / size <= 10) || 50000;
    pen.textAlign = "center";
    for (let step = Math.ceil(from / gap) * gap; step <= to; step += gap) pen.fillText(String(step), x(step), bottom + 12);
  }

  /** The stretches [first, last] of steps over which a key stays the same: drawn in one go, without seams. */
  function* runs({ from, to }, key) {
    const end = Math.min(to, last);
    for (let k = from, first = from; k <= end; k++) {
      if (k < end && key(k + 1) === key(k)) continue;
      yield [first, k];
      first = k + 1;
    }
  }

  function shadeSpreading({ pen, x, from, to, top, bottom }) {
    pen.fillStyle = colours.spreading;
    pen.globalAlpha = 0.22;
    for (const [first, end] of runs({ from, to }, (k) => steps.spreading[k] > 0))
      if (steps.spreading[first]) pen.fillRect(x(first - 1), top, x(end) - x(first - 1), bottom - top);
    pen.globalAlpha = 1;
  }

  /** Veil what is still to come, draw the playhead, and end the clipping. */
  function finish({ pen, x, right, top, bottom }) {
    const at = x(view.time);
    pen.fillStyle = colours.veil;
    pen.fillRect(at, top - 2, Math.max(0, right - at), bottom - top + 4);
    stroke(pen, [[at, top - 2], [at, bottom + 2]], colours.ink, 1.2);
    pen.restore();
  }

  function mark({ pen, y, left, right }, value, text, colour) {
    stroke(pen, [[left, y(value)], [right, y(value)]], colour, 1, [5, 4]);
    pen.restore();
    pen.fillStyle = colour;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    pen.fillText(text, right + 5, y(value));
    pen.save();
  }

  function drawSpectrum() {
    const [low, high] = scenario.band_mhz, margin = 0.06 * (high - low);
    const bottom = low - margin, top = high + 2 * margin;
    const ticks = [0, 1, 2, 3, 4].map((i) => low + (i * (high - low)) / 4);
    const axes = timeAxes("spectrum", (value) => (value - bottom) / (top - bottom), ticks, false);
    const { pen, x, y, from, to } = axes;
    const jammed = (k) => `${steps.type[k]} ${steps.centre[k]}`;
    for (const [first, end] of runs(axes, jammed)) drawFootprint(axes, first, end, bottom, high + margin / 2);
    const level = ([first, end], value, ...style) => stroke(pen, [[x(first - 1), y(value)], [x(end), y(value)]], ...style);
    for (const run of runs(axes, (k) => steps.known[k - 1])) level(run, steps.known[run[0] - 1], colours.ink, 1.2, [1.5, 2]);
    for (let k = from; k <= to && k <= last; k++)
      stroke(pen, [[x(k - 1), y(steps.frequency[k - 1])], [x(k - 1), y(steps.frequency[k])]], colours.ally, 0.8, [], 0.8);
    const held = (k) => `${steps.frequency[k]} ${outage(k)}`;
    for (const run of runs(axes, held)) level(run, steps.frequency[run[0]], colours.panel, 6);
    for (const run of runs(axes, held)) {
      const out = outage(run[0]);
      level(run, steps.frequency[run[0]], out ? colours.ink : colours.ally, out ? 6 : 3.4);
    }
    for (let k = from; k <= to && k <= last; k++) {
      if (steps.hopped[k]) dot(pen, x(k - 0.5), y(steps.frequency[k]));
      if (steps.check[k]) triangle(pen, x(k - 0.5), y(high + 1.3 * margin), steps.check[k] > 0);
    }
    finish(axes);
  }

  function drawFootprint({ pen, x, y }, k, end, bottom, top) {
    if (steps.type[k] < 0) return;
    const kind = scenario.jamming[steps.type[k]], spacing = kind.spacing_mhz;
    const first = spacing ? steps.centre[k] - spacing * Math.ceil((steps.centre[k] - bottom) / spacing) : steps.centre[k];
    pen.fillStyle = colours.opponent;
    pen.globalAlpha = Math.max(0.3, Math.min(0.85, 0.3 + (0.55 * kind.power_dbm) / 30));
    for (let centre = first; centre <= top + kind.half_width_mhz; centre += spacing || Infinity) {
      const low = Math.max(bottom, centre - kind.half_width_mhz), high = Math.min(top, centre + kind.half_width_mhz);
      if (low < high) pen.fillRect(x(k - 1), y(high), x(end) - x(k - 1), y(low) - y(high));
    }
    pen.globalAlpha = 1;
  }

  function dot(pen, x, y) {
    pen.beginPath();
    pen.arc(x, y, 3.6, 0, 7);
    pen.fillStyle = colours.panel;
    pen.strokeStyle = colours.ally;
    pen.lineWidth = 1.8;
    pen.fill();
    pen.stroke();
  }

  function triangle(pen, x, y, filled) {
    pen.beginPath();
    pen.moveTo(x - 4.5, y - 4); pen.lineTo(x + 4.5, y - 4); pen.lineTo(x, y + 4); pen.closePath();
    pen.fillStyle = filled ? colours.ink : colours.panel;
    pen.strokeStyle = colours.ink;
    pen.lineWidth = 1;
    pen.fill();
    pen.stroke();
  }

  function series({ x, y, from, to }, values) {
    const points = [];
    for (let k = from - 1; k <= to && k <= last; k++) points.push([x(k), y(values[k])]);
    return points;
  }

  function drawSnr() {
    const low = steps.snr.reduce((a, b) => Math.min(a, b), -20) - 2, high = [...steps.snr, ...steps.clean_snr].reduce((a, b) => Math.max(a, b), 90) + 4;
    const axes = timeAxes("snr", (value) => (value - low) / (high - low), [0, 25, 50, 75], false);
    mark(axes, scenario.threshold_db, `M ${scenario.threshold_db}`, colours.ink);
    clipAgain(axes);
    stroke(axes.pen, series(axes, steps.clean_snr), colours.grey, 1);
    stroke(axes.pen, series(axes, steps.snr), colours.ally, 1.6);
    for (let k = axes.from; k <= axes.to && k <= last; k++) {
      if (!outage(k)) continue;
      axes.pen.beginPath();
      axes.pen.arc(axes.x(k), axes.y(steps.snr[k]), 2.8, 0, 7);
      axes.pen.fillStyle = colours.ink;
      axes.pen.fill();
    }
    finish(axes);
  }

  function drawDistance() {
    const radius = scenario.distance_reward_m, low = Math.max(radius, 1) / 4;
    const high = 1.1 * Math.hypot(...scenario.box_m);
    const scale = (value) => Math.log(Math.max(value, low) / low) / Math.log(high / low);
    const axes = timeAxes("distance", scale, [10, 100, 1000].filter((tick) => tick > low && tick < high), true);
    mark(axes, radius, `${radius} m`, colours.opponent);
    clipAgain(axes);
    stroke(axes.pen, series(axes, steps.distance), colours.ink, 1.6);
    finish(axes);
  }

  function clipAgain({ pen, left, right, top, bottom }) {
    pen.beginPath();
    pen.rect(left, top - 2, right - left, bottom - top + 4);
    pen.clip();
  }

  /* ---- hands and keys ---- */

  function draw() {
    if (!data) return;
    showFigures();
    drawArena();
    drawSpectrum();
    drawSnr();
    drawDistance();
  }

  let before = 0;
  function tick(time) {
    if (view.playing) {
      goTo(view.time + (Math.min(100, time - before) / 1000) * Number(byId("speed").value));
      if (view.time >= last) play(false);
    }
    before = time;
    if (data && view.dirty) {
      view.dirty = false;
      draw();
    }
    requestAnimationFrame(tick);
  }

  function turnByDragging(canvas) {
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      view.azimuth -= event.movementX * 0.4;
      view.elevation = Math.max(5, Math.min(90, view.elevation + event.movementY * 0.4));
      view.dirty = true;
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      view.zoom = Math.max(0.5, Math.min(8, view.zoom * Math.exp(-event.deltaY / 600)));
      view.dirty = true;
    }, { passive: false });
  }

  function seekByPointing(canvas) {
    const seek = (event) => {
      const area = canvas.getBoundingClientRect(), [from, to] = timeSpan();
      const share = (event.clientX - area.left - MARGIN.left) / (area.width - MARGIN.left - MARGIN.right);
      goTo(Math.round(from + share * (to - from)));
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); seek(event); });
    canvas.addEventListener("pointermove", (event) => { if (canvas.hasPointerCapture(event.pointerId)) seek(event); });
  }

  function changeSpeed(by) {
    const speed = byId("speed");
    speed.selectedIndex = Math.max(0, Math.min(speed.length - 1, speed.selectedIndex + by));
  }

  const KEYS = {
    " ": () => play(!view.playing),
    ArrowLeft: (shift) => goTo(now() - (shift ? 10 : 1)),
    ArrowRight: (shift) => goTo(now() + (shift ? 10 : 1)),
    ArrowUp: () => changeSpeed(1),
    ArrowDown: () => changeSpeed(-1),
    Home: () => goTo(0),
    End: () => goTo(last),
  };

  function listen() {
    keys.addEventListener("keydown", (event) => {
      const element = event.target.tagName;
      const own = element === "SELECT" || (element === "BUTTON" && event.key === " ");
      if (!KEYS[event.key] || own || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      KEYS[event.key](event.shiftKey);
    });
    byId("play").addEventListener("click", () => play(!view.playing));
    byId("step").addEventListener("input", (event) => goTo(Number(event.target.value)));
    byId("rounds").addEventListener("change", (event) => chooseRound(Number(event.target.value)));
    byId("span").addEventListener("change", () => (view.dirty = true));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
    new MutationObserver(recolour).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    new ResizeObserver(draw).observe(root.querySelector(".plots"));
    turnByDragging(byId("arena"));
    ["spectrum", "snr", "distance"].forEach((id) => seekByPointing(byId(id)));
  }

  function recolour() {
    readColours();
    view.dirty = true;
  }

  /** Show the rounds of what `replay_data` gives, from their start. */
  function show(shown) {
    data = shown;
    scenario = data.scenario;
    byId("title").textContent = data.title;
    byId("rounds").replaceChildren();
    data.rounds.forEach((one, index) => {
      byId("rounds").add(new Option(`seed ${one.seed}, match ${one.match}, round ${one.round}`, index));
    });
    byId("rounds").hidden = data.rounds.length < 2;
    play(false);
    chooseRound(0);
  }

  buildFigures();
  readColours();
  listen();
  requestAnimationFrame(tick);
  return { show, goTo, play };
}
