/** The panels over time of a replay: the band, the SNR and the distance, up to the present step and not beyond.
 *  scene: what the player shows (see replay_player.js); canvases: by name, spectrum, and snr and distance if they are drawn. */
function fpgTimes(scene, canvases) {
  "use strict";
  const { prepare, stroke } = fpgPen;

  const MARGIN = { left: 46, right: 14, top: 24, bottom: 8 };

  /** Axes over time: `x` of a step, `y` of a value by `scale`, frame and ticks drawn. */
  function timeAxes(id, scale, ticks, labels) {
    const { pen, width, height } = prepare(canvases[id]);
    const bottom = height - MARGIN.bottom - (labels ? 14 : 0);
    const [from, to] = scene.timeSpan();
    const x = (step) => MARGIN.left + ((step - from) / (to - from)) * (width - MARGIN.left - MARGIN.right);
    const y = (value) => bottom - scale(value) * (bottom - MARGIN.top);
    const axes = { pen, x, y, from: Math.max(1, Math.floor(from)), to: Math.min(Math.ceil(to), scene.now()), top: MARGIN.top, bottom, left: MARGIN.left, right: width - MARGIN.right };
    pen.fillStyle = scene.colours.grey;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const tick of ticks) {
      stroke(pen, [[axes.left, y(tick)], [axes.right, y(tick)]], scene.colours.line, 0.6);
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
    for (let k = from, first = from; k <= to; k++) {
      if (k < to && key(k + 1) === key(k)) continue;
      yield [first, k];
      first = k + 1;
    }
  }

  function shadeSpreading({ pen, x, from, to, top, bottom }) {
    pen.fillStyle = scene.colours.spreading;
    pen.globalAlpha = 0.22;
    for (const [first, end] of runs({ from, to }, (k) => scene.steps.spreading[k] > 0))
      if (scene.steps.spreading[first]) pen.fillRect(x(first - 1), top, x(end) - x(first - 1), bottom - top);
    pen.globalAlpha = 1;
  }

  /** Draw the playhead, and end the clipping. */
  function finish({ pen, x, top, bottom }) {
    const at = x(scene.view.time);
    stroke(pen, [[at, top - 2], [at, bottom + 2]], scene.colours.ink, 1.2);
    pen.restore();
  }

  /** Draw a threshold, and its name above the panel. */
  function mark({ pen, y, left, right, top }, value, text, colour) {
    stroke(pen, [[left, y(value)], [right, y(value)]], colour, 1, [5, 4]);
    pen.restore();
    pen.fillStyle = colour;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillText(`╌ ${text}`, right, top - 11);
    pen.save();
  }

  function drawSpectrum() {
    const [low, high] = scene.scenario.band_mhz, margin = 0.06 * (high - low);
    const bottom = low - margin, top = high + 2 * margin;
    const ticks = [0, 1, 2, 3, 4].map((i) => low + (i * (high - low)) / 4);
    const axes = timeAxes("spectrum", (value) => (value - bottom) / (top - bottom), ticks, false);
    const { pen, x, y, from, to } = axes;
    const jammed = (k) => `${scene.steps.type[k]} ${scene.steps.centre[k]}`;
    for (const [first, end] of runs(axes, jammed)) drawFootprint(axes, first, end, bottom, high + margin / 2);
    const level = ([first, end], value, ...style) => stroke(pen, [[x(first - 1), y(value)], [x(end), y(value)]], ...style);
    for (const run of runs(axes, (k) => scene.steps.known[k - 1])) level(run, scene.steps.known[run[0] - 1], scene.colours.ink, 1.2, [1.5, 2]);
    for (let k = from; k <= to; k++)
      stroke(pen, [[x(k - 1), y(scene.steps.frequency[k - 1])], [x(k - 1), y(scene.steps.frequency[k])]], scene.colours.ally, 0.8);
    const held = (k) => `${scene.steps.frequency[k]} ${scene.outage(k)}`;
    for (const run of runs(axes, held)) level(run, scene.steps.frequency[run[0]], scene.colours.panel, 6);
    for (const run of runs(axes, held)) {
      const out = scene.outage(run[0]);
      level(run, scene.steps.frequency[run[0]], out ? scene.colours.ink : scene.colours.ally, out ? 6 : 3.4);
    }
    for (let k = from; k <= to; k++) {
      if (scene.steps.hopped[k]) dot(pen, x(k - 0.5), y(scene.steps.frequency[k]));
      if (scene.steps.check[k]) triangle(pen, x(k - 0.5), y(high + 1.3 * margin), scene.steps.check[k] > 0);
    }
    finish(axes);
  }

  function drawFootprint({ pen, x, y }, k, end, bottom, top) {
    if (scene.steps.type[k] < 0) return;
    const kind = scene.scenario.jamming[scene.steps.type[k]];
    pen.fillStyle = scene.colours.opponent;
    pen.globalAlpha = Math.max(0.3, Math.min(0.85, 0.3 + (0.55 * kind.power_dbm) / 30));
    for (const [low, high] of fpgPen.footprint(kind, scene.steps.centre[k], bottom, top)) pen.fillRect(x(k - 1), y(high), x(end) - x(k - 1), y(low) - y(high));
    pen.globalAlpha = 1;
  }

  function dot(pen, x, y) {
    pen.beginPath();
    pen.arc(x, y, 3.6, 0, 7);
    pen.fillStyle = scene.colours.panel;
    pen.strokeStyle = scene.colours.ally;
    pen.lineWidth = 1.8;
    pen.fill();
    pen.stroke();
  }

  function triangle(pen, x, y, filled) {
    pen.beginPath();
    pen.moveTo(x - 4.5, y - 4); pen.lineTo(x + 4.5, y - 4); pen.lineTo(x, y + 4); pen.closePath();
    pen.fillStyle = filled ? scene.colours.ink : scene.colours.panel;
    pen.strokeStyle = scene.colours.ink;
    pen.lineWidth = 1;
    pen.fill();
    pen.stroke();
  }

  function series({ x, y, from, to }, values) {
    const points = [];
    for (let k = from - 1; k <= to; k++) points.push([x(k), y(values[k])]);
    return points;
  }

  function drawSnr() {
    const known = [...scene.steps.snr, ...scene.steps.clean_snr].filter(Number.isFinite); // a side may not know all
    const low = Math.min(-20, ...known) - 2, high = Math.max(90, ...known) + 4;
    const axes = timeAxes("snr", (value) => (value - low) / (high - low), [0, 25, 50, 75], false);
    mark(axes, scene.scenario.threshold_db, `outage below ${scene.scenario.threshold_db} dB`, scene.colours.ink);
    clipAgain(axes);
    stroke(axes.pen, series(axes, scene.steps.clean_snr), scene.colours.grey, 1);
    stroke(axes.pen, series(axes, scene.steps.snr), scene.colours.ally, 1.6);
    for (let k = axes.from; k <= axes.to; k++) {
      if (!scene.outage(k)) continue;
      axes.pen.beginPath();
      axes.pen.arc(axes.x(k), axes.y(scene.steps.snr[k]), 2.8, 0, 7);
      axes.pen.fillStyle = scene.colours.ink;
      axes.pen.fill();
    }
    finish(axes);
  }

  function drawDistance() {
    const radius = scene.scenario.distance_reward_m, low = Math.max(radius, 1) / 4;
    const high = 1.1 * Math.hypot(...scene.scenario.box_m);
    const scale = (value) => Math.log(Math.max(value, low) / low) / Math.log(high / low);
    const axes = timeAxes("distance", scale, [10, 100, 1000].filter((tick) => tick > low && tick < high), true);
    mark(axes, radius, `near: within ${radius} m`, scene.colours.opponent);
    clipAgain(axes);
    stroke(axes.pen, series(axes, scene.steps.distance), scene.colours.ink, 1.6);
    finish(axes);
  }

  function clipAgain({ pen, left, right, top, bottom }) {
    pen.beginPath();
    pen.rect(left, top - 2, right - left, bottom - top + 4);
    pen.clip();
  }

  /** The step that stands at a place of a panel, in pixels of the page. */
  function stepAt(clientX, canvas) {
    const area = canvas.getBoundingClientRect(), [from, to] = scene.timeSpan();
    const share = (clientX - area.left - MARGIN.left) / (area.width - MARGIN.left - MARGIN.right);
    return Math.round(from + share * (to - from));
  }

  function draw() {
    drawSpectrum();
    if (canvases.snr) drawSnr();
    if (canvases.distance) drawDistance();
  }

  return { draw, stepAt };
}
