// What all viewers of this page see comes here, as one message of changes twice a second at most (`live_channel.py`).
// Each message also says that the robot is there: while they come, the page need not ask.
const msbotLive = (() => {
  const FIRST_MS = 1000, LONGEST_MS = 30000, HIDDEN = "hidden", SHOWN = "shown";
  const shows = {}, known = {};
  let socket = null, wait = FIRST_MS;

  function open() {
    if (!window.clientId || !window.WebSocket) return later();
    const place = new URL(msbotAt("/live"), location.href);
    place.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    place.search = new URLSearchParams({ page: window.clientId });
    socket = new WebSocket(place);
    socket.onopen = () => { if (document.hidden) socket.send(HIDDEN); };
    socket.onmessage = ({ data }) => {
      wait = FIRST_MS;
      msbot.heard();
      if (data === ".") return;
      for (const [name, news] of Object.entries(JSON.parse(data))) {
        known[name] = Object.assign(known[name] || {}, news);
        if (shows[name]) shows[name](news);
      }
    };
    socket.onclose = () => {
      socket = null;
      later();
    };
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
