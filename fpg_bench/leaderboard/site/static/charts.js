/* What the pages with plots share: Plotly in the page's own colours, and tables of numbers. */
"use strict";
const fpgCharts = (() => {
  const percent = (share, digits = 1) => (share === null || share === undefined ? "–" : `${(100 * share).toFixed(digits)} %`);
  const step = (value) => (value === null || value === undefined ? "–" : value.toFixed(2).replace("-", "−"));
  const redraws = [];

  function colours() {
    const style = getComputedStyle(document.documentElement);
    const names = ["page", "panel", "ink", "grey", "pale", "ally", "opponent"];
    return Object.fromEntries(names.map((name) => [name, style.getPropertyValue("--" + name).trim()]));
  }

  function layout(more) {
    const c = colours();
    const axis = { gridcolor: c.pale, zerolinecolor: c.pale, linecolor: c.pale, automargin: true, fixedrange: true };
    return {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: 'system-ui, "Segoe UI", "DejaVu Sans", sans-serif', size: 12, color: c.ink },
      hoverlabel: { bgcolor: c.panel, bordercolor: c.pale, font: { color: c.ink } },
      margin: { l: 10, r: 10, t: 14, b: 10 },
      ...more,
      xaxis: { ...axis, ...more.xaxis }, yaxis: { ...axis, ...more.yaxis },
    };
  }

  // Plotly understands a few marks in texts; these are names that anybody may have chosen.
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const short = (text) => {
    const letters = [...String(text)];
    return plain(letters.length > 22 ? letters.slice(0, 21).join("") + "…" : text);
  };

  /** Draw now, and again in other colours where the theme changes. */
  function draw(id, make) {
    const again = () => {
      const { traces, ...more } = make(colours());
      return Plotly.react(id, traces, layout(more), { displayModeBar: false, responsive: true });
    };
    redraws[id] = again;
    again();
  }

  const redrawAll = () => Object.values(redraws).forEach((again) => again());
  new MutationObserver(redrawAll).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);

  /**
   * A heat map; axis texts are numbered inside, as two players may have one name.
   * `scale` holds the numbers of both ends (`low`, `top`), the `colours` between them, and `share`: whether
   * numbers are shares, to be written in per cent.
   */
  function heatMap(id, rows, columns, values, title, scale) {
    const big = columns.length > 40;
    const ticks = (names) => (big ? { showticklabels: false, ticks: "" } : {
      tickmode: "array", tickvals: names.map((_, i) => i), ticktext: names.map(short),
    });
    const cell = Math.max(22, Math.min(34, 900 / rows.length));
    const written = columns.length <= 16 ? { texttemplate: scale.share ? "%{z:.0%}" : "%{z:.1f}", textfont: { size: 11 } } : {};
    const told = scale.share ? percent : step;
    const box = document.getElementById(id).style;
    box.maxWidth = `${Math.max(420, 260 + 72 * columns.length)}px`;
    box.minWidth = big ? "" : `${230 + (columns.length <= 16 ? 34 : 14) * columns.length}px`; // else it scrolls
    draw(id, (c) => ({
      traces: [{
        type: "heatmap", ...written, z: values, zmin: scale.low, zmax: scale.top, colorscale: scale.colours(c), hoverongaps: false,
        x: columns.map((_, i) => i), y: rows.map((_, i) => i), xgap: big ? 0 : 2, ygap: big ? 0 : 2,
        customdata: values.map((line, i) => line.map((value, j) =>
          `${plain(rows[i])}<br>${plain(columns[j])}<br><b>${told(value)}</b>`)),
        hovertemplate: "%{customdata}<extra></extra>",
        colorbar: { title: { text: title, side: "right" }, tickformat: scale.share ? ".0%" : ".0f", thickness: 12, outlinewidth: 0 },
      }],
      xaxis: { ...ticks(columns), side: "top", tickangle: -45, showgrid: false, zeroline: false },
      yaxis: { ...ticks(rows), autorange: "reversed", showgrid: false, zeroline: false },
      height: Math.max(300, Math.min(1000, 170 + cell * rows.length)),
    }));
  }

  /** Fill a table: `head` of texts, `rows` of lists; the first of each row is its heading. */
  function table(element, caption, head, rows) {
    const make = (kind, text, attributes = {}) => {
      const cell = document.createElement(kind);
      cell.textContent = text;
      for (const [name, value] of Object.entries(attributes)) cell.setAttribute(name, value);
      return cell;
    };
    const line = document.createElement("tr");
    head.forEach((text, i) => line.append(make("th", text, { scope: "col", class: i ? "num" : "" })));
    const thead = document.createElement("thead");
    thead.append(line);
    const body = document.createElement("tbody");
    for (const [name, ...cells] of rows) {
      const row = document.createElement("tr");
      row.append(make("th", name, { scope: "row" }), ...cells.map((text) => make("td", text, { class: "num" })));
      body.append(row);
    }
    element.replaceChildren(make("caption", caption, { class: "unseen" }), thead, body);
  }

  function fill(select, names) {
    select.replaceChildren(...names.map((name, i) => new Option(name, i)));
  }

  return { percent, step, draw, heatMap, table, fill, plain, short };
})();
