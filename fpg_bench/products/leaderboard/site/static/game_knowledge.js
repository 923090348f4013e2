/* Which point the ally hops to: its own preference, or the knowledge base; see fpg_bench/game/hopping.py. */
"use strict";
const fpgKnowledge = (() => {
  const { PURPOSE, integer } = fpgDraws;
  const f32 = Math.fround;
  const SENSED_CENTRE = 9, SENSED_TYPE = 10; // of the ally's observation

  function choose(game, action, rules) {
    if (rules.knowledge && action[4] > 0) return expertPoint(game, action, rules);
    return Math.floor(((action[3] + 1) / 2) * (rules.points - 1) + 0.5);
  }

  /** The strategy of the highest score; ties to the lowest. */
  function strategyOf(seen, action, rules) {
    let best = 0, most = -Infinity;
    for (let kind = 0; kind < rules.types.length; kind++) {
      const score = f32(seen[SENSED_TYPE + kind] + action[5 + kind]);
      if (score > most) [best, most] = [kind, score];
    }
    return best;
  }

  const centreOf = (seen, rules) => rules.band_middle + seen[SENSED_CENTRE] * rules.band_half;

  /** The points outside a strategy's footprint and guard, but for the present one. */
  function freePoints(game, strategy, rules) {
    const centre = centreOf(game.allySees, rules);
    return Array.from({ length: rules.points }, (_, point) => point).filter((point) => {
      const offset = fpgRules.footprintDistance(fpgRules.pointMhz(point, rules) - centre, rules.strategy_spacing[strategy]);
      return point !== game.point && offset > rules.strategy_half_width[strategy];
    });
  }

  function expertPoint(game, action, rules) {
    const strategy = strategyOf(game.allySees, action, rules), free = freePoints(game, strategy, rules);
    const draw = (count) => integer(game.key, game.step, PURPOSE.knowledge, count);
    if (!free.length) { // a guard wider than the band: any other point
      const other = draw(rules.points - 1);
      return other + (other >= game.point ? 1 : 0);
    }
    const most = rules.strategy_candidates[strategy];
    if (!most) return free[draw(free.length)];
    return farthest(free, game, rules)[draw(Math.min(most, free.length))];
  }

  function farthest(free, game, rules) {
    const away = (point) => Math.abs(fpgRules.pointMhz(point, rules) - centreOf(game.allySees, rules));
    return [...free].sort((a, b) => away(b) - away(a) || a - b);
  }

  return { choose };
})();
