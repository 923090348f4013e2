/* Who plays on these pages: scripts, and policies, each of which is a script to be loaded. */
"use strict";
const fpgPlayers = (() => {
  const { rules, agents } = window.fpgData, policies = {};

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

  /** Load a choice, `script:name` or `agent:file`; gives (side, key of a round) => player. */
  async function load(choice) {
    const [kind, name] = choice.split(/:(.*)/s);
    if (kind === "script") return (side, key) => fpgScripts.make(side, name, rules, key);
    const policy = await fetched(name);
    return () => fpgPolicy.make(policy);
  }

  const championOf = (side) => agents.find((one) => one.side === side && one.name.includes("champion"));

  return { load, championOf };
})();
