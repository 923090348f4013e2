/* The difference of two entries with a 95 % interval, from the scores that each one's own interval is over.
   Both have played the same matches. Two scripts are compared match by match; an entry of several training seeds varies over
   these, and a script beside it is a fixed player (Welch's t where both were trained). */
"use strict";
const fpgDifferences = (() => {
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const SEEDS = "training seeds";

  /** The squared error of a mean, and its degrees of freedom. */
  function error(values) {
    const middle = mean(values);
    return values.reduce((sum, value) => sum + (value - middle) ** 2, 0) / (values.length - 1) / values.length;
  }

  /** The t quantile of so many degrees of freedom, which need not be whole; `table[k]` is that of k + 1. */
  function quantile(freedom, table) {
    const low = Math.max(1, Math.min(table.length, Math.floor(freedom))), high = Math.min(table.length, low + 1);
    return table[low - 1] + (freedom - low > 0 && high > low ? (freedom - low) * (table[high - 1] - table[low - 1]) : 0);
  }

  /** `[difference, half, how]` of two lists of scores; half is null where nothing can be said. */
  function between(one, two, table) {
    const apart = mean(one.scores) - mean(two.scores);
    const trained = [one, two].filter(({ over }) => over === SEEDS).map(({ scores }) => scores);
    if (!trained.length) return matched(one.scores, two.scores, apart, table);
    if (trained.some((scores) => scores.length < 2)) return [apart, null, ""];
    const errors = trained.map(error), sum = errors.reduce((a, b) => a + b, 0);
    const freedom = sum ** 2 / errors.reduce((total, of, k) => total + of ** 2 / (trained[k].length - 1), 0);
    return [apart, sum ? quantile(freedom, table) * Math.sqrt(sum) : 0, "over training seeds"];
  }

  function matched(one, two, apart, table) {
    if (one.length !== two.length || one.length < 2) return [apart, null, ""];
    const apiece = one.map((score, k) => score - two[k]);
    return [apart, quantile(one.length - 1, table) * Math.sqrt(error(apiece)), "match by match"];
  }

  /** The scores over all rivals of a suite, unit by unit. */
  const overall = ({ over, scores }) => ({ over, scores: scores[0].map((_, unit) => mean(scores.map((of) => of[unit]))) });

  return { between, overall };
})();
