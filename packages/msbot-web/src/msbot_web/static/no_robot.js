// What a browser shows in a page's place while no robot answers: it asks now and then, and loads the page when one does.
(() => {
  const FIRST_MS = 1000, GROWS = 1.4, LONGEST_MS = 8000, PATIENCE_MS = 3000;
  const root = new URL(document.currentScript.src).pathname.replace(/\/web\/no_robot\.js$/, "");
  let failures = 0;

  async function ask() {
    try {
      const answer = await fetch(`${root}/api/health`, { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      if (answer.ok) return location.reload();
    } catch {
      // It asks again.
    }
    later();
  }

  function later() {
    const ms = Math.min(FIRST_MS * GROWS ** failures, LONGEST_MS) * (0.5 + Math.random());
    failures += 1;
    setTimeout(ask, ms);
  }

  addEventListener("online", ask);
  document.addEventListener("DOMContentLoaded", () => {
    const again = document.getElementById("ms-again");
    again.addEventListener("click", (event) => { event.preventDefault(); location.reload(); });
  });
  later();
})();
