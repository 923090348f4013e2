/* The page of cross-play: one of three matrices, strongest first, one player's numbers, and the mixture. */
"use strict";
(() => {
  const { percent, step, heatMap, table, fill } = fpgCharts;
  const { names, matrices, rounds, nash } = window.fpgData;
  const SHOWN = {
    ally: { short: "ally's return", better: "ally", written: step },
    opponent: { short: "opponent's return", better: "opponent", written: step },
    jammed: { short: "jammed", better: "opponent", written: percent },
  };
  const slugs = { ally: window.fpgData.allies, opponent: window.fpgData.opponents };
  const called = (side, slug) => names[side][slug] ?? slug;
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const matrix = document.getElementById("matrix"), who = document.getElementById("who");
  let order; // of each side, as places: strongest first
  let players; // to choose from, as [side, place]

  const line = (key, side, place) => (side === "ally" ? matrices[key][place] : matrices[key].map((row) => row[place]));

  /** The places of a side's players by their means in the matrix shown, the best for that side first. */
  function ordered(side) {
    const up = SHOWN[matrix.value].better === side ? -1 : 1;
    const means = slugs[side].map((_, place) => mean(line(matrix.value, side, place)));
    return means.map((_, place) => place).sort((a, b) => up * (means[a] - means[b]) || a - b);
  }

  function draw() {
    const { short, better } = SHOWN[matrix.value];
    order = { ally: ordered("ally"), opponent: ordered("opponent") };
    const values = order.ally.map((i) => order.opponent.map((j) => matrices[matrix.value][i][j]));
    const shown = Object.fromEntries(["ally", "opponent"].map((side) => [side, order[side].map((place) => called(side, slugs[side][place]))]));
    const share = matrix.value === "jammed";
    heatMap("heatmap", shown.ally, shown.opponent, values, short, {
      share, low: share ? 0 : Math.min(...values.flat()), top: Math.max(share ? 0.01 : -Infinity, ...values.flat()),
      colours: (c) => [[0, c.panel], [1, c[better]]],
    });
    const before = players?.[who.value];
    players = ["ally", "opponent"].flatMap((side) => order[side].map((place) => [side, place]));
    fill(who, players.map(([side, place]) => `${side}: ${called(side, slugs[side][place])}`));
    who.value = Math.max(0, players.findIndex(([side, place]) => before && side === before[0] && place === before[1]));
    show();
  }

  /** All numbers of one player, its strongest counterparts first. */
  function show() {
    const [side, place] = players[who.value];
    const other = side === "ally" ? "opponent" : "ally";
    const keys = Object.keys(SHOWN);
    const rows = order[other].map((k) => [called(other, slugs[other][k]), ...keys.map((key) => SHOWN[key].written(line(key, side, place)[k]))]);
    const caption = `Returns a step and jamming success rate of ${who.selectedOptions[0].text}, ${rounds} rounds a pair`;
    table(document.getElementById("row"), caption, [side === "ally" ? "Opponent" : "Ally", "Ally's return", "Opponent's return", "Jammed"], rows);
  }

  const asked = new URLSearchParams(location.hash.slice(1)).get("matrix");
  if (asked in SHOWN) matrix.value = asked;
  matrix.addEventListener("change", () => {
    history.replaceState(null, "", `#matrix=${matrix.value}`);
    draw();
  });
  who.addEventListener("change", show);
  draw();

  if (!nash) return;
  document.getElementById("value").textContent = step(nash.value);
  for (const side of ["ally", "opponent"]) {
    const rows = Object.entries(nash[side] ?? {}).filter(([, share]) => share > 0.0005).sort((a, b) => b[1] - a[1]);
    table(document.getElementById(`nash-${side}`), `Share of each ${side} in the mixture`,
      [side === "ally" ? "Ally" : "Opponent", "Share"], rows.map(([slug, share]) => [called(side, slug), percent(share)]));
  }
})();
