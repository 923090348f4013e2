/* The difference of two entries with its interval, as the ranking has it: both have played the same matches, which are compared one by
   one. `student` is Student's t, with which the intervals of all pairs of a track hold together. */
"use strict";
const fpgDifferences = (() => {
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

  /** `[difference, half]` of two entries' scores by match; half is null where nothing can be said. */
  function between(one, two, student) {
    const apart = one.map((score, k) => score - two[k]), middle = mean(apart);
    if (student === undefined || apart.length < 2) return [middle, null];
    const variance = apart.reduce((sum, value) => sum + (value - middle) ** 2, 0) / (apart.length - 1);
    return [middle, student * Math.sqrt(variance / apart.length)];
  }

  /** The scores by match against rival `k` of a suite, or over all of them (null). */
  const against = (scores, k) => (k === null ? scores[0].map((_, i) => mean(scores.map((of) => of[i]))) : scores[k]);

  return { between, against };
})();
