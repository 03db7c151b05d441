// Copies the camera, and shows a figure over the whole width; without scripts the buttons do not appear.
(function () {
  "use strict";
  document.querySelectorAll("button[data-copy]").forEach(function (button) {
    const code = document.getElementById(button.dataset.copy);
    if (!code || !navigator.clipboard) return;
    button.disabled = false;
    button.addEventListener("click", function () {
      navigator.clipboard.writeText(code.textContent).then(function () { button.textContent = "Copied"; });
    });
  });
  document.querySelectorAll("button[data-enlarge]").forEach(function (button) {
    const figure = button.closest("figure");
    button.disabled = false;
    button.addEventListener("click", function () {
      const wide = figure.classList.toggle("wide");
      button.setAttribute("aria-pressed", String(wide));
      button.textContent = wide ? "Smaller" : "Enlarge";
    });
  });
})();
