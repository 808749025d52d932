// The MicroPython VM in node, driven line by line: one request (JSON) in, one answer out. See vm_host.py.
// A list [LIBRARY, HOST, ...] begins a new VM with the files of that package, so that one node serves many tests.
// Hosts run one after the other; MODULE=FILE puts a file where `import MODULE` finds it.
import { readFileSync, readdirSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";

const vm = process.argv[2];
const { loadMicroPython } = await import(join(vm, "micropython.mjs"));
const stray = []; // what the VM prints by itself: an error of the host

async function begin([library, ...hosts]) {
  const mp = await loadMicroPython({
    url: join(vm, "micropython.wasm"),
    stdout: (line) => stray.push(line),
    stderr: (line) => stray.push(line),
    linebuffer: true,
  });
  mp.FS.mkdir("/lib");
  mp.FS.mkdir("/lib/msbot");
  for (const name of readdirSync(library)) {
    if (name.endsWith(".py") || name.endsWith(".mpy")) mp.FS.writeFile(`/lib/msbot/${name}`, readFileSync(join(library, name)));
  }
  for (const host of hosts) {
    const [name, file] = host.split("=");
    if (file) mp.FS.writeFile(`/lib/${name}.py`, readFileSync(file));
    else mp.runPython(readFileSync(host, "utf8"));
  }
  return mp;
}

let mp;
for await (const line of createInterface({ input: process.stdin })) {
  let reply;
  try {
    if (line.startsWith("[")) {
      mp = await begin(JSON.parse(line));
      reply = "{}";
    } else reply = mp.globals.get("answer")(line);
  } catch (error) {
    reply = JSON.stringify({ broken: `${error.message}` });
  }
  process.stdout.write(`${reply}\n`);
  if (stray.length) process.stderr.write(`${stray.splice(0).join("\n")}\n`);
}
