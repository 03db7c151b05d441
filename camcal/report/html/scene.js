// Turns the 3D view: drag, arrow keys, buttons. Draws the polygons that the page already holds.
(function () {
  "use strict";
  const svg = document.getElementById("scene");
  const holder = document.getElementById("scene-data");
  if (!svg || !holder) return;
  const data = JSON.parse(holder.textContent);
  const start = { yaw: data.yaw, pitch: data.pitch, zoom: 1 };
  const state = Object.assign({}, start);
  const polygons = new Map();
  svg.querySelectorAll("polygon[data-shape]").forEach(function (p) {
    polygons.set(Number(p.dataset.shape), p);
  });

  const labels = new Map();
  svg.querySelectorAll("text[data-label]").forEach(function (t) {
    labels.set(Number(t.dataset.label), t);
  });

  // the same rule as in scene.py
  function project(points) {
    const cy = Math.cos(state.yaw), sy = Math.sin(state.yaw);
    const cp = Math.cos(state.pitch), sp = Math.sin(state.pitch);
    let depth = 0;
    const text = points.map(function (p) {
      const x = cy * p[0] - sy * p[2];
      let z = sy * p[0] + cy * p[2];
      const y = cp * p[1] - sp * z;
      z = sp * p[1] + cp * z;
      depth += z / points.length;
      const scale = 0.5 * data.height * data.fill * state.zoom * data.eye / (data.eye + z);
      return (data.width / 2 + scale * x).toFixed(1) + "," + (data.height / 2 + scale * y).toFixed(1);
    }).join(" ");
    return { text: text, depth: depth };
  }

  function draw() {
    const drawn = data.shapes.map(function (points, i) {
      return Object.assign({ node: polygons.get(i), label: labels.get(i) }, project(points));
    });
    drawn.sort(function (a, b) { return b.depth - a.depth; });
    drawn.forEach(function (d) {
      d.node.setAttribute("points", d.text);
      svg.appendChild(d.node); // the last stands in front
      if (d.label) {
        const end = d.text.split(" ").pop().split(",");
        d.label.setAttribute("x", Number(end[0]) + 4);
        d.label.setAttribute("y", Number(end[1]) + 4);
        svg.appendChild(d.label);
      }
    });
  }

  function turn(yaw, pitch, zoom) {
    state.yaw += yaw;
    state.pitch = Math.max(-1.5, Math.min(1.5, state.pitch + pitch));
    state.zoom = Math.max(0.4, Math.min(6, state.zoom * zoom));
    draw();
  }

  const step = Math.PI / 18;
  const moves = {
    left: [-step, 0, 1], right: [step, 0, 1], up: [0, -step, 1], down: [0, step, 1],
    nearer: [0, 0, 1.25], farther: [0, 0, 0.8]
  };
  const keys = {
    ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down",
    "+": "nearer", "=": "nearer", "-": "farther"
  };
  function reset() { Object.assign(state, start); draw(); }

  document.querySelectorAll("button[data-turn]").forEach(function (button) {
    button.disabled = false;
    button.addEventListener("click", function () {
      const move = moves[button.dataset.turn];
      if (move) turn(move[0], move[1], move[2]); else reset();
    });
  });
  svg.addEventListener("keydown", function (event) {
    if (event.key === "Home") { reset(); event.preventDefault(); return; }
    const move = moves[keys[event.key]];
    if (!move) return;
    turn(move[0], move[1], move[2]);
    event.preventDefault();
  });
  let last = null;
  svg.addEventListener("pointerdown", function (event) {
    last = [event.clientX, event.clientY];
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", function (event) {
    if (!last) return;
    turn((event.clientX - last[0]) * 0.008, (event.clientY - last[1]) * -0.008, 1);
    last = [event.clientX, event.clientY];
  });
  ["pointerup", "pointercancel"].forEach(function (name) {
    svg.addEventListener(name, function () { last = null; });
  });
})();
