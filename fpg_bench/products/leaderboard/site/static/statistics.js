/* The page of statistics: ranks and performance profiles, per track. */
"use strict";
(() => {
  const { percent, table } = fpgCharts;
  const { tracks } = window.fpgData;
  const chosen = document.getElementById("track");
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

  function show() {
    track = tracks.find((one) => one.key === chosen.value) ?? tracks[0];
    ranks();
    profiles();
  }

  const asked = new URLSearchParams(location.hash.slice(1)).get("track");
  if (tracks.some((one) => one.key === asked)) chosen.value = asked;
  chosen.addEventListener("change", () => {
    history.replaceState(null, "", `#track=${chosen.value}`);
    show();
  });
  show();
})();
