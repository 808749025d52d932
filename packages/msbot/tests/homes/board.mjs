// A simulated board: the MicroPython VM, its own REPL, and what a board adds to it. `node board.mjs SETTINGS` (JSON);
// file descriptor 0 is the board's end of its serial line: the master side of a pseudo terminal, not blocking.
//
// The prompt, raw mode, tracebacks and the file system calls are MicroPython's own. Added here: raw paste with its
// window (this VM's own has no input to read from), the receive buffer of a UART (what does not fit is lost), a flash of
// limited size that outlives resets, Ctrl-C while a program runs, soft reset with boot.py and main.py, and a UART on a
// second line (`machine`, below).
//
// Settings: vm (folder), flash (octets), buffer (octets; 0 = no limit, as USB, which stops the sender), window (octets of
// raw paste; most boards have 128), paste ("yes"; "no": it says that it has no raw paste; "unknown": it is older than raw
// paste, and begins raw mode anew at its last character), uart (path of a terminal), boot (Python that is run before anything else), lib (folder
// of a package that is on it already), files (more files, path: text).
import { openSync, readdirSync, readFileSync, readSync, writeSync, constants } from "node:fs";
import { join } from "node:path";

const settings = { flash: 600_000, buffer: 0, window: 2048, paste: "yes", uart: "", boot: "", lib: "", files: {}, ...JSON.parse(process.argv[2]) };
const { loadMicroPython } = await import(join(settings.vm, "micropython.mjs"));
const INTERRUPT = 3, NO_SPACE = 28, BLOCK = 512, POLL_MS = 0.5;
const RAW = 1, FRIENDLY = 2, SOFT_RESET = 4;
const FIRST_FOLDERS = ["/dev", "/home", "/proc", "/tmp", "/rom"]; // of the VM, not of the board's flash

const MACHINE = `
import _board
class UART:
    def __init__(self, number, baudrate, *, rxbuf, **pins):
        pass
    def read(self):
        return bytes(_board.uart_read()) or None
    def write(self, octets):
        return _board.uart_write(octets.hex())
def unique_id():
    return b"simulated"
`;

let mp = null, isRunning = false, isFile = false, isOkHidden = false, polledAt = 0;
const received = [], waiting = [];
const flash = new Map(); // path: octets, null = folder
const realNow = Date.now;
const nap = new Int32Array(new SharedArrayBuffer(4));
const sleep = (ms) => Atomics.wait(nap, 0, 0, ms);

function readFrom(descriptor, most) {
  const octets = Buffer.allocUnsafe(most);
  try {
    const count = readSync(descriptor, octets, 0, most);
    if (count === 0) process.exit(0);
    return octets.subarray(0, count);
  } catch (error) {
    if (error.code === "EAGAIN") return Buffer.alloc(0);
    if (error.code === "EIO") return Buffer.alloc(0); // nobody has the other end open
    throw error;
  }
}

function writeTo(descriptor, octets) {
  try {
    return writeSync(descriptor, octets);
  } catch (error) {
    if (error.code === "EAGAIN" || error.code === "EIO") return 0;
    throw error;
  }
}

function receive() {
  const room = settings.buffer ? 4096 : 4096 - received.length; // USB leaves the rest with the sender
  for (const octet of room > 0 ? readFrom(0, room) : []) {
    if (octet === INTERRUPT && isRunning && (isFile || mp._module._mp_hal_get_interrupt_char() === INTERRUPT)) {
      mp._module._mp_sched_keyboard_interrupt();
    } else if (!settings.buffer || received.length < settings.buffer) {
      received.push(octet);
    }
  }
}

function flush() {
  while (waiting.length) {
    const sent = writeTo(0, Buffer.from(waiting.slice(0, 1024)));
    waiting.splice(0, sent);
    if (!sent) {
      receive();
      sleep(POLL_MS);
    }
  }
}

// The VM asks for the time whenever a program waits or writes: then a board's interrupts come through.
Date.now = () => {
  const now = realNow();
  if (now !== polledAt) {
    polledAt = now;
    flush();
    receive();
  }
  return now;
};

function next() {
  flush();
  if (settings.buffer || !received.length) receive(); // a look costs ten times what an octet does; only a UART loses any
  while (!received.length) {
    sleep(POLL_MS);
    receive();
  }
  return received.shift();
}

const say = (text) => waiting.push(...Buffer.from(text, "latin1"));

function used(fs, folder = "/") {
  let blocks = 0;
  for (const name of fs.readdir(folder)) {
    const path = (folder === "/" ? "" : folder) + "/" + name;
    if (name === "." || name === ".." || FIRST_FOLDERS.includes(path)) continue;
    const { mode, size } = fs.stat(path);
    blocks += fs.isDir(mode) ? 1 + used(fs, path) : 1 + Math.ceil(size / BLOCK);
  }
  return blocks;
}

function keep(fs, folder = "/") {
  if (folder === "/") flash.clear();
  for (const name of fs.readdir(folder)) {
    const path = (folder === "/" ? "" : folder) + "/" + name;
    if (name === "." || name === ".." || FIRST_FOLDERS.includes(path)) continue;
    const isFolder = fs.isDir(fs.stat(path).mode);
    flash.set(path, isFolder ? null : fs.readFile(path));
    if (isFolder) keep(fs, path);
  }
}

