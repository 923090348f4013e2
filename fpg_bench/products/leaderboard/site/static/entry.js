/* An entry's rounds: each is a script of its own, loaded when it is chosen. The address keeps which, and the step. */
"use strict";
(() => {
  const root = document.getElementById("replay");
  const player = fpgReplay(root, root);
  const buttons = [...document.querySelectorAll("button.round")];
  const address = () => new URLSearchParams(location.hash.slice(1));
  let wanted = null, keeping = null;
  let asked = address(); // until the first round is there

  // What a round's script calls.
  window.fpgRound = (round) => {
    document.getElementById("round-summary").textContent = round.summary;
    player.show(round.replay);
    if (asked) player.follow(asked);
    asked = null;
  };

  function choose(button) {
    if (wanted === button) return;
    wanted = button;
    for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
    const script = document.createElement("script");
    script.src = button.dataset.file;
    script.addEventListener("load", () => script.remove());
    document.head.append(script);
  }

  /** Where the player rests, in the address; a page that nobody has touched keeps its own. */
  function keep({ detail: { step } }) {
    clearTimeout(keeping);
    keeping = setTimeout(() => {
      const place = buttons.indexOf(wanted);
      if ((!step && !place) || address().has("embed")) return;
      history.replaceState(null, "", `#${new URLSearchParams({ round: place, step })}`);
    }, 250);
  }

  root.addEventListener("fpg-rest", keep);
  for (const button of buttons) button.addEventListener("click", () => choose(button));
  addEventListener("hashchange", () => { // a rival's row links its round
    choose(buttons[Number(address().get("round"))] ?? buttons[0]);
    document.getElementById("watch").scrollIntoView();
  });
  choose(buttons[Number(address().get("round"))] ?? buttons[0]);
})();
