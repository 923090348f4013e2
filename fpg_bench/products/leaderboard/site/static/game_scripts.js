/* The scripted players in the browser, as fpg_bench/players/scripts.py: each answers an observation with nine numbers.
   fpgScripts(side, name, rules, key) gives (observation) => action for one round. */
"use strict";
const fpgScripts = (() => {
  const { PURPOSE, bits, uniform } = fpgDraws;
  const f32 = Math.fround;
  const NAMES = {
    ally: ["idle", "random", "reactive", "expert", "expert-spread", "always-hop"],
    opponent: ["tone", "narrowband", "broadband", "comb", "random", "sweep", "adaptive", "watchful"],
  };
  const SPREAD_S = 8, PURSUIT_M = 10;
  const gate = (on) => (on ? 1 : -1);

  /** The key of a side's own draws in a round. */
  const playerKey = (round, side) => bits(round, 0, side === "ally" ? PURPOSE.allyPlayer : PURPOSE.opponentPlayer);
  const draw = (key, step, purpose) => 2 * uniform(key, step, PURPOSE.player + purpose) - 1;
  const random = (key, step, rules) => Array.from({ length: 5 + rules.types.length }, (_, j) => draw(key, step, j));

  /** The way to the other side in metres; observations hold its signed root over the box. */
  const awayFrom = (seen, rules) => [0, 1, 2].map((axis) => {
    const root = seen[3 + axis];
    return Math.sign(root) * f32(root * root) * rules.box[axis];
  });

  function ally(name, seen, step, key, rules) {
    const snr = seen[8] / rules.per_snr_scale;
    const expert = name.startsWith("expert") && seen[14] > 0 && snr < rules.scripts.threat_db;
    const hop = expert || name === "always-hop" || (name === "reactive" && snr < rules.threshold);
    const spreadS = seen[7] / rules.per_spreading_scale;
    const spread = name === "expert-spread" && (hop || (spreadS > 0.5 && spreadS < SPREAD_S - 0.5));
    const preference = name === "reactive" || name === "always-hop" ? draw(key, step, 3) : 0;
    const sprints = Math.hypot(...awayFrom(seen, rules)) < rules.scripts.sprint_m;
    return [gate(hop), gate(spread), sprints ? 1 : 0, preference, gate(expert), ...rules.types.map(() => 0)];
  }

  /** True if the last check heard the ally where it was jammed; a tone remembers it until the next one. */
  function stayed(seen, checked, { types }) {
    return checked ? seen[9] === seen[6] || !seen.slice(10, 10 + types.length).some(Boolean) : seen[10] > 0;
  }

  function opponent(name, seen, step, key, rules) {
    const away = awayFrom(seen, rules);
    const metres = Math.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2);
    const sweeping = name === "sweep";
    const type = sweeping ? "narrowband" : rules.types.includes(name) ? name : answer(name, seen, metres, rules);
    const tuning = sweeping ? (2 * (step % rules.points)) / (rules.points - 1) - 1 : 0;
    const reach = Math.max(metres, PURSUIT_M);
    return [...rules.types.map((one) => gate(one === type)), tuning, gate(sweeping), ...away.map((x) => x / reach)];
  }

  /** The type that adaptive and watchful choose. */
  function answer(name, seen, metres, rules) {
    const checked = seen[7] <= 0;
    if (name === "watchful" ? stayed(seen, checked, rules) : checked) return "tone";
    if (checked) return "narrowband";
    if (metres < rules.scripts.broadband_m) return "broadband";
    return metres < rules.scripts.comb_m ? "comb" : "narrowband";
  }

  function make(side, name, rules, round) {
    const key = playerKey(round, side), play = side === "ally" ? ally : opponent;
    let step = -1;
    return (seen) => {
      step += 1;
      return name === "random" ? random(key, step, rules) : play(name, seen, step, key, rules);
    };
  }

  return { NAMES, make, playerKey };
})();
