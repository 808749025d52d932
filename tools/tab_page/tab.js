// The page "Try it in this tab": shows what the robot's master tells, and passes on what the visitor does. It decides
// nothing: every state, reason, value and frame comes from the worker.
"use strict";

(() => {
  const here = new URL(".", document.currentScript.src).href;
  const SILENT_MS = 6000;
  const place = document.getElementById("tab-robot");
  const make = (tag, { text, ...more } = {}, ...inside) => {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(more)) {
      if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
      else if (value !== undefined && value !== false) made.setAttribute(name, value === true ? "" : value);
    }
    if (text !== undefined) made.textContent = text;
    made.append(...inside);
    return made;
  };
  const say = (node, text) => {
    if (node.textContent !== text) node.textContent = text;
  };

  let worker = null;
  let heard = 0;
  let program = null;
  let isHeld = false;
  let lastEvent = 0;
  const cards = new Map();
  const act = (what, more = {}) => worker && worker.postMessage(JSON.stringify({ do: what, ...more }));

  // Before the robot is there

  const status = make("p", { role: "status", class: "tr-status" });
  const load = make("button", {
    type: "button",
    class: "tr-button tr-main",
    text: `Load the robot (about ${place.dataset.megabytes} MB)`,
    onclick: begin,
  });
  const loaded = make("progress", { "aria-label": "Loaded", hidden: true, max: place.dataset.megabytes, value: 0 });
  place.replaceChildren(load, loaded, status);

  function begin() {
    if (worker) worker.terminate();
    load.disabled = true;
    heard = 0;
    lastEvent = 0;
    isHeld = false;
    cards.clear();
    try {
      worker = new Worker(`${here}worker.js`);
    } catch (error) {
      on.failed(location.protocol === "file:" ? "open this page through a web server" : error.message);
      return;
    }
    worker.onmessage = ({ data: { kind, value } }) => on[kind](value);
    worker.onerror = (event) => on.failed(event.message || "a file of the robot cannot be loaded");
    loaded.hidden = false;
    say(status, "Loading…");
  }

  const on = {
    loaded: (octets) => { loaded.value = octets / 1e6; },
    starting: () => say(status, "Starting…"),
    program: (parts) => { program = parts; },
    look: (text) => {
      if (!heard) show(program);
      heard = Date.now();
      again.hidden = true;
      look(JSON.parse(text));
    },
    failed: (words) => {
      say(status, `The robot does not run: ${words}`);
      loaded.hidden = true;
      load.disabled = false;
      if (load.isConnected) return;
      say(againWords, "The robot has ended. ");
      again.hidden = false;
    },
  };

  // A program that never ends stops the robot's thread, and with it what it tells.
  const againWords = make("span");
  const again = make("p", { class: "tr-again", hidden: true }, againWords,
    make("button", { type: "button", class: "tr-button", text: "Start again", onclick: begin }));
  setInterval(() => {
    if (!heard || Date.now() - heard < SILENT_MS || !again.hidden) return;
    say(againWords, "The robot has said nothing for some seconds. A program that never ends stops this whole robot. ");
    again.hidden = false;
  }, 1000);

  // The face

  const view = {};

  function show([head, first, tail]) {
    const written = view.lines ? view.lines.value : first;
    view.stop = make("button", {
      type: "button", class: "tr-button tr-stop", text: "STOP", onclick: () => act("stop"),
    });
    view.go = make("button", { type: "button", class: "tr-button tr-go", text: "GO", onclick: () => act("go") });
    view.stopWords = make("p", { class: "tr-words" });
    view.answer = make("p", { class: "tr-wrong", role: "alert" });
    view.cards = make("ul", { class: "tr-cards" });
    view.lines = make("textarea", {
      id: "tr-lines", rows: 4, spellcheck: "false", autocapitalize: "off", autocomplete: "off",
    });
    view.lines.value = written;
    view.said = make("pre", { class: "tr-said", tabindex: 0, "aria-label": "What your program says" });
    view.events = make("ol", { class: "tr-events" });
    view.bus = make("p", { class: "tr-words" });
    view.frames = make("tbody");
    view.hold = make("button", {
      type: "button", class: "tr-button", "aria-pressed": "false", text: "Hold", onclick: () => {
        isHeld = !isHeld;
        view.hold.setAttribute("aria-pressed", String(isHeld));
      },
    });
    const frames = make("div", { class: "tr-scroll", tabindex: 0, role: "region", "aria-label": "Frames on the bus" },
      make("table", {},
        make("thead", {}, make("tr", {},
          ...["Sender", "What it says", "Frame"].map((text) => make("th", { scope: "col", text })))),
        view.frames));
    place.replaceChildren(
      again, status,
      make("div", { class: "tr-bar tr-always" }, view.stop, view.go, view.stopWords), view.answer, view.cards,
      make("h3", { text: "Your part" }),
      make("pre", { class: "tr-code", text: head.trimEnd() }),
      make("label", { for: "tr-lines", text: "Your lines" }), view.lines,
      make("pre", { class: "tr-code", text: tail.trim() }),
      make("div", { class: "tr-bar" },
        make("button", {
          type: "button", class: "tr-button tr-main", text: "Run",
          onclick: () => act("run", { lines: view.lines.value }),
        }),
        make("button", {
          type: "button", class: "tr-button", text: "The first lines again",
          onclick: () => { view.lines.value = first; },
        })),
      view.said,
      make("h3", { text: "What happened" }), view.events,
      make("h3", { text: "The bus" }),
      make("div", { class: "tr-bar" }, view.hold, view.bus), frames);
    view.stop.focus();
  }

  function look(robot) {
    stopOf(robot.stop);
    say(view.answer, robot.answer);
    for (const part of robot.parts) cardOf(part);
    say(view.said, [...robot.program, ...robot.log].join("\n"));
    view.said.hidden = !view.said.textContent;
    if (robot.events.length && robot.events.at(-1).number !== lastEvent) eventsOf(robot.events);
    busOf(robot);
  }

  function stopOf(stop) {
    view.stop.disabled = stop.stopped;
    view.go.disabled = !stop.stopped;
    const told = stop.confirmed.map((one) => `${one.part} after ${Math.max(1, Math.round(one.ms))} ms`);
    const missing = stop.silent.length ? `; not yet: ${stop.silent.join(", ")}` : "";
    say(view.stopWords, stop.stopped
      ? `STOP by ${stop.by}. Confirmed: ${told.join(", ") || "none"}${missing}`
      : "No STOP holds.");
  }

  // One card for each place. Nodes stay, so that the keyboard's focus does.
  function cardOf(part) {
    let card = cards.get(part.name);
    if (!card) cards.set(part.name, (card = newCard(part)));
    const state = part.plugged || part.state !== "new" ? part.state : "empty";
    say(card.state, state);
    card.node.dataset.state = state;
    say(card.where, part.slot && part.slot !== part.name ? `in slot ${part.slot}` : part.part_number);
    say(card.reason, part.reason);
    say(card.readings, part.readings.map((one) =>
      `${one.words}: ${typeof one.value === "boolean" ? (one.value ? "yes" : "no") : one.value} ${one.unit}`.trim()
    ).join("\n"));
    say(card.counts, `${part.messages_out} messages out, ${part.messages_in} in, ${part.beats} beats`);
    say(card.plug, part.plugged ? "Unplug" : "Plug in");
    card.plug.setAttribute("aria-label", `${part.plugged ? "Unplug" : "Plug in"} ${part.name}`);
    card.plug.hidden = part.is_yours && !part.plugged;
    card.isPlugged = part.plugged;
    const dial = part.controls.find((one) => one.kind === "number");
    card.dial.hidden = !dial;
    if (dial && !card.range) newDial(card, part.name, dial);
    if (dial && document.activeElement !== card.range) card.range.value = dial.value;
  }

  function newCard(part) {
    const card = {
      state: make("span", { class: "tr-state" }), where: make("p", { class: "tr-words" }),
      reason: make("p", { class: "tr-reason" }), readings: make("p", { class: "tr-readings" }),
      counts: make("p", { class: "tr-words" }), dial: make("div", { class: "tr-dial", hidden: true }),
      isPlugged: false, range: null,
    };
    card.plug = make("button", {
      type: "button", class: "tr-button", onclick: () => act(card.isPlugged ? "pull" : "plug", { place: part.name }),
    });
    card.node = make("li", { class: "tr-card", "data-place": part.name },
      make("div", { class: "tr-head" }, make("strong", { text: part.name }), card.state),
      card.where, card.readings, card.dial, card.reason, card.counts, card.plug);
    view.cards.append(card.node);
    return card;
  }

  function newDial(card, name, dial) {
    const id = `tr-${name}-${dial.name}`;
    card.range = make("input", {
      id, type: "range", min: dial.least, max: dial.most, step: 1,
      oninput: () => act("set", { place: name, control: dial.name, value: Number(card.range.value) }),
    });
    card.dial.replaceChildren(make("label", { for: id, text: `${dial.words} (${dial.unit})` }), card.range);
  }

  function eventsOf(events) {
    const words = (one) => `${one.part}: ${one.from_state ? `${one.from_state} → ` : ""}${one.to_state}, ${one.reason}`;
    view.events.replaceChildren(...[...events].reverse().map((one) =>
      make("li", {}, make("span", { class: "tr-time", text: `${one.at_s.toFixed(1)} s ` }), words(one))));
    lastEvent = events.at(-1).number;
    say(status, words(events.at(-1)));
  }

  function busOf(robot) {
    if (isHeld) return;
    const bus = robot.bus;
    say(view.bus, `${bus.frames} frames, ${bus.load_now_percent.toFixed(1)} % of the time of `
      + `${bus.bitrate / 1000} kbit/s`);
    view.frames.replaceChildren(...[...robot.frames].reverse().map((one) => make("tr", {},
      make("td", { text: one.sender }), make("td", { text: one.words }),
      make("td", {}, make("code", { text: one.frame.trim() })))));
  }
})();
