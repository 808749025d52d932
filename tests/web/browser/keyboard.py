"""Somebody who has no mouse: what Tab comes to, and how they get to a thing of a certain name.

In the program editor Tab indents; Escape before it leads out, as the page's help says.
"""

from __future__ import annotations

from playwright.sync_api import Locator, Page

MOST_TABS = 400
"""No page has as many things to come to."""
_IN_EDITOR = "!!document.activeElement.closest('.cm-editor')"
_BEGIN = """() => {
  window.msReached = new Set();
  if (!window.msListens) document.addEventListener("focusin", (event) => window.msReached.add(event.target));
  window.msListens = true;
  window.msTabs = 0;
  document.activeElement.blur();
}"""
# What a mouse could use: visible, not greyed out. One of a group in which arrows choose stands for all of it.
_MISSED = """() => {
  const usable = 'a[href], button, input, select, textarea, summary, [role=button], [role=link], [role=slider], ' +
    '[role=combobox], [role=switch], [role=checkbox], [role=tab], [contenteditable=true], .q-toggle';
  const isSeen = (one) => one.checkVisibility({ visibilityProperty: true, opacityProperty: true })
    && one.getBoundingClientRect().width > 1;
  return [...(document.querySelector(".q-dialog [role=dialog], .q-dialog__inner") || document).querySelectorAll(usable)]
    .filter((one) => isSeen(one) && !one.disabled && one.getAttribute("aria-disabled") !== "true")
    .filter((one) => ![...window.msReached].some((reached) => reached === one || reached.contains(one)
      || one.contains(reached)))
    .filter((one) => { const group = one.closest("[role=tablist], [role=radiogroup]");
      return !(group && [...window.msReached].some((reached) => group.contains(reached))); })
    .map((one) => one.outerHTML.slice(0, 200));
}"""


def out_of_reach(page: Page) -> list[str]:
    """What a mouse could use on a page and Tab never comes to; ideally nothing."""
    page.evaluate(_BEGIN)
    for _ in range(MOST_TABS):
        _press_tab(page)
        # Behind the last one comes the page itself; in a dialog the first one again.
        if page.evaluate("document.activeElement === document.body || msReached.size < msTabs - 5"):
            break
    else:
        raise AssertionError("Tab does not leave the page any more")
    missed: list[str] = page.evaluate(_MISSED)
    return missed


def _press_tab(page: Page) -> None:
    if page.evaluate(f"window.msTabs += 1, {_IN_EDITOR}"):
        page.keyboard.press("Escape")
    page.keyboard.press("Tab")


def tab_to(page: Page, target: Locator) -> None:
    """Press Tab until something has the focus."""
    target.wait_for(state="visible")
    for _ in range(MOST_TABS):
        page.keyboard.press("Tab")
        # Pages are drawn anew while they are used: each time it is the one that is there now.
        if target.evaluate("one => one === document.activeElement || one.contains(document.activeElement)"):
            return
    raise AssertionError(f"Tab does not come to {target}")
