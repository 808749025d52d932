// A page that the robot does not give at this moment: it asks for its turn, with growing waits, and comes back by itself.
(() => {
  const FIRST_MS = 1000, GROWS = 1.6, LONGEST_MS = 15000, PATIENCE_MS = 5000;
  const root = new URL(document.currentScript.src).pathname.replace(/\/web\/refused\.js$/, "");
  let failures = 0;

  function again() {
    const ms = Math.min(FIRST_MS * GROWS ** failures, LONGEST_MS) * (0.5 + Math.random());
    failures += 1;
    setTimeout(ask, ms);
  }

  function load() {
    if (typeof msbot !== "undefined" && msbot.isSaying()) again();  // STOP goes before
    else location.reload();
  }

  async function ask() {
    try {
      const answer = await fetch(`${root}/turn`, { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      if (answer.status === 401) return location.reload();
      if (answer.ok) return setTimeout(load, (await answer.json()).wait_ms);
    } catch {
      // It asks again.
    }
    again();
  }

  again();
})();
