/* Chance as the game draws it: a number for each (key, step, purpose), from the finaliser of SplitMix64.
   Keys are BigInts of 64 bits; numbers are the same as in fpg_bench/game/rng.py. */
"use strict";
const fpgDraws = (() => {
  const ALL = (1n << 64n) - 1n;
  const GOLDEN = 0x9e3779b97f4a7c15n, MIX_1 = 0xbf58476d1ce4e5b9n, MIX_2 = 0x94d049bb133111ebn;
  const PURPOSES = 64;
  const PURPOSE = { // of a match and a round, whose step is 0, then of a step
    curve: 0, opponentStart: 12, startPoint: 16, firstCheck: 17, path: 18, allyPlayer: 20, opponentPlayer: 21, fadingStart: 23, jammingFadingStart: 25,
    fading: 0, detection: 1, checkInterval: 2, sensedType: 3, knowledge: 4, jammingFading: 5, player: 8,
  };

  function mix(z) {
    z = ((z ^ (z >> 30n)) * MIX_1) & ALL;
    z = ((z ^ (z >> 27n)) * MIX_2) & ALL;
    return z ^ (z >> 31n);
  }

  const matchKey = (seed, match) => mix((mix((seed + GOLDEN) & ALL) + BigInt(match) * GOLDEN) & ALL);
  const roundKey = (key, number) => mix(((key ^ MIX_1) + BigInt(number + 1) * GOLDEN) & ALL);
  const bits = (key, step, purpose) => mix((key + BigInt(step * PURPOSES + purpose + 1) * GOLDEN) & ALL);
  const share = (word) => Number(word >> 11n) * 2 ** -53;
  const uniform = (key, step, purpose) => share(bits(key, step, purpose));
  const integer = (key, step, purpose, count) => Math.min(Math.floor(uniform(key, step, purpose) * count), count - 1);

  /** Two standard normal numbers. */
  function gaussians(key, step, purpose) {
    const word = bits(key, step, purpose);
    const radius = Math.sqrt(-2 * Math.log(1 - share(word)));
    const angle = 2 * Math.PI * share(mix((word + GOLDEN) & ALL));
    return [radius * Math.cos(angle), radius * Math.sin(angle)];
  }

  return { PURPOSE, matchKey, roundKey, bits, uniform, integer, gaussians };
})();
