// A program of a person, in a worker of its own: nothing of it runs on the robot's computer, and ending the worker ends
// whatever it does. The server sends this file with rules for the browser (Content-Security-Policy): from here nothing
// can be reached but the VM's files and the robot's link, so that a program of somebody else can do nothing in the name
// of whoever runs it, but be a part.

import { openHome } from "../web/program/home.js";

const FLUSH_MS = 200, MOST_LINES = 50, LONGEST = 2000, LOOK_MS = 250, BACK_MS = 1000, WAITING = 64 * 1024;
const REFUSED = 4400; // codes from here to 4499: the robot does not want this part

let home = null, socket = null, timer = null, isOver = false, isHeld = false, link = "", address = "", notSent = 0, toldAt = -Infinity;
let incoming = [], lines = [], left = 0, flushedAt = 0;

const now = () => Math.round(performance.now());

function flush() {
  flushedAt = performance.now();
  if (lines.length || left) postMessage({ said: lines, left });
  lines = [];
  left = 0;
}

// At once when the last lines are old, so that a function that never ends shows what it prints, too.
function tell(kind, text, line) {
  if (lines.length < MOST_LINES) lines.push([kind, `${text}`.slice(0, LONGEST), line]);
  else left += 1;
  if (performance.now() - flushedAt > FLUSH_MS) flush();
}

function connect() {
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { link = "up"; step(); };
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") return tell("error", data, 0), flush();
    incoming.push(hex(new Uint8Array(data)));
    soon(0);
  };
  socket.onclose = ({ code, reason }) => {
    if (isOver) return;
    if (code >= REFUSED && code < REFUSED + 100) {
      tell("error", reason, 0);
      return over();
    }
    link = "the connection with the robot's page has ended";
    step();
    setTimeout(() => { if (!isOver) connect(); }, BACK_MS);
  };
}

const hex = (octets) => Array.from(octets, (octet) => octet.toString(16).padStart(2, "0")).join("");
const octets = (text) => Uint8Array.from(text.match(/../g) || [], (pair) => parseInt(pair, 16));
const isOpen = () => socket !== null && socket.readyState === WebSocket.OPEN;

function ask(request) {
  try {
    return home(request);
  } catch (error) {
    tell("error", `${error.message}`.trim().split("\n").pop(), 0);
    over();
    return null;
  }
}

function soon(ms) {
  clearTimeout(timer);
  timer = setTimeout(step, ms);
}

function step() {
  if (isOver) return;
  const request = { do: "step", now: now(), in: incoming, room: isOpen() ? WAITING - socket.bufferedAmount : 0 };
  if (link) request.link = link;
  incoming = [];
  link = "";
  take(ask(request));
}

function take(answer) {
  if (answer === null) return;
  for (const packet of answer.out) if (isOpen()) socket.send(octets(packet));
  if (answer.acts.length) postMessage({ acts: answer.acts });
  if (answer.due === null) return over();
  soon(Math.max(0, answer.due - now()));
}

function over() {
  isOver = true;
  clearTimeout(timer);
  look();
  flush();
  if (socket !== null) socket.close(1000);
  postMessage({ over: true });
}

function look() {
  if (home === null) return;
  const seen = ask({ do: "look" });
  if (seen === null) return;
  postMessage({ look: seen });
  if ((seen.not_sent || 0) > notSent && now() - toldAt > 10000) {
    toldAt = now();
    tell("tooFast", `${seen.not_sent - notSent}`, 0);
    notSent = seen.not_sent;
  }
}

onmessage = async ({ data }) => {
  if (data.do === "ping") {
    postMessage({ pong: true });
  } else if (data.do === "device" && home !== null && !isOver) {
    ask(data);
  } else if (data.do === "hold") {
    isHeld = data.on;
    if (home !== null && !isOver) { ask({ do: "hold", on: isHeld, now: now() }); soon(0); }
  } else if (data.do === "stop" && home !== null && !isOver) {
    take(ask({ do: "end", now: now() }));
    step();
  } else if (data.do === "run") {
    address = data.address;
    home = await openHome(data.base, data.files, tell);
    postMessage({ ready: true });
    if (data.device) ask({ do: "device", values: data.device });
    const started = ask({ do: "start", program: data.program, name: data.name, uid: data.uid, now: now(), live: true });
    if (started === null) return;
    if (started.due === null) return over();
    if (isHeld) ask({ do: "hold", on: true, now: now() });
    connect();
    take(started);
    setInterval(flush, FLUSH_MS);
    setInterval(() => { if (!isOver) look(); }, LOOK_MS);
  }
};
