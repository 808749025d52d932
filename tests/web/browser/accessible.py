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
_RUN = """async ([dark, colours]) => {
  // Again until it holds: the page may be about to set what its visitor has chosen, also while axe looks. And on a busy
  // machine the robot may answer late for a moment, which makes the page grey: nobody has to read it then.
  const isDead = () => document.documentElement.classList.contains('ms-dead');
  let found, wasDead;
  const watch = new MutationObserver(() => { wasDead = wasDead || isDead(); });
  watch.observe(document.documentElement, { attributeFilter: ['class'] });
  do {
    while (isDead()) await new Promise((done) => setTimeout(done, 50));
    wasDead = false;
    window.Quasar?.Dark.set(dark);
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    found = await axe.run({ exclude: [['.cm-editor'], ['#popup'], ['.q-loading-bar']] }, {
    rules: colours ? {} : { 'label-content-name-mismatch': { enabled: false } }, preload: false,
    runOnly: colours || ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa'], resultTypes: ['violations'] });
  } while (wasDead || window.Quasar && document.body.classList.contains('body--dark') !== dark);
  watch.disconnect();
  return found.violations.flatMap((rule) => rule.nodes.map((node) =>
    [rule.id, node.target.join(' '), node.html.slice(0, 160),
     (node.any[0] || node.all[0] || node.none[0] || {}).message].join(': ')));
}"""


def hurdles_by_day_and_night(page: Page) -> list[str]:
    """What somebody could not see, hear or reach in the light, and what they could not see in the dark."""
    return hurdles(page, dark=False) + hurdles(page, dark=True, rules=COLOURS)


def hurdles(page: Page, *, dark: bool, rules: Sequence[str] | None = None) -> list[str]:
    """What of a page somebody could not see, hear or reach; ideally nothing. By all rules, or by these."""
    page.emulate_media(reduced_motion="reduce")  # colours change at once then
    if page.evaluate("typeof Quasar === 'undefined'"):  # a plain form, which follows what the browser prefers
        page.emulate_media(color_scheme="dark" if dark else "light")
    if not page.evaluate("typeof axe === 'object'"):
        page.evaluate(AXE.read_text("utf-8"))
    found: list[str] = page.evaluate(_RUN, [dark, rules])
    return found
