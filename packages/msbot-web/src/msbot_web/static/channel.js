// The page's connection for what is live. socket.io carries it; when to try, and what happens to a page that the robot
// does not know any more, is decided by `MsbotReconnect`: NiceGUI would load the page again and again.
//
// Loaded after socket.io and before NiceGUI connects.
const msbotChannel = (() => {
  const LEASE = `msbot-anew ${msbotAt("/")}`, LEASE_MS = 10000, PATIENCE_MS = 3000;
  const FIRST_TIMEOUT_MS = 4000, LONGEST_TIMEOUT_MS = 20000, FAILED = 2;
  const NOT_THERE = ["Implicit handshake failed", "try_reconnect"];
  const plan = new MsbotReconnect();
  const tab = `${Math.random()}`;
  let goTo = "";
  let socket = null, aliveAt = Date.now(), failures = 0, seen = null, wasHere = false;

  // One tab of a browser is made anew at a time, until it is connected or has had its time. Two that look in the same
  // instant both go: that is no harm.
  function mayGo(now) {
    try {
      const found = JSON.parse(localStorage.getItem(LEASE) || "null");
      if (found && found.tab !== tab && found.until > now && found.until <= now + LEASE_MS) return false;
      localStorage.setItem(LEASE, JSON.stringify({ tab, until: now + LEASE_MS }));
    } catch {
      // A browser that keeps nothing: each tab for itself.
    }
    return true;
  }

  function letOthersGo() {
    try {
      localStorage.removeItem(LEASE);
    } catch {
      // It keeps nothing.
    }
  }

  async function askForTurn() {
    if (!mayGo(Date.now())) return plan.later(Date.now());
    try {
      const answer = await fetch(msbotAt("/turn"), { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      if (answer.status === 401) return msbotSignIn();
      if (answer.ok) return plan.turn(Date.now(), (await answer.json()).wait_ms);
    } catch {
      // Refused, below.
    }
    letOthersGo();
    plan.refused(Date.now());
  }

  // How the robot sees this page's requests: a proxy that changes them keeps the connection from coming up.
  async function askHowSeen() {
    try {
      const answer = await fetch(msbotAt("/seen"), { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      if (answer.ok) seen = await answer.json();
    } catch {
      // The next failure asks again.
    }
  }

  function connected() {
    wasHere = true;
    failures = 0;
    seen = null;
    aliveAt = Date.now();
    plan.connected();
    letOthersGo();
  }

  function failed(error) {
    if (NOT_THERE.includes(error.message)) return plan.gone(Date.now(), document.visibilityState !== "visible");
    failures += 1;
    // What hangs is something between that lets no WebSocket through: the other way first from now on.
    if (error.message === "timeout") socket.io.opts.transports = ["polling", "websocket"];
    plan.lost(Date.now());
    askHowSeen();
  }

  function connect() {
    socket.io.opts.query.next_message_id = window.nextMessageId;
    socket.io.timeout(Math.min(FIRST_TIMEOUT_MS * 2 ** failures, LONGEST_TIMEOUT_MS));
    socket.connect();
  }

  const make = window.io;
  window.io = (address, options) => {
    const extraHeaders = { ...options.extraHeaders, "X-CSRF-Token": document.getElementById("ms-stop").dataset.csrf };
    socket = make(address, { ...options, extraHeaders, reconnection: false, timeout: FIRST_TIMEOUT_MS });
    const on = socket.on.bind(socket);
    on("connect", connected);
    on("disconnect", () => plan.lost(Date.now()));
    on("connect_error", failed);
    on("try_reconnect", () => failed({ message: "try_reconnect" }));
    socket.on = (event, handler) => (event === "connect_error" || event === "try_reconnect" ? socket : on(event, handler));
    return socket;
  };

  return {
    // To be called all the time: takes the step that is due, and gives the moment up to which the page was live.
    look(now, answers) {
      if (socket && socket.connected) aliveAt = now;
      const step = msbot.isSaying() ? "" : plan.step(now, answers);
      if (step === "connect") connect();
      else if (step === "turn") askForTurn();
      else if (step === "reload") goTo ? location.assign(msbotAt(goTo)) : location.reload();
      return aliveAt;
    },
    back: (now) => plan.back(now),
    // Another robot takes this one's place: what this page becomes when that one is there.
    comeBackTo(path) {
      goTo = path;
    },
    isChanging: () => goTo !== "",
    // Why nothing live comes: the name of the words on the STOP button, and what is put into them.
    trouble() {
      if (["anew", "asking", "turn", "leaving"].includes(plan.state)) return ["anew", {}];
      if (failures < FAILED) return [wasHere ? "apart" : "joining", {}];
      if (seen && seen.proxy) return ["untrusted", seen];
      if (seen && seen.address !== location.origin) return ["renamed", { ...seen, asked: location.origin }];
      return ["blocked", {}];
    },
  };
})();
