// A click on a figure opens it alone, as wide as the window.
document.addEventListener("click", (event) => {
  if (event.target.matches("article :not(a) > img")) window.open(event.target.src, "_self");
});
