"""Whether everybody can use a page: axe-core's rules for WCAG 2.1, levels A and AA, light and dark."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from playwright.sync_api import Page

# The editor, the note about a lost connection and the loading bar are NiceGUI's own. The name of a card is its slot's
# name and what a click does, not all the numbers that change in it: whoever speaks to the page says "open slot fan".
AXE = Path(__file__).parent / "axe-core" / "axe.min.js"
COLOURS = ("color-contrast", "link-in-text-block")
"""The rules about colours; all others find in the dark what they find in the light."""
_LOOKS_SO = "(dark) => !window.Quasar || Quasar.Dark.isActive === dark"
_RUN = """async (colours) => {
  // The robot may answer late for a moment, which makes the page grey: nobody has to read it then. On a busy machine
  // axe itself keeps the page from hearing the robot.
  const awake = new CSSStyleSheet();
  awake.replaceSync(
    '.ms-dead #content, .ms-dead .q-dialog__inner { filter: none !important; opacity: 1 !important; }');
  document.adoptedStyleSheets.push(awake);
  const found = await axe.run({ exclude: [['.cm-editor'], ['#popup'], ['.q-loading-bar']] }, {
    rules: colours ? {} : { 'label-content-name-mismatch': { enabled: false } }, preload: false,
    runOnly: colours || ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'], resultTypes: ['violations'] });
  document.adoptedStyleSheets.splice(document.adoptedStyleSheets.indexOf(awake), 1);
  return found.violations.flatMap((rule) => rule.nodes.map((node) =>
    [rule.id, node.target.join(' '), node.html.slice(0, 160),
     (node.any[0] || node.all[0] || node.none[0] || {}).message].join(': ')));
}"""


def hurdles_by_day_and_night(page: Page) -> list[str]:
    """What somebody could not see, hear or reach in the light, and what they could not see in the dark."""
    return hurdles(page, dark=False) + hurdles(page, dark=True, rules=COLOURS)


def hurdles(page: Page, *, dark: bool, rules: Sequence[str] | None = None) -> list[str]:
    """What of a page somebody could not see, hear or reach; ideally nothing. By all rules, or by these."""
    # Colours change at once then. The page follows what the browser prefers; set from here, its look would be set back
    # at the page's next update, which is often before axe has come to its end.
    page.emulate_media(reduced_motion="reduce", color_scheme="dark" if dark else "light")
    page.wait_for_function(_LOOKS_SO, arg=dark)
    if not page.evaluate("typeof axe === 'object'"):
        page.evaluate(AXE.read_text("utf-8"))
    found: list[str] = page.evaluate(_RUN, rules)
    assert page.evaluate(_LOOKS_SO, dark), "the page's look has changed meanwhile"
    return found
