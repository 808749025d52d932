// The robot's own thread: Python (Pyodide), MsBOT, and nothing of the page. A program that never ends stops this
// thread only, and the page can end it.
"use strict";

importScripts("pyodide/pyodide.js");

const tell = (kind, value) => postMessage({ kind, value });

// What is fetched is counted on its way; that the answers keep their type lets the browser compile while it loads.
let octets = 0;
const plainFetch = self.fetch;
self.fetch = async (...request) => {
  const answer = await plainFetch(...request);
  if (!answer.ok || !answer.body) return answer;
  const counted = answer.body.pipeThrough(new TransformStream({
    transform(chunk, controller) {
      octets += chunk.byteLength;
      tell("loaded", octets);
      controller.enqueue(chunk);
    },
  }));
  return new Response(counted, { status: answer.status, statusText: answer.statusText, headers: answer.headers });
};

async function begin() {
  const files = new URL("pyodide/", self.location.href).href;
  const [pyodide, packages] = await Promise.all([loadPyodide({ indexURL: files }), fetchPackages()]);
  tell("starting", "");
  pyodide.unpackArchive(packages, "zip", { extractDir: "/msbot" });
  pyodide.runPython("import sys; sys.path.insert(0, '/msbot')");
  const start = pyodide.pyimport("tab_start");
  const tab = start.Tab((text) => tell("look", text), (words) => tell("failed", words));
  tell("program", start.program.toJs());
  self.onmessage = (event) => tab.act(event.data);
  tab.begin();
}

async function fetchPackages() {
  const answer = await fetch("msbot.zip");
  if (!answer.ok) throw new Error(`msbot.zip: ${answer.status} ${answer.statusText}`);
  return answer.arrayBuffer();
}

begin().catch((error) => tell("failed", String(error.message || error)));
