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
  const TYPES = ["tone", "narrowband", "broadband", "comb"];
  const THREATENED_DB = 30, SPREAD_S = 8, BROADBAND_M = 35, COMB_M = 90, PURSUIT_M = 10;
  const gate = (on) => (on ? 1 : -1);

  /** The key of a side's own draws in a round. */
  const playerKey = (round, side) => bits(round, 0, side === "ally" ? PURPOSE.allyPlayer : PURPOSE.opponentPlayer);
  const draw = (key, step, purpose) => 2 * uniform(key, step, PURPOSE.player + purpose) - 1;
  const random = (key, step) => Array.from({ length: 9 }, (_, j) => draw(key, step, j));

  function ally(name, seen, step, key, rules) {
    const snr = seen[8] / rules.per_snr_scale;
    const expert = name.startsWith("expert") && seen[14] > 0 && snr < THREATENED_DB;
    const hop = expert || name === "always-hop" || (name === "reactive" && snr < rules.threshold);
    const spreadS = seen[7] / rules.per_spreading_scale;
    const spread = name === "expert-spread" && (hop || (spreadS > 0.5 && spreadS < SPREAD_S - 0.5));
    const preference = name === "reactive" || name === "always-hop" ? draw(key, step, 3) : 0;
    return [gate(hop), gate(spread), 1, preference, gate(expert), 0, 0, 0, 0];
  }

  /** True if the last check heard the ally where it was jammed; a tone remembers it until the next one. */
  function stayed(seen, checked) {
    return checked ? seen[9] === seen[6] || !seen.slice(10, 14).some(Boolean) : seen[10] > 0;
  }

  function opponent(name, seen, step, key, rules) {
    const away = [0, 1, 2].map((axis) => {
      const root = seen[3 + axis];
      return Math.sign(root) * f32(root * root) * rules.box[axis];
    });
    const metres = Math.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2);
    const sweeping = name === "sweep";
    const type = sweeping ? "narrowband" : TYPES.includes(name) ? name : answer(name, seen, metres);
    const tuning = sweeping ? (2 * (step % rules.points)) / (rules.points - 1) - 1 : 0;
    const reach = Math.max(metres, PURSUIT_M);
    return [...TYPES.map((one) => gate(one === type)), tuning, gate(sweeping), ...away.map((x) => x / reach)];
  }

  /** The type that adaptive and watchful choose. */
  function answer(name, seen, metres) {
    const checked = seen[7] <= 0;
    if (name === "watchful" ? stayed(seen, checked) : checked) return "tone";
    if (checked) return "narrowband";
    if (metres < BROADBAND_M) return "broadband";
    return metres < COMB_M ? "comb" : "narrowband";
  }

  function make(side, name, rules, round) {
    const key = playerKey(round, side), play = side === "ally" ? ally : opponent;
    let step = -1;
    return (seen) => {
      step += 1;
      return name === "random" ? random(key, step) : play(name, seen, step, key, rules);
    };
  }

  return { NAMES, make };
})();
