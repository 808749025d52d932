// Where the keyboard is. When the thing that had the focus is gone (its list was drawn anew, its dialog closed, its button
// greyed out), the browser leaves the focus nowhere: whoever uses no mouse, or has the page read aloud, begins again at the
// top. Here it goes to the thing that has taken its place; else to what is beside it; else to where a dialog was opened
// from; else to the page's content.
{
  const LOOK_MS = 150;
  const USABLE = "a[href], button, input, select, textarea, summary, [tabindex]";
  const openers = new WeakMap();  // by dialog or menu: the description of what had the focus before it
  let last = null;

  const nameOf = (one) => [one.tagName, one.type, one.getAttribute("role"), one.dataset.slot, one.dataset.port,
    one.getAttribute("aria-label") || one.name || one.textContent.trim().slice(0, 80)].join("|");
  const canTake = (one) => !one.disabled && one.tabIndex >= 0 && one.getAttribute("aria-disabled") !== "true"
    && one.checkVisibility({ visibilityProperty: true });
  const usableIn = (place) => [...place.querySelectorAll(USABLE)].filter(canTake);
  const dialogOf = (one) => one.closest(".q-dialog, .q-menu");

  function describe(one) {
    const chain = [];  // each place around it, and which of the things in there it is
    for (let place = one.parentElement; place && place !== document.body; place = place.parentElement)
      chain.push([place, [...place.querySelectorAll(USABLE)].indexOf(one)]);
    return { one, name: nameOf(one), chain, dialog: dialogOf(one) };
  }

  function heirOf(description) {
    if (!description) return null;
    const { one, name, chain, dialog } = description;
    if (one.isConnected && canTake(one)) return one;
    for (const [place, index] of chain) {
      if (!place.isConnected || place.contains(document.getElementById("content"))) continue;
      const found = usableIn(place);
      const same = found.find((other) => nameOf(other) === name);
      if (same) return same;
      if (found.length) return found[Math.min(Math.max(index, 0), found.length - 1)];
    }
    return dialog && heirOf(openers.get(dialog));
  }

  function look() {
    if (document.activeElement !== document.body || !last || !document.hasFocus()) return;
    const heir = heirOf(last) || document.getElementById("content");
    if (heir) heir.focus({ preventScroll: true });
  }

  addEventListener("focusin", ({ target }) => {
    if (target === document.body || target.id === "content") return;
    const dialog = dialogOf(target);
    if (dialog && last && last.dialog !== dialog && !openers.has(dialog)) openers.set(dialog, last);
    last = describe(target);
  });
  // Who clicks beside everything wants the focus nowhere.
  addEventListener("mousedown", () => setTimeout(() => { if (document.activeElement === document.body) last = null; }), true);
  addEventListener("DOMContentLoaded", () => {
    new MutationObserver(look).observe(document.body, { childList: true, subtree: true });
    setInterval(look, LOOK_MS);
  });
}
