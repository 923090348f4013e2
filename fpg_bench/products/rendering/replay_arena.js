/** The arena of a replay: both drones and what they have flown, from a camera that can be turned, and a near one.
 *  scene: what the player shows (see replay_player.js); canvas: where. */
function fpgArena(scene, canvas) {
  "use strict";
  const { prepare, stroke, note, labels } = fpgPen;
  const camera = { azimuth: -62, elevation: 38, zoom: 1 };
  const NEAR = { times: 5, size: 0.42, most: 190 }; // from so many times the rewarded distance; share of the arena, pixels
  const TRAIL = 30; // steps
  let written = [];

  const ground = (p) => [p[0], p[1], 0];
  const between = (a, b, share) => a.map((x, i) => x + share * (b[i] - x));

  /** The projection of places in m to pixels: turned about a place, parallel. */
  function projection(about, middle, scale) {
    const azimuth = (camera.azimuth * Math.PI) / 180, elevation = (camera.elevation * Math.PI) / 180;
    return ([x, y, z]) => {
      const u = x - about[0], v = y - about[1], w = z - about[2];
      const across = v * Math.cos(azimuth) - u * Math.sin(azimuth);
      const deep = u * Math.cos(azimuth) + v * Math.sin(azimuth);
      const up = w * Math.cos(elevation) - deep * Math.sin(elevation);
      return [middle[0] + scale * across, middle[1] - scale * up];
    };
  }

  function whole(width, height) {
    const [bx, by, bz] = scene.scenario.box_m;
    const scale = (camera.zoom * Math.min(width * 0.92, height * 1.1)) / Math.hypot(bx, by);
    return projection([bx / 2, by / 2, bz / 2], [width / 2, height / 2], scale);
  }

  function drawBox(pen, at) {
    const [bx, by, bz] = scene.scenario.box_m, { colours } = scene;
    const corners = [[0, 0], [bx, 0], [bx, by], [0, by]];
    pen.fillStyle = colours.ground;
    pen.beginPath();
    corners.forEach(([x, y], i) => (i ? pen.lineTo(...at([x, y, 0])) : pen.moveTo(...at([x, y, 0]))));
    pen.fill();
    for (let i = 1; i < 5; i++) {
      stroke(pen, [at([(i * bx) / 5, 0, 0]), at([(i * bx) / 5, by, 0])], colours.panel);
      stroke(pen, [at([0, (i * by) / 5, 0]), at([bx, (i * by) / 5, 0])], colours.panel);
    }
    for (const z of [0, bz]) stroke(pen, [...corners, corners[0]].map(([x, y]) => at([x, y, z])), z ? colours.line : colours.grey);
    for (const [x, y] of corners) stroke(pen, [at([x, y, 0]), at([x, y, bz])], colours.line);
  }

  function nameBox(names, at) {
    const [bx, by, bz] = scene.scenario.box_m, { grey } = scene.colours;
    names.add(`x ${bx} m`, at([bx / 2, -0.02 * by, 0]), grey, false);
    names.add(`y ${by} m`, at([1.03 * bx, by / 2, 0]), grey, false);
    names.add(`${bz} m high`, at([0, -0.02 * by, bz / 2]), grey, false);
  }

  /** Where both are at this moment, between two steps. */
  function places() {
    const k = scene.now(), share = scene.view.time - k, next = Math.min(k + 1, scene.last);
    return Object.fromEntries(["ally", "opponent"].map((side) => {
      const way = scene.steps[side];
      return [side, share > 0 ? between(way[k], way[next], share) : way[k]];
    }));
  }

  /** What was flown, to the ground, the link and the beam; nothing that is still to come. */
  function drawFlight(pen, at, here) {
    const { colours, steps, scenario } = scene, k = scene.now();
    for (const side of ["ally", "opponent"]) {
      const track = [...steps[side].slice(0, k + 1), here[side]];
      stroke(pen, track.map((p) => at(ground(p))), colours.line);
      stroke(pen, track.map(at), colours[side]);
      stroke(pen, track.slice(-TRAIL).map(at), colours[side], 3);
      stroke(pen, [at(here[side]), at(ground(here[side]))], colours.grey);
    }
    stroke(pen, [at(scenario.base_station_m), at(here.ally)], colours.ally, 1.4, scene.outage(k) ? [2, 6] : []);
    if (steps.type[k] >= 0) stroke(pen, [at(here.opponent), at(here.ally)], colours.opponent, 1.6, steps.covered[k] ? [] : [2, 6]);
    drawRing(pen, at, here.ally);
  }

  function drawRing(pen, at, [x, y, z]) {
    const r = scene.scenario.distance_reward_m;
    const ring = Array.from({ length: 41 }, (_, i) => at([x + r * Math.cos((i * Math.PI) / 20), y + r * Math.sin((i * Math.PI) / 20), z]));
    stroke(pen, ring, scene.colours.opponent, 1.2);
  }

  /** The waypoints that were due already: those to come are the planner's secret. */
  function drawWaypoints(pen, at) {
    const { waypoints } = scene.round;
    if (!waypoints) return;
    const due = Math.floor((scene.now() * waypoints.length) / scene.last);
    for (const place of waypoints.slice(0, due)) {
      const [x, y] = at(place);
      stroke(pen, [[x - 3, y], [x + 3, y]], scene.colours.opponent, 1.4);
      stroke(pen, [[x, y - 3], [x, y + 3]], scene.colours.opponent, 1.4);
    }
  }

  function drawTower(pen, [x, y]) {
    pen.fillStyle = scene.colours.ink;
    pen.beginPath();
    pen.moveTo(x, y - 9); pen.lineTo(x + 7, y + 4); pen.lineTo(x - 7, y + 4);
    pen.fill();
  }

  function drawMarker(pen, [x, y], colour, diamond) {
    pen.save();
    pen.translate(x, y);
    pen.beginPath();
    if (diamond) { pen.rotate(Math.PI / 4); pen.rect(-5.5, -5.5, 11, 11); } else pen.arc(0, 0, 6.5, 0, 7);
    pen.fillStyle = colour;
    pen.strokeStyle = scene.colours.panel;
    pen.lineWidth = 2;
    pen.fill();
    pen.stroke();
    pen.restore();
  }

  function drawDrones(pen, at, here) {
    drawMarker(pen, at(here.ally), scene.colours.ally, 0);
    drawMarker(pen, at(here.opponent), scene.colours.opponent, 1);
  }

  /** A second camera in the corner that is freer, while the drones are close. */
  function drawNear(pen, width, height, here, names) {
    const radius = scene.scenario.distance_reward_m, distance = scene.steps.distance[scene.now()];
    if (!radius || distance > NEAR.times * radius) return;
    const size = Math.min(NEAR.most, NEAR.size * Math.min(width, height));
    const left = whole(width, height)(here.ally)[0] > width / 2 ? 10 : width - size - 10, top = height - size - 10;
    const about = between(here.ally, here.opponent, 0.5);
    const at = projection(about, [left + size / 2, top + size / 2], (0.42 * size) / Math.max(distance, 1.4 * radius));
    pen.save();
    pen.beginPath();
    pen.roundRect(left, top, size, size, 8);
    pen.fillStyle = scene.colours.page;
    pen.fill();
    pen.clip();
    drawFlight(pen, at, here);
    drawDrones(pen, at, here);
    pen.restore();
    pen.beginPath();
    pen.roundRect(left, top, size, size, 8);
    pen.strokeStyle = scene.colours.grey;
    pen.lineWidth = 1;
    pen.stroke();
    note(pen, size > 140 ? `near camera, ${distance.toFixed(0)} m` : `${distance.toFixed(0)} m`, [left + size / 2, top + 12], { panel: scene.colours.page }, scene.colours.ink, true);
    for (let x = left + 10; x < left + size; x += 20) for (let y = top + 10; y < top + size; y += 20) names.keep([x, y], 20);
  }

  function draw() {
    const { pen, width, height } = prepare(canvas);
    const at = whole(width, height), here = places(), { colours } = scene;
    const base = at(scene.scenario.base_station_m);
    const names = labels(pen, width, height, colours);
    drawBox(pen, at);
    drawWaypoints(pen, at);
    drawFlight(pen, at, here);
    drawTower(pen, base);
    drawDrones(pen, at, here);
    drawNear(pen, width, height, here, names);
    names.keep(base, 16);
    for (const side of ["ally", "opponent"]) names.keep(at(here[side]), 16);
    for (const side of ["ally", "opponent"]) names.add(`${side}, ${here[side][2].toFixed(0)} m high`, at(here[side]), colours[side]);
    names.add(`${scene.steps.distance[scene.now()].toFixed(0)} m`, between(at(here.ally), at(here.opponent), 0.5), colours.ink);
    names.add("base station", base, colours.ink, false);
    nameBox(names, at);
    written = names.write();
  }

  /** Turn the camera by degrees and zoom by a factor. */
  function turn(across, up, factor = 1) {
    camera.azimuth += across;
    camera.elevation = Math.max(5, Math.min(90, camera.elevation + up));
    camera.zoom = Math.max(0.5, Math.min(8, camera.zoom * factor));
    scene.view.dirty = true;
  }

  return { draw, turn, labels: () => written };
}
