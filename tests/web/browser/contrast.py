"""How well the text of a page stands out from what is behind it, after WCAG 2.1, 1.4.3 (level AA)."""

from __future__ import annotations

from playwright.sync_api import Page

_FAINT = """() => {
  const parse = (text) => { const p = text.match(/[\\d.]+/g).map(Number); return [p[0], p[1], p[2], p[3] ?? 1]; };
  const over = (top, below) => [0, 1, 2].map((i) => top[i] * top[3] + below[i] * (1 - top[3])).concat(1);
  const light = (c) => { const f = (v) => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; };
    return 0.2126 * f(c[0]) + 0.7152 * f(c[1]) + 0.0722 * f(c[2]); };
  const behind = (element) => { const layers = [];
    for (let e = element; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor);
      layers.push(c); if (c[3] === 1) break; }
    return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255, 1]); };
  const found = new Set();
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement, text = walker.currentNode.textContent.trim();
    if (!text || element.closest('svg, script, style, [aria-hidden=true], .disabled, .q-icon, .cm-editor')) continue;
    if (!element.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue;
    const style = getComputedStyle(element), back = behind(element), size = parseFloat(style.fontSize);
    const ink = light(over(parse(style.color), back)), ground = light(back);
    const ratio = (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05);
    const isLarge = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (isLarge ? 3 : 4.5)) found.add(`${text.slice(0, 40)}: ${ratio.toFixed(2)}`);
  }
  return [...found];
}"""


def faint_texts(page: Page, *, dark: bool) -> list[str]:
    """Visible texts of the page with too little contrast, each with its ratio; ideally none."""
    page.emulate_media(reduced_motion="reduce")  # colours change at once then
    # Asked again until it holds: the page may be about to set what its visitor has chosen.
    page.wait_for_function(
        "(dark) => { Quasar.Dark.set(dark); return document.body.classList.contains('body--dark') === dark }", arg=dark
    )
    found: list[str] = page.evaluate(_FAINT)
    return found
