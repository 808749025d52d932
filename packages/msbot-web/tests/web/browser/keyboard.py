"""Somebody who has no mouse: what Tab comes to, and how they get to a thing of a certain name.

In the program editor Tab indents; Escape before it leads out, as the page's help says.
"""

from __future__ import annotations

from playwright.sync_api import Locator, Page

MOST_TABS = 400
"""No page has as many things to come to."""
_SEEN_AGAIN = 50
"""So many Tabs later a thing is looked up anew, since another one may bear its name by now."""
_HAS_FOCUS = """(one) => one.isConnected
  ? one === document.activeElement || one.contains(document.activeElement) : null"""
_BEGIN = """() => {
  window.msReached = new Set();
  if (!window.msListens) document.addEventListener("focusin", (event) => window.msReached.add(event.target));
  window.msListens = true;
  window.msTabs = 0;
  document.activeElement.blur();
}"""
# Behind the last one comes the page itself; in a dialog the first one again.
_AFTER_TAB = """() => {
  const one = document.activeElement;
  return { isRound: one === document.body || window.msReached.size < ++window.msTabs - 5,
    isInEditor: !!one.closest(".cm-editor") };
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


_ROUNDS = 3
"""On a busy machine a page is still being made while Tab goes round: the next round comes to what came behind it."""


def out_of_reach(page: Page) -> list[str]:
    """What a mouse could use on a page and Tab never comes to; ideally nothing."""
    missed: list[str] = []
    for _ in range(_ROUNDS):
        missed = _missed_by_tab(page)
        if not missed:
            break
    return missed


def _missed_by_tab(page: Page) -> list[str]:
    """The same, in one round."""
    page.evaluate(_BEGIN)
    is_in_editor = False
    for _ in range(MOST_TABS):
        if is_in_editor:
            page.keyboard.press("Escape")
        page.keyboard.press("Tab")
        now = page.evaluate(_AFTER_TAB)
        if now["isRound"]:
            break
        is_in_editor = now["isInEditor"]
    else:
        raise AssertionError("Tab does not leave the page any more")
    missed: list[str] = page.evaluate(_MISSED)
    return missed


def tab_to(page: Page, target: Locator) -> None:
    """Press Tab until something has the focus."""
    target.wait_for(state="visible")
    one = target.element_handle()
    for count in range(MOST_TABS + 1):
        # To look something up by its name takes longer than a Tab. Pages are drawn anew while they are used: what is
        # gone is looked up again.
        has_focus = page.evaluate(_HAS_FOCUS, one)
        if has_focus is None or count % _SEEN_AGAIN == _SEEN_AGAIN - 1:
            one = target.element_handle()
            has_focus = page.evaluate(_HAS_FOCUS, one)
        if has_focus:
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"Tab does not come to {target}")
