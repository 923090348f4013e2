/** Hands and keys on a replay. One finger on the arena scrolls the page; two, a mouse, its buttons or its arrow keys turn it. */
function fpgHands(player) {
  "use strict";
  const { root, keys, byId, scene, arena, times, goTo, play, chooseRound } = player;
  const { view, now } = scene;
  const TURN = 15; // degrees, of a button or a key

  function turnByMouse(canvas) {
    canvas.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "touch") canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId) && event.pointerType !== "touch") arena.turn(-event.movementX * 0.4, event.movementY * 0.4);
    });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return; // then it scrolls the page
      event.preventDefault();
      arena.turn(0, 0, Math.exp(-event.deltaY / 300));
    }, { passive: false });
  }

  /** Two fingers: their middle turns the camera, their distance zooms. */
  function turnByTouch(canvas) {
    let before = null;
    const pair = ({ touches: [a, b] }) => ({
      x: (a.clientX + b.clientX) / 2, y: (a.clientY + b.clientY) / 2, apart: Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY),
    });
    const move = (event) => {
      if (event.touches.length !== 2) return (before = null);
      event.preventDefault();
      const here = pair(event);
      if (before) arena.turn(-(here.x - before.x) * 0.4, (here.y - before.y) * 0.4, here.apart / Math.max(before.apart, 1));
      return (before = here);
    };
    for (const kind of ["touchstart", "touchmove"]) canvas.addEventListener(kind, move, { passive: false });
    canvas.addEventListener("touchend", () => (before = null));
  }

  const TURNS = {
    ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN],
    "+": [0, 0, 1.25], "-": [0, 0, 0.8],
  };

  function turnByKeys(canvas) {
    canvas.addEventListener("keydown", (event) => {
      if (!TURNS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation();
      arena.turn(...TURNS[event.key]);
    });
    for (const button of root.querySelectorAll("[data-turn]")) {
      button.addEventListener("click", () => arena.turn(...TURNS[button.dataset.turn]));
    }
  }

  function seekByPointing(canvas) {
    const seek = (event) => goTo(times.stepAt(event.clientX, canvas));
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) seek(event);
    });
  }

  function changeSpeed(by) {
    const speed = byId("speed");
    speed.selectedIndex = Math.max(0, Math.min(speed.length - 1, speed.selectedIndex + by));
  }

  const KEYS = {
    " ": () => play(!view.playing),
    ArrowLeft: (shift) => goTo(now() - (shift ? 10 : 1)),
    ArrowRight: (shift) => goTo(now() + (shift ? 10 : 1)),
    ArrowUp: () => changeSpeed(1),
    ArrowDown: () => changeSpeed(-1),
    Home: () => goTo(0),
    End: () => goTo(scene.last),
  };

  keys.addEventListener("keydown", (event) => {
    const element = event.target.tagName;
    const own = element === "SELECT" || ((element === "BUTTON" || element === "SUMMARY") && event.key === " ");
    if (!KEYS[event.key] || own || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    KEYS[event.key](event.shiftKey);
  });
  byId("play").addEventListener("click", () => play(!view.playing));
  byId("step").addEventListener("input", (event) => goTo(Number(event.target.value)));
  byId("rounds").addEventListener("change", (event) => chooseRound(Number(event.target.value)));
  byId("span").addEventListener("change", () => (view.dirty = true));
  turnByMouse(byId("arena"));
  turnByTouch(byId("arena"));
  turnByKeys(byId("arena"));
  ["spectrum", "snr", "distance"].forEach((id) => seekByPointing(byId(id)));
}
