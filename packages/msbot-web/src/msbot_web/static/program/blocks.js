// Blocks beside the editor of the page Program. Blockly is loaded when somebody wants blocks, from the robot's computer.
// What the blocks mean as Python goes into the editor, as if it was typed; the blocks themselves go to the server as one
// text, which is kept with the program. Nothing here needs the server while blocks are moved.

const msbotBlocks = (() => {
  const FORM = 1, MOST_BLOCKS = 1000, LONGEST = 256 * 1024, SETTLE_MS = 120, PHONE_PX = 700;
  const robot = { parts: [], types: {} };
  let words = {}, language = "en", editor = 0, name = "", parts = null, loading = null, workspace = null, made = null;
  let isOpen = false, isLoading = false, timer = null, following = null, told = "", written = "", ran = null, wrong = [], wasOwn = null, turn = 0;

  const at = (id) => document.getElementById(id);
  const view = () => getElement(editor).editor;
  const isStill = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

  function script(path) {
    return new Promise((done, fail) => {
      const one = Object.assign(document.createElement("script"), { src: path, onload: done, onerror: () => fail(new Error(path)) });
      document.head.append(one);
    });
  }

  // Blockly takes itself for a module of an AMD loader where there is one; the page has none.
  async function load() {
    const base = msbotAt("/web/blockly");
    await script(`${base}/blockly_compressed.js`);
    await script(`${base}/blocks_compressed.js`);
    await script(`${base}/python_compressed.js`);
    await script(`${base}/${language}.js`);
    const [shapes, writer] = await Promise.all([import(msbotAt("/web/program/block_shapes.js")), import(msbotAt("/web/program/block_python.js"))]);
    parts = { ...shapes, ...writer, ...shapes.defineBlocks(Blockly, robot, words) };
    defineLooks();
  }
  const loaded = () => (loading = loading || load());

  // White on each of these colours has a contrast of at least 4.5.
  const COLOURS = {
    part: "#5b3a8c", when: "#7d5200", send: "#1b7a3d", sense: "#0b6e99", loop: "#a23b0c", logic: "#2f5d9b", math: "#4a4fa3",
    text: "#0f6e63", variable: "#93325f",
  };
  function defineLooks() {
    const blockStyles = {}, categoryStyles = {};
    for (const [style, colour] of Object.entries(COLOURS)) {
      const mixed = (other, share) => `#${[1, 3, 5].map((from) => Math.round(parseInt(colour.slice(from, from + 2), 16) * (1 - share) + other * share).toString(16).padStart(2, "0")).join("")}`;
      blockStyles[`${style}_blocks`] = {
        colourPrimary: colour, colourSecondary: mixed(255, 0.25), colourTertiary: mixed(0, 0.35), hat: style === "when" ? "cap" : "",
      };
      categoryStyles[`${style}_category`] = { colour };
    }
    const common = { base: Blockly.Themes.Zelos, blockStyles, categoryStyles, fontStyle: { family: "system-ui, sans-serif", weight: "600", size: 12 } };
    const look = (name, [back, box, ink, flyout]) => Blockly.Theme.defineTheme(name, {
      ...common,
      componentStyles: {
        workspaceBackgroundColour: back, toolboxBackgroundColour: box, toolboxForegroundColour: ink, flyoutBackgroundColour: flyout,
        flyoutForegroundColour: ink, flyoutOpacity: 0.97, scrollbarColour: "#7b8a96", scrollbarOpacity: 0.6,
      },
    });
    parts.themes = { light: look("msbot_light", ["#ffffff", "#eef2f5", "#17212a", "#e3e9ee"]), dark: look("msbot_dark", ["#0e151b", "#17212a", "#e8eef3", "#22303c"]) };
  }
  const theme = () => parts.themes[document.body.classList.contains("body--dark") ? "dark" : "light"];

  function inject() {
    const isNarrow = innerWidth < PHONE_PX, place = at("ms-blocks-place");
    workspace = Blockly.inject(place, {
      toolbox: parts.toolboxOf(words, false), renderer: "zelos", theme: theme(), media: msbotAt("/web/blockly/"), sounds: false,
      trashcan: !isNarrow, maxBlocks: MOST_BLOCKS, horizontalLayout: isNarrow, toolboxPosition: isNarrow ? "end" : "start",
      move: { scrollbars: true, drag: true, wheel: true },
      // Below 1 Blockly leaves out what wobbles; who wants no motion cannot zoom beyond.
      // On a phone Blockly's buttons would lie over the ends of blocks: there they are above (`blocks.html`).
      zoom: { controls: !isNarrow, wheel: false, pinch: true, startScale: isNarrow ? 0.65 : 0.7, maxScale: isStill() ? 0.99 : 2, minScale: 0.3 },
    });
    for (const [number, button] of at("ms-blocks-zoom").querySelectorAll("button").entries()) {
      button.onclick = () => number === 2 ? workspace.zoomToFit() : workspace.zoomCenter(number ? 1 : -1);
    }
    at("ms-blocks-zoom").hidden = !isNarrow;
    workspace.addChangeListener(changed);
    workspace.addChangeListener(Blockly.Events.disableOrphans);
    // The class is written again and again; a theme that is set anew draws all blocks and closes the open category.
    new MutationObserver(() => workspace.getTheme() === theme() || workspace.setTheme(theme()))
      .observe(document.body, { attributes: true, attributeFilter: ["class"] });
    new ResizeObserver(() => Blockly.svgResize(workspace)).observe(place);
    // Before Run, Keep and the rest ask for the program. Blockly tells of a change one picture later: nothing need be told.
    document.addEventListener("click", () => settleNow(true), true);
    addEventListener("pagehide", () => settleNow(true));
    keepFocus(place);
  }

  // One picture after a block got the focus, Blockly moves its neighbours behind it. If one of these has the focus by
  // then, as somebody went on quickly, the browser takes it away, and no key would lead back.
  function keepFocus(place) {
    let pressedAt = -Infinity;
    document.addEventListener("pointerdown", () => { pressedAt = performance.now(); }, true);
    place.addEventListener("focusout", (event) => {
      if (event.relatedTarget !== null || performance.now() - pressedAt < 300) return;
      queueMicrotask(() => {
        if (document.hasFocus() && document.activeElement === document.body && event.target.isConnected) event.target.focus();
      });
    });
  }

  // Reading what is kept.

  // The workspace of a kept text, or an error of which the message is a sentence.
  function read(doc) {
    let found;
    if (doc.length > LONGEST) throw new Error(words.tooLarge);
    try {
      found = JSON.parse(doc);
    } catch {
      throw new Error(words.broken);
    }
    if (found === null || typeof found !== "object" || !Number.isInteger(found.msbot)) throw new Error(words.broken);
    if (found.msbot > FORM) throw new Error(words.newer);
    if ((doc.match(/"type":/g) || []).length > MOST_BLOCKS) throw new Error(words.tooLarge);
    return found.workspace;
  }

  function fill(target, state) {
    try {
      Blockly.serialization.workspaces.load(state && typeof state === "object" ? state : {}, target);
    } catch {
      target.clear();
      throw new Error(words.broken); // of a kind that is not known here, or cut off
    }
    if (!target.getBlocksByType(parts.ROOT).length) target.newBlock(parts.ROOT);
    refresh(target);
  }

  // What somebody begins with.
  function begin(target) {
    const part = robot.parts[0];
    const hears = part && part.ports.some((port) => !port.sends && port.wired);
    Blockly.serialization.workspaces.load({ blocks: { blocks: [
      { type: parts.ROOT, x: 20, y: 20, ...(!part && { fields: { PART: parts.OWN } }) },
      { type: hears ? "msbot_when" : "msbot_every", x: 20, y: part ? 110 : 260 },
    ] } }, target);
    refresh(target);
  }

  // Everything that is drawn once and depends on the robot, or on the ports that the program has.
  function refresh(target) {
    for (const block of target.getAllBlocks(false)) {
      for (const input of block.inputList) for (const field of input.fieldRow) if (field instanceof parts.FieldRobot) field.refresh();
      if (block.shape) block.shape(block.getFieldValue("PORT") ?? block.getFieldValue("PART"));
    }
  }

  // Showing.

  // Show the blocks of a program; "" begins anew. Their Python takes the place of `text`: of no other one, which was
  // typed, or came from elsewhere, while Blockly was loaded. Gives what is wrong with them, or "", or { changed: true }.
  async function show(file, doc, text) {
    const mine = ++turn;
    told = "";
    try {
      await loaded();
    } catch {
      loading = null;
      return words.noFiles;
    }
    if (mine !== turn) return "";
    written = view().state.doc.toString();
    if (written !== text.replace(/\r\n?/g, "\n")) return { changed: true };
    at("ms-blocks").hidden = false;
    document.documentElement.classList.add("ms-with-blocks");
    if (workspace === null) inject();
    isOpen = false;
    name = file;
    wrong = [];
    ran = null;
    isLoading = true;
    Blockly.Events.disable();
    try {
      workspace.clear();
      if (doc) fill(workspace, read(doc));
      else begin(workspace);
    } catch (error) {
      hide();
      return error.message;
    } finally {
      Blockly.Events.enable();
      isLoading = false;
    }
    workspace.clearUndo();
    isOpen = true;
    for (const block of workspace.getTopBlocks(false)) {
      if (block.outputConnection || block.previousConnection) block.setDisabledReason(true, "ORPHANED_BLOCK");
    }
    Blockly.svgResize(workspace);
    toTop();
    settleNow(true);
    return "";
  }

  // The beginning of the program at the upper left corner, not its middle in the middle.
  function toTop() {
    const box = workspace.getBlocksBoundingBox();
    workspace.scroll(20 - box.left * workspace.scale, 20 - box.top * workspace.scale);
  }

  function hide() {
    settleNow();
    turn += 1;
    isOpen = false;
    at("ms-blocks").hidden = true;
    document.documentElement.classList.remove("ms-with-blocks");
    if (workspace !== null) Blockly.hideChaff();
  }

  // The Python of kept blocks without showing them: { text } or { error }.
  async function textOf(doc) {
    let target = null;
    try {
      await loaded();
      target = new Blockly.Workspace();
      fill(target, read(doc));
      return { text: parts.pythonOf(Blockly, python, target, robot, parts.partOf).text };
    } catch (error) {
      return { error: parts === null ? words.noFiles : error.message };
    } finally {
      if (target !== null) target.dispose();
    }
  }

  // Following.

  function changed(event) {
    if (!isOpen || isLoading || event.isUiEvent) return;
    clearTimeout(timer);
    timer = setTimeout(settleNow, SETTLE_MS);
  }

  // Blocks to text, and both to the server; not over a text that has come from elsewhere, of which the blocks will hear.
  function settleNow(isFirst) {
    clearTimeout(timer);
    if (!isOpen || (timer === null && isFirst !== true)) return;
    timer = null;
    const before = view().state.doc.toString();
    if (before !== written) return;
    const isOwn = parts.partOf(workspace).own === true;
    if (isOwn !== wasOwn && !isHeld()) {
      wasOwn = isOwn;
      workspace.updateToolbox(parts.toolboxOf(words, isOwn));
    }
    Blockly.Events.disable(); // warnings and labels are no change of the program
    try {
      for (const block of workspace.getBlocksByType("msbot_send")) block.shape(block.getFieldValue("PORT"));
      warn();
    } finally {
      Blockly.Events.enable();
    }
    made = parts.pythonOf(Blockly, python, workspace, robot, parts.partOf);
    if (before !== made.text) view().dispatch({ changes: { from: 0, to: before.length, insert: made.text } });
    written = view().state.doc.toString();
    outline();
    const doc = JSON.stringify({ msbot: FORM, view: "blocks", workspace: Blockly.serialization.workspaces.save(workspace) });
    if (doc !== told) emitEvent("ms_blocks", { name, doc });
    told = doc;
  }

  const put = (text, values) => text.replace(/{(\w+)}/g, (_, key) => values[key]);

  // What is amiss with a block, in one sentence; "" if nothing is.
  function amiss(block, part) {
    if (block.type === parts.ROOT && made && made.more.includes(block)) return words.oneRoot;
    for (const input of block.inputList) for (const field of input.fieldRow) {
      if (!(field instanceof parts.FieldRobot) || !input.isVisible()) continue;
      if (field.getValue() === "") return words.nothing;
      if (field.isMissing()) return put(field.list === "parts" ? words.noPart : words.noPort, { port: field.getText(), number: part.number });
    }
    const key = block.getFieldValue("PORT");
    const port = typeof key === "string" && part.ports.find((one) => key.startsWith(JSON.stringify([one.name]).slice(0, -1)));
    if (!port || part.own) return "";
    if (!port.wired) return put(words.notWired, { port: port.name });
    return port.silent.length ? put(words.silent, { port: port.name, slot: port.silent.join(", ") }) : "";
  }

  function warn() {
    const part = parts.partOf(workspace);
    for (const block of workspace.getAllBlocks(false)) {
      if (!block.type.startsWith("msbot_")) continue;
      const words = block.isEnabled() ? amiss(block, part) : "";
      if (words !== (block.saidAmiss || "")) block.setWarningText(words || null, "amiss");
      block.saidAmiss = words;
    }
  }

  // The program in words, for whoever cannot see blocks.
  function outline() {
    const said = (block) => block.inputList.filter((input) => input.isVisible() && !(input.connection && input.connection.type === Blockly.NEXT_STATEMENT))
      .map((input) => {
        const label = input.fieldRow.map((field) => field.getText()).join(" ");
        const inner = input.connection && input.connection.targetBlock();
        return `${label} ${input.connection ? (inner ? said(inner) : "…") : ""}`;
      }).join(" ").replace(/\s+/g, " ").trim();
    const list = (block) => {
      const rows = document.createElement("ul");
      for (let one = block; one; one = one.getNextBlock()) rows.append(row(one));
      return rows;
    };
    const row = (block) => {
      const one = document.createElement("li");
      one.textContent = said(block) + (block.saidAmiss ? ` (${block.saidAmiss})` : "") + (block.isEnabled() ? "" : ` (${words.unused})`);
      for (const input of block.inputList) {
        const inner = input.connection && input.connection.type === Blockly.NEXT_STATEMENT && input.isVisible() && input.connection.targetBlock();
        if (inner) one.append(list(inner));
      }
      return one;
    };
    const all = document.createElement("ul");
    for (const block of workspace.getTopBlocks(true)) all.append(...(block.getNextBlock() ? list(block).children : [row(block)]));
    at("ms-blocks-outline").replaceChildren(...all.children);
  }

  // Errors of a run.

  function clear() {
    for (const id of wrong) {
      const block = workspace.getBlockById(id);
      if (block) {
        block.setWarningText(null, "run");
        block.getSvgRoot().classList.remove("ms-block-wrong");
      }
    }
    wrong = [];
  }

  // A program begins: from now on errors speak of its lines, also when the blocks have changed since.
  function began() {
    settleNow();
    if (workspace !== null) {
      Blockly.Events.disable();
      clear();
      Blockly.Events.enable();
    }
    ran = isOpen && made ? made.lines : null;
  }

  const blockOf = (line) => (isOpen && ran && ran[line - 1] ? workspace.getBlockById(ran[line - 1]) : null);

  // An error names a line: its block lights up with the sentence. Says whether there is such a block.
  function light(line, sentence) {
    const block = blockOf(line);
    if (!block || wrong.includes(block.id)) return block !== null;
    wrong.push(block.id);
    Blockly.Events.disable();
    block.setWarningText(sentence, "run");
    block.getSvgRoot().classList.add("ms-block-wrong");
    Blockly.Events.enable();
    if (wrong.length === 1) reveal(line);
    return true;
  }

  function reveal(line) {
    const block = blockOf(line);
    if (!block) return false;
    workspace.centerOnBlock(block.id);
    const icon = block.getIcon(Blockly.icons.IconType.WARNING);
    if (icon) icon.setBubbleVisible(true);
    return true;
  }

  // From the server.

  // The robot as it is now.
  function know(found) {
    Object.assign(robot, found);
    follow();
  }

  // Blocks that somebody holds, or is among with the keyboard, are not made anew under their hands.
  function isHeld() {
    const flyout = workspace.getFlyout();
    return workspace.isDragging() || Blockly.Gesture.inProgress()
      || (flyout !== null && Blockly.getFocusManager().getFocusedTree() === flyout.getWorkspace());
  }

  function follow() {
    clearTimeout(following);
    if (workspace === null || !isOpen) return;
    if (isHeld()) return void (following = setTimeout(follow, 300));
    Blockly.Events.disable();
    refresh(workspace);
    Blockly.Events.enable();
    settleNow(true);
    workspace.refreshToolboxSelection();
  }

  function rename(file) {
    name = file;
    told = "";
  }

  function use(id, those, code) {
    editor = id;
    words = those;
    language = code;
  }

  // The blocks as the server was told them; it may not have heard.
  const doc = () => (isOpen ? told : "");
  function tellAgain() {
    if (doc()) emitEvent("ms_blocks", { name, doc: told });
  }

  return { use, know, rename, show, hide, textOf, began, light, reveal, doc, tellAgain, isShown: () => isOpen, words: (key) => words[key], workspace: () => workspace, lines: () => (made ? made.lines : []) };
})();
