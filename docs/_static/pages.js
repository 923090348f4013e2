// A click on a figure opens it alone, as wide as the window.
document.addEventListener("click", (event) => {
  if (event.target.matches("article :not(a) > img")) window.open(event.target.src, "_self");
});

// A button copies a block of code.
for (const block of document.querySelectorAll("div:not(.highlight-text) > div.highlight")) {
  const button = Object.assign(document.createElement("button"), { type: "button", className: "copy", textContent: "copy" });
  button.addEventListener("click", () => {
    getSelection().selectAllChildren(block.querySelector("pre"));
    button.textContent = document.execCommand("copy") ? "copied" : "select it and copy";
    setTimeout(() => { button.textContent = "copy"; }, 1500);
  });
  block.append(button);
}
