/** The player of replays, in the markup of replay_player.html.
 *  root: the element that holds that markup; keys: the element whose key presses steer it. */
function fpgReplay(root, keys) {
  "use strict";
  const byId = (id) => root.querySelector("#replay-" + id);
  const view = { round: 0, time: 0, playing: false, dirty: true };
  const REST_MS = 3000; // that a loop stays at its end
  let data, scenario, round, steps, last, totals, colours, events, loop = null; // loop: the step it begins with

  /* ---- what is shown ---- */

  function chooseRound(index) {
    view.round = index;
    round = data.rounds[index];
    steps = round.steps;
    last = steps.snr.length - 1;
    totals = {};
    for (const side of ["ally", "opponent"]) {
      let sum = 0;
      totals[side] = steps[side + "_reward"].map((reward) => (sum += reward));
    }
    byId("subtitle").textContent =
      `seed ${round.seed}, match ${round.match}, round ${round.round}, opponent's path: ${round.path}`;
    byId("step").max = last;
    byId("rounds").value = index;
    for (const [place, button] of [...byId("match").querySelectorAll("button")].entries()) button.setAttribute("aria-pressed", place === index);
    buildStory();
    goTo(events.find(({ step }) => step >= last / 3)?.step ?? 0, true);
  }

  const now = () => Math.min(last, Math.floor(view.time + 1e-9));

  /** Go to a step; `opening`: a moment to begin with, from which nothing has been played yet. */
  function goTo(time, opening = false) {
    view.opening = opening;
    view.time = Math.max(0, Math.min(last, time));
    view.dirty = true;
    if (!view.playing) told();
  }

  /** Let the page know where the player rests: it may keep that in its address. */
  function told() {
    root.dispatchEvent(new CustomEvent("fpg-rest", { detail: { round: view.round, step: view.opening ? 0 : now() } }));
  }

  function play(on) {
    if (on && (view.opening || view.time >= last)) goTo(0);
    view.playing = on;
    byId("play").textContent = on ? "❚❚ pause" : "▶ play";
    if (!on) told();
  }

  /** [first, last] step of the time axis. */
  function timeSpan() {
    const wanted = Number(byId("span").value);
    if (!wanted || wanted >= last) return [0, last];
    const from = Math.max(0, Math.min(last - wanted, view.time - wanted * 0.75));
    return [from, from + wanted];
  }

  /* ---- figures ---- */

  const FIGURES = [ // name, style, text, room in characters
    ["step, s", "", (k) => `${k} / ${last}`, 9],
    ["ally's reward", "ally", (k) => signed(totals.ally[k], 0) + "  (" + signed(steps.ally_reward[k], 1) + ")", 15],
    ["opponent's reward", "opponent", (k) => signed(totals.opponent[k], 0) + "  (" + signed(steps.opponent_reward[k], 1) + ")", 15],
    ["link", "link", (k) => `${steps.snr[k].toFixed(1)} dB ${outage(k) ? "outage" : "up"}`, 15],
    ["ally", "ally", (k) => `${steps.frequency[k].toFixed(1)} MHz` + (steps.spreading[k] ? `, spread ${steps.spreading[k]} s` : ""), 22],
    ["jamming", "opponent", (k) => steps.type[k] < 0 ? "none yet" : `${scenario.jamming[steps.type[k]].name} ${steps.centre[k].toFixed(1)} MHz`, 21],
    ["known to the opponent", "", (k) => `${steps.known[k].toFixed(1)} MHz, ${steps.age[k]} s old`, 20],
    ["distance", "", (k) => `${steps.distance[k].toFixed(0)} m`, 8],
  ];
  const signed = (value, digits) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(digits);
  const outage = (k) => steps.snr[k] < scenario.threshold_db;

  function buildFigures() {
    for (const [name, style, , room] of FIGURES) {
      const box = document.createElement("div");
      box.style.flex = `1 0 ${room}ch`;
      const term = box.appendChild(document.createElement("dt"));
      const value = box.appendChild(document.createElement("dd"));
      term.textContent = name;
      if (style && style !== "link") value.className = style;
      byId("figures").append(box);
    }
  }

  function showFigures() {
    const k = now();
    byId("figures").querySelectorAll("dd").forEach((value, i) => {
      value.textContent = FIGURES[i][2](k);
      if (FIGURES[i][1] === "link") value.className = outage(k) ? "out" : "";
    });
    byId("step").value = k;
  }

  /* ---- what happens, in words ---- */

  /** Marks on the slider, and a list from which one goes to an event. */
  function buildStory() {
    events = fpgEvents(round, scenario);
    const marks = events.map(({ step, kind }) => {
      const mark = document.createElement("i");
      mark.className = kind;
      mark.style.left = `${(100 * step) / last}%`;
      return mark;
    });
    const items = events.map(({ step, text }) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = `${step} s: ${text}`;
      button.addEventListener("click", () => goTo(step));
      const item = document.createElement("li");
      item.append(button);
      return item;
    });
    byId("marks").replaceChildren(...marks);
    byId("story").querySelector("ol").replaceChildren(...items);
    byId("story").querySelector("summary").textContent = `the round in words: ${events.length} events`;
  }

  /** Say the last event and mark all that have happened; those to come are not told. */
  function showStory() {
    const k = now();
    [...byId("marks").children].forEach((mark, i) => (mark.hidden = events[i].step > k));
    const told = events.findLast((event) => event.step <= k);
    const text = k === last ? closing() : told ? `${told.step} s: ${told.text}` : "Nothing has happened yet";
    if (byId("event").textContent !== text) byId("event").textContent = text;
  }

  function closing() {
    const [ally, opponent] = ["ally", "opponent"].map((side) => signed(totals[side][last] / last, 2));
    const broken = steps.snr.slice(1).filter((level) => level < scenario.threshold_db).length / last;
    return `The end: ally ${ally} per step, opponent ${opponent}; link broken ${(100 * broken).toFixed(0)} % of the time`;
  }

  /* ---- drawing, and the way to it ---- */

  function draw() {
    if (!data) return;
    showFigures();
    showStory();
    arena.draw();
    times.draw();
  }

  let before = 0;
  function tick(time) {
    if (view.playing) {
      goTo(view.time + (Math.min(100, time - before) / 1000) * Number(byId("speed").value));
      if (view.time >= last) ended();
    }
    before = time;
    if (data && view.dirty) {
      view.dirty = false;
      draw();
    }
    requestAnimationFrame(tick);
  }

  function ended() {
    play(false);
    if (loop !== null) setTimeout(() => { goTo(loop); play(true); }, REST_MS);
  }

  /** Show the replay as an address asks, such as `#embed&play&loop&from=40`: alone, at once, again and again, from a step. */
  function follow(address) {
    const from = Number(address.get("from") ?? address.get("step")) || 0;
    document.documentElement.classList.toggle("embed", address.has("embed"));
    loop = address.has("loop") ? from : null;
    if (from) goTo(from);
    if (address.has("play")) play(true);
  }

  function recolour() {
    colours = fpgPen.readColours();
    view.dirty = true;
  }

  /** Show the rounds of what `replay_data` gives. */
  function show(shown) {
    data = shown;
    scenario = data.scenario;
    byId("title").textContent = data.title;
    byId("rounds").replaceChildren();
    data.rounds.forEach((one, index) => {
      const status = one.status ? `, ${one.status}` : "";
      byId("rounds").add(new Option(`seed ${one.seed}, match ${one.match}, round ${one.round}${status}`, index));
    });
    byId("rounds").hidden = data.rounds.length < 2;
    showMatch();
    play(false);
    chooseRound(0);
  }

  /** What the opponent earned in each round of a match, as bars that choose the round. */
  function showMatch() {
    const sums = data.rounds.map((one) => one.steps.opponent_reward.reduce((sum, reward) => sum + reward, 0) / (one.steps.snr.length - 1));
    const most = Math.max(...sums.map(Math.abs), 1e-9);
    byId("match").hidden = sums.length < 2;
    byId("match").querySelector("div").replaceChildren(...sums.map((sum, index) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(document.createElement("i"), String(index + 1));
      button.firstChild.style.height = `${(34 * Math.abs(sum)) / most}px`;
      button.setAttribute("aria-label", `round ${index + 1}: the opponent earns ${sum.toFixed(1)} a step`);
      button.addEventListener("click", () => chooseRound(index));
      return button;
    }));
  }

  const scene = {
    view, now, outage, timeSpan,
    get scenario() { return scenario; }, get round() { return round; }, get steps() { return steps; },
    get last() { return last; }, get colours() { return colours; },
  };
  const arena = fpgArena(scene, byId("arena"));
  const times = fpgTimes(scene, { spectrum: byId("spectrum"), snr: byId("snr"), distance: byId("distance") });
  buildFigures();
  recolour();
  fpgHands({ root, keys, byId, scene, arena, times, goTo, play, chooseRound });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  new MutationObserver(recolour).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  new ResizeObserver(draw).observe(root.querySelector(".plots"));
  requestAnimationFrame(tick);
  root.fpgLabels = arena.labels; // where the arena's texts stand
  return { show, goTo, play, follow };
}
