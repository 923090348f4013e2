/* Who plays on these pages: scripts, and policies, whose files are scripts to be loaded. A policy runs in a worker of its
   own, so that none can stop the page; its answers are promises. */
"use strict";
const fpgPlayers = (() => {
  const { games, form } = window.fpgData, policies = {}, workers = {};
  const ANSWER_MS = 2_000, ALL_MS = 120_000; // what an answer, and all of a policy's answers, may take

  /** In the worker: read a policy, then answer for its rounds, one message after the other. */
  function serve() {
    const rounds = new Map();
    let policy;
    onmessage = ({ data: { file, held, form: known, round, seen, noise } }) => {
      try {
        if (file || held) {
          policy = file ? fpgOnnx.read(file, known) : held;
          postMessage({ size: policy.noise ?? 0 });
          return;
        }
        if (!rounds.has(round)) rounds.set(round, fpgPolicy.make(policy));
        postMessage({ action: rounds.get(round)(seen, noise) });
      } catch (error) {
        postMessage({ error: error.constructor === Error ? error.message : `The policy's graph cannot be played: ${error.message}` });
      }
    };
  }

  /** Start a worker for { file } or { held }; gives `ask` for an answer and `end`. Its failure is an Error. */
  function started(policy) {
    const code = `"use strict"; const fpgPolicy = (${fpgPolicyCode})(), fpgOnnx = (${fpgOnnxCode})(); (${serve})();`;
    const address = URL.createObjectURL(new Blob([code], { type: "text/javascript" })), worker = new Worker(address), waiting = [];
    let left = ALL_MS, failure = null, timer, since;
    const end = (line) => {
      failure ??= new Error(line);
      clearTimeout(timer);
      worker.terminate();
      URL.revokeObjectURL(address);
      waiting.splice(0).forEach(({ reject }) => reject(failure));
    };
    const watch = () => {
      clearTimeout(timer);
      since = performance.now();
      if (waiting.length) timer = setTimeout(() => end("The policy takes too long to answer; on the board it would lose its rounds."), Math.min(ANSWER_MS, left));
    };
    worker.onmessage = ({ data }) => {
      const { resolve, reject } = waiting.shift();
      left -= performance.now() - since;
      if (data.error === undefined) resolve(data);
      else reject(new Error(data.error));
      watch();
    };
    worker.onerror = (event) => end(`The policy cannot be played: ${event.message}`);
    const ask = (message) => new Promise((resolve, reject) => {
      if (failure) return reject(failure);
      waiting.push({ resolve, reject });
      worker.postMessage(message);
      if (waiting.length === 1) watch();
    });
    return ask({ ...policy, form }).then(({ size }) => ({ ask, end, size }));
  }

  /** Players of a policy: (side, key of a round) => player, whose `lost` is true after an answer that is no action. */
  async function policyOf(policy) {
    const { ask, end, size } = await started(policy);
    let rounds = 0;
    const make = (side, key) => {
      const round = rounds++, own = fpgScripts.playerKey(key, side), idle = Array(9).fill(0);
      let step = 0;
      const play = async (seen) => {
        const noise = Array.from({ length: size }, (_, k) => fpgDraws.gaussians(own, step, fpgDraws.PURPOSE.player + k)[0]);
        step++;
        const { action } = await ask({ round, seen: [...seen], noise });
        if (action.length === 9 && action.every((value) => Math.abs(value) <= 1 + 1e-6)) return action;
        play.lost = true; // as on the board, whatever comes after it
        return idle;
      };
      return Object.assign(play, { lost: false });
    };
    return Object.assign(make, { end });
  }

  // Called by a policy's script.
  window.fpgAgent = (file, policy) => (policies[file] = policy);

  /** Load a policy, which is a script of its own. */
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

  /** Load a choice, `script:name` or `agent:file`; gives (side, key of a round, rules) => player. */
  async function load(choice) {
    const [kind, name] = choice.split(/:(.*)/s);
    if (kind === "script") return (side, key, rules) => fpgScripts.make(side, name, rules, key);
    return (workers[name] ??= policyOf({ held: await fetched(name) }));
  }

  /** The best of the board's entries of a side in a game that the page can play, as a choice. */
  const leaderOf = (side, game) => games[game].leaders[side];

  return { load, policyOf, leaderOf };
})();
