/* The page of cross-play: returns and jamming rate of every pair, strongest first, one player's numbers, and the mixture. */
"use strict";
(() => {
  const { percent, step, one, tint, matrix, table, fill } = fpgCharts;
  const { names, matrices, half, watch, rounds, nash, game } = window.fpgData;
  const SHOWN = {
    ally: { short: "ally's return", better: "ally", written: step, brief: one },
    opponent: { short: "opponent's return", better: "opponent", written: step, brief: one },
    jamming_success_rate: { short: "jamming success rate", better: "opponent", written: percent, brief: (value) => percent(value, 0) },
  };
  const slugs = { ally: window.fpgData.allies, opponent: window.fpgData.opponents };
  const called = (side, slug) => names[side][slug] ?? slug;
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const shown = document.getElementById("matrix"), who = document.getElementById("who");
  let order; // of each side, as places: strongest first
  let players; // to choose from, as [side, place]

  const line = (key, side, place) => (side === "ally" ? matrices[key][place] : matrices[key].map((row) => row[place]));

  /** The places of a side's players by their means in the matrix shown, the best for that side first. */
  function ordered(side) {
    const up = SHOWN[shown.value].better === side ? -1 : 1;
    const means = slugs[side].map((_, place) => mean(line(shown.value, side, place)));
    return means.map((_, place) => place).sort((a, b) => up * (means[a] - means[b]) || a - b);
  }

  /** A number with half of its interval, where it has one. */
  function within(key, i, j, written) {
    const width = half[key]?.[i][j] ?? null;
    return width === null ? written(matrices[key][i][j]) : `${written(matrices[key][i][j])} ± ${written(width)}`;
  }

  /** Where a round of a pair is played, if the page can play both. */
  function address(ally, opponent) {
    const [a, o] = [watch.ally[ally], watch.opponent[opponent]];
    return a && o ? `play.html#${new URLSearchParams({ side: "nobody", ...(game !== "standard" && { game }), ally: a.player, opponent: o.player, path: o.path })}` : undefined;
  }

  function cell(key, i, j, [low, top]) {
    const [ally, opponent] = [slugs.ally[i], slugs.opponent[j]];
    const beside = key === "jamming_success_rate" ? ["ally"] : ["jamming_success_rate"];
    const { brief } = SHOWN[key], wide = half[key]?.[i][j] ?? null;
    const href = address(ally, opponent);
    const figures = Object.keys(SHOWN).map((name) => `${SHOWN[name].short} ${within(name, i, j, SHOWN[name].written)}`).join(", ");
    return {
      href, text: brief(matrices[key][i][j]), tint: tint((matrices[key][i][j] - low) / (top - low || 1)),
      notes: [...(wide === null ? [] : [`± ${brief(wide)}`]), ...beside.map((name) => SHOWN[name].brief(matrices[name][i][j]))],
      label: `${called("ally", ally)} against ${called("opponent", opponent)}: ${figures}${href ? "; watch a round" : ""}`,
    };
  }

  function draw() {
    const key = shown.value;
    order = { ally: ordered("ally"), opponent: ordered("opponent") };
    const every = matrices[key].flat(), ends = [key === "jamming_success_rate" ? 0 : Math.min(...every), Math.max(...every)];
    const labels = (side) => order[side].map((place) => called(side, slugs[side][place]));
    const element = document.getElementById("heatmap");
    element.className = `heat pairs of-${SHOWN[key].better}`;
    matrix(element, `${SHOWN[key].short} of each pair`, "Ally", labels("ally"), labels("opponent"), (i, j) => cell(key, order.ally[i], order.opponent[j], ends));
    const before = players?.[who.value];
    players = ["ally", "opponent"].flatMap((side) => order[side].map((place) => [side, place]));
    fill(who, players.map(([side, place]) => `${side}: ${called(side, slugs[side][place])}`));
    who.value = Math.max(0, players.findIndex(([side, place]) => before && side === before[0] && place === before[1]));
    show();
  }

  /** All numbers of one player, its strongest rivals first. */
  function show() {
    const [side, place] = players[who.value];
    const other = side === "ally" ? "opponent" : "ally";
    const numbers = (k) => Object.keys(SHOWN).map((key) => within(key, ...(side === "ally" ? [place, k] : [k, place]), SHOWN[key].written));
    const rows = order[other].map((k) => [called(other, slugs[other][k]), ...numbers(k)]);
    const caption = `Returns per step and jamming success rate of ${who.selectedOptions[0].text}, ${rounds} rounds per pair`;
    table(document.getElementById("row"), caption, [side === "ally" ? "Opponent" : "Ally", "Ally's return", "Opponent's return", "Jamming success rate"], rows);
  }

  const asked = new URLSearchParams(location.hash.slice(1)).get("matrix");
  if (Object.hasOwn(SHOWN, asked)) shown.value = asked;
  shown.addEventListener("change", () => {
    history.replaceState(null, "", `#matrix=${shown.value}`);
    draw();
  });
  who.addEventListener("change", show);
  draw();

  document.getElementById("value").textContent = step(nash.value);
  for (const side of ["ally", "opponent"]) {
    const rows = Object.entries(nash[side]).filter(([, share]) => share > 0.0005).sort((a, b) => b[1] - a[1]);
    table(document.getElementById(`nash-${side}`), `Share of each ${side} in the mixture`,
      [side === "ally" ? "Ally" : "Opponent", "Share"], rows.map(([slug, share]) => [called(side, slug), percent(share)]));
  }
})();
