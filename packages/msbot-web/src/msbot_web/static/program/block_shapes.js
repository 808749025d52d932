// The blocks of MsBOT: what they look like, and what their drop-downs list. All of it comes from the live robot
// (`robot`, see robot_words.py); what a robot does not have (any more) stays in the block and is marked as missing.

export const ROOT = "msbot_part", OWN = "*", LONGEST = 600;
export const CHECKS = { bool: "Boolean", text: "String" };
const NAME = /^[A-Za-z_]\w{0,60}$/, MOST_FIELDS = 20;

export const isName = (text) => typeof text === "string" && NAME.test(text);
export const packed = (...those) => JSON.stringify(those);

// The values of a drop-down; null when it holds something else, for example of a program that somebody made by hand.
export function unpacked(value, count) {
  try {
    const those = JSON.parse(value);
    return Array.isArray(those) && those.length === count && those.every((one) => typeof one === "string") ? those : null;
  } catch {
    return null;
  }
}

// A send block's fields as they are saved: [[name, kind, unit], ...].
function fieldsFrom(saved) {
  if (!Array.isArray(saved) || saved.length > MOST_FIELDS) return [];
  return saved.filter((one) => Array.isArray(one) && isName(one[0]) && isName(one[1]))
    .map(([name, kind, unit]) => ({ name, kind, unit: typeof unit === "string" ? unit.slice(0, 20) : "" }));
}

