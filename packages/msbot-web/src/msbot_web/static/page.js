// What every page does in the browser by itself: watch whether the robot is there, STOP, and drawers that Back closes.
// It works without the websocket, so that STOP is said, and a dead master is seen, when that is gone.

// Before anything of the page is seen: whoever has it read aloud hears the first word in its language, scripts write
// their numbers in it, and easy texts have larger letters.
{
  const { language, easy } = document.querySelector("meta[name=ms-page]").dataset;
  document.documentElement.lang = language;
  document.documentElement.classList.toggle("ms-easy", easy !== undefined);
}

// Where a path of the robot's page is: behind a proxy it may be in a folder of another site.
const msbotRoot = new URL(document.currentScript.src).pathname.replace(/\/web\/page\.js$/, "");
const msbotAt = (path) => msbotRoot + path;

// When the server does not let this page in any more (it was started anew, the person was signed out elsewhere),
// go and sign in again, and come back to the same view.
function msbotSignIn() {
  const path = location.pathname.startsWith(msbotAt("/")) ? location.pathname.slice(msbotRoot.length) : "/";
  location.href = msbotAt("/login?next=") + encodeURIComponent(path + location.search);
}

const msbot = (() => {
  const ASK_MS = 600, PATIENCE_MS = 1200, DEAD_MS = 1800, LOOK_MS = 200, RETRY_MS = 1000, TWICE_MS = 800;
  const TOLD_MS = 1300;  // the robot says twice in three looks at most that it is there; then it is asked
  const LONG_MS = 8000, SELDOM_MS = 1500;  // who has not been heard for so long is asked less often
  let toldAt = -Infinity, heardAt = Date.now(), lookedAt = Date.now(), isAsking = false;
  let isDead = false, isSaying = false, stopTimer = null, stopPress = "", escapeAt = -Infinity;

  const words = (name) => document.getElementById("ms-stop").dataset[name];

  function say(id, text, kind) {
    const bar = document.getElementById(id);
    if (bar.textContent !== text) bar.textContent = text;
    bar.className = "ms-alarm " + (text ? kind : "");
  }

  async function ask() {
    if (isAsking) return;
    isAsking = true;
    try {
      const answer = await fetch(msbotAt("/beat"), { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      if (answer.status === 401) return msbotSignIn();
      if (answer.ok) heard();
    } catch {
      // No answer: the age of the last one tells.
    } finally {
      isAsking = false;
    }
  }

  function heard() {
    const now = Date.now(), wasSilent = now - heardAt > DEAD_MS;
    heardAt = now;
    if (wasSilent && hasChannel()) msbotChannel.back(now);
  }

  // Where the robot says by itself that it is there (`live.js`), nobody asks: heard only lately, or hidden.
  function keepAsking() {
    const isTold = hasLive() && (msbotLive.isResting() || Date.now() - toldAt < TOLD_MS);
    if (isTold && msbotLive.isResting()) heardAt = Date.now();
    if (!isTold) ask();
    const isAway = Date.now() - heardAt > LONG_MS;
    setTimeout(keepAsking, isAway ? SELDOM_MS * (0.5 + Math.random()) : ASK_MS);
  }

  // What the robot said by itself.
  function told() {
    toldAt = Date.now();
    heard();
  }

  // A page of refusal has none.
  const hasLive = () => typeof msbotLive !== "undefined";
  const hasChannel = () => typeof msbotChannel !== "undefined";

  // Grey as soon as nothing was heard for a while; at once after the device has slept, until the robot answers again.
  // A connection that has never come up is no life either.
  function look() {
    const now = Date.now();
    const slept = now - lookedAt > DEAD_MS && document.visibilityState === "visible";
    lookedAt = now;
    if (slept) ask();
    const answers = now - heardAt <= DEAD_MS;
    const aliveAt = hasChannel() ? msbotChannel.look(now, answers) : now;
    const age = now - Math.min(heardAt, aliveAt);
    isDead = age > DEAD_MS;
    document.documentElement.classList.toggle("ms-dead", isDead);
    say("ms-lost", isDead ? why(answers, age) : "", "bad");
  }

  function why(answers, age) {
    if (hasChannel() && msbotChannel.isChanging()) return words("changing");
    const [name, values] = answers && hasChannel() ? msbotChannel.trouble() : ["lost", {}];
    const filled = { ...values, seconds: Math.round(age / 1000) };
    return words(name).replace(/\{(\w+)\}/g, (_, key) => filled[key]);
  }

  // Each press has a name: what is said again because its answer was late is no second STOP, also after a GO.
  function stop() {
    stopPress = `${Date.now()}-${Math.random()}`;
    isSaying = true;
    sayStop(stopPress);
  }

  async function sayStop(press) {
    clearTimeout(stopTimer);
    say("ms-stop-says", words("saying"), "warn");
    const began = performance.now();
    try {
      const answer = await fetch(msbotAt("/api/stop"), {
        method: "POST", body: "{}", cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS),
        headers: { "Content-Type": "application/json", "X-CSRF-Token": words("csrf"), "X-Stop-Press": press },
      });
      const done = await answer.json();
      if (answer.ok) {
        const ms = Math.round(performance.now() - began);
        const told = `${words("told")} (${ms} ms)`;
        if (done.stored) say("ms-stop-says", told, "good");
        else say("ms-stop-says", `${told} ${words("unstored")}`, "warn");
        stopTimer = setTimeout(stopSaid, done.stored ? 6000 : 30000);
        return;
      }
      isSaying = false;
      // 409: this press was obeyed before, and somebody has said GO since.
      say("ms-stop-says", answer.status === 409 ? done.error : `${words("refused")} ${done.error}`, "bad");
    } catch {
      if (press !== stopPress) return;
      // It goes on trying: whoever pressed STOP means it, until the robot has heard it.
      say("ms-stop-says", words("undelivered"), "bad");
      stopTimer = setTimeout(() => sayStop(press), RETRY_MS);
    }
  }

  function stopSaid() {
    isSaying = false;
    say("ms-stop-says", "", "");
  }

  function key(event) {
    if (event.key !== "Escape" || event.repeat) return;
    // When it was pressed, not when a busy page comes to it: two that were quick enough are STOP, however late.
    if (event.timeStamp - escapeAt <= TWICE_MS) {
      escapeAt = -Infinity;
      stop();
    } else escapeAt = event.timeStamp;
  }

  // What is clicked while the robot does not answer would be done whenever it goes on again: a GO, too.
  function refuse(event) {
    if (!isDead || event.target.closest("#ms-stop, a[href]")) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  // Drawers and dialogs: Back closes the one on top before it leaves the page. What is open has an entry in the history,
  // as deep as it lies. What is closed by its button leaves its entry to the next that is opened, or to Back: we never go
  // back on our own while something is open, which a Back of the person's at that moment would become one with.
  const closers = [], addresses = new Map();
  let depth = 0, bare = location.href;
  function entry() {  // one of a page that was loaded before had the same numbers
    const found = history.state && history.state.msbot;
    return found && found.page === performance.timeOrigin ? found : null;
  }
  function mark(isNew) {
    const state = { ...history.state, msbot: { page: performance.timeOrigin, depth, open: [...closers] } };
    history[isNew ? "pushState" : "replaceState"](state, "", closers.length ? addresses.get(closers.at(-1)) : bare);
  }
  function opened(id, address) {
    if (!closers.length) bare = location.href;
    if (!entry()) mark(false);
    closers.push(id);
    addresses.set(id, address ? msbotAt(address) : location.href);
    const isNew = closers.length > depth;
    if (isNew) depth += 1;
    mark(isNew);
  }
  function forget(at) {
    const [id] = closers.splice(at, 1);
    addresses.delete(id);
    return id;
  }
  function closed(id) {
    const at = closers.lastIndexOf(id);
    if (at < 0) return;
    forget(at);
    mark(false);
  }
  function passed() {  // Back or Forward, or a link into the page, which makes an entry of its own
    const before = depth, found = entry();
    depth = found ? found.depth : 0;
    const isBack = depth < before;
    if (found && isBack && !closers.length) history.go(-depth - 1);  // there is nothing to close: it means the page
    if (!closers.length) return;
    const most = Math.min(depth, isBack ? closers.length - 1 : closers.length);
    while (closers.length > most) emitEvent(`ms_close_${forget(closers.length - 1)}`);
    mark(false);
  }

  // The small page that is shown while no robot answers (`service_worker.js`): only where the browser keeps any.
  function keepShell() {
    const kept = navigator.serviceWorker && navigator.serviceWorker.register(msbotAt("/service-worker.js"), { scope: msbotAt("/") });
    if (kept) kept.catch(() => {});  // it keeps nothing: its own error is shown then
  }

  addEventListener("click", refuse, true);
  addEventListener("keydown", key, true);
  addEventListener("popstate", passed);
  addEventListener("online", ask);
  addEventListener("pageshow", () => { look(); ask(); });
  addEventListener("pagehide", () => window.socket && socket.emit("left", { client_id: window.clientId }));
  document.addEventListener("visibilitychange", () => { look(); ask(); });
  addEventListener("DOMContentLoaded", () => {
    document.getElementById("ms-stop").addEventListener("click", stop);
    const tooLong = document.getElementById("too_long_message_popup");
    if (tooLong) tooLong.replaceChildren(Object.assign(document.createElement("span"), { textContent: words("long") }));
    keepAsking();
    setInterval(look, LOOK_MS);
    keepShell();
  });
  // Whether a STOP is on its way, or its answer is being read: a page that were loaded anew now would lose it.
  return { stop, opened, closed, heard: told, isSaying: () => isSaying };
})();

// From now on the robot is told whether the page is dark, and whenever that changes: editors look like their page.
const msbotLook = (() => {
  let told = null;
  function tell() {  // the class is written again and again
    const isDark = document.body.classList.contains("body--dark");
    if (isDark !== told) emitEvent("ms_look", told = isDark);
  }
  const observer = new MutationObserver(tell);
  return () => {
    told = null;
    tell();
    observer.observe(document.body, { attributes: true, attributeFilter: ["class"] });
  };
})();

// The text that an editor keeps when the robot changes anything else of it (`Editor`). Past Vue, which would draw the
// page anew for each letter.
function msbotTyped(id) {
  const editor = getElement(id);
  if (editor && editor.editor) Vue.toRaw(mounted_app.elements[id].props).value = editor.editor.state.doc.toString();
}

// What was put before the page had its robot is said as soon as it has; later, a page without its robot takes no press.
function msbotSaidLater(slider) {
  if (slider.dataset.waits) return;
  slider.dataset.waits = "1";
  const look = setInterval(() => {
    if (!window.did_handshake || !window.socket.connected) return;
    clearInterval(look);
    delete slider.dataset.waits;
    slider.dispatchEvent(new Event("input"));
  }, 50);
}

// Where a slider was put (`Slider`), and how that is said: past Vue as well, which would put it back.
function msbotSlid(id, slider) {
  const value = slider.valueAsNumber.toLocaleString(document.documentElement.lang, { maximumSignificantDigits: 4 });
  const text = `${value} ${slider.dataset.unit}`.trim(), props = Vue.toRaw(mounted_app.elements[id].props);
  slider.setAttribute("aria-valuetext", text);
  Object.assign(props, { value: slider.value, "aria-valuetext": text });
  if (!window.did_handshake) msbotSaidLater(slider);
}

// The numbers behind entries of the menu, by their paths; none at 0.
function msbotMenuCounts(numbers) {
  for (const [path, number] of Object.entries(numbers)) {
    for (const count of document.querySelectorAll(`.ms-nav [data-count="${path}"]`)) {
      count.textContent = number;
      count.hidden = !number;
    }
  }
}

// Where the cards are; what is live of them comes by `msbotLive`.
function msbotLiveCards(grid) {
  msbotLive.show("cards", (cards) => msbotCards(grid, cards));
}

// Cards of slots that look otherwise now, by the name of the slot: [HTML, name, is it plugged in, what the plug's button
// does, the word on it]; by `now:` and that name only the value: [picture, words, curve], as HTML; by `ring:` only the
// ring: [its words, how much of it is missing, how it goes on, the number in it].
function msbotCards(grid, cards) {
  const root = document.getElementById(grid);
  if (!root) return;
  for (const place of root.querySelectorAll("[data-slot]")) {
    const name = place.dataset.slot;
    const found = cards[name], now = cards[`now:${name}`], ring = cards[`ring:${name}`];
    if (found) {
      place.innerHTML = found[0];
      if (place.getAttribute("aria-label") !== found[1]) place.setAttribute("aria-label", found[1]);
    }
    if (now) msbotValue(place.querySelector(".body"), now);
    if (ring && !found) msbotRing(place.querySelector(".head > svg"), ring);
  }
  for (const plug of root.querySelectorAll("[data-plug]")) {
    const found = cards[plug.dataset.plug];
    if (!found) continue;
    plug.firstElementChild.textContent = found[2] ? "power_off" : "power";
    plug.title = found[3];
    plug.setAttribute("aria-label", found[3]);
    plug.querySelector(".plug-words").textContent = found[4];
  }
}

// The value on a card. What is shown stands before the words about its wire.
function msbotValue(body, [picture, words, curve]) {
  const values = body && body.querySelector(".vals"), wire = values && values.querySelector(".wire");
  if (!wire) return;  // a card without a port
  while (values.firstChild !== wire) values.firstChild.remove();
  wire.insertAdjacentHTML("beforebegin", `${words}\n`);
  values.previousElementSibling.outerHTML = picture;
  const drawn = values.nextElementSibling;
  if (drawn) drawn.outerHTML = curve;
}

// A new ring in place of an old one: its animation begins anew.
function msbotRing(old, [words, gap, animation, life]) {
  if (!old) return;
  const ring = old.cloneNode(true), turning = ring.querySelector(".beat-now");
  ring.setAttribute("aria-label", words);
  ring.querySelector("title").textContent = words;
  turning.setAttribute("stroke-dashoffset", gap);
  if (animation) turning.setAttribute("style", `animation:${animation}`);
  else turning.removeAttribute("style");
  ring.querySelector(".life").textContent = life;
  old.replaceWith(ring);
}

// The frame around what the tour is talking about; '' takes it away.
function msbotFrame(selector) {
  for (const framed of document.querySelectorAll(".ms-framed")) framed.classList.remove("ms-framed");
  let found = selector && document.querySelector(selector);
  if (!found) return;
  // An entry of a menu that is closed: the button that opens it.
  if (found.getBoundingClientRect().right <= 0) found = document.querySelector(".ms-header button");
  found.classList.add("ms-framed");
  // What begins in the upper half of the page is shown with what stands above it.
  if (found.getBoundingClientRect().top + scrollY < innerHeight / 2) scrollTo(0, 0);
  else found.scrollIntoView({ block: "center", behavior: "auto" });
}

// Show other lines in an element; while somebody marks text in it, not before he has let go of it.
function msbotLines(id, content) {
  const shown = document.getElementById(id);
  if (!shown) return;
  const isMarked = () => {
    const mark = getSelection();
    return !!mark && !mark.isCollapsed && (shown.contains(mark.anchorNode) || shown.contains(mark.focusNode));
  };
  const isWaiting = shown.msbotLater !== undefined;
  shown.msbotLater = content;
  if (isWaiting) return;
  const look = () => {
    if (isMarked()) return;
    document.removeEventListener("selectionchange", look);
    shown.innerHTML = shown.msbotLater;
    shown.msbotLater = undefined;
  };
  document.addEventListener("selectionchange", look);
  look();
}

// NiceGUI sets light or dark anew whenever it draws the page anew, and the browser then works out all styles.
addEventListener("DOMContentLoaded", () => {
  const set = window.setDark;
  let known;
  if (set)
    window.setDark = (look) => {
      if (known && known[0] === look) return;
      known = [look];
      set(look);
    };
});
