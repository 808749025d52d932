// Keeps one small page in the browser, and shows it in place of the browser's own error while no robot answers. What the
// robot answers is passed on as it is: nothing of it is kept.
const SHELL = "msbot-no-robot-@MARK@", PAGE = "no-robot";
const FILES = [PAGE, "web/form.css", "web/icon.svg", "web/no_robot.js"];
const at = (path) => new URL(path, registration.scope).href;

addEventListener("install", (event) => {
  event.waitUntil((async () => {
    const shell = await caches.open(SHELL);
    await shell.addAll(FILES.map((path) => new Request(at(path), { cache: "reload" })));
    await skipWaiting();
  })());
});

addEventListener("activate", (event) => {
  event.waitUntil((async () => {
    for (const name of await caches.keys()) if (name.startsWith("msbot-no-robot-") && name !== SHELL) await caches.delete(name);
    await clients.claim();
  })());
});

addEventListener("fetch", (event) => {
  const { request } = event;
  const isFile = FILES.some((path) => request.url === at(path));
  if (request.method !== "GET" || (request.mode !== "navigate" && !isFile)) return;
  event.respondWith((async () => {
    try {
      return await fetch(request);
    } catch (error) {
      const shell = await caches.open(SHELL);
      const kept = await shell.match(isFile ? request : at(PAGE));
      if (!kept) throw error;
      return kept;
    }
  })());
});
