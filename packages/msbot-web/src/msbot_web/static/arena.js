// The world of a page: the robot says ten times a second where everything is, the browser draws the frames in between.
// Lengths are mm; the picture's y axis points down, the world's points up.
const msbotArena = (() => {
  const BEHIND_MS = 150, MOST_STATES = 8, MOST_TRAIL = 900, TRAIL_MM = 8, PUT_MS = 80, DRIVE_MS = 250, NUDGE_MM = 50, NUDGE_DEG = 15;
  const NS = "http://www.w3.org/2000/svg";
  const COLOURS = { distance: "#fff", near: "#fff", line: "#f0c", colour: "#0c6", touch: "#f80", light: "#fd0", sound: "#9cf", magnet: "#f33", heading: "#fff", grip: "#bbb", tone: "#c9f" };
  // Whoever does not want motion sees a still picture, and another one twice a second.
  const calm = matchMedia("(prefers-reduced-motion: reduce)"), CALM_MS = 500;
  let drawnAt = -CALM_MS;
  let host = null, svg = null, height = 0, whole = null, states = [], trails = {}, shown = { trails: true, rays: true };
  let frames = 0, held = null, words = {}, may = false, driving = null, driven = null, marks = {};

  const make = (name, attributes, parent) => {
    const element = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    parent.append(element);
    return element;
  };
  const robots = () => [...svg.querySelectorAll(".arena-robot")];
  const turned = (from, to) => ((to - from + 540) % 360 + 360) % 360 - 180;

  function begin(setup) {
    words = setup.words;
    may = setup.may;
    window.msbotArenaFrames = () => frames;
    const wait = () => {
      host = document.getElementById(setup.host);
      svg = host && host.querySelector("svg.arena");
      if (!svg) return setTimeout(wait, 30);
      height = Number(svg.dataset.height);
      whole = svg.getAttribute("viewBox");
      listen();
      show(setup.state);
      draw();
    };
    wait();
  }

  function show(state) {
    state.at = performance.now();
    states.push(state);
    if (states.length > MOST_STATES) states.shift();
    if (svg) for (const [name, robot] of Object.entries(state.robots)) mark(name, robot);
  }

  // The parts on a robot, drawn again only when another one has come.
  function mark(name, robot) {
    const key = JSON.stringify(robot.parts);
    if (marks[name] === key) return;
    marks[name] = key;
    const group = find("arena-robot", name);
    if (!group) return;
    const parts = group.querySelector(".arena-parts");
    parts.replaceChildren();
    for (const [slot, kind, x, y] of robot.parts) {
      if (kind === "lamp") continue;
      const dot = make("g", { transform: `translate(${x} ${-y})` }, parts);
      make("title", {}, dot).textContent = slot;
      if (kind === "line") make("rect", { x: -5, y: -35, width: 10, height: 70, rx: 4, fill: COLOURS.line, stroke: "#111", "stroke-width": 2 }, dot);
      else if (kind === "touch") make("rect", { x: -2, y: -50, width: 9, height: 100, rx: 4, fill: COLOURS.touch, stroke: "#111", "stroke-width": 2 }, dot);
      else if (kind === "grip") for (const side of [-1, 1]) make("rect", { class: "finger", "data-side": side, x: 0, y: side * 27 - 4, width: 42, height: 8, rx: 3, fill: COLOURS.grip, stroke: "#111", "stroke-width": 2 }, dot);
      else make("circle", { r: 9, fill: COLOURS[kind] || "#fff", stroke: "#111", "stroke-width": 3 }, dot);
    }
  }

  const find = (kind, name) => [...svg.querySelectorAll("." + kind)].find((one) => one.dataset.name === name);

  function draw() {
    if (!document.contains(svg)) return;
    requestAnimationFrame(draw);
    if (document.hidden || !states.length) return;
    if (calm.matches && performance.now() - drawnAt < CALM_MS) return;
    drawnAt = performance.now();
    frames += 1;
    const at = performance.now() - BEHIND_MS;
    let later = states.findIndex((state) => state.at > at);
    if (later < 0) later = states.length - 1;
    const one = states[Math.max(0, later - 1)], two = states[later];
    const share = two.at > one.at ? Math.min(1, Math.max(0, (at - one.at) / (two.at - one.at))) : 1;
    const between = (from, to) => {
      const [ax, ay, aa] = from || to, [bx, by, ba] = to;
      if (Math.hypot(bx - ax, by - ay) > 300) return to;  // put elsewhere, not driven
      return [ax + (bx - ax) * share, ay + (by - ay) * share, aa + turned(aa, ba) * share];
    };
    for (const [name, place] of Object.entries(two.boxes)) set(find("arena-box", name), between(one.boxes[name], place));
    const rays = svg.querySelector(".arena-rays");
    const polygons = [];
    for (const [name, robot] of Object.entries(two.robots)) {
      const element = find("arena-robot", name);
      if (!element || (held && held.name === name)) continue;
      const [x, y, angle] = between(one.robots[name] && one.robots[name].p, robot.p);
      set(element, [x, y, angle]);
      trail(name, x, y);
      const lamp = element.querySelector(".arena-lamp");
      lamp.setAttribute("fill", robot.lamp ? `rgb(${robot.lamp})` : "#555");
      lamp.setAttribute("stroke-width", robot.loud ? 3 + robot.loud / 6 : 3);
      for (const finger of element.querySelectorAll(".finger")) {
        finger.setAttribute("y", finger.dataset.side * Math.max(2, robot.grip / 2) - 4);
      }
      if (shown.rays) for (const ray of robot.rays) polygons.push(cone(ray));
    }
    while (rays.childElementCount > polygons.length) rays.lastChild.remove();
    polygons.forEach((points, place) => {
      const polygon = rays.children[place] || make("polygon", { fill: "#0b6e99", opacity: 0.25 }, rays);
      polygon.setAttribute("points", points);
    });
  }

  function set(element, [x, y, angle]) {
    if (element) element.setAttribute("transform", `translate(${x.toFixed(1)} ${(height - y).toFixed(1)}) rotate(${(-angle).toFixed(2)})`);
  }

  function cone([x, y, angle, reach, opening]) {
    const points = [[x, y]];
    for (const side of [-1, 0, 1]) {
      const turn = ((angle + (side * Math.max(opening, 1.5)) / 2) * Math.PI) / 180;
      points.push([x + reach * Math.cos(turn), y + reach * Math.sin(turn)]);
    }
    return points.map(([px, py]) => `${px.toFixed(0)},${(height - py).toFixed(0)}`).join(" ");
  }

  function trail(name, x, y) {
    if (!shown.trails) return;
    const points = (trails[name] ||= []);
    const last = points[points.length - 1];
    if (last && Math.hypot(x - last[0], y - last[1]) < TRAIL_MM) return;
    if (last && Math.hypot(x - last[0], y - last[1]) > 300) points.length = 0;
    points.push([x, y]);
    if (points.length > MOST_TRAIL) points.shift();
    const group = svg.querySelector(".arena-trails");
    const line = [...group.children].find((one) => one.dataset.name === name)
      || make("polyline", { "data-name": name, fill: "none", stroke: "#d55e00", "stroke-width": 6, opacity: 0.6, "stroke-linejoin": "round" }, group);
    line.setAttribute("points", points.map(([px, py]) => `${px.toFixed(0)},${(height - py).toFixed(0)}`).join(" "));
  }

  function forget() {
    trails = {};
    svg.querySelector(".arena-trails").replaceChildren();
  }

  function toggle(what, button) {
    shown[what] = !shown[what];
    button.setAttribute("aria-pressed", shown[what]);
    if (what === "trails" && !shown.trails) forget();
  }

  // Zoom and move the picture.
  const box = () => svg.getAttribute("viewBox").split(" ").map(Number);
  function zoom(factor) {
    const [x, y, w, h] = box(), [, , ww, wh] = whole.split(" ").map(Number);
    const width = Math.min(ww, Math.max(ww / 12, w * factor)), tall = (width * wh) / ww;
    look(x + (w - width) / 2, y + (h - tall) / 2, width, tall);
  }
  function look(x, y, w, h) {
    const [wx, wy, ww, wh] = whole.split(" ").map(Number);
    svg.setAttribute("viewBox", [Math.min(wx + ww - w, Math.max(wx, x)), Math.min(wy + wh - h, Math.max(wy, y)), w, h].join(" "));
  }
  const fit = () => svg.setAttribute("viewBox", whole);

  // What a person does: drag a robot or the picture, arrow keys, drive.
  const place = (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [point.x, height - point.y];
  };
  const latest = (name) => states[states.length - 1].robots[name].p;
  const put = (name, [x, y, angle]) => emitEvent("arena_put", [name, x / 1000, y / 1000, angle]);

  function listen() {
    for (const robot of robots()) {
      if (!may) continue;
      robot.setAttribute("tabindex", "0");
      robot.setAttribute("role", "button");
      robot.setAttribute("aria-label", `${robot.dataset.name}: ${words.drag}`);
      robot.addEventListener("keydown", (event) => nudge(robot.dataset.name, event));
    }
    svg.setAttribute("tabindex", "0");
    svg.addEventListener("pointerdown", take);
    svg.addEventListener("pointermove", move);
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, leave);
    svg.addEventListener("wheel", (event) => { if (event.ctrlKey) { event.preventDefault(); zoom(event.deltaY > 0 ? 1.15 : 0.87); } }, { passive: false });
    document.addEventListener("keydown", driveByKey);
    document.addEventListener("keyup", (event) => { if (powersOf(event)) drive(REST); });
    addEventListener("blur", () => drive(REST));
    for (const button of document.querySelectorAll("[data-drive]")) {
      const powers = button.dataset.drive.split(",").map(Number);
      button.addEventListener("pointerdown", () => drive(powers));
      for (const end of ["pointerup", "pointerleave", "pointercancel", "blur"]) button.addEventListener(end, () => drive(REST));
      button.addEventListener("keydown", (event) => { if (event.key === " " || event.key === "Enter") drive(powers); });
      button.addEventListener("keyup", () => drive(REST));
    }
    document.addEventListener("visibilitychange", () => emitEvent("arena_seen", !document.hidden));
  }

  const KEYS = { ArrowUp: [55, 55, 55, 55], ArrowDown: [-55, -55, -55, -55], ArrowLeft: [-28, 28, -28, 28], ArrowRight: [28, -28, 28, -28] };
  const LETTERS = { w: "ArrowUp", a: "ArrowLeft", s: "ArrowDown", d: "ArrowRight" };
  const REST = [0, 0, 0, 0];
  // What keys mean something else in: fields, lists, dialogs, what is scrolled, and a robot, which they move.
  const OWN_KEYS = "input, textarea, select, [contenteditable], [role=slider], [role=menu], [role=listbox], [role=dialog], .scroll, .arena-robot";

  const powersOf = (event) => KEYS[LETTERS[event.key.toLowerCase()] || event.key];

  // Wherever the focus is: who drives looks at the robot, not for a button.
  function driveByKey(event) {
    const powers = powersOf(event), pad = document.querySelector(".arena-pad");
    if (!powers || event.ctrlKey || event.altKey || event.metaKey || !pad || !pad.offsetParent) return;
    if (event.target.closest && event.target.closest(OWN_KEYS)) return;
    event.preventDefault();
    drive(powers);
  }

  // Said again and again while a button is held: when this page is gone, the robot stands.
  function drive(powers) {
    if (!may || String(powers) === String(driving || REST)) return;
    clearInterval(driven);
    driving = powers.some(Boolean) ? powers : null;
    emitEvent("arena_drive", powers);
    if (driving) driven = setInterval(() => emitEvent("arena_drive", driving), DRIVE_MS);
  }

  function nudge(name, event) {
    const steps = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
    if (!steps) return;
    event.preventDefault();
    event.stopPropagation();
    const [x, y, angle] = latest(name);
    put(name, event.shiftKey ? [x, y, angle - NUDGE_DEG * (steps[0] || steps[1])] : [x + NUDGE_MM * steps[0], y + NUDGE_MM * steps[1], angle]);
  }

  function take(event) {
    const robot = event.target.closest(".arena-robot");
    svg.setPointerCapture(event.pointerId);
    if (robot && may) {
      const [x, y] = place(event), [rx, ry, angle] = latest(robot.dataset.name);
      held = { name: robot.dataset.name, element: robot, off: [rx - x, ry - y], angle, said: 0 };
    } else held = { from: [event.clientX, event.clientY], box: box() };
  }

  function move(event) {
    if (!held) return;
    if (!held.name) {
      const scale = held.box[2] / svg.getBoundingClientRect().width;
      look(held.box[0] - (event.clientX - held.from[0]) * scale, held.box[1] - (event.clientY - held.from[1]) * scale, held.box[2], held.box[3]);
      return;
    }
    const [x, y] = place(event);
    held.at = [x + held.off[0], y + held.off[1], held.angle];
    set(held.element, held.at);
    if (event.timeStamp - held.said > PUT_MS) {
      held.said = event.timeStamp;
      put(held.name, held.at);
    }
  }

  function leave() {
    if (held && held.at) {
      put(held.name, held.at);
      delete trails[held.name];
    }
    held = null;
  }

  return { begin, show, zoom, fit, toggle, forget };
})();
