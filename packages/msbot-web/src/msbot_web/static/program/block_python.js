// Blocks to Python: the common language of parts (docs/reference/part.md), which runs unchanged on a computer, in a
// browser and on a board. Every line knows the block it came from, so that an error of a run finds its block.

import { CHECKS, isName, OWN, ROOT, unpacked } from "./block_shapes.js";

const MARK = "\u0001", INDENT = "    ";
const KINDS = { text: "str" };
const WAITING = ["msbot_wait", "msbot_forever", "controls_whileUntil"];
const TAKEN = `False None True and as assert break class continue def del elif else except finally for from global if import in is
  lambda nonlocal not or pass raise return try while with yield async await abs bool float int len list max min print range
  round sorted str sum math random part message Part Message`.split(/\s+/);
const WORDS = new Set(TAKEN);
const EVENTS = { join: "on_join", stop: "on_stop", go: "on_go", identify: "on_identify", lost: "on_lost" };
const PAUSE = "yield 0.05";  // after each pass of a loop that nobody knows the end of

const LETTERS = { ä: "ae", ö: "oe", ü: "ue", ß: "ss", Ä: "Ae", Ö: "Oe", Ü: "Ue" };

// A text as Python reads it, on one line.
const quoted = (text) => JSON.stringify(text.replace(/[\ud800-\udbff](?![\udc00-\udfff])|(?<![\ud800-\udbff])[\udc00-\udfff]/g, "?"))
  .replace(/[\u007f-\u009f\u2028\u2029]/g, (one) => `\\u${one.charCodeAt(0).toString(16).padStart(4, "0")}`);

// Names of Python that are not taken yet.
class Names {
  constructor(...taken) {
    this.taken = new Set(taken.flat());
  }
  fresh(wanted) {
    let base = wanted.replace(/[äöüßÄÖÜ]/g, (one) => LETTERS[one]).normalize("NFKD").replace(/[^\w]+/g, "_").replace(/^_+|_+$/g, "").slice(0, 40);
    if (!/^[A-Za-z_]/.test(base)) base = `x${base && `_${base}`}`;
    let name = base;
    if (WORDS.has(base)) name = base = `${base}_`; // `in` is a good name for a port, and none for Python
    for (let number = 2; this.taken.has(name); number += 1) name = `${base}_${number}`;
    this.taken.add(name);
    return name;
  }
}

const descendants = (hat) => hat.getDescendants(true);
const isPlainNumber = (code) => /^-?\d+$/.test(code);