// `robot`: { parts, types }, of which the contents change; `words`: texts in the person's language.
export function defineBlocks(Blockly, robot, words) {
  const unitOf = (unit) => (unit ? ` (${unit})` : "");

  // The part that the program of a workspace is, with its ports.
  function partOf(workspace) {
    const root = workspace && (workspace.targetWorkspace || workspace).getBlocksByType(ROOT)[0];
    const number = root ? root.getFieldValue("PART") : "";
    if (number !== OWN) {
      const found = robot.parts.find((part) => part.number === number);
      return found || { number, missing: Boolean(number), ports: [], settings: [] };
    }
    const ports = [], names = new Set();
    for (let block = root.getInputTargetBlock("PORTS"); block; block = block.getNextBlock()) {
      const name = block.getFieldValue("NAME").trim();
      if (block.type !== "msbot_own_port" || !name || names.has(name)) continue;
      names.add(name);
      ports.push({ name, sends: block.getFieldValue("WAY") === "send", type: block.getFieldValue("TYPE"), wired: true, silent: [], what: "", block });
    }
    return { number: root.getFieldValue("NUMBER").trim(), own: true, ports, settings: [] };
  }

  const labelled = (port) => (port.wired ? port.name : `${port.name} (${words.unwired})`);
  const fieldsOf = (type) => (robot.types[type] ? robot.types[type].fields : []);
  const lists = {
    parts: () => [...robot.parts.map((part) => [`${part.number} – ${part.name}`, part.number]), [words.own, OWN]],
    heard: (part) => part.ports.filter((port) => !port.sends).map((port) => [labelled(port), packed(port.name, port.type)]),
    sent: (part) => part.ports.filter((port) => port.sends).map((port) => [labelled(port), packed(port.name, port.type)]),
    read: (part) => part.ports.filter((port) => !port.sends).flatMap((port) => fieldsOf(port.type).map((field) => [
      `${port.name}: ${field.name}${unitOf(field.unit)}`, packed(port.name, port.type, field.name, field.kind),
    ])),
    ports: (part) => part.ports.map((port) => [port.name, packed(port.name)]),
    settings: (part) => part.settings.map((one) => [`${one.name}${unitOf(one.unit)}`, packed(one.name, one.kind, String(one.default))]),
    types: () => Object.keys(robot.types).map((type) => [type, type]),
  };
  const named = (value) => {
    const those = [1, 2, 3, 4].map((count) => unpacked(value, count)).find(Boolean);
    return those ? (those.length === 4 ? `${those[0]}: ${those[2]}` : those[0]) : value;
  };

  // A drop-down of what the robot has now; it keeps what it holds, also when the robot does not have it.
  class FieldRobot extends Blockly.FieldDropdown {
    constructor(list) {
      super(() => [["–", ""]]);
      this.list = list;
    }
    static fromJson(options) {
      return new FieldRobot(options.list);
    }
    offered() {
      const block = this.getSourceBlock();
      return this.list && block ? lists[this.list](this.list === "parts" || this.list === "types" ? null : partOf(block.workspace)) : [];
    }
    isMissing() {
      const value = this.getValue();
      return value !== "" && !this.offered().some((one) => one[1] === value);
    }
    getOptions() {
      const found = this.offered(), value = this.getValue();
      if (value && !found.some((one) => one[1] === value)) found.push([`${named(value).slice(0, 60)} (${words.missing})`, value]);
      return found.length ? found : [["–", ""]];
    }
    doClassValidation_(value) {
      return typeof value === "string" && value.length <= LONGEST ? value : null;
    }
    // The robot has changed: what it holds may have another label now.
    refresh() {
      this.doValueUpdate_(this.getValue());
      this.forceRerender();
    }
  }
  Blockly.fieldRegistry.register("msbot_choice", FieldRobot);
  const choice = (name, list) => ({ type: "msbot_choice", name, list });
  const body = { type: "input_statement", name: "DO" };

  function define(type, definition, more = {}) {
    Blockly.Blocks[type] = {
      ...more,
      init() {
        this.jsonInit(definition);
        for (const input of this.inputList) for (const field of input.fieldRow) {
          if (field instanceof FieldRobot && field.getValue() === "") {
            const first = field.offered()[0];
            if (first) field.setValue(first[1]);
          }
        }
        if (more.begun) more.begun.call(this);
      },
    };
  }
  const statement = { previousStatement: null, nextStatement: null };
  const hat = (message, ...args) => ({
    message0: message, args0: args, message1: "%1", args1: [body], style: "when_blocks",
  });

  define(ROOT, {
    message0: words.part, args0: [choice("PART", "parts")], style: "part_blocks",
  }, {
    begun() {
      this.setDeletable(false);
      this.getField("PART").setValidator((value) => this.shape(value));
      this.shape(this.getFieldValue("PART"));
    },
    // What belongs to a part of one's own is hidden, not removed, when the program becomes a part of the library.
    shape(value) {
      if (value === OWN && !this.getInput("PORTS")) {
        const [before, between, after] = words.ownPart.split(/%[12]/);
        this.appendDummyInput("ABOUT").appendField(before.trim()).appendField(new Blockly.FieldTextInput("MY-1"), "NUMBER")
          .appendField(between.trim()).appendField(new Blockly.FieldTextInput(words.ownTitle), "TITLE").appendField(after.trim());
        this.appendStatementInput("PORTS").setCheck("OwnPort");
      }
      for (const input of this.inputList.slice(1)) input.setVisible(value === OWN);
      if (this.rendered) this.queueRender();
    },
    saveExtraState() {
      return this.getInput("PORTS") ? { own: true } : null;
    },
    loadExtraState(state) {
      if (state && state.own) this.shape(OWN);
    },
  });
  define("msbot_own_port", {
    message0: words.ownPort,
    args0: [
      { type: "field_dropdown", name: "WAY", options: [[words.sends, "send"], [words.receives, "receive"]] },
      choice("TYPE", "types"), { type: "field_input", name: "NAME", text: words.ownPortName },
    ],
    previousStatement: "OwnPort", nextStatement: "OwnPort", style: "part_blocks",
  });
  define("msbot_when", hat(words.when, choice("PORT", "heard")));
  define("msbot_every", hat(words.every, { type: "field_number", name: "SECONDS", value: 1, min: 0.05, max: 86400 }));
  define("msbot_event", hat(words.event, {
    type: "field_dropdown", name: "EVENT",
    options: ["join", "stop", "go", "identify", "lost"].map((event) => [words[`event_${event}`], event]),
  }));
  define("msbot_send", {
    message0: words.send, args0: [choice("PORT", "sent")], inputsInline: true, style: "send_blocks", ...statement,
  }, {
    begun() {
      this.fields = [];
      this.getField("PORT").setValidator((value) => this.shape(value));
      this.shape(this.getFieldValue("PORT"));
    },
    shape(value) {
      const those = unpacked(value, 2);
      if (those && robot.types[those[1]]) this.lay(robot.types[those[1]].fields);
    },
    // One value input for each field of the message.
    lay(fields) {
      for (const input of this.inputList.filter((one) => one.name.startsWith("F_"))) {
        if (!fields.some((field) => `F_${field.name}` === input.name && field.kind === input.kind)) this.removeInput(input.name);
      }
      for (const field of fields) {
        if (this.getInput(`F_${field.name}`)) continue;
        const input = this.appendValueInput(`F_${field.name}`).setCheck(CHECKS[field.kind] || "Number");
        input.appendField(`${field.name}${unitOf(field.unit)}`);
        input.kind = field.kind;
        input.connection.setShadowState(shadowOf(field.kind));
      }
      this.fields = fields;
    },
    saveExtraState() {
      return { fields: this.fields.map(({ name, kind, unit }) => [name, kind, unit]) };
    },
    loadExtraState(state) {
      this.lay(fieldsFrom(state && state.fields));
    },
  });
  define("msbot_read", { message0: "%1", args0: [choice("PORT", "read")], output: null, style: "sense_blocks" }, {
    begun() {
      this.getField("PORT").setValidator((value) => this.shape(value));
      this.shape(this.getFieldValue("PORT"));
    },
    shape(value) {
      const those = unpacked(value, 4);
      this.setOutput(true, those ? CHECKS[those[3]] || "Number" : null);
    },
  });
  define("msbot_setting", { message0: words.setting, args0: [choice("NAME", "settings")], output: null, style: "sense_blocks" });
  define("msbot_stopped", { message0: words.stopped, output: "Boolean", style: "sense_blocks" });
  define("msbot_bound", { message0: words.bound, args0: [choice("PORT", "ports")], output: "Boolean", style: "sense_blocks" });
  define("msbot_wait", {
    message0: words.wait, args0: [{ type: "input_value", name: "SECONDS", check: "Number" }], inputsInline: true,
    style: "loop_blocks", ...statement,
  });
  define("msbot_forever", {
    message0: words.forever, message1: "%1", args1: [body], previousStatement: null, style: "loop_blocks",
  });
  define("msbot_end", { message0: words.end, previousStatement: null, style: "loop_blocks" });

  return { FieldRobot, partOf };
}

