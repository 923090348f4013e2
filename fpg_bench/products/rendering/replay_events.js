/** What happens in a round, in words: a list of { step, kind, text }, in the order of the steps.
 *  round, scenario: as replay_data gives them. Kinds: found, hopped, spread, covered, jammed, back, near, herded. */
function fpgEvents(round, scenario) {
  "use strict";
  const HERD = { times: 3, within: 5 }; // covered so often in so many seconds
  const steps = round.steps;
  const events = [];
  const mhz = (value) => `${value.toFixed(1)} MHz`;
  const add = (step, kind, text) => events.push({ step, kind, text });
  const jammed = (k) => steps.covered[k] && steps.snr[k] < scenario.threshold_db;
  const near = (k) => steps.distance[k] < scenario.distance_reward_m;
  const jamming = (k) => scenario.jamming[steps.type[k]].name.replace("tone", "single tone");
  let heard = null; // the frequency at which the ally was heard last, while it stays there
  let since = null; // the first step of the jamming that goes on
  let covered = []; // the steps in which jamming met the ally anew

  function listened(k) {
    if (steps.frequency[k] !== heard) heard = null;
    if (steps.check[k] !== 1 || heard !== null) return;
    heard = steps.frequency[k];
    add(k, "found", `The opponent hears the ally at ${mhz(heard)}`);
  }

  function changed(k) {
    if (steps.hopped[k]) {
      const [from, to] = [steps.frequency[k - 1], steps.frequency[k]];
      add(k, "hopped", from === to ? `The ally pays for a hop and stays at ${mhz(to)}` : `The ally hops from ${mhz(from)} to ${mhz(to)}`);
    }
    if (steps.spreading[k] && !steps.spreading[k - 1]) add(k, "spread", "The ally spreads its signal to hide in noise");
  }

  function hit(k) {
    if (jammed(k) && since === null) {
      since = k;
      add(k, "jammed", `Jammed: ${jamming(k)} at ${mhz(steps.centre[k])} breaks the link`);
    } else if (!jammed(k) && since !== null) {
      add(k, "back", `The ally is free of jamming after ${k - since} s`);
      since = null;
    }
  }

  const coveredAnew = (k) => steps.covered[k] && (!steps.covered[k - 1] || steps.frequency[k] !== steps.frequency[k - 1]);

  function held(k) {
    if (coveredAnew(k) && !jammed(k)) add(k, "covered", `Covered: ${jamming(k)} at ${mhz(steps.centre[k])}; the link holds at ${steps.snr[k].toFixed(0)} dB`);
  }

  function herded(k) {
    const anew = coveredAnew(k);
    covered = covered.filter((step) => step > k - HERD.within);
    if (anew) covered.push(k);
    if (covered.length < HERD.times) return;
    add(k, "herded", `The ally is herded: covered ${HERD.times} times in ${HERD.within} s`);
    covered = [];
  }

  for (let k = 1; k < steps.snr.length; k++) {
    changed(k);
    hit(k);
    held(k);
    herded(k);
    if (near(k) && !near(k - 1)) add(k, "near", `The opponent is within ${scenario.distance_reward_m} m`);
    listened(k); // a check comes at a step's end
  }
  return events;
}