function limit(fs) {
  const most = Math.floor(settings.flash / BLOCK), write = fs.write, stat = fs.statfsNode;
  fs.write = function (stream, buffer, offset, length, ...rest) {
    if (stream.tty === undefined && stream.path && !stream.path.startsWith("/dev/")) {
      const more = Math.ceil((stream.position + length) / BLOCK) - Math.ceil(stream.node.usedBytes / BLOCK);
      if (more > 0 && used(fs) + more > most) throw new fs.ErrnoError(NO_SPACE);
    }
    return write.call(fs, stream, buffer, offset, length, ...rest);
  };
  fs.statfsNode = (node) => {
    const free = Math.max(0, most - used(fs));
    return { ...stat.call(fs, node), bsize: BLOCK, frsize: BLOCK, blocks: most, bfree: free, bavail: free };
  };
}

const uart = settings.uart ? openSync(settings.uart, constants.O_RDWR | constants.O_NONBLOCK | constants.O_NOCTTY) : -1;
const board = {
  uart_read: () => (uart < 0 ? [] : [...readFrom(uart, 256)]),
  uart_write: (text) => (uart < 0 ? text.length / 2 : writeTo(uart, Buffer.from(text, "hex"))),
};

let hidden = "";
function hear(octets) {
  if (!isOkHidden) return waiting.push(...octets);
  hidden += String.fromCharCode(...octets);
  if (hidden.length === 2) [isOkHidden, hidden] = [false, ""];
}

async function start() {
  mp = await loadMicroPython({
    url: join(settings.vm, "micropython.wasm"),
    heapsize: 256 * 1024,
    stdout: hear,
    linebuffer: false,
  });
  limit(mp.FS);
  mp.FS.mkdir("/rom");
  mp.FS.writeFile("/rom/machine.py", MACHINE);
  mp.registerJsModule("_board", board);
  for (const [path, octets] of flash) octets === null ? mp.FS.mkdir(path) : mp.FS.writeFile(path, octets);
  mp.runPython(`import sys\nsys.path[:] = ["", "/rom", "/lib"]\n${settings.boot}`);
}

function run(code) {
  isRunning = isFile = true; // Ctrl-C also ends boot.py and main.py; this VM says so only of what its prompt runs
  try {
    mp.runPython(code);
  } finally {
    isRunning = isFile = false;
  }
}

const runFile = (name) => run(`
import sys
try:
    with open("${name}") as file:
        source = file.read()
except OSError:
    source = None
if source is not None:
    try:
        exec(compile(source, "${name}", "exec"), {"__name__": "__main__"})
    except KeyboardInterrupt as error:
        sys.print_exception(error)
    except Exception as error:
        sys.print_exception(error)
`);

// One character for the VM's own prompt; returns whether it asks for a soft reset.
function type(octet) {
  isRunning = octet === SOFT_RESET || octet === 13 || octet === 10;
  const result = mp.replProcessChar(octet);
  isRunning = false;
  return result !== 0;
}

// Raw paste: what the host sends in windows is given to raw mode, whose "OK" is not part of this way.
function paste() {
  const code = [];
  say(`R\x01${String.fromCharCode(settings.window & 255, settings.window >> 8)}\x01`);
  for (let room = settings.window; ; ) {
    const octet = next();
    if (octet === SOFT_RESET || octet === INTERRUPT) {
      say("\x04");
      if (octet === INTERRUPT) return say("\x04\x04>"), false;
      break;
    }
    code.push(octet);
    if (--room === 0) {
      say("\x01");
      room = settings.window;
    }
  }
  flush();
  for (const octet of code) mp.replProcessChar(octet);
  isOkHidden = true;
  return type(SOFT_RESET);
}

// `isRaw`: a soft reset in raw mode stays in it, and does not run main.py.
function prompt(isRaw) {
  const before = waiting.length;
  mp.replInit();
  if (isRaw) {
    waiting.length = before;
    mp.replProcessChar(RAW);
  }
}

if (settings.lib) {
  for (const folder of ["/lib", "/lib/msbot"]) flash.set(folder, null);
  const modules = readdirSync(settings.lib).filter((name) => /\.m?py$/.test(name)); // not what Python keeps beside them
  for (const name of modules) flash.set(`/lib/msbot/${name}`, readFileSync(join(settings.lib, name)));
}
for (const [path, text] of Object.entries(settings.files)) flash.set(path, text);
await start();
runFile("boot.py");
runFile("main.py");
prompt(false);
let isRaw = false, asked = [];
for (;;) {
  const octet = next();
  if (octet === 1 && asked.join() === "5,65" && isRaw) {
    asked = [];
    type(INTERRUPT); // forget the two
    if (settings.paste === "no") say("R\x00");
    if (settings.paste === "unknown") type(RAW);
    if (settings.paste !== "yes" || !paste()) continue;
  } else {
    asked = octet === 5 || asked.length === 1 ? [...asked, octet] : [];
    if (octet === RAW) isRaw = true;
    if (octet === FRIENDLY) isRaw = false;
    if (!type(octet)) continue;
  }
  say("MPY: soft reboot\r\n");
  flush();
  keep(mp.FS);
  await start();
  runFile("boot.py");
  if (!isRaw) runFile("main.py");
  prompt(isRaw);
}
