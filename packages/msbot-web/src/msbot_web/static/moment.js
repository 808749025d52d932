// The time slider: which moment a page shows. Its range is seconds before now; what is read comes from the robot.
const msbotMoment = (() => {
  const ASK_MS = 150, LIVE_S = 0.5, EACH_MS = 1000, MINUTE_S = 60;
  let ahead = 0, begin = 0, end = null, work = 0, at = null, zone = 0, words = {}, paths = [], asking = null, wanted = null;
  let told = 0;  // the "now" that the slider's seconds count from: a press half a second later means the same moment

  const part = (name) => document.getElementById(name ? `ms-moment-${name}` : "ms-moment");
  const now = () => Date.now() + ahead;
  const hour = (when) => new Date(when + zone).toISOString().slice(11, 21);
  const span = (seconds) => (seconds < MINUTE_S ? `${Math.max(seconds, 0).toFixed(0)} s`
    : `${Math.floor(seconds / MINUTE_S)} min ${Math.floor(seconds % MINUTE_S)} s`);

  function take(setup) {
    ahead = setup.now - Date.now();
    ({ begin, end, work, at, zone, words, paths } = setup);
    part("trouble").textContent = setup.trouble;
  }

  // What is shown has changed: the bar, the address, and where the menu leads to.
  function show(setup) {
    if (!part()) return;
    take(setup);
    document.documentElement.classList.toggle("ms-past", at !== null);
    document.documentElement.classList.remove("ms-reading");
    if (asking === null) wanted = null;
    const address = new URL(location.href);
    if (at === null) address.searchParams.delete("at");
    else address.searchParams.set("at", Math.round(at));
    if (address.href !== location.href) history.replaceState(history.state, "", address);
    for (const link of document.querySelectorAll(".ms-nav a")) {
      const path = new URL(link.href).pathname;
      if (paths.includes(path)) link.setAttribute("href", at === null ? path : `${path}?at=${Math.round(at)}${work ? `&work=${work}` : ""}`);
    }
    part("back").hidden = at === null;
    part("later").disabled = at === null || (end !== null && Math.round(at) >= Math.floor(end));
    tell();
  }

  // This robot has no past.
  function hide() {
    part().parentElement.hidden = true;
  }

  function reading() {
    document.documentElement.classList.add("ms-reading");
    part("says").textContent = words.reading;
  }

  function tell() {
    if (!part()) return;
    const slider = part("at"), when = wanted === null ? at : wanted;
    told = now();
    slider.min = Math.floor((begin - told) / 1000);
    slider.max = end === null ? 0 : Math.ceil((end - told) / 1000);
    slider.value = when === null ? 0 : (when - told) / 1000;
    const text = when === null ? words.now : words.past.replace("{time}", hour(when));
    const ago = when === null ? "" : words.ago.replace("{span}", span((now() - when) / 1000));
    slider.setAttribute("aria-valuetext", `${text} ${ago}`);
    part("ago").textContent = ago;
    if (!document.documentElement.classList.contains("ms-reading") && part("says").textContent !== text) part("says").textContent = text;
  }

  // The robot is asked when a person has come to rest for a moment; the bar follows at once.
  function ask(when) {
    wanted = when;
    clearTimeout(asking);
    asking = setTimeout(() => {
      asking = null;
      emitEvent("ms_moment", when);
    }, when === null ? 0 : ASK_MS);
    tell();
  }

  function step(seconds) {
    const from = wanted === null ? (at === null ? now() : at) : wanted;
    const to = Math.min(Math.max(from + seconds * 1000, begin), end === null ? Infinity : end);
    ask(now() - to < LIVE_S * 1000 && end === null ? null : to);
  }

  function back() {
    clearTimeout(asking);
    asking = wanted = null;
    emitEvent("ms_moment", null);
  }

  function listen() {
    part("at").addEventListener("input", (event) => {
      const seconds = Number(event.target.value);
      ask(seconds > -LIVE_S && end === null ? null : Math.min(told + seconds * 1000, end === null ? Infinity : end));
    });
    part("earlier").addEventListener("click", () => step(-1));
    part("later").addEventListener("click", () => step(1));
    part("back").addEventListener("click", back);
    // Escape closes what is open first; twice in a row it is STOP, wherever one looks.
    addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || event.repeat || at === null || document.querySelector(".q-dialog, .q-menu")) return;
      back();
    });
    setInterval(tell, EACH_MS);
  }

  function start(setup) {
    if (!part()) return setTimeout(() => start(setup), 30);
    take(setup);
    listen();
    tell();
  }

  // What time it is on the robot's computer: the setup that the slider began with was written before the page was loaded.
  function clock(its) {
    if (!part()) return setTimeout(() => clock(its), 30);
    ahead = its - Date.now();
    tell();
  }

  return { begin: start, show, hide, reading, clock };
})();
