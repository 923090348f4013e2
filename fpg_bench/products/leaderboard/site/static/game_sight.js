/* A step of a round as replay_data lists it: the truth, and the part of it that a side's 15 numbers hold. */
"use strict";
const fpgSight = (() => {
  const FIELDS = ["ally", "opponent", "frequency", "known", "age", "type", "centre", "distance", "snr", "clean_snr", "spreading", "hopped", "covered", "check", "ally_reward", "opponent_reward"];

  const truth = (game) => ({
    ally: game.ally, opponent: game.opponent, frequency: game.frequency, known: game.known, age: game.age, type: game.type, centre: game.centre,
    distance: game.distance, snr: game.snr, clean_snr: game.cleanSnr, spreading: game.spreadingS, hopped: Number(game.hopped), covered: Number(game.covered),
    check: game.checked ? game.lastCheck : 0, ally_reward: game.allyReward, opponent_reward: game.opponentReward,
  });

  /** The ally knows its link and what its monitor senses, errors included; not what the opponent heard. */
  function ally({ allySees: seen, rules }) {
    const type = seen.slice(10, 10 + rules.types.length).indexOf(1);
    return {
      type, centre: rules.band_middle + seen[9] * rules.band_half, snr: seen[8] / rules.per_snr_scale, covered: Number(seen[14] > 0),
      clean_snr: NaN, known: NaN, age: NaN, check: 0, opponent_reward: NaN,
    };
  }

  /** The opponent knows its own jamming and the frequency that it heard last; nothing of the link. */
  function opponent(game) {
    const heard = game.step === 0 || (game.checked && game.lastCheck === 1);
    return {
      frequency: heard ? game.known : NaN, snr: NaN, clean_snr: NaN, covered: 0, spreading: 0, hopped: 0, ally_reward: NaN, opponent_reward: NaN,
    };
  }

  const SIDES = { ally, opponent, nobody: () => ({}) };
  const seen = (game, side) => ({ ...truth(game), ...SIDES[side](game) });

  /** The steps of a round, field by field, and one more. */
  const empty = () => Object.fromEntries(FIELDS.map((field) => [field, []]));
  const add = (steps, one) => FIELDS.forEach((field) => steps[field].push(one[field]));

  return { truth, seen, empty, add };
})();
