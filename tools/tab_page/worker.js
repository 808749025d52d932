// The robot's own thread: Python (Pyodide), MsBOT, and nothing of the page. A program that never ends stops this
// thread only, and the page can end it.
"use strict";

importScripts("pyodide/pyodide.js");

const tell = (kind, value) => postMessage({ kind, value });

async function begin() {
  tell("progress", "Loading Python");
  const files = new URL("pyodide/", self.location.href).href;
  const [pyodide, packages] = await Promise.all([loadPyodide({ indexURL: files }), fetchPackages()]);
  tell("progress", "Starting MsBOT");
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