// The program of a workspace: { text, lines }, where lines[i] is the id of the block that line i + 1 came from, or "".
export function pythonOf(Blockly, python, workspace, robot, partOf) {
  const { Order } = python;
  const generator = new python.PythonGenerator("MsBOT");
  Object.assign(generator.forBlock, python.pythonGenerator.forBlock);
  generator.INDENT = INDENT;
  generator.PASS = `${INDENT}pass\n`;
  generator.quote_ = quoted;
  const ids = [], types = new Set(), seen = new Map();
  const part = partOf(workspace);
  const roots = workspace.getBlocksByType(ROOT, true), root = roots[0];
  const variables = new Map();
  const names = new Names(TAKEN, Object.keys(robot.types), Object.values(robot.types).flatMap((type) => type.fields.map((one) => one.kind)));
  for (const variable of Blockly.Variables.allUsedVarModels(workspace)) variables.set(variable.getId(), names.fresh(variable.getName()));

  // The variable that holds the last message of a port.
  function seenOf(port, type) {
    const key = `${port}\n${type}`;
    if (!seen.has(key)) seen.set(key, { port, type, name: names.fresh(port) });
    types.add(type);
    return seen.get(key).name;
  }
  for (const block of workspace.getBlocksByType("msbot_read", true)) {
    const those = unpacked(block.getFieldValue("PORT"), 4);
    if (those && isName(those[1]) && isName(those[2]) && block.getRootBlock().isEnabled()) seenOf(those[0], those[1]);
  }
  generator.addReservedWords([...names.taken].join(",")); // now: what Blockly names by itself shall not hide these
  generator.init(workspace);
  generator.getVariableName = (id) => variables.get(id) || "x";

  generator.scrub_ = (block, code, isAlone) => {
    if (block.outputConnection) return code;
    const about = block.getCommentText();
    const told = about ? about.split(/[\r\n\u0001]+/).map((line) => `# ${line.trim()}\n`).join("") : "";
    const index = ids.push(block.id) - 1;
    const marked = code.split("\n").map((line) => (line && !line.includes(MARK) ? `${line}${MARK}${index}` : line)).join("\n");
    const next = block.nextConnection && block.nextConnection.targetBlock();
    return told + marked + (next && !isAlone ? generator.blockToCode(next) : "");
  };

  function valueOf(block, field) {
    const input = `F_${field.name}`, code = generator.valueToCode(block, input, Order.NONE);
    const from = block.getInputTargetBlock(input), check = from && from.outputConnection.getCheck();
    const wanted = CHECKS[field.kind] || "Number", fits = Boolean(check && check.includes(wanted));
    if (field.kind === "bool") return !code ? "False" : fits ? code : `bool(${code})`;
    if (field.kind === "text") return !code ? '""' : fits ? code : `str(${code})`;
    if (!code) return "0";
    return field.kind.includes("int") && !isPlainNumber(code) ? `round(${code})` : code;
  }

  Object.assign(generator.forBlock, {
    msbot_send(block) {
      const those = unpacked(block.getFieldValue("PORT"), 2);
      if (!those || !isName(those[1])) return "pass\n";
      types.add(those[1]);
      const values = block.fields.map((field) => `${field.name}=${valueOf(block, field)}`).join(", ");
      return `part.publish(${quoted(those[0])}, ${those[1]}(${values}))\n`;
    },
    msbot_read(block) {
      const those = unpacked(block.getFieldValue("PORT"), 4);
      if (!those || !isName(those[1]) || !isName(those[2])) return ["0", Order.ATOMIC];
      return [`${seenOf(those[0], those[1])}.${those[2]}`, Order.MEMBER];
    },
    msbot_setting(block) {
      const those = unpacked(block.getFieldValue("NAME"), 3);
      if (!those || !isName(those[1])) return ["0", Order.ATOMIC];
      const [name, kind, first] = those;
      const usual = kind === "text" ? quoted(first) : kind === "bool" ? (first === "true" ? "True" : "False") : String(Number(first) || 0);
      return [`part.setting(${quoted(name)}, ${KINDS[kind] || kind}, ${usual})`, Order.FUNCTION_CALL];
    },
    msbot_stopped: () => ["part.stopped", Order.MEMBER],
    msbot_bound(block) {
      const those = unpacked(block.getFieldValue("PORT"), 1);
      return those ? [`part.bound(${quoted(those[0])})`, Order.FUNCTION_CALL] : ["False", Order.ATOMIC];
    },
    msbot_wait: (block) => `yield ${generator.valueToCode(block, "SECONDS", Order.NONE) || "0"}\n`,
    msbot_forever: (block) => `while True:\n${pass(block)}`,
    msbot_end: () => "part.end()\n",
    controls_whileUntil(block) {
      const isUntil = block.getFieldValue("MODE") === "UNTIL";
      const while_ = generator.valueToCode(block, "BOOL", isUntil ? Order.LOGICAL_NOT : Order.NONE) || "False";
      return `while ${isUntil ? "not " : ""}${while_}:\n${pass(block)}`;
    },
    controls_flow_statements(block) {
      if (block.getFieldValue("FLOW") === "BREAK") return "break\n";
      let loop = block.getSurroundParent();
      while (loop && !["controls_whileUntil", "msbot_forever", "controls_repeat_ext", "controls_for"].includes(loop.type)) loop = loop.getSurroundParent();
      return loop && WAITING.includes(loop.type) ? `${PAUSE}\ncontinue\n` : "continue\n";
    },
    text_join(block) {
      const parts = block.inputList.filter((input) => input.name.startsWith("ADD")).map((input) => {
        const from = input.connection.targetBlock(), check = from && from.outputConnection.getCheck();
        if (!from) return "";
        return check && check.includes("String") ? generator.valueToCode(block, input.name, Order.ADDITIVE) : `str(${generator.valueToCode(block, input.name, Order.NONE)})`;
      }).filter(Boolean);
      return parts.length ? [parts.join(" + "), parts.length > 1 ? Order.ADDITIVE : Order.FUNCTION_CALL] : ['""', Order.ATOMIC];
    },
    math_change(block) {
      const name = generator.getVariableName(block.getFieldValue("VAR"));
      return `${name} = ${name} + ${generator.valueToCode(block, "DELTA", Order.ADDITIVE) || "0"}\n`;
    },
  });

  // One pass of a loop that nobody knows the end of. It lets the part go on with the rest of its work: a function that
  // never returns would keep it from beating.
  function pass(block) {
    const code = generator.statementToCode(block, "DO");
    const first = [];
    for (let one = block.getInputTargetBlock("DO"); one; one = one.getNextBlock()) first.push(one.type);
    return first.includes("msbot_wait") ? code : `${code}${INDENT}${PAUSE}\n`;
  }

  // The stacks, as functions.
  const functions = [], heard = new Map(), others = [];

  function stackOf(hat, name, isHandler) {
    const code = generator.statementToCode(hat, "DO");
    const changed = new Set();
    let waits = false;
    for (const one of descendants(hat)) {
      if (["variables_set", "math_change", "controls_for"].includes(one.type)) changed.add(generator.getVariableName(one.getFieldValue("VAR")));
      waits = waits || (one !== hat && WAITING.includes(one.type));
    }
    return { hat, name, code, waits, changed: [...changed].sort(), isHandler };
  }

  for (const hat of workspace.getTopBlocks(true)) {
    if (!hat.isEnabled()) continue;
    if (hat.type === "msbot_when") {
      const those = unpacked(hat.getFieldValue("PORT"), 2);
      if (!those || !isName(those[1])) continue;
      const key = `${those[0]}\n${those[1]}`;
      if (!heard.has(key)) heard.set(key, { port: those[0], type: those[1], stacks: [] });
      types.add(those[1]);
      heard.get(key).stacks.push(stackOf(hat, names.fresh(`when_${those[0]}`)));
    } else if (hat.type === "msbot_every") {
      others.push([stackOf(hat, names.fresh("every")), `@part.every(${Number(hat.getFieldValue("SECONDS")) || 1})`]);
    } else if (hat.type === "msbot_event" && EVENTS[hat.getFieldValue("EVENT")]) {
      const event = hat.getFieldValue("EVENT");
      others.push([stackOf(hat, names.fresh(`when_${event}`)), `@part.${EVENTS[event]}`, event]);
    }
  }
  if (part.own) for (const port of part.ports) if (isName(port.type)) types.add(port.type);
  for (const { port, type } of [...seen.values(), ...(part.own ? part.ports.filter((one) => !one.sends).map((one) => ({ port: one.name, type: one.type })) : [])]) {
    if (isName(type) && !heard.has(`${port}\n${type}`)) heard.set(`${port}\n${type}`, { port, type, stacks: [] });
  }

  // Writing.
  const lines = [], from = [];
  function write(code, block) {
    for (const line of code.replace(/\n$/, "").split("\n")) {
      const [told, index] = line.split(MARK);
      lines.push(told.trimEnd());
      from.push(index === undefined ? (block ? block.id : "") : ids[Number(index)]);
    }
  }
  const gap = () => { if (lines.length) write("\n\n", null); };

  // A function with its stack. One that keeps a message does so also while its stack waits: `part.start` skips only that.
  function writeFunction(decorator, name, parameter, keep, stacks) {
    const hat = stacks.length ? stacks[0].hat : root;
    const inline = stacks.length === 1 && !(keep && stacks[0].waits) ? stacks[0] : null;
    const changed = [...new Set([...(keep ? [keep] : []), ...(inline ? inline.changed : [])])];
    gap();
    write(decorator, hat);
    write(`def ${name}(${parameter}):`, hat);
    if (changed.length) write(`${INDENT}global ${changed.join(", ")}`, hat);
    if (keep) write(`${INDENT}${keep} = message`, hat);
    if (inline && inline.code) write(inline.code, hat);
    if (!inline) for (const stack of stacks) {
      write(stack.waits ? `${INDENT}part.start(${stack.work})` : `${INDENT}${stack.work}()`, stack.hat);
    }
    if (!keep && (inline ? !inline.code : !stacks.length)) write(`${INDENT}pass`, hat);
    if (inline) return;
    for (const stack of stacks) {
      gap();
      write(`def ${stack.work}():`, stack.hat);
      if (stack.changed.length) write(`${INDENT}global ${stack.changed.join(", ")}`, stack.hat);
      write(stack.code || `${INDENT}pass`, stack.hat);
    }
  }

  const events = new Map();
  for (const [stack, decorator, event] of others) {
    if (!event || !events.has(event)) functions.push({ decorator, name: stack.name, stacks: [stack] });
    if (event && events.has(event)) events.get(event).stacks.push(stack);
    else if (event) events.set(event, functions[functions.length - 1]);
  }
  const handlers = [...heard.values()].map(({ port, type, stacks }) => ({
    decorator: `@part.on(${quoted(port)}, ${type})`, name: stacks.length ? stacks[0].name : names.fresh(`when_${port}`), parameter: "message",
    keep: seen.has(`${port}\n${type}`) ? seen.get(`${port}\n${type}`).name : "", stacks,
  }));
  for (const one of [...handlers, ...functions]) for (const stack of one.stacks) stack.work = names.fresh(`${stack.name}_blocks`);

  const definitions = Object.entries(generator.definitions_).filter(([key]) => key !== "variables").map(([, code]) => code);
  const used = [...types].filter((type) => robot.types[type] === undefined || robot.types[type].standard);
  const made = [...types].filter((type) => robot.types[type] && !robot.types[type].standard).sort();
  const kinds = made.flatMap((type) => robot.types[type].fields.map((field) => field.kind)).filter((kind) => kind !== "bool" && kind !== "text");
  write("# Made of blocks.", root);
  for (const code of definitions.filter((one) => /^(import|from) /.test(one))) write(code, null);
  if (definitions.some((one) => /^(import|from) /.test(one))) write("", null);
  write(`from msbot import ${[...new Set([...used, ...(made.length ? ["Message"] : []), ...kinds, "Part"])].sort((a, b) => (a.toLowerCase() < b.toLowerCase() ? -1 : 1)).join(", ")}`, root);
  for (const type of made) {
    gap();
    write([`class ${type}(Message):`, ...robot.types[type].fields.map((field) => `${INDENT}${field.name}: ${KINDS[field.kind] || field.kind}`)].join("\n"), root);
  }
  if (made.length) gap();
  else write("", null);
  if (part.own) {
    const title = root.getFieldValue("TITLE").trim();
    write(`part = Part(${quoted(part.number)}, describes=${title ? quoted(title) : "True"})`, root);
    for (const port of part.ports) if (port.sends && isName(port.type)) write(`part.publishes(${quoted(port.name)}, ${port.type})`, port.block);
  } else write(`part = Part(${quoted(part.number)})`, root);
  for (const name of [...variables.values()].sort()) write(`${name} = 0`, null);
  for (const { name, type } of seen.values()) write(`${name} = ${type}()`, root);
  for (const code of definitions.filter((one) => !/^(import|from) /.test(one))) {
    gap();
    write(code, null);
  }
  for (const { decorator, name, parameter, keep, stacks } of handlers) writeFunction(decorator, name, parameter, keep, stacks);
  for (const { decorator, name, stacks } of functions) writeFunction(decorator, name, "", "", stacks);
  gap();
  write("part.run()", root);
  return { text: `${lines.join("\n")}\n`, lines: from, root, more: roots.slice(1) };
}
