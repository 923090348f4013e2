/* Who plays on these pages: scripts, and policies, each of which is a script to be loaded. */
"use strict";
const fpgPlayers = (() => {
  const { games, agents } = window.fpgData, policies = {};

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
    const policy = await fetched(name);
    return () => fpgPolicy.make(policy);
  }

  /** The board's leader of a side in a game, as a choice; a champion of the zoo where the page cannot play that one. */
  function championOf(side, game) {
    const agent = agents.find((one) => one.side === side && one.game === game && one.name.includes("champion"));
    return games[game].leaders[side] ?? (agent && `agent:${agent.file}`);
  }

  return { load, championOf };
})();
