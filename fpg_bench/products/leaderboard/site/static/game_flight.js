/* Where the two fly: the ally's curve, and the opponent's patrols, pursuit and own course; see fpg_bench/game/flight.py. */
"use strict";
const fpgFlight = (() => {
  const f32 = Math.fround;
  const PATHS = { circle: 0, triangle: 1, rectangle: 2, pursuit: 3, learned: 4 };

  const distance = (a, b) => Math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2);

  function bezier(points, axis, t) {
    const u = 1 - t;
    return u * u * u * points[0][axis] + 3 * u * u * t * points[1][axis] + 3 * u * t * t * points[2][axis] + t * t * t * points[3][axis];
  }

  function beginCurve(game, chords) {
    game.chord = -1;
    game.outbound = true;
    game.ally = [0, 1, 2].map((axis) => bezier(game.curve, axis, 0));
    game.chordStart = [...game.ally];
    game.chordVector = [0, 0, 0];
    enterNextChord(game, chords);
  }

  /** Step to the neighbouring chord in the direction of flight, or turn round on the last one. */
  function enterNextChord(game, chords) {
    const { curve, chordStart: start, chordVector: vector } = game;
    if (game.chord === (game.outbound ? chords - 1 : 0)) game.outbound = !game.outbound;
    else if (game.outbound) {
      game.chord += 1;
      for (let axis = 0; axis < 3; axis++) {
        start[axis] += vector[axis];
        vector[axis] = bezier(curve, axis, (game.chord + 1) / chords) - start[axis];
      }
    } else {
      game.chord -= 1;
      for (let axis = 0; axis < 3; axis++) {
        const end = start[axis];
        start[axis] = bezier(curve, axis, game.chord / chords);
        vector[axis] = end - start[axis];
      }
    }
    game.chordLength = Math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2);
    game.chordOffset = game.outbound ? 0 : game.chordLength;
  }

  function flyCurve(game, metres, rules) {
    let left = metres;
    for (let i = 0; i < 4 * rules.chords; i++) {
      const room = game.outbound ? game.chordLength - game.chordOffset : game.chordOffset;
      if (left < room) {
        game.chordOffset += game.outbound ? left : -left;
        const share = game.chordOffset / game.chordLength;
        game.ally = game.chordStart.map((start, axis) => start + share * game.chordVector[axis]);
        return;
      }
      left -= room;
      enterNextChord(game, rules.chords);
    }
  }

  /** The place on a circle, triangle or rectangle after so many metres. */
  function patrol(path, flown, rules) {
    const { patrol_radius: radius, patrol_centre: centre } = rules;
    let x, y;
    if (path === PATHS.circle) [x, y] = [Math.cos(flown / radius), Math.sin(flown / radius)];
    else {
      const angle = (2 * Math.PI) / (path === PATHS.triangle ? 3 : 4);
      const sides = flown / (2 * radius * Math.sin(angle / 2));
      const corner = Math.floor(sides), share = sides - corner;
      const a = angle * corner, b = angle * (corner + 1);
      x = (1 - share) * Math.cos(a) + share * Math.cos(b);
      y = (1 - share) * Math.sin(a) + share * Math.sin(b);
    }
    return [centre[0] + radius * x, centre[1] + radius * y, centre[2]];
  }

  /** Move the opponent one second; the ally has not moved yet. */
  function flyOpponent(game, action, rules) {
    const speed = rules.opponent_speed;
    if (game.path <= PATHS.rectangle) game.opponent = patrol(game.path, speed * (game.step + 1), rules);
    else if (game.path === PATHS.pursuit) {
      const away = distance(game.opponent, game.ally);
      const share = away > 0 ? Math.min(speed, away) / away : 0;
      game.opponent = game.opponent.map((x, axis) => x + share * (game.ally[axis] - x));
    } else {
      const squares = [6, 7, 8].map((j) => f32(action[j] * action[j]));
      const length = f32(Math.sqrt(f32(f32(squares[0] + squares[1]) + squares[2])));
      game.opponent = game.opponent.map((x, axis) => x + (speed * action[6 + axis]) / Math.max(1, length));
    }
    game.opponent = inside(game.opponent, rules);
  }

  const inside = (position, rules) => position.map((x, axis) => Math.min(Math.max(x, 0), rules.box[axis]));

  return { PATHS, distance, beginCurve, flyCurve, flyOpponent, patrol, inside };
})();
