/* The rules in the browser: a round of one game, step by step, as fpg_bench/game/step.py plays it.
   rules: the numbers of state.RULES, the names of the jamming types, and `radio`, null but in the model `link` (game_link.js). Actions are lists of nine numbers, clipped to [-1, 1] and to single precision. */
"use strict";
const fpgRules = (() => {
  const { PURPOSE, matchKey, roundKey, uniform, integer, gaussians } = fpgDraws;
  const { distance, beginCurve, flyCurve, flyOpponent, patrol, inside, PATHS } = fpgFlight;
  const f32 = Math.fround, DB = 10 / Math.LN10;
  const AXES = [0, 1, 2];
  const clip = (x) => Math.min(Math.max(x, -1), 1);
  const played = (action) => Array.from(action, (x) => f32(clip(f32(x))));
  const pointMhz = (point, rules) => rules.band_low + point * rules.point_spacing;

  /** Begin a seed's first match and round; path: one of fpgFlight.PATHS, or none for the scenario's. */
  function begin(rules, seed, path) {
    const match = matchKey(BigInt(seed), 0), key = roundKey(match, 0);
    const drawn = (purpose, low, high) => low + uniform(match, 0, purpose) * (high - low);
    const game = {
      rules, key, step: 0, over: false, spreading: false, spreadingS: 0, hopped: false, age: 0, lastCheck: 0, checked: false,
      type: -1, centre: rules.band_middle, sensedType: -1, sensedMhz: rules.band_middle, covered: false, allyReward: 0, opponentReward: 0,
    };
    game.curve = [0, 1, 2, 3].map((corner) => AXES.map((axis) => {
      const [low, high] = axis === 2 ? rules.curve_altitude : [0, rules.box[axis]];
      return rules.random_curve ? drawn(PURPOSE.curve + 3 * corner + axis, low, high) : rules.curve[corner][axis];
    }));
    game.opponent = AXES.map((axis) => uniform(match, 0, PURPOSE.opponentStart + axis) * rules.box[axis]);
    beginCurve(game, rules.chords);
    game.path = path === undefined ? rules.path[integer(key, 0, PURPOSE.path, rules.paths)] : PATHS[path];
    if (game.path <= PATHS.rectangle) game.opponent = patrol(game.path, 0, rules);
    game.point = integer(key, 0, PURPOSE.startPoint, rules.points);
    game.frequency = game.known = pointMhz(game.point, rules);
    const [low, high] = rules.first_check;
    game.nextCheck = low + integer(key, 0, PURPOSE.firstCheck, high - low + 1);
    game.distance = distance(game.ally, game.opponent);
    [game.fading, game.jammingFading] = [0, 0];
    if (rules.radio) fpgLink.transmit(game, rules);
    else game.snr = game.cleanSnr = rules.base_power - pathLoss(distance(game.ally, rules.base_station), game.frequency, rules) - rules.noise;
    [game.fading, game.jammingFading] = [PURPOSE.fadingStart, PURPOSE.jammingFadingStart].map((purpose) => gaussians(key, 0, purpose)[0]);
    observe(game);
    return game;
  }

  /** Play one step: both sides act at once. */
  function step(game, allyAction, opponentAction) {
    const { rules } = game;
    if (game.over) return;
    const [ally, opponent] = [played(allyAction), played(opponentAction)];
    chooseJamming(game, opponent, rules);
    chooseFrequency(game, ally, rules);
    const before = game.opponent;
    flyOpponent(game, opponent, rules); // first: pursuit aims at where the ally was
    game.flown = distance(before, game.opponent);
    const [slow, fast] = rules.ally_speed;
    game.speed = slow + ((ally[2] + 1) / 2) * (fast - slow);
    flyCurve(game, game.speed, rules);
    game.ally = inside(game.ally, rules);
    const [fading, centreError] = gaussians(game.key, game.step, PURPOSE.fading);
    transmit(game, fading, rules);
    reward(game, rules);
    check(game, rules);
    sense(game, centreError, rules);
    game.step += 1;
    game.over = game.step >= rules.steps;
    observe(game);
  }

  function chooseJamming(game, action, rules) {
    let best = -1;
    for (let kind = 0; kind < rules.types.length; kind++) if (rules.allowed[kind] === 1 && (best < 0 || action[kind] > action[best])) best = kind;
    game.type = best;
    game.centre = action[5] > 0 ? rules.band_middle + action[4] * rules.band_half
      : Math.min(Math.max(game.known + action[4] * rules.tuning_span, rules.band_low), rules.band_high);
  }

  function chooseFrequency(game, action, rules) {
    const spread = action[1] > 0, before = game.point;
    game.hopped = action[0] > 0;
    if (game.hopped || (rules.reselect && game.spreading && !spread)) {
      game.point = fpgKnowledge.choose(game, action, rules);
      game.frequency = pointMhz(game.point, rules);
    }
    if (rules.radio) fpgLink.tune(game, before, spread, rules);
    game.spreading = spread;
    game.spreadingS = spread ? game.spreadingS + 1 : 0;
  }

  function pathLoss(metres, mhz, rules) {
    return rules.path_loss_constant + 2 * DB * Math.log((Math.max(metres, rules.minimum_distance) / 1000) * mhz);
  }

  function powerSum(a, b) {
    const high = Math.max(a, b);
    return high + DB * Math.log(1 + Math.exp((Math.min(a, b) - high) / DB));
  }

  /** Distance from a footprint's centre line, or from the nearest tooth of a comb. */
  function footprintDistance(offset, spacing) {
    return Math.abs(spacing > 0 ? offset - spacing * Math.floor(offset / spacing + 0.5) : offset);
  }

  const covers = (type, centre, { frequency: mhz, spreading }, rules) => rules.radio ? fpgLink.covers(type, centre, mhz, spreading, rules) : footprintDistance(mhz - centre, rules.tooth_spacing[type]) <= rules.half_width[type];
  const noiseOf = (game, rules) => (game.spreading ? rules.spread_noise : rules.noise);

  function snr(signal, jamming, covered, noise, fading, rules) {
    if (!covered) return signal - noise + fading;
    return (rules.paper_snr ? signal - jamming : signal) - powerSum(noise, jamming) + fading;
  }

  function transmit(game, fading, rules) {
    game.distance = distance(game.ally, game.opponent);
    game.covered = covers(game.type, game.centre, game, rules);
    if (rules.radio) {
      fpgLink.fade(game, fading, rules);
      fpgLink.transmit(game, rules);
      return;
    }
    const signal = rules.base_power - pathLoss(distance(game.ally, rules.base_station), game.frequency, rules);
    const jamming = rules.jamming_power[game.type] - pathLoss(game.distance, game.frequency, rules);
    const noise = noiseOf(game, rules), faded = rules.fading_sd * fading;
    game.snr = snr(signal, jamming, game.covered, noise, faded, rules);
    game.cleanSnr = snr(signal, jamming, false, noise, faded, rules);
  }

  /** What the seconds of spreading cost, piece by piece. */
  function spreadCost(seconds, rules) {
    let cost = 0;
    rules.spread_from.forEach((start, piece) => {
      if (seconds > start) cost += rules.spread_slope[piece] * (Math.min(seconds, rules.spread_from[piece + 1] ?? seconds) - start);
    });
    return cost;
  }

  function reward(game, rules) {
    const costs = spreadCost(game.spreadingS, rules) + (game.hopped ? rules.hop_cost : 0), near = game.distance < rules.distance_reward_m ? rules.distance_reward : 0;
    if (rules.radio) return void fpgLink.reward(game, costs, near, rules);
    const cap = rules.snr_cap ?? Infinity, value = Math.min(game.snr, cap), clean = Math.min(game.cleanSnr, cap);
    game.allyReward = value - rules.threshold - costs;
    game.opponentReward = near + rules.snr_drop_weight * (clean - value);
  }

  function check(game, rules) {
    game.age += 1;
    game.checked = game.step + 1 === game.nextCheck;
    if (!game.checked) return;
    const heard = hears(game, rules);
    if (heard) [game.known, game.age] = [game.frequency, 0];
    game.lastCheck = heard ? 1 : -1;
    const [low, high] = rules.check_interval;
    game.nextCheck += low + integer(game.key, game.step, PURPOSE.checkInterval, high - low + 1);
  }

  function hears(game, rules) {
    if (rules.radio) return fpgLink.hears(game, rules);
    if (rules.detection !== 0) return rules.detection === 1 && !game.spreading && game.snr >= rules.threshold;
    const level = rules.ally_emission - pathLoss(game.distance, game.frequency, rules);
    const [fading] = gaussians(game.key, game.step, PURPOSE.detection);
    return level - noiseOf(game, rules) + rules.fading_sd * fading >= rules.threshold;
  }

  function sense(game, centreError, rules) {
    game.sensedMhz = game.centre + rules.sensing_sd * centreError;
    game.sensedType = game.type;
    const chance = uniform(game.key, game.step, PURPOSE.sensedType);
    if (chance >= rules.sensing_error) return;
    const other = Math.min(Math.floor((chance / rules.sensing_error) * (rules.types.length - 1)), rules.types.length - 2);
    game.sensedType = other + (other >= game.type ? 1 : 0);
  }

  /** What both sides get to know: 15 numbers each, as in fpg_bench/game/sensing.py. */
  function observe(game) {
    const { rules } = game;
    const inBand = (mhz) => clip((mhz - rules.band_middle) * rules.per_band_half);
    const places = (own, other) => [
      ...AXES.map((axis) => clip(2 * own[axis] * rules.per_box[axis] - 1)),
      ...AXES.map((axis) => {
        const away = other[axis] - own[axis];
        return clip(Math.sign(away) * Math.sqrt(Math.abs(away) * rules.per_box[axis]));
      }),
    ];
    const kinds = (type) => rules.types.map((_, kind) => (kind === type ? 1 : 0));
    const sensed = game.sensedType >= 0;
    game.allySees = Float32Array.from([
      ...places(game.ally, game.opponent), inBand(game.frequency), clip(game.spreadingS * rules.per_spreading_scale), clip(game.snr * rules.per_snr_scale),
      sensed ? inBand(game.sensedMhz) : 0, ...kinds(game.sensedType), sensed && covers(game.sensedType, game.sensedMhz, game, rules) ? 1 : -1,
    ]);
    game.opponentSees = Float32Array.from([
      ...places(game.opponent, game.ally), inBand(game.known), clip(game.age * rules.per_age_scale), clip((game.nextCheck - game.step) * rules.per_check_scale),
      game.type >= 0 ? inBand(game.centre) : 0, ...kinds(game.type), game.lastCheck,
    ]);
  }

  return { begin, step, pointMhz, footprintDistance, covers, spreadCost };
})();
