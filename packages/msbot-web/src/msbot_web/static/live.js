// What all viewers of this page see comes here, as one message of changes twice a second at most (`live_channel.py`).
// Each message also says that the robot is there: while they come, the page need not ask.
const msbotLive = (() => {
  const FIRST_MS = 1000, LONGEST_MS = 30000, HIDDEN = "hidden", SHOWN = "shown";
  const shows = {}, known = {};
  const canUnpack = typeof DecompressionStream === "function";
  let socket = null, wait = FIRST_MS;
  let reading = Promise.resolve();  // one after the other: what comes packed is there a little later

  function open() {
    if (!window.clientId || !window.WebSocket) return later();
    const place = new URL(msbotAt("/live"), location.href);
    place.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    place.search = new URLSearchParams({ page: window.clientId, packed: canUnpack ? "1" : "0" });
    socket = new WebSocket(place);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { if (document.hidden) socket.send(HIDDEN); };
    const from = socket;
    socket.onmessage = ({ data }) => {
      wait = FIRST_MS;
      msbot.heard();
      if (data === ".") return;
      const text = typeof data === "string" ? data : unpacked(data);
      // What cannot be unpacked is missing: the next connection begins with the whole.
      reading = reading.then(() => text).then(take, () => from.close()).catch(console.error);
    };
    socket.onclose = () => {
      socket = null;
      later();
    };
  }

  const unpacked = (octets) =>
    new Response(new Blob([octets]).stream().pipeThrough(new DecompressionStream("deflate"))).text();

  function take(text) {
    for (const [name, news] of Object.entries(JSON.parse(text))) {
      known[name] = Object.assign(known[name] || {}, news);
      if (shows[name]) shows[name](news);
    }
  }

  // A robot that is restarted is not asked by all of a class in the same instant.
  function later() {
    setTimeout(open, wait * (0.5 + Math.random()));
    wait = Math.min(2 * wait, LONGEST_MS);
  }

  const isOpen = () => socket !== null && socket.readyState === WebSocket.OPEN;

  document.addEventListener("visibilitychange", () => {
    if (isOpen()) socket.send(document.hidden ? HIDDEN : SHOWN);
  });
  addEventListener("DOMContentLoaded", () => setTimeout(open, 0));

  return {
    // Draw what comes under a name with a function of it.
    show(name, draw) {
      shows[name] = draw;
      if (known[name]) draw(known[name]);
    },
    // A hidden tab is told nothing, and does not ask: the robot's end of the connection would be noticed.
    isResting: () => document.hidden && isOpen(),
  };
})();
