/* The difference of two entries with a 95 % interval. Both have played the same matches, which are compared one by one; trained
   entries vary over their training seeds, too. Halves of the intervals add as squares (Banerjee 1960). */
"use strict";
const fpgDifferences = (() => {
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

  /** Half of the interval of a mean; 0 of a single value. `table[k]` is Student's t of k + 2 values. */
  function halfOf(values, table) {
    if (values.length < 2) return 0;
    const middle = mean(values);
    const variance = values.reduce((sum, value) => sum + (value - middle) ** 2, 0) / (values.length - 1);
    return table[Math.min(values.length - 2, table.length - 1)] * Math.sqrt(variance / values.length);
  }

  /** `[difference, half, how]` of two entries' scores; half is null where nothing can be said. */
  function between(one, two, table) {
    const isTrained = one.seeds.length > 1 || two.seeds.length > 1;
    const apiece = one.matches.map((score, k) => score - two.matches[k]);
    const apart = mean(one.matches) - mean(two.matches);
    if (!isTrained && apiece.length < 2) return [apart, null, ""];
    const half = Math.hypot(...[one.seeds, two.seeds, apiece].map((values) => halfOf(values, table)));
    return [apart, half, isTrained ? "over training seeds and matches" : "match by match"];
  }

  /** The scores against rival `k` of a suite, or over all of them (null). */
  const against = ({ seeds, matches }, k) => ({ seeds: unit(seeds, k), matches: unit(matches, k) });
  const unit = (scores, k) => (k === null ? scores[0].map((_, i) => mean(scores.map((of) => of[i]))) : scores[k]);

  return { between, against };
})();
