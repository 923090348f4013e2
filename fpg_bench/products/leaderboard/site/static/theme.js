/* The theme that a visitor chose, set before anything is drawn, else the system's; and the head of the page. */
"use strict";
(() => {
  const KEY = "fpg-theme";
  const root = document.documentElement;
  const remembered = () => {
    try {
      return localStorage.getItem(KEY);
    } catch {
      return null; // storage may be forbidden
    }
  };
  const chosen = remembered();
  if (chosen === "light" || chosen === "dark") root.dataset.theme = chosen;
  root.classList.add("js");
  document.addEventListener("DOMContentLoaded", () => {
    const nav = document.querySelector("header nav"), here = nav.querySelector("[aria-current]");
    if (here) nav.scrollLeft += here.getBoundingClientRect().right - nav.getBoundingClientRect().right; // on a phone
    document.getElementById("theme").addEventListener("click", () => {
      const next = getComputedStyle(root).colorScheme === "dark" ? "light" : "dark";
      root.dataset.theme = next;
      try {
        localStorage.setItem(KEY, next);
      } catch {
        // then it holds for this page
      }
    });
  });
})();
