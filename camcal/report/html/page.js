// Copies the camera, shows a figure over the whole width (without scripts the buttons do not appear), and marks a view
// wherever it is shown: its bar, its board in space, its row, its picture. A click keeps it and goes to the picture or,
// where there is none, to the row.
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

  const byView = new Map();
  document.querySelectorAll("[data-view]").forEach(function (node) {
    const id = node.dataset.view;
    byView.set(id, (byView.get(id) || []).concat(node));
  });
  let kept = null;
  function mark(id, on) {
    (byView.get(id) || []).forEach(function (node) { node.classList.toggle("marked", on); });
  }
  byView.forEach(function (nodes, id) {
    if (nodes.length < 2) return;
    nodes.forEach(function (node) {
      node.classList.add("linked");
      node.addEventListener("pointerenter", function () { mark(id, true); });
      node.addEventListener("pointerleave", function () { if (kept !== id) mark(id, false); });
      node.addEventListener("click", function () {
        if (kept !== null) mark(kept, false);
        kept = kept === id ? null : id;
        if (kept === null) return;
        mark(id, true);
        const target = nodes.find(function (n) { return "picture" in n.dataset; })
          || nodes.find(function (n) { return n.tagName === "TR"; });
        if (target && target !== node) target.scrollIntoView({ block: "center" });
      });
    });
  });
})();
