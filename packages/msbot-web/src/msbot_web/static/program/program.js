// The page Program: runs what is in the editor in a worker, and shows what it says and how its part is. Nothing here
// needs the server while a program runs; texts from the program are shown as text, never as HTML.

const msbotProgram = (() => {
  const SILENT_MS = 2500, PING_MS = 500, END_MS = 1500, MOST_LINES = 500, DEVICE_MS = 50, TYPED = "msbot_typed", FRESH_MS = 10000;
  let worker = null, files = null, editor = 0, name = "program.py", askedAt = null, isStuck = false, stuckRow = null, watch = null, ending = null;
  let begun = 0, tellOpened = null, held = "", person = "";
  const isOpened = new Promise((done) => { tellOpened = done; });
  let device = {}, sent = "", audio = null, deviceTimer = null, hasTilt = false;

  const at = (id) => document.getElementById(id);
  const words = () => JSON.parse(at("ms-prog").dataset.words);
  const say = (key, values = {}) => words()[key].replace(/{(\w+)}/g, (_, found) => values[found]);
  const text = () => getElement(editor).editor.state.doc.toString();

  // What MsBOT's part and Python say, in the person's language and with a hint; what is not known stays as it is.
  let forms = null;
  function told(text) {
    forms = forms || Object.entries(words().said).map(([form, mine]) => {
      const names = [], plain = form.replace(/[.*+?^$()|[\]\\]/g, "\\$&");
      const pattern = plain.replace(/{(\w+)}/g, (_, found) => { names.push(found); return "(.+?)"; });
      return [new RegExp(`^${pattern}$`, "s"), names, mine];
    });
    const place = text.match(/^(\S+:\d+(?: in \S+)?|\w+Error): (.+)$/s);
    if (place) return `${place[1]}: ${told(place[2])}`;
    for (const [pattern, names, mine] of forms) {
      const found = text.match(pattern), raw = (name) => found[names.indexOf(name) + 1], states = words().states;
      if (!found || (names.includes("state") && !states[raw("state")])) continue;
      const value = (name) => name === "state" ? states[raw(name)] : told(raw(name));
      return mine.replace(/{(\w+)}/g, (_, name) => value(name));
    }
    return text;
  }

  function line(kind, content, where) {
    write([[kind, content, where]]);
  }

  // All that came at once in one go: a program that prints without end must not keep the page from being drawn.
  function write(lines) {
    if (!lines.length) return;
    const log = at("ms-console"), rows = document.createDocumentFragment();
    const isAtEnd = log.scrollHeight - log.scrollTop - log.clientHeight < 40;
    for (const [kind, content, where] of lines) {
      const row = document.createElement("div");
      row.className = `ms-said ms-said-${kind}`;
      row.textContent = content;
      if (where) {
        const go = document.createElement("button");
        go.type = "button";
        const isOfBlock = kind === "error" && msbotBlocks.light(where, content);
        go.textContent = isOfBlock ? say("block") : say("line", { number: where });
        go.onclick = () => { if (!msbotBlocks.reveal(where)) emitEvent("ms_program_line", { lines: [where], show: true }); };
        row.append(" ", go);
      }
      rows.append(row);
    }
    log.append(rows);
    while (log.childElementCount > MOST_LINES) log.firstElementChild.remove();
    if (isAtEnd) log.scrollTop = log.scrollHeight;
  }

  const looks = { active: "active", standby: "standby", refused: "refused", "wrong robot": "refused", lost: "lost", ended: "empty" };

  function state(word, look, reason) {
    const chip = at("ms-prog-state"), shown = words().states[word] || word;
    if (chip.textContent !== shown) chip.textContent = shown;
    chip.className = `state s-${look}`;
    chip.dataset.state = word;
    const told = at("ms-prog-reason");
    if (told.textContent !== reason) told.textContent = reason;
  }

  const arrows = { in: "←", out: "→", serve: "⇠", call: "⇢" };

  function show(seen) {
    if (isStuck) return;
    if (!seen.state) return;
    const reason = (held ? held + ". " : "") + (seen.slot ? say("slot", { slot: seen.slot }) + ". " : "") + (seen.stopped ? say("stopped") + ". " : "") +
      (seen.state === "refused" ? `${told(seen.reason)}. ${say(seen.describes ? "describes" : seen.reason === words().no_slot ? "waits" : "adopt", { number: seen.number })}`
        : seen.slot ? "" : told(seen.reason));
    showAdopt(seen.state === "refused", seen.describes);
    // What a refused part calls a full robot is, for people, a spare that waits.
    const word = seen.state === "refused" && seen.reason === words().no_slot ? "standby" : seen.state;
    state(word, looks[word] || "checking", reason);
    const rows = seen.ports.map(([port, way, type, topic, age, shown]) => {
      const row = document.createElement("tr");
      const cells = [`${port} ${arrows[way]}`, type, age === null ? (topic || !seen.slot ? "–" : say("unwired")) : `${shown} (${(age / 1000).toFixed(1)} s)`];
      for (const cell of cells) row.append(Object.assign(document.createElement("td"), { textContent: cell }));
      row.firstElementChild.title = topic;
      row.lastElementChild.className = "ms-last num";
      return row;
    });
    if (rows.length) at("ms-prog-ports").replaceChildren(...rows);
    at("ms-prog-settings").textContent = seen.settings.map(([key, value]) => `${key} = ${value}`).join(", ");
  }

  function showAdopt(isRefused, describes) {
    at("ms-prog-adopt").hidden = !isRefused;
    const button = document.querySelector("#ms-prog-adopt button");
    if (button === null) return;
    button.hidden = !describes;
    button.onclick = () => emitEvent("ms_program_adopt", { uid: uid() });
  }

  // The device's sensors, and what the program does with it.

  function measure() {
    const now = new Date();
    device.clock = [now.getHours(), now.getMinutes(), now.getSeconds()];
    device.slider = Number(at("ms-device-slider").value);
    const values = JSON.stringify(device);
    if (worker !== null && values !== sent) worker.postMessage({ do: "device", values: device });
    sent = values;
    if (!hasTilt) at("ms-device-tilt").textContent = say(window.isSecureContext ? "noTilt" : "tiltNeedsTls");
  }

  function tilted({ alpha, beta, gamma }) {
    if (beta === null) return;
    hasTilt = true;
    device.tilt = [gamma, beta, alpha || 0].map((angle) => Math.round(angle * 10) / 10);
    at("ms-device-tilt").textContent = say("tilt") + " " + device.tilt.map((angle) => `${angle}°`).join(" / ");
  }

  function act([kind, ...values]) {
    if (kind === "colour") at("ms-device-colour").style.background = `rgb(${values.map(Number).join(",")})`;
    if (kind === "vibrate" && navigator.vibrate) navigator.vibrate(Number(values[0]) * 1000);
    if (kind === "tone" && audio !== null) sound(Number(values[0]), Number(values[1]));
  }

  let voice = null;
  function sound(hertz, seconds) {
    if (voice !== null) voice.stop();
    voice = null;
    if (!(hertz > 0)) return;
    const volume = audio.createGain();
    volume.gain.value = 0.1;
    volume.connect(audio.destination);
    voice = audio.createOscillator();
    voice.frequency.value = hertz;
    voice.connect(volume);
    voice.start();
    voice.stop(audio.currentTime + seconds);
  }

  function useDevice(isUsed) {
    at("ms-device").hidden = !isUsed;
    clearInterval(deviceTimer);
    window.removeEventListener("deviceorientation", tilted);
    if (!isUsed) return;
    audio = audio || new AudioContext();
    audio.resume();
    const ask = window.DeviceOrientationEvent && DeviceOrientationEvent.requestPermission;
    if (ask) DeviceOrientationEvent.requestPermission().catch(() => {});
    window.addEventListener("deviceorientation", tilted);
    for (const button of document.querySelectorAll(".ms-device-button")) {
      const press = (isDown) => { device[`button${button.dataset.button}`] = isDown; button.classList.toggle("down", isDown); };
      button.onpointerdown = () => press(true);
      button.onpointerup = button.onpointerleave = button.onpointercancel = button.onblur = () => press(false);
      button.onkeydown = (event) => { if (event.key === " " || event.key === "Enter") press(true); };
      button.onkeyup = () => press(false);
    }
    measure();
    deviceTimer = setInterval(measure, DEVICE_MS);
  }

  // Running.

  // One piece of hardware for each tab: two tabs are two parts, and one that is loaded again is the same.
  function uid() {
    let found = sessionStorage.getItem("msbot_uid");
    if (!found) {
      found = Array.from(crypto.getRandomValues(new Uint8Array(8)), (octet) => octet.toString(16).padStart(2, "0")).join("");
      sessionStorage.setItem("msbot_uid", found);
    }
    return found;
  }

  async function run() {
    finish();
    at("ms-console").replaceChildren();
    emitEvent("ms_program_line", { lines: [], show: false });
    const mine = ++begun;
    if (!editor) { // pressed before the server has told which program it is
      state("starting", "new", "");
      await isOpened;
      if (mine !== begun) return;
    }
    msbotBlocks.began();
    const program = text();
    useDevice(/^\s*(import|from)\s+device\b/m.test(program));
    state("starting", "new", "");
    try {
      files = files || (await (await fetch(msbotAt("/program/files.json"))).json());
    } catch {
      if (mine !== begun) return;
      line("error", say("noFiles"), 0);
      return finish();
    }
    if (mine !== begun) return; // stopped meanwhile, or begun once more
    const one = (worker = new Worker(msbotAt("/program/worker.js"), { type: "module" }));
    worker.onmessage = ({ data }) => { if (worker === one) heard(data); };
    worker.onerror = (event) => { if (worker === one) { line("error", event.message || say("noFiles"), 0); finish(); } };
    askedAt = null;
    worker.postMessage({
      do: "hold", on: held !== "",
    });
    worker.postMessage({
      do: "run", base: location.origin + msbotRoot, address: location.origin.replace("http", "ws") + msbotAt("/api/link"), files, program, name, uid: uid(), device,
    });
    document.documentElement.classList.add("ms-runs");
    sessionStorage.setItem("msbot_runs", name);
  }

  function heard(data) {
    // What comes before, loading the VM, may take long, and is no function of the program.
    if (data.ready) watch = setInterval(look, PING_MS);
    if (data.pong) {
      askedAt = null; // in a hidden tab pings are rare, answers are not
      isStuck = false;
    }
    const marks = [], lines = [];
    for (const [kind, content, where] of data.said || []) {
      if (kind === "tooFast") lines.push(["error", say("tooFast", { number: content }), 0]);
      else if (kind === "print") lines.push([kind, content, where]);
      else lines.push(kind === "info" ? [kind, `# ${told(content)}`, where] : ["error", told(content), where]);
      if (where) marks.push(where);
    }
    if (data.left) lines.push(["error", say("left", { number: data.left }), 0]);
    write(lines);
    if (marks.length) emitEvent("ms_program_line", { lines: marks, show: false });
    if (data.look) show(data.look);
    for (const one of data.acts || []) act(one);
    if (data.over) finish();
  }

  // A function that never ends: the browser goes on, and the person is told what to do.
  function look() {
    const silent = askedAt === null ? 0 : performance.now() - askedAt;
    if (silent > SILENT_MS) {
      if (!isStuck || !stuckRow.isConnected) { // a program that prints in its loop pushes it out of the console
        line("error", say("stuck"), 0);
        stuckRow = at("ms-console").lastElementChild;
      }
      isStuck = true;
      state("busy", "lost", say("stuckFor", { seconds: Math.round(silent / 1000) }));
    }
    if (askedAt === null) askedAt = performance.now();
    worker.postMessage({ do: "ping" });
  }

  function stop() {
    if (worker === null) return finish();
    if (isStuck) {
      line("info", `# ${say("killed")}`, 0);
      return finish();
    }
    worker.postMessage({ do: "stop" });
    clearTimeout(ending);
    ending = setTimeout(() => { if (worker !== null) { line("info", `# ${say("killed")}`, 0); finish(); } }, END_MS);
  }

  function finish() {
    begun += 1; // what is being begun is not wanted any more
    clearInterval(watch);
    clearTimeout(ending);
    clearInterval(deviceTimer);
    if (voice !== null) voice.stop();
    voice = null;
    if (worker !== null) worker.terminate();
    worker = null;
    isStuck = false;
    document.documentElement.classList.remove("ms-runs");
    sessionStorage.removeItem("msbot_runs");
    showAdopt(false);
    state("not running", "empty", "");
  }

  // The same program on a board.

  let board = null;

  async function showBoard() {
    await isOpened;
    const panel = at("ms-board");
    panel.hidden = !panel.hidden;
    if (panel.hidden) return void leaveBoard();
    at("ms-board-command").textContent = `msbot board run ${name}`;
    const isThere = msbotBoard.isThere();
    at("ms-board-none").hidden = isThere;
    at("ms-board-form").hidden = !isThere;
    tellBoard("", "");
    panel.scrollIntoView({ block: "nearest" });
  }

  function tellBoard(words, kind) {
    const told = at("ms-board-state");
    told.textContent = words;
    told.className = kind === "error" ? "ms-said-error" : "soft";
    told.dataset.kind = kind;
  }

  function settings() {
    const link = at("ms-board-link").value.trim(), found = {};
    if (!link) return null;
    found.link = link;
    const wifi = at("ms-board-wifi").value;
    if (wifi) found.wifi = [wifi, at("ms-board-password").value];
    if (at("ms-board-token").value.trim()) found.token = at("ms-board-token").value.trim();
    return found;
  }

  async function putOnBoard() {
    if (!editor) await isOpened;
    const bar = at("ms-board-bar"), button = at("ms-board-put"), program = text(), file = name;
    let port;
    try {
      port = await navigator.serial.requestPort();
    } catch {
      return tellBoard(say("boardNoPort"), "error");
    }
    await leaveBoard();
    const mine = (board = new msbotBoard.Board(port));
    button.disabled = true;
    bar.hidden = false;
    bar.removeAttribute("value");
    tellBoard(say("boardAsks"), "");
    const packageFiles = async (mpy) => {
      const answer = await fetch(msbotAt(`/program/board.json?mpy=${mpy}`)).catch(() => null);
      if (!answer || !answer.ok) throw new BoardError("noFiles");
      return answer.json();
    };
    const tell = (done, all) => {
      bar.max = all;
      bar.value = done;
      tellBoard(say("boardWrites", { done: Math.ceil(done / 1024), all: Math.ceil(all / 1024) }), "");
    };
    try {
      await mine.open();
      const put = await msbotBoard.put(mine, { program, name: file, settings: settings(), packageFiles, tell });
      at("ms-console").replaceChildren();
      await mine.restart(lines());
      tellBoard(say("boardRuns", { name: put.name, count: put.written.length }), "done");
    } catch (error) {
      if (!(error instanceof BoardError)) throw error;
      tellBoard(say(`board_${error.word}`, { detail: error.detail }), "error");
      await mine.close();
      if (board === mine) board = null;
    } finally {
      button.disabled = false;
      bar.hidden = true;
    }
  }

  // What a board prints, line by line, in the console.
  function lines() {
    const decoder = new TextDecoder();
    let rest = "";
    return (octets) => {
      const all = (rest + decoder.decode(octets, { stream: true })).split(/\r?\n/);
      rest = all.pop().slice(-2000);
      write(all.map((one) => {
        const place = one.match(new RegExp(`File "${name.replace(/[.]/g, "\\.")}", line (\\d+)`));
        return [one.startsWith("# ") ? "info" : "print", one.slice(0, 2000), place ? Number(place[1]) : 0];
      }));
    };
  }

  async function leaveBoard() {
    const before = board;
    board = null;
    if (before !== null) await before.close();
  }

  // A teacher holds the program, and says why; empty: not any more.
  function hold(reason) {
    held = reason;
    if (worker !== null) worker.postMessage({ do: "hold", on: held !== "" });
  }

  function opened(id, file, who) {
    editor = id;
    name = file;
    person = who;
    const typed = JSON.parse(sessionStorage.getItem(TYPED));
    sessionStorage.removeItem(TYPED);
    // However long this page took to be loaded: what counts is when that began.
    const isFresh = typed !== null && performance.timeOrigin - typed.at < FRESH_MS;
    if (typed !== null && (typed.isAway || isFresh)) emitEvent("ms_program_typed", typed);
    document.querySelector(".ms-prog-text").removeAttribute("inert");
    const shown = at("ms-prog");
    if (shown) useDevice(false);
    if (worker === null && sessionStorage.getItem("msbot_runs")) {
      line("info", `# ${say("reloaded", { name: sessionStorage.getItem("msbot_runs") })}`, 0);
      sessionStorage.removeItem("msbot_runs");
    }
    tellOpened();
  }

  // What was under way when a connection broke has never arrived, and what came later would be put into another text:
  // the server asks for all of it when the connection is there again.
  function tellAll() {
    const found = getElement(editor);
    if (!found || !found.editor) return;
    const all = text();
    found.$emit("update:value", { sections: [0, all.length], inserted: [all.split("\n")] });
    msbotBlocks.tellAgain();
  }

  // Named for whoever cannot see it: the editor's own field has no label.
  function label(id, title) {
    const found = getElement(id);
    if (!found || !found.editor) return setTimeout(() => label(id, title), 100);
    found.editor.contentDOM.setAttribute("aria-label", title);
  }

  addEventListener("click", (event) => {
    if (event.target.closest("#ms-board-put")) putOnBoard();
  });
  addEventListener("pagehide", () => {
    if (worker !== null) worker.postMessage({ do: "stop" });
    const found = editor && getElement(editor);
    if (!found || !found.editor) return;
    // A page that is loaded anew is made before the server has kept what was typed into this one; and while the robot is
    // out of reach it hears nothing of that at all.
    sessionStorage.setItem(TYPED, JSON.stringify({
      name, who: person, text: text(), blocks: msbotBlocks.doc(), isAway: !window.socket.connected, at: Date.now(),
    }));
  });
  return { run, stop, hold, opened, tellAll, label, showBoard, isRunning: () => worker !== null };
})();
