/* Buttons that copy what stands beside them. */
"use strict";
(() => {
  /** Where there is no clipboard, as on some pages from a disk: what is selected is copied. */
  function selected(code) {
    getSelection().selectAllChildren(code);
    return document.execCommand("copy");
  }

  for (const button of document.querySelectorAll("button.copy")) {
    button.hidden = false;
    button.addEventListener("click", async () => {
      const code = button.parentElement.querySelector("code");
      const done = await (navigator.clipboard?.writeText(code.textContent).then(() => true, () => selected(code)) ?? selected(code));
      button.textContent = done ? "copied" : "select it and copy";
      setTimeout(() => (button.textContent = "copy"), 1500);
    });
  }
})();
