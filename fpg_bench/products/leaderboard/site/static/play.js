/* A visitor's round: the rules of game_rules.js, a rival, and the panels of the replay, which grow step by step.
   A side is shown what its 15 numbers hold (game_sight.js); the truth and the score of others come at the end. */
"use strict";
(() => {
  const { games, agents } = window.fpgData;
  const { load } = fpgPlayers;
  const byId = (id) => document.getElementById(id);
  const view = { time: 0, dirty: true };
  const other = { ally: "opponent", opponent: "ally" };
  let rules, scenario, scales; // of the game that is chosen
  let game = null, round, players, human = "ally", truth, shown, colours = fpgPen.readColours(), timer = null, replay = null;

  const scene = {
    view, get scenario() { return scenario; }, now: () => Math.floor(view.time), outage: (k) => shown.snr[k] < scenario.threshold_db,
    timeSpan: () => {
      const end = Math.min(scene.last, Math.max(90, view.time + 10));
      return [Math.max(0, end - 90), end];
    },
    get last() { return game.rules.steps; }, get steps() { return shown; }, get round() { return { waypoints: null }; }, get colours() { return colours; },
  };
  const arena = fpgArena(scene, byId("arena"));
  const times = fpgTimes(scene, { spectrum: byId("spectrum"), snr: byId("snr"), distance: byId("distance") });
  // The leader's own round on the same seed, step by step beside the visitor's; null without a race.
  let race = null;
  const raceTimes = fpgTimes({
    view, get scenario() { return scenario; }, now: scene.now, timeSpan: scene.timeSpan, outage: (k) => race.shown.snr[k] < scenario.threshold_db,
    get steps() { return race.shown; }, get colours() { return colours; },
  }, { spectrum: byId("race-spectrum") });
  const written = (value, digits) => value.toFixed(digits).replace(/^-(0(\.0+)?)$/, "$1").replace("-", "−");
  const pointMhz = (point) => fpgRules.pointMhz(point, rules);

  const leaderOf = (side) => fpgPlayers.leaderOf(side, byId("game").value);

  /** Take the rules of the game that is chosen; in `link` a visitor flies as its scripts do, at half speed. */
  function chooseGame() {
    ({ rules, scenario, scales } = games[byId("game").value]);
    byId("type").replaceChildren(...rules.types.map((name, kind) => new Option(name, kind)));
    const points = Array.from({ length: rules.points }, (_, point) => new Option(`${pointMhz(point).toFixed(1)} MHz`, point));
    byId("point").replaceChildren(new Option("where the knowledge base says", "expert"), ...points);
    byId("speed").value = rules.radio ? 0 : 1;
    listRivals();
  }

  /* ---- players ---- */

  /** Fill a choice of a side's players: submitted entries, trained ones of the zoo, scripts. */
  function list(select, side) {
    const group = (label, options) => {
      const element = document.createElement("optgroup");
      element.label = label;
      element.append(...options);
      return element;
    };
    const trained = (wanted) => agents.filter((one) => one.side === side && one.kind === wanted && one.game === byId("game").value).map(({ name, file }) => new Option(name, `agent:${file}`));
    const groups = [["Submitted", trained("submitted")], ["Zoo", trained("zoo")], ["Scripts", fpgScripts.NAMES[side].map((name) => new Option(name, `script:${name}`))]];
    select.replaceChildren(...groups.filter(([, options]) => options.length).map(([label, options]) => group(label, options)));
    select.value = leaderOf(side) ?? select.options[0].value;
  }

  function listRivals() {
    const side = byId("side").value;
    list(byId("rival"), side === "opponent" ? "ally" : "opponent");
    list(byId("first"), "ally");
    byId("second").hidden = side !== "nobody";
    byId("racing").hidden = side === "nobody" || !leaderOf(side);
    for (const element of document.querySelectorAll("[data-side]")) element.hidden = side === "nobody" ? element.tagName !== "SPAN" : element.dataset.side !== side;
  }

  const seat = (makers, key) => Object.fromEntries(Object.entries(makers).map(([side, make]) => [side, make(side, key, rules)]));
  const start = () => fpgRules.begin({ ...rules, steps: round.seconds }, round.seed, round.path);
  const earnedBy = (one, side) => (side === "opponent" ? one.opponentReward : one.allyReward);

  /** The mean reward of another player in the visitor's place, on the same seed. */
  async function inPlace(make) {
    const one = start(), both = seat({ ...round.makers, [human]: make }, one.key);
    let sum = 0;
    while (!one.over) {
      fpgRules.step(one, ...(await actions(one, both)));
      sum += earnedBy(one, human);
    }
    return sum / round.seconds;
  }

  /* ---- a round ---- */

  /** Begin a round; a page without a wish shows one that waits. */
  async function begin(isWanted = true) {
    run(false);
    human = byId("side").value;
    const choices = { ally: byId(human === "nobody" ? "first" : "rival").value, opponent: byId("rival").value };
    delete choices[human];
    const flies = agents.find(({ file }) => `agent:${file}` === choices.opponent)?.flies;
    const asked = human === "nobody" ? address().get("path") : null;
    const makers = {};
    for (const side of Object.keys(choices)) makers[side] = await load(choices[side]);
    round = {
      makers, choices, seed: Math.max(0, Math.trunc(Number(byId("seed").value)) || 0), seconds: Number(byId("seconds").value),
      path: asked ?? (human === "opponent" || flies ? "learned" : "pursuit"), total: 0,
    };
    const raced = await entered();
    game = start();
    players = seat(makers, game.key);
    [truth, shown, race] = [fpgSight.empty(), fpgSight.empty(), raced];
    if (race) noteRace();
    for (const id of ["end", "back"]) byId(id).hidden = true;
    byId("hands").hidden = false;
    byId("leader").hidden = document.querySelector(".rival").hidden = race === null;
    byId("arena").parentElement.hidden = race !== null;
    byId("goal").textContent = GOALS[human](scoreToBeat());
    byId("snr").parentElement.hidden = human === "opponent";
    press("hop", false);
    press("spread", false);
    byId("event").textContent = isWanted ? "The round begins." : "A round against the opponents' leader waits: run it, or choose another.";
    keep();
    draw();
    if (!isWanted) return;
    keepAddress(asked);
    document.querySelector(".play").scrollIntoView();
  }

  /** A second round with the leader in the visitor's place; null if no race is wanted, or can be. */
  async function entered() {
    const leader = byId("race").checked && human !== "nobody" ? leaderOf(human) : undefined;
    if (!leader) return null;
    const make = await load(leader), one = start();
    return { game: one, players: seat({ ...round.makers, [human]: make }, one.key), shown: fpgSight.empty(), total: 0 };
  }

  function noteRace() {
    fpgSight.add(race.shown, fpgSight.seen(race.game, human));
  }

  async function goRace() {
    const { game: one, players: both } = race;
    fpgRules.step(one, ...(await actions(one, both)));
    race.total += earnedBy(one, human);
    noteRace();
  }

  /** What both sides do in a game; a policy answers in time, or a script at once. */
  const actions = (one, both) => Promise.all([both.ally(one.allySees), both.opponent(one.opponentSees)]);

  let busy = false; // with a second of the round

  async function next() {
    if (!game || game.over || busy) return;
    const now = round;
    busy = true;
    try {
      if (race) await goRace();
      const both = await actions(game, { ...players, ...(human === "ally" && { ally: allyAction }), ...(human === "opponent" && { opponent: opponentAction }) });
      if (now === round) go(both);
    } catch (error) {
      run(false);
      byId("event").textContent = error.message;
    } finally {
      busy = false;
    }
  }

  /** Play a second of the round. */
  function go(both) {
    fpgRules.step(game, ...both);
    press("hop", false); // it is for one second
    round.total += earnedBy(game, human);
    keep();
    tell();
    if (game.over) finish();
    draw();
  }

  function keep() {
    fpgSight.add(truth, fpgSight.truth(game));
    fpgSight.add(shown, fpgSight.seen(game, human));
    view.time = game.step;
  }

  function tell() {
    const event = fpgEvents({ steps: shown }, scenario).at(-1);
    const text = event ? `${event.step} s: ${event.text}` : "";
    if (text && byId("event").textContent !== text) byId("event").textContent = text;
  }

  /** A mean reward on the board's scale, as a number; null where the board has no such table. */
  function score(earned) {
    const scale = scales[human === "opponent" ? round.path : "ally"];
    return scale ? (100 * (earned - scale.zero)) / (scale.top - scale.zero) : null;
  }

  function draw() {
    if (!game) return;
    const hidden = human === "opponent" && !game.over, begun = game.step && !hidden;
    const earned = round.total / Math.max(1, game.step), points = score(earned);
    byId("clock").textContent = `${game.step} / ${round.seconds}`;
    byId("earned").textContent = begun ? written(earned, 2) : hidden ? "at the end" : "–";
    byId("score").textContent = begun && points !== null ? written(points, 1) : hidden ? "at the end" : "–";
    byId("knowledge").textContent = KNOWN[human]();
    if (human === "ally") showCosts();
    times.draw();
    if (!race) return arena.draw();
    raceTimes.draw();
    byId("race-score").textContent = begun ? mean(race.total / game.step) : hidden ? "at the end" : "–";
  }

  const KNOWN = {
    nobody: () => "all",
    ally: () => {
      const k = game.step, type = shown.type[k];
      const sensed = type < 0 ? "no jamming sensed yet" : `${scenario.jamming[type].name} sensed at ${shown.centre[k].toFixed(1)} MHz`;
      return `${game.frequency.toFixed(1)} MHz is yours; ${sensed}`;
    },
    opponent: () => `heard ${game.age} s ago at ${game.known.toFixed(1)} MHz; next check in ${game.nextCheck - game.step} s`,
  };

  const GOALS = {
    ally: (beaten) => `Keep your link: get away from the jamming, but ${rules.radio ? "each hop and each change of the waveform takes a part of a second" : "each hop and each second of spreading costs points"}. ${beaten === null ? "A link that is never jammed has 100 points, random play 0." : `The score to beat is ${beaten}.`}`,
    opponent: (beaten) => `Break the ally's link: jam the frequency that it uses, and stay near. ${beaten === null ? "You see your score at the end." : `The score to beat is ${beaten}.`}`,
    nobody: () => "",
  };

  /** What an amount of reward is worth in this round's score; null where the board has no such table. */
  const worth = (reward) => (scales.ally ? (100 * reward) / round.seconds / (scales.ally.top - scales.ally.zero) : null);

  function showCosts() {
    const cost = fpgRules.spreadCost(game.spreadingS + 1, rules), { radio } = rules;
    byId("costs").textContent = radio ? `a hop ${radio.hop_airtime} s of the link` : `a hop ${rules.hop_cost}; spreading now ${written(cost, 1)} a second`;
    const [hop, spread] = [rules.hop_cost, cost].map(worth).map((lost) => (radio || lost === null ? "" : `, −${lost.toFixed(lost < 0.095 ? 2 : 1)} points`));
    const [h, s] = matchMedia("(hover: hover)").matches && byId("keys").checked ? [" (h)", " (s)"] : ["", ""];
    byId("hop").textContent = `Hop${h}${hop}`;
    byId("spread").textContent = `Spread${s}${spread}`;
    if (!game.over) showLink();
  }

  /** What the ally knows of its link; which move is best depends on the rival, and no script's advice held against all. */
  function showLink() {
    const snr = `${written(game.snr, 0)} dB`;
    byId("hint").textContent = game.allySees[14] > 0 ? `Jamming covers you: your link has ${snr}.` : `Your link has ${snr}.`;
  }

  /* ---- the end ---- */

  async function finish() {
    run(false);
    shown = truth;
    byId("snr").parentElement.hidden = false;
    const earned = round.total / round.seconds, points = score(earned);
    byId("event").textContent = `The round is over: ${human === "nobody" ? "the ally earned " : ""}${written(earned, 2)} per second${points === null ? "" : `, a score of ${written(points, 1)}; 0 is random play`}.`;
    byId("hands").hidden = true;
    byId("link").textContent = `${location.href.replace(/&beat=[^&]*/, "")}${points === null || human === "nobody" ? "" : `&beat=${written(points, 0)}`}`;
    byId("end").hidden = false;
    document.querySelector(".play").scrollIntoView();
    const name = human === "nobody" ? "The ally" : "You";
    byId("result").textContent = `${name} ${mean(earned)}`;
    byId("result").focus();
    if (human !== "nobody") byId("result").textContent = await compared(name, earned);
  }

  const mean = (earned) => (score(earned) === null ? `${written(earned, 2)} per second` : written(score(earned), 0));

  /** The visitor beside the leader of the side and random play, all on this seed. */
  async function compared(name, earned) {
    const now = round, leader = leaderOf(human);
    const rows = [[name, earned], ["random", await inPlace(await load("script:random"))]];
    if (leader) rows.splice(1, 0, ["the leader", await inPlace(await load(leader))]);
    if (now !== round) return byId("result").textContent;
    const said = rows.map(([who, value]) => `${who} ${mean(value)}`).join(", ");
    byId("link").textContent = `${said.replace(/^You/, "I")}. Beat me: ${byId("link").textContent}`;
    return said;
  }

  /** The round as a replay, with everything that happened. */
  function watch() {
    replay ??= fpgReplay(byId("replay"), byId("replay"));
    byId("back").hidden = false;
    const name = (side) => (side === human ? "you" : round.choices[side].split(":")[1].split("/").at(-1).replace(".js", ""));
    replay.show({
      title: `${name("ally")} against ${name("opponent")}`, ally: name("ally"), opponent: name("opponent"), scenario,
      rounds: [{ seed: String(round.seed), match: 0, round: 0, path: round.path, waypoints: null, steps: truth }],
    });
    replay.play(true);
    byId("back").scrollIntoView();
  }

  /* ---- hands and keys ---- */

  const pressed = (id) => byId(id).getAttribute("aria-pressed") === "true";
  const press = (id, on) => byId(id).setAttribute("aria-pressed", on);
  const flip = (id) => press(id, !pressed(id));

  function allyAction() {
    const chosen = byId("point").value, expert = chosen === "expert";
    const preference = expert ? 0 : (2 * Number(chosen)) / (rules.points - 1) - 1;
    return [pressed("hop") ? 1 : -1, pressed("spread") ? 1 : -1, Number(byId("speed").value), preference, expert ? 1 : -1, ...rules.types.map(() => 0)];
  }

  function opponentAction() {
    const away = game.ally.map((x, axis) => x - game.opponent[axis]), metres = Math.max(10, Math.hypot(...away));
    const course = byId("course").value === "after" ? away.map((x) => x / metres) : byId("course").value.split(",").map(Number);
    return [...rules.types.map((_, kind) => (kind === Number(byId("type").value) ? 1 : -1)), Number(byId("tuning").value), -1, ...course];
  }

  function run(on) {
    clearInterval(timer);
    timer = on ? setInterval(next, 1000 / Number(byId("pace").value)) : null;
    byId("run").textContent = on ? "❚❚ pause" : "▶ run";
  }

  function again(seed) {
    byId("seed").value = seed;
    begin().then(goOn);
  }

  /** Let the round run; whoever came by the keyboard has the focus on what it plays with, and sees that. */
  function goOn() {
    run(true);
    if (byKeys) byId(human === "ally" ? "hop" : "run").focus({ preventScroll: true });
  }

  // Whether the keyboard was used last: a click needs no ring.
  let byKeys = false;
  for (const kind of ["keydown", "pointerdown"]) document.addEventListener(kind, () => (byKeys = kind === "keydown"), true);

  const KEYS = { h: () => human === "ally" && flip("hop"), s: () => human === "ally" && flip("spread"), n: next };
  document.addEventListener("keydown", (event) => {
    const busy = event.ctrlKey || event.metaKey || event.altKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName) || event.target.type === "number";
    if (KEYS[event.key] && byId("keys").checked && game && !busy) KEYS[event.key]();
  });

  byId("game").addEventListener("change", chooseGame);
  byId("side").addEventListener("change", listRivals);
  byId("setup").addEventListener("submit", (event) => {
    event.preventDefault();
    begin();
  });
  for (const id of ["hop", "spread"]) byId(id).addEventListener("click", () => flip(id));
  byId("one").addEventListener("click", next);
  byId("run").addEventListener("click", () => run(timer === null));
  byId("again").addEventListener("click", () => again(round.seed));
  byId("fresh").addEventListener("click", () => again(round.seed + 1));
  byId("watch").addEventListener("click", watch);
  byId("pace").addEventListener("change", () => run(timer !== null));
  byId("tuning").addEventListener("input", () => (byId("offset").textContent = `${Math.round(Number(byId("tuning").value) * rules.tuning_span)} MHz`));
  const recolour = () => {
    colours = fpgPen.readColours();
    draw();
  };
  new MutationObserver(recolour).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
  new ResizeObserver(() => draw()).observe(document.querySelector(".plots"));

  /* ---- the address keeps the round: side, players, seed, seconds ---- */

  function address() {
    return new URLSearchParams(location.hash.slice(1));
  }

  function keepAddress(path) {
    const content = { side: human, ...(byId("game").value !== "standard" && { game: byId("game").value }), ...round.choices, seed: round.seed, seconds: round.seconds, pace: byId("pace").value, ...(path && { path }) };
    if (document.documentElement.classList.contains("quick")) content.quick = "";
    if (byId("race").checked && human !== "nobody") content.race = "";
    const beaten = address().get("seed") === String(round.seed) ? scoreToBeat() : null;
    if (beaten !== null) content.beat = beaten;
    history.replaceState(null, "", `#${new URLSearchParams(content)}`);
  }

  /** The score in the address of somebody who shared the round; null if there is none. */
  function scoreToBeat() {
    const beaten = address().get("beat")?.replace("−", "-") ?? "";
    return /^-?\d{1,5}$/.test(beaten) ? Number(beaten) : null;
  }

  /** The day's seed, the same for everybody: days since 1970 in UTC. */
  const today = () => Math.floor(Date.now() / 86_400_000);

  /** Begin the round that the address asks for, or say in one line what it asks in vain; `quick`, and two players, start at once. */
  function asked() {
    const wanted = address(), side = wanted.get("side") ?? "ally", unknown = [];
    const choose = (id, name) => {
      const value = wanted.get(name);
      if ([...byId(id).options].some((option) => option.value === value)) byId(id).value = value;
      else if (value !== null) unknown.push(`${name} “${value.slice(0, 60)}”`);
    };
    choose("side", "side");
    choose("game", "game");
    chooseGame();
    if (side === "nobody") choose("first", "ally");
    choose("rival", other[side] ?? "opponent");
    for (const id of ["seconds", "pace"]) choose(id, id);
    const seed = wanted.get("seed") ?? byId("seed").value;
    if (/^\d{1,6}$/.test(seed) || seed === "today") byId("seed").value = seed === "today" ? today() : seed;
    else unknown.push(`seed “${seed.slice(0, 60)}”`);
    if (unknown.length) {
      byId("event").textContent = `This link does not work here: ${unknown.join(", ")} is unknown. Choose another, and begin a new round.`;
      return;
    }
    byId("race").checked = wanted.has("race");
    document.documentElement.classList.toggle("quick", wanted.has("quick"));
    begin(wanted.has("side")).then(() => (wanted.has("side") && (side === "nobody" || wanted.has("quick")) ? goOn() : run(false)));
  }

  addEventListener("hashchange", asked);
  chooseGame();
  asked();
})();
