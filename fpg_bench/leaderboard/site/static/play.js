/* A visitor's round: the rules of game_rules.js, a rival, and the panels of the replay, which grow step by step. */
"use strict";
(() => {
  const { rules, scenario, agents, scales } = window.fpgData;
  const byId = (id) => document.getElementById(id);
  const FIELDS = ["ally", "opponent", "frequency", "known", "age", "type", "centre", "distance", "snr", "clean_snr", "spreading", "hopped", "covered", "check", "ally_reward", "opponent_reward"];
  const view = { time: 0, dirty: true };
  let game = null, rivals = {}, human = "ally", path, steps, shown, colours = fpgPen.readColours(), timer = null, total = 0, policies = {};

  const scene = {
    view, scenario, last: rules.steps, now: () => Math.floor(view.time), outage: (k) => shown.snr[k] < scenario.threshold_db,
    timeSpan: () => [Math.max(0, Math.min(rules.steps, Math.max(90, view.time + 10)) - 90), Math.min(rules.steps, Math.max(90, view.time + 10))],
    get steps() { return shown; }, get round() { return { waypoints: null }; }, get colours() { return colours; },
  };
  const arena = fpgArena(scene, byId("arena"));
  const times = fpgTimes(scene, { spectrum: byId("spectrum"), snr: byId("snr"), distance: byId("distance") });

  /* ---- rivals ---- */

  /** Fill a choice of a side's players: submitted entries, trained ones of the zoo, scripts. */
  function list(select, side) {
    const group = (label, options) => {
      const element = document.createElement("optgroup");
      element.label = label;
      element.append(...options);
      return element;
    };
    const trained = (wanted) => agents.filter((one) => one.side === side && one.kind === wanted).map(({ name, file }) => new Option(name, `agent:${file}`));
    const groups = [["Submitted", trained("submitted")], ["Zoo", trained("zoo")], ["Scripts", fpgScripts.NAMES[side].map((name) => new Option(name, `script:${name}`))]];
    select.replaceChildren(...groups.filter(([, options]) => options.length).map(([label, options]) => group(label, options)));
    select.value = [...select.options].find(({ text }) => text.includes("champion"))?.value ?? select.options[0].value;
  }

  function listRivals() {
    const side = byId("side").value;
    list(byId("rival"), side === "opponent" ? "ally" : "opponent");
    list(byId("first"), "ally");
    byId("second").hidden = side !== "nobody";
    byId("as-ally").hidden = side !== "ally";
    byId("as-opponent").hidden = side !== "opponent";
  }

  // Called by a policy's script.
  window.fpgAgent = (file, policy) => (policies[file] = policy);

  /** The rival's policy; a script of its own, loaded when it is chosen. */
  function fetched(file) {
    if (policies[file]) return Promise.resolve(policies[file]);
    return new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = file;
      script.addEventListener("load", () => done(policies[file]));
      script.addEventListener("error", failed);
      document.head.append(script);
    });
  }

  async function begin(event) {
    event?.preventDefault();
    run(false);
    human = byId("side").value;
    const chosen = { ally: byId(human === "nobody" ? "first" : "rival").value, opponent: byId("rival").value };
    const others = human === "nobody" ? ["ally", "opponent"] : [human === "ally" ? "opponent" : "ally"];
    const asked = human === "nobody" ? new URLSearchParams(location.hash.slice(1)).get("path") : null;
    path = asked ?? (human === "opponent" || agents.find(({ file }) => `agent:${file}` === chosen.opponent)?.flies ? "learned" : "pursuit");
    const named = Object.fromEntries(others.map((side) => [side, chosen[side].split(/:(.*)/s)]));
    const loaded = await Promise.all(others.map((side) => (named[side][0] === "agent" ? fetched(named[side][1]) : null)));
    game = fpgRules.begin(rules, Math.max(0, Math.trunc(Number(byId("seed").value)) || 0), path);
    rivals = Object.fromEntries(others.map((side, k) => [side, loaded[k] ? fpgPolicy.make(loaded[k]) : fpgScripts.make(side, named[side][1], rules, game.key)]));
    steps = Object.fromEntries(FIELDS.map((field) => [field, []]));
    shown = Object.fromEntries(FIELDS.map((field) => [field, []]));
    total = 0;
    keep();
    for (const id of ["run", "one"]) byId(id).disabled = false;
    byId("event").textContent = "The round begins.";
    draw();
  }

  /* ---- a step ---- */

  const pointMhz = (point) => fpgRules.pointMhz(point, rules);

  function allyAction() {
    const chosen = byId("point").value, expert = chosen === "expert";
    const preference = expert ? 0 : (2 * Number(chosen)) / (rules.points - 1) - 1;
    return [byId("hop").checked ? 1 : -1, byId("spread").checked ? 1 : -1, Number(byId("speed").value), preference, expert ? 1 : -1, 0, 0, 0, 0];
  }

  function opponentAction() {
    const away = game.ally.map((x, axis) => x - game.opponent[axis]), metres = Math.max(10, Math.hypot(...away));
    const course = byId("course").value === "after" ? away.map((x) => x / metres) : byId("course").value.split(",").map(Number);
    return [...[0, 1, 2, 3].map((kind) => (kind === Number(byId("type").value) ? 1 : -1)), Number(byId("tuning").value), -1, ...course];
  }

  function next() {
    if (!game || game.over) return;
    fpgRules.step(game, human === "ally" ? allyAction() : rivals.ally(game.allySees), human === "opponent" ? opponentAction() : rivals.opponent(game.opponentSees));
    byId("hop").checked = false; // it is for one second
    total += human === "opponent" ? game.opponentReward : game.allyReward;
    keep();
    tell();
    draw();
    if (game.over) finish();
  }

  /** Add the present step; a side is shown what it may know, the other's secrets are left out. */
  function keep() {
    const now = {
      ally: game.ally, opponent: game.opponent, frequency: game.frequency, known: game.known, age: game.age, type: game.type, centre: game.centre,
      distance: game.distance, snr: game.snr, clean_snr: game.cleanSnr, spreading: game.spreadingS, hopped: Number(game.hopped), covered: Number(game.covered),
      check: game.checked ? game.lastCheck : 0, ally_reward: game.allyReward, opponent_reward: game.opponentReward,
    };
    const heard = now.check === 1 || !game.step;
    const secret = human === "nobody" ? {} : human === "ally" ? { known: NaN, check: 0 }
      : { frequency: heard ? now.frequency : NaN, spreading: 0, hopped: 0 };
    for (const field of FIELDS) {
      steps[field].push(now[field]);
      shown[field].push(field in secret ? secret[field] : now[field]);
    }
    view.time = game.step;
  }

  /* ---- messages ---- */

  function tell() {
    const kinds = human === "nobody" ? ["found", "hopped", "spread", "jammed", "back", "near", "herded"] : human === "ally" ? ["hopped", "spread", "jammed", "back", "near", "herded"] : ["found", "jammed", "back", "near", "herded"];
    const event = fpgEvents({ steps }, scenario).findLast(({ kind }) => kinds.includes(kind));
    const text = event ? `${event.step} s: ${event.text}` : "";
    if (text && byId("event").textContent !== text) byId("event").textContent = text;
  }

  function score() {
    const scale = scales[human === "opponent" ? path : "ally"];
    const earned = total / Math.max(1, game.step);
    return [earned, scale ? (100 * (earned - scale.zero)) / (scale.top - scale.zero) : null];
  }

  const written = (value, digits) => value.toFixed(digits).replace("-", "−");

  function finish() {
    run(false);
    const [earned, points] = score();
    byId("event").textContent = `The round is over: ${human === "nobody" ? "the ally earned " : ""}${written(earned, 2)} per step${points === null ? "" : `, a score of ${written(points, 1)}; 0 is random play`}.`;
    for (const id of ["run", "one"]) byId(id).disabled = true;
  }

  function draw() {
    if (!game) return;
    const [earned, points] = score();
    byId("clock").textContent = `${game.step} / ${rules.steps}`;
    byId("earned").textContent = game.step ? written(earned, 2) : "–";
    byId("score").textContent = game.step && points !== null ? written(points, 1) : "–";
    byId("knowledge").textContent = human === "nobody" ? "all" : human === "ally" ? `you are at ${game.frequency.toFixed(1)} MHz` : `heard ${game.age} s ago at ${game.known.toFixed(1)} MHz`;
    hint();
    arena.draw();
    times.draw();
  }

  /** The knowledge base's advice for the ally. */
  function hint() {
    if (human !== "ally") return;
    const points = fpgKnowledge.advice(game, rules);
    byId("hint").textContent = points.length
      ? `The knowledge base would hop to one of ${points.map((point) => pointMhz(point).toFixed(0)).join(", ")} MHz.` : "The knowledge base would stay.";
  }

  function run(on) {
    clearInterval(timer);
    timer = on ? setInterval(next, 1000 / Number(byId("pace").value)) : null;
    byId("run").textContent = on ? "❚❚ pause" : "▶ run";
  }

  /* ---- hands and keys ---- */

  const flip = (id) => (byId(id).checked = !byId(id).checked);
  const KEYS = { h: () => flip("hop"), s: () => flip("spread"), n: next };

  byId("point").add(new Option("where the knowledge base says", "expert"));
  for (let point = 0; point < rules.points; point++) byId("point").add(new Option(`${pointMhz(point).toFixed(1)} MHz`, point));
  byId("side").addEventListener("change", listRivals);
  byId("setup").addEventListener("submit", begin);
  byId("one").addEventListener("click", next);
  byId("run").addEventListener("click", () => run(timer === null));
  byId("pace").addEventListener("change", () => run(timer !== null));
  byId("tuning").addEventListener("input", () => (byId("offset").textContent = `${Math.round(Number(byId("tuning").value) * rules.tuning_span)} MHz`));
  document.addEventListener("keydown", (event) => {
    if (!KEYS[event.key] || event.ctrlKey || event.metaKey || event.altKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName) || event.target.type === "number") return;
    KEYS[event.key]();
  });
  const recolour = () => {
    colours = fpgPen.readColours();
    draw();
  };
  new MutationObserver(recolour).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  new ResizeObserver(() => draw()).observe(document.querySelector(".plots"));
  /** A round of two players that the address asks for, as cross-play does. */
  function asked() {
    const address = new URLSearchParams(location.hash.slice(1));
    if (address.get("side") !== "nobody") return;
    byId("side").value = "nobody";
    listRivals();
    byId("first").value = address.get("ally");
    byId("rival").value = address.get("opponent");
    if (byId("first").value && byId("rival").value) begin().then(() => run(true));
  }

  listRivals();
  asked();
})();
