// Wires by mouse and by keyboard. Drag from one port to another that fits, or press Enter on both; Delete takes a port
// off its topic, and so does the button that a picked port with a topic has; the cross of a slot takes it out. What it comes
// to is told to the page: {deed, from, to}.
function msbotWires(root, tell, cutter) {
  if (root.dataset.wired) return;
  root.dataset.wired = "1";
  const STEADY_PX = 8;  // a finger that taps is never quite still
  let picked = null, line = null, moved = false, begun = null;
  const crossAt = (target) => target && target.closest && target.closest(".take-out");
  const portAt = (target) => target && target.closest && target.closest(".port");
  const fits = (one, other) => one !== other && one.dataset.type === other.dataset.type && one.dataset.way !== other.dataset.way;

  function pick(port) {
    drop();
    picked = port;
    port.classList.add("picked");
    root.classList.add("picking");
    cutter.classList.toggle("on", Boolean(port.dataset.topic));
    for (const other of root.querySelectorAll(".port")) other.classList.toggle("fits", fits(port, other));
  }
  function drop() {
    picked = null;
    root.classList.remove("picking");
    cutter.classList.remove("on");
    for (const other of root.querySelectorAll(".port")) other.classList.remove("fits", "picked");
    if (line) line.remove();
    line = null;
  }
  function join(port) {
    const from = picked.dataset.way === "out" ? picked : port, to = from === picked ? port : picked;
    tell({ deed: "join", from: from.dataset.port, to: to.dataset.port });
    drop();
  }
  function cut(port) {
    drop();
    if (port.dataset.topic) tell({ deed: "cut", from: port.dataset.port, to: port.dataset.topic });
  }
  cutter.addEventListener("click", () => picked && cut(picked));
  function place(event) {
    const svg = root.querySelector("svg.wires"), point = new DOMPoint(event.clientX, event.clientY);
    return point.matrixTransform(svg.getScreenCTM().inverse());
  }
  function takeOut(cross) {
    drop();
    tell({ deed: "take_out", from: cross.dataset.slot, to: "" });
  }
  root.addEventListener("pointerdown", (event) => {
    const port = portAt(event.target);
    if (!port || event.button) return;
    if (picked) return;
    event.preventDefault();
    port.focus();
    moved = false;
    begun = [event.clientX, event.clientY];
    pick(port);
    const dot = port.querySelector("circle");
    line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    for (const [name, value] of Object.entries({ x1: dot.getAttribute("cx"), y1: dot.getAttribute("cy"),
      x2: dot.getAttribute("cx"), y2: dot.getAttribute("cy"), class: "dragged" })) line.setAttribute(name, value);
    root.querySelector("svg.wires").append(line);
  });
  addEventListener("pointermove", (event) => {
    if (!line) return;
    moved ||= Math.hypot(event.clientX - begun[0], event.clientY - begun[1]) > STEADY_PX;
    const at = place(event);
    line.setAttribute("x2", at.x);
    line.setAttribute("y2", at.y);
  });
  addEventListener("pointercancel", () => {
    if (line) drop();  // the finger scrolls
  });
  addEventListener("pointerup", (event) => {
    if (!line) return;
    line.remove();
    line = null;
    if (!moved) return;  // a click: the port stays picked up until another one is clicked
    const port = portAt(document.elementFromPoint(event.clientX, event.clientY));
    if (port && picked && fits(picked, port)) return join(port);
    if (port && picked && port !== picked) tell({ deed: "misfit", from: picked.dataset.port, to: port.dataset.port });
    drop();
  });
  root.addEventListener("click", (event) => {
    const port = portAt(event.target), cross = crossAt(event.target);
    if (cross) return takeOut(cross);
    if (!port) return drop();
    if (picked && fits(picked, port)) join(port);
    else if (picked && picked !== port) pick(port);
  });
  root.addEventListener("keydown", (event) => {
    const port = portAt(event.target);
    if (event.key === "Escape" && picked) return drop();
    const cross = crossAt(event.target), isPress = event.key === "Enter" || event.key === " ";
    if (cross && isPress) {
      event.preventDefault();
      return takeOut(cross);
    }
    if (!port) return;
    if (isPress) {
      event.preventDefault();
      if (picked && fits(picked, port)) join(port);
      else if (picked === port) drop();
      else pick(port);
    } else if (event.key === "Delete" || event.key === "Backspace") {
      event.preventDefault();
      cut(port);
    }
  });
}

// The edges of slots whose state is another one now: {slot: colour}.
function msbotBoxes(colours) {
  for (const box of document.querySelectorAll("[data-box]")) {
    if (box.dataset.box in colours) box.setAttribute("stroke", colours[box.dataset.box]);
  }
}

// How often each topic comes now, without drawing the wires anew: {topic: [words, is it busy]}.
function msbotRates(rates) {
  for (const [topic, [words, busy]] of Object.entries(rates)) {
    for (const text of document.querySelectorAll("[data-rate]")) if (text.dataset.rate === topic) text.textContent = words;
    for (const wire of document.querySelectorAll("[data-line]")) if (wire.dataset.line === topic) {
      wire.classList.toggle("busy", busy);
      const [path, tip] = wire.children, colour = busy ? "#2e9e57" : "#8896a1";
      path.setAttribute("stroke", colour);
      path.setAttribute("stroke-width", busy ? 3 : 2);
      path.setAttribute("stroke-dasharray", busy ? "" : "6 5");
      tip.setAttribute("fill", colour);
    }
  }
}
