/* The page of statistics: performance profiles and the probability of improvement, per track. */
"use strict";
(() => {
  const { percent, draw, heatMap, table, fill, plain } = fpgCharts;
  const MOST = 6; // lines that can be told apart
  // Okabe and Ito's palette, and dashes beside it: no line is told by its colour alone.
  const PALETTE = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
  const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "solid"];
  const { tracks } = window.fpgData;
  const chosen = document.getElementById("track");
  const who = document.getElementById("who");
  let track;

  function profiles() {
    const slugs = Object.keys(track.share).slice(0, MOST);
    const { thresholds, names } = track;
    draw("profile", () => ({
      traces: slugs.map((slug, i) => ({
        type: "scatter", mode: "lines", x: thresholds, y: track.share[slug], name: plain(names[slug]),
        line: { color: PALETTE[i % PALETTE.length], dash: DASHES[i % DASHES.length], width: 2.2 },
        hovertemplate: "%{y:.0%} above %{x}<extra>%{fullData.name}</extra>",
      })),
      xaxis: { title: { text: "score" } },
      yaxis: { title: { text: "share of runs above it" }, tickformat: ".0%", range: [-0.02, 1.03] },
      legend: { orientation: "h", y: -0.22 }, height: 400,
    }));
    const nearest = (score) => thresholds.reduce((best, x, i) => (Math.abs(x - score) < Math.abs(thresholds[best] - score) ? i : best), 0);
    const columns = thresholds.length ? [...new Set([0, 25, 50, 75, 100, 125].map(nearest))] : [];
    table(document.getElementById("profile-table"), "Share of runs that score more than a threshold",
      ["Entry", ...columns.map((i) => `> ${Math.round(thresholds[i])}`)],
      Object.entries(track.share).map(([slug, line]) => [names[slug], ...columns.map((i) => percent(line[i], 0))]));
  }

  function improvement() {
    const found = track.improvement;
    const section = document.querySelector("[aria-labelledby=improvement]");
    section.hidden = !found;
    if (!found) return;
    const names = found.names.map((slug) => track.names[slug] ?? slug);
    const values = found.value.map((line, i) => line.map((value, j) => (i === j ? null : value)));
    heatMap("matrix", names, names, values, "", {
      low: 0, top: 1, share: true, colours: (c) => [[0, c.opponent], [0.5, c.panel], [1, c.ally]],
    });
    fill(who, names);
    one();
  }

  function one() {
    const { names, value, low, high } = track.improvement;
    const i = Number(who.value);
    const rows = names.map((slug, j) => [track.names[slug] ?? slug, j]).filter(([, j]) => j !== i);
    rows.sort((a, b) => value[i][b[1]] - value[i][a[1]]);
    table(document.getElementById("row"), `How likely ${who.selectedOptions[0].text} scores more than each other entry`,
      ["Scores more than", "Probability", "95 % interval"],
      rows.map(([name, j]) => [name, percent(value[i][j], 0), `${percent(low[i][j], 0)} to ${percent(high[i][j], 0)}`]));
  }

  function show() {
    track = tracks.find((one) => one.key === chosen.value) ?? tracks[0];
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
