// The MicroPython VM with MsBOT's package in it: requests of host.py in, answers out. No clock, no network, no page.

const MOST_MEMORY = 48 * 1024 * 1024; // octets of the VM; beyond, the program gets a MemoryError

// The VM asks for more memory by itself, and would take all that the device has.
function boundMemory() {
  const grow = WebAssembly.Memory.prototype.grow;
  WebAssembly.Memory.prototype.grow = function (pages) {
    if (this.buffer.byteLength + pages * 65536 > MOST_MEMORY) throw new RangeError("the program may have no more memory");
    return grow.call(this, pages);
  };
}

// `files`: {path: text}, of which host.py is run; `tell(kind, text, line)` hears what program and part say.
// Returns a function that gives host.py's answer to a request.
export async function openHome(base, files, tell) {
  boundMemory();
  const { loadMicroPython } = await import(`${base}/web/micropython/micropython.mjs`);
  const quiet = console.error;
  console.error = () => {}; // the VM says there when it gets no more memory; the program's MemoryError says it better
  const mp = await loadMicroPython({
    url: `${base}/web/micropython/micropython.wasm`,
    stdout: (line) => tell("print", line, 0),
    stderr: (line) => tell("error", line, 0),
    linebuffer: true,
  });
  for (const [path, text] of Object.entries(files)) {
    if (path === "host.py") continue;
    const folder = `/lib/${path}`.split("/").slice(0, -1).join("/");
    if (!mp.FS.analyzePath(folder).exists) mp.FS.mkdirTree(folder);
    mp.FS.writeFile(`/lib/${path}`, text);
  }
  mp.globals.set("tell", tell);
  mp.globals.set("source", files["host.py"]); // under a name of the package: no line of it is the program's
  mp.runPython("exec(compile(source, 'msbot/host.py', 'exec'))");
  const answer = mp.globals.get("answer");
  return Object.assign((request) => JSON.parse(answer(JSON.stringify(request))), { quiet });
}
