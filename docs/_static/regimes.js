// A radio on the map of the regimes: what pays at the measured points around it, by the page's own tables.
{
  const [radios, map] = ["radio", "hop / dwell"].map((head) =>
    [...document.querySelectorAll("article table")].find((table) => table.rows[0].cells[0].textContent === head));
  const words = (row) => [...row.cells].map((cell) => cell.textContent.trim());
  const [head, ...rows] = [...map.rows].map(words);
  const points = rows.map((cells) => ({ at: cells.slice(0, 3).map(Number), cells }));
  const axes = [0, 1, 2].map((k) => [...new Set(points.map(({ at }) => at[k]))].sort((a, b) => a - b));
  const planes = [...axes[1].map((reaction) => [reaction, 3]), ...axes[2].filter((db) => db !== 3).map((db) => [4, db])];
  const [ABILITIES, LEAST] = [["hop", "spread", "speed", "knowledge"], 3]; // fewer percent of the value do not pay
  const form = document.querySelector("#radio");
  const [chosen, ...inputs] = form.querySelectorAll("select, input");

  const of = ({ cells }, column) => cells[head.indexOf(column)];
  const share = (point, ability) => parseInt(of(point, `${ability} %`));
  const decibels = (db) => `${db > 0 ? "+" : ""}${db} dB`;
  const called = ({ at: [hop, reaction, db] }) => `(${hop}, ${reaction}, ${decibels(db)})`;

  // Real radios of the first table whose hop time and reaction are numbers; letters mark them on the map.
  const real = [...radios.rows].slice(1).map((row) => {
    const [name, , hop, reaction] = words(row);
    const numbers = [hop.match(/^(?:at most )?([\d.]+)/)?.[1], reaction.match(/[\d.]+$/)?.[0]];
    return { name, letter: row.querySelector("strong")?.textContent ?? "·", at: numbers.map(Number) };
  }).filter(({ at }) => !at.some(Number.isNaN));

  // Where a value lies on an axis, in steps from its first mark; the ends stand for what lies beyond.
  function place(value, marks) {
    const next = marks.findIndex((mark) => mark >= value);
    return next < 1 ? (next && marks.length - 1) : next - (marks[next] - value) / (marks[next] - marks[next - 1]);
  }

  // Measured points less than a step away on each axis, nearest first; nothing between them is interpolated.
  function around(mine) {
    const steps = ({ at }) => at.map((value, k) => Math.abs(place(value, axes[k]) - place(mine[k], axes[k])));
    const far = new Map(points.map((point) => [point, steps(point).reduce((sum, step) => sum + step)]));
    return points.filter((point) => Math.max(...steps(point)) < 1).sort((a, b) => far.get(a) - far.get(b));
  }

  const [WIDE, HIGH] = [90, 44]; // of a cell
  const x = (step) => 70 + WIDE * step;
  const y = (step) => HIGH * step + (step > axes[1].length - 0.5 ? 64 : 34);
  const text = (kind, left, top, said) => `<text class="${kind}" x="${left}" y="${top}">${said}</text>`;

  function cell(point, near) {
    const best = share(point, "hop") < share(point, "spread") ? "spread" : "hop";
    const kind = `${share(point, best) < LEAST ? "" : best} ${near.includes(point) ? "near" : ""}`;
    const [left, top] = [x(axes[0].indexOf(point.at[0])), y(planes.findIndex((of) => of.join() === point.at.slice(1).join()))];
    return `<rect class="${kind}" x="${left}" y="${top}" width="${WIDE - 4}" height="${HIGH - 4}" rx="4"/>`
      + text("", left + 43, top + 17, of(point, "value").split(" ")[0]) + text("", left + 43, top + 33, `${best} ${share(point, best)} %`);
  }

  // A place in the plane of reactions, beside it if the map ends before.
  function spot([hop, reaction]) {
    const [hops, reactions] = axes;
    const beyond = (reaction > reactions.at(-1)) - (reaction < reactions[0]);
    return [x(place(hop, hops)) + (hop > hops.at(-1) ? 98 : 43), y(place(reaction, reactions)) + 20 + 34 * beyond];
  }

  function draw(mine, near) {
    const sides = planes.map(([reaction, db], k) => text("", 35, y(k) + 25, k < axes[1].length ? reaction : decibels(db)));
    const below = axes[0].map((hop, k) => text("", x(k) + 43, 350, hop));
    const letters = real.map(({ at, letter }) => text("mark", spot(at)[0], spot(at)[1] + 5, letter));
    const [left, top] = spot(mine);
    form.querySelector("svg").innerHTML = [...points.map((point) => cell(point, near)), ...sides, ...below, ...letters,
      text("", 35, 14, "reaction"), text("", 35, 228, "power"), text("", 250, 368, "hop time / dwell"),
      `<circle cx="${left}" cy="${top}" r="24"/>`].join("");
  }

  function answer() {
    const mine = inputs.map((input) => Number(input.value));
    const near = around(mine);
    const pays = ABILITIES.filter((ability) => share(near[0], ability) >= LEAST).sort((a, b) => share(near[0], b) - share(near[0], a));
    form.querySelector("output").textContent = [
      `What pays at the nearest point, ${called(near[0])}: ${pays.map((ability) => `${ability} ${of(near[0], `${ability} %`)} %`).join(", ") || "nothing"}.`,
      mine.some((value, k) => value < axes[k][0] || value > axes[k].at(-1)) ? "Your radio lies beyond the map." : "",
      mine[1] < 1 ? "Its jammer follows within the dwell: the map flatters the radio." : "",
    ].join(" ");
    form.querySelector("tbody").replaceChildren(...near.map((point) => {
      const row = document.createElement("tr");
      row.append(...[called(point), ...["value", "idle / free", ...ABILITIES.map((ability) => `${ability} %`)].map((column) => of(point, column))]
        .map((said) => Object.assign(document.createElement("td"), { textContent: said })));
      return row;
    }));
    draw(mine, near);
  }

  for (const { name } of real) chosen.add(new Option(name));
  chosen.addEventListener("input", () => {
    real[chosen.selectedIndex].at.forEach((value, k) => { inputs[k].value = value; });
    answer();
  });
  for (const input of inputs) {
    input.addEventListener("input", () => {
      chosen.selectedIndex = -1; // a radio of your own
      answer();
    });
  }
  answer();
}
