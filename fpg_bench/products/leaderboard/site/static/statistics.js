/* The page of statistics: ranks, performance profiles and the probability of improvement, per track. */
"use strict";
(() => {
  const { percent, tint, matrix, table, fill } = fpgCharts;
  const MOST = 40; // entries of a matrix; all stand in the list below it
  const { tracks } = window.fpgData;
  const chosen = document.getElementById("track");
  const who = document.getElementById("who");
  let track;

  function ranks() {
    const { names, ranks: known } = track;
    table(document.getElementById("rank-table"), "Best and worst rank of each entry", ["Entry", "Rank"], Object.entries(known).map(([slug, rank]) => [names[slug], rank]));
  }

  function profiles() {
    const { thresholds, names, share } = track;
    const first = Object.keys(share).slice(0, fpgProfile.MOST);
    const marks = fpgProfile.draw(document.getElementById("profile"), thresholds, first.map((slug) => ({ name: names[slug], share: share[slug] })));
    const nearest = (score) => thresholds.reduce((best, x, i) => (Math.abs(x - score) < Math.abs(thresholds[best] - score) ? i : best), 0);
    const columns = [...new Set(marks.map(nearest))];
    table(document.getElementById("profile-table"), "Share of runs that score more than a threshold",
      ["Entry", ...columns.map((i) => `> ${String(Math.round(thresholds[i])).replace("-", "−")}`)],
      Object.entries(share).map(([slug, line]) => [names[slug], ...columns.map((i) => percent(line[i], 0))]));
  }

  /** A cell of the matrix: blue where the one on the left is likelier ahead, orange where the other is. */
  function cell(i, j) {
    const { names, value, low, high } = track.improvement;
    if (i === j || value[i][j] === null) return null;
    const interval = `${percent(low[i][j], 0)} to ${percent(high[i][j], 0)}`, side = value[i][j] >= 0.5 ? "ally" : "opponent";
    return {
      text: percent(value[i][j], 0), notes: [`${Math.round(100 * low[i][j])}–${Math.round(100 * high[i][j])}`],
      tint: `of-${side} ${tint(Math.abs(2 * value[i][j] - 1))}`,
      label: `${named(names[i])} scores more than ${named(names[j])} with a probability of ${percent(value[i][j], 0)}, ${interval}`,
    };
  }

  const named = (slug) => track.names[slug] ?? slug;

  function improvement() {
    const { improvement: matrices } = track;
    const section = document.querySelector("[aria-labelledby=improvement]");
    section.hidden = !matrices;
    if (!matrices) return;
    const names = matrices.names.map(named), shown = names.slice(0, MOST);
    document.getElementById("left").textContent = names.length > MOST ? `The first ${MOST} of ${names.length} entries are shown; the list below has all.` : "";
    matrix(document.getElementById("matrix"), "Probability that the row's entry scores more than the column's", "Scores more", shown, shown, cell);
    fill(who, names);
    one();
  }

  function one() {
    const { names, value, low, high } = track.improvement;
    const i = Number(who.value);
    const rows = names.map((slug, j) => [named(slug), j]).filter(([, j]) => j !== i);
    rows.sort((a, b) => value[i][b[1]] - value[i][a[1]]);
    table(document.getElementById("row"), `Probability that ${who.selectedOptions[0].text} scores more than each other entry`,
      ["Scores more than", "Probability", "95 % interval"],
      rows.map(([name, j]) => [name, percent(value[i][j], 0), `${percent(low[i][j], 0)} to ${percent(high[i][j], 0)}`]));
  }

  function show() {
    track = tracks.find((one) => one.key === chosen.value) ?? tracks[0];
    ranks();
    profiles();
    improvement();
  }

  const asked = new URLSearchParams(location.hash.slice(1)).get("track");
  if (tracks.some((one) => one.key === asked)) chosen.value = asked;
  chosen.addEventListener("change", () => {
    history.replaceState(null, "", `#track=${chosen.value}`);
    show();
  });
  who.addEventListener("change", one);
  show();
})();
