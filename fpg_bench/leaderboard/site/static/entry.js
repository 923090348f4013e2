/* An entry's rounds: each is a script of its own, loaded when it is chosen. */
"use strict";
(() => {
  const root = document.getElementById("replay");
  const player = fpgReplay(root, root);
  const buttons = [...document.querySelectorAll("button.round")];
  let wanted = null;

  // What a round's script calls.
  window.fpgRound = (round) => {
    document.getElementById("told").textContent = round.summary;
    player.show(round.replay);
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

  for (const button of buttons) button.addEventListener("click", () => choose(button));
  choose(buttons[0]);
})();
