/* A visitor's policy.onnx against the scripts, in the browser: scores on the board's scale, and its rounds to watch. */
"use strict";
(() => {
  const { games, form } = window.fpgData;
  const { percent, one: written, table, fill } = fpgCharts;
  const SEEDS = [1, 2, 3, 4, 5];
  const TABLES = {
    ally: { side: "ally", path: "pursuit", game: "standard", label: "an ally" },
    pursuit: { side: "opponent", path: "pursuit", game: "standard", label: "an opponent in pursuit" },
    learned: { side: "opponent", path: "learned", game: "standard", label: "an opponent that flies" },
    "ally-link": { side: "ally", path: "pursuit", game: "link", label: "an ally on a radio link" },
    "opponent-link": { side: "opponent", path: "pursuit", game: "link", label: "an opponent on a radio link" },
  };
  const byId = (id) => document.getElementById(id);
  /** What is played: the side, the path and the name of the game, and that game. */
  const chosen = () => ({ ...TABLES[byId("plays").value], ...games[TABLES[byId("plays").value].game] });
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const other = (side) => (side === "ally" ? "opponent" : "ally");
  const pause = () => new Promise((done) => setTimeout(done)); // so that the page answers, and the text is seen
  let file = null, turn = 0, rounds = [], player = null;

  /** Play a round of a policy against a script; the truth of each step as a replay has it. */
  async function play(make, rival, seed) {
    const { side, path, rules } = chosen();
    const game = fpgRules.begin(rules, seed, path), steps = fpgSight.empty();
    const script = fpgScripts.make(other(side), rival, rules, game.key), policy = make(side, game.key, rules);
    fpgSight.add(steps, fpgSight.truth(game));
    while (!game.over) {
      const mine = await policy(side === "ally" ? game.allySees : game.opponentSees);
      const theirs = script(side === "ally" ? game.opponentSees : game.allySees);
      fpgRules.step(game, ...(side === "ally" ? [mine, theirs] : [theirs, mine]));
      fpgSight.add(steps, fpgSight.truth(game));
    }
    return { rival, seed, path, steps, lost: policy.lost };
  }

  /** The measures of a round: its score, the share of time on jammed frequencies, and that in which this breaks the link. */
  function measured({ rival, seed, path, steps, lost }) {
    const { side, scales, scenario } = chosen(), scale = scales[side === "ally" ? side : path];
    const earned = mean(steps[`${side}_reward`].slice(1)), count = steps.snr.length - 1;
    const share = (happens) => steps.snr.filter((_, k) => k && happens(k)).length / count;
    return {
      rival, seed, path, lost, score: (100 * (earned - scale.zero)) / (scale.top - scale.zero), overlap: share((k) => steps.covered[k]),
      jammed: share((k) => steps.covered[k] && steps.snr[k] < scenario.threshold_db),
    };
  }

  /** All rounds of a policy, one after the other; null if another file was given meanwhile. */
  async function playAll(make, mine, say) {
    const rivals = fpgScripts.NAMES[other(chosen().side)], all = [];
    for (const rival of rivals) {
      for (const seed of SEEDS) {
        say(`${all.length} of ${rivals.length * SEEDS.length} rounds`);
        await pause();
        if (mine !== turn) return null;
        all.push(measured(await play(make, rival, seed)));
      }
    }
    const least = Math.min(form.lost, ...all.filter(({ lost }) => !lost).map(({ score: points }) => points));
    return all.map((round) => (round.lost ? { ...round, score: least } : round)); // as on the board
  }

  let ended = () => {}; // ends what plays now

  async function score() {
    const mine = ++turn, say = (text) => (byId("status").textContent = text);
    byId("scores").hidden = true;
    byId("file").textContent = file.name;
    try {
      ended();
      const make = await fpgPlayers.policyOf({ file: new Uint8Array(await file.arrayBuffer()) }), leader = fpgPlayers.leaderOf(chosen().side, chosen().game);
      const own = await playAll(make, mine, (done) => say(`${file.name}: ${done}`));
      const best = leader ? await fpgPlayers.load(leader).then((load) => playAll(load, mine, (done) => say(`The leader: ${done}`))) : [];
      if (mine !== turn) return make.end();
      ended = make.end;
      if (own && best) show(own.sort((a, b) => a.score - b.score), best, make);
    } catch (error) {
      if (mine === turn) say(error.message);
    }
  }

  function show(own, best, make) {
    rounds = own.map((round) => ({ ...round, make }));
    const lost = own.filter((round) => round.lost).length;
    const row = (name, of) => {
      const average = (list, key) => (list.length ? mean(list.map((round) => round[key])) : null), ours = own.filter(of);
      return [name, written(average(ours, "score")), percent(average(ours, "overlap")), percent(average(ours, "jammed")), written(average(best.filter(of), "score"))];
    };
    const scoreOf = (rival) => mean(own.filter((round) => round.rival === rival).map(({ score: points }) => points));
    const rivals = [...new Set(own.map(({ rival }) => rival))].sort((a, b) => scoreOf(a) - scoreOf(b));
    const rows = [row("all", () => true), ...rivals.map((rival) => row(rival, (round) => round.rival === rival))];
    table(byId("table"), `Scores of ${file.name}`, ["Rival", "Score", "Overlap ratio", "Jamming success rate", "Leader's score"], rows);
    byId("status").textContent = `${file.name}: an unofficial score of ${rows[0][1]} over ${own.length} rounds; worst against ${own[0].rival}, ${written(own[0].score)} on seed ${own[0].seed}.${lost ? ` It loses ${lost} of them by an answer that is no action.` : ""}`;
    fill(byId("round"), own.map(({ rival, seed, score: points }) => `${rival}, seed ${seed}: ${written(points)}`));
    byId("scores").hidden = false;
    watch();
  }

  async function watch() {
    const { make, rival, seed } = rounds[byId("round").value], { side, scenario } = chosen();
    const { path, steps } = await play(make, rival, seed), names = { [side]: file.name, [other(side)]: rival };
    player ??= fpgReplay(byId("replay"), byId("replay"));
    player.show({ title: `${names.ally} against ${names.opponent}`, ...names, scenario, rounds: [{ seed: String(seed), match: 0, round: 0, path, waypoints: null, steps }] });
  }

  function take(given) {
    if (!given) return;
    file = given;
    score();
  }

  const zone = byId("drop");
  for (const [key, { label, side, path, game }] of Object.entries(TABLES)) if (games[game].scales[side === "ally" ? side : path]) byId("plays").add(new Option(label, key));
  byId("plays").addEventListener("change", () => file && score());
  byId("policy").addEventListener("change", () => take(byId("policy").files[0]));
  byId("round").addEventListener("change", watch);
  for (const kind of ["dragover", "dragleave", "drop"]) {
    zone.addEventListener(kind, (event) => {
      event.preventDefault();
      zone.classList.toggle("over", kind === "dragover");
      if (kind === "drop") take(event.dataTransfer.files[0]);
    });
  }
})();