export function shadowOf(kind) {
  if (kind === "bool") return { type: "logic_boolean", fields: { BOOL: "TRUE" } };
  return kind === "text" ? { type: "text", fields: { TEXT: "" } } : { type: "math_number", fields: { NUM: 0 } };
}

// What can be dragged out, by categories.
export function toolboxOf(words, isOwn) {
  const number = (value) => ({ shadow: { type: "math_number", fields: { NUM: value } } });
  const text = (value) => ({ shadow: { type: "text", fields: { TEXT: value } } });
  const block = (type, inputs, fields) => ({ kind: "block", type, ...(inputs && { inputs }), ...(fields && { fields }) });
  const category = (name, style, contents) => ({ kind: "category", name, categorystyle: style, contents });
  return {
    kind: "categoryToolbox",
    contents: [
      ...(isOwn ? [category(words.inPorts, "part_category", [block("msbot_own_port")])] : []),
      category(words.inWhen, "when_category", [block("msbot_when"), block("msbot_every"), block("msbot_event")]),
      category(words.inSend, "send_category", [block("msbot_send"), block("text_print", { TEXT: text(words.hello) })]),
      category(words.inSense, "sense_category", [block("msbot_read"), block("msbot_stopped"), block("msbot_setting"), block("msbot_bound")]),
      category(words.inLoops, "loop_category", [
        block("msbot_wait", { SECONDS: number(1) }), block("controls_repeat_ext", { TIMES: number(4) }), block("msbot_forever"),
        block("controls_whileUntil"), block("controls_for", { FROM: number(1), TO: number(10), BY: number(1) }),
        block("controls_flow_statements"), block("msbot_end"),
      ]),
      category(words.inLogic, "logic_category", [
        block("controls_if"), block("controls_ifelse"), block("logic_compare", { A: number(0), B: number(0) }),
        block("logic_operation"), block("logic_negate"), block("logic_boolean"),
      ]),
      category(words.inMath, "math_category", [
        block("math_number"), block("math_arithmetic", { A: number(1), B: number(1) }), block("math_single", { NUM: number(9) }),
        block("math_round", { NUM: number(3.1) }), block("math_modulo", { DIVIDEND: number(64), DIVISOR: number(10) }),
        block("math_constrain", { VALUE: number(50), LOW: number(-100), HIGH: number(100) }),
        block("math_random_int", { FROM: number(1), TO: number(6) }),
      ]),
      category(words.inText, "text_category", [block("text"), block("text_join"), block("text_print", { TEXT: text(words.hello) })]),
      { kind: "category", name: words.inVariables, categorystyle: "variable_category", custom: "VARIABLE" },
    ],
  };
}
