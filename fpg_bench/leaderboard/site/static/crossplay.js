/* The page of cross-play: the matrix, one player's row of it, and the mixture. */
"use strict";
(() => {
  const { percent, heatMap, table, fill } = fpgCharts;
  const { names, rates, rounds, nash } = window.fpgData;
  const called = (side, slug) => names[side][slug] ?? slug;
  const allies = window.fpgData.allies.map((slug) => called("ally", slug));
  const opponents = window.fpgData.opponents.map((slug) => called("opponent", slug));
  const top = Math.max(0.01, ...rates.flat().filter((rate) => rate !== null));
  heatMap("heatmap", allies, opponents, rates, "jammed", {
    top, colours: (c) => [[0, c.panel], [1, c.opponent]],
  });

  const who = document.getElementById("who");
  fill(who, [...allies.map((name) => `ally: ${name}`), ...opponents.map((name) => `opponent: ${name}`)]);
  function show() {
    const index = Number(who.value);
    const isAlly = index < allies.length;
    const others = isAlly ? opponents : allies;
    const line = isAlly ? rates[index] : rates.map((row) => row[index - allies.length]);
    const rows = others.map((name, i) => [name, line[i]]).sort((a, b) => b[1] - a[1]);
    const caption = `Jamming success rate of ${who.selectedOptions[0].text}, ${rounds} rounds a pair`;
    table(document.getElementById("row"), caption, [isAlly ? "Opponent" : "Ally", "Jammed"],
      rows.map(([name, rate]) => [name, percent(rate)]));
  }
  who.addEventListener("change", show);
  show();

  if (!nash) return;
  document.getElementById("value").textContent = percent(nash.value);
  for (const side of ["ally", "opponent"]) {
    const rows = Object.entries(nash[side] ?? {}).filter(([, share]) => share > 0.0005).sort((a, b) => b[1] - a[1]);
    table(document.getElementById(`nash-${side}`), `Share of each ${side} in the mixture`,
      [side === "ally" ? "Ally" : "Opponent", "Share"], rows.map(([slug, share]) => [called(side, slug), percent(share)]));
  }
})();
