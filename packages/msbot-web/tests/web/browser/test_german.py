"""Every page, in German: it opens, fits and can be read by everybody, and by whoever knows no English.

Numbers have a decimal comma.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

import pytest
from playwright.sync_api import Browser, Page, expect

from msbot_web.language import languages
from tests.web.browser.accessible import hurdles_by_day_and_night
from tests.web.browser.conftest import Site, go, new_page
from tests.web.browser.test_demo_pages import FITS, PAGES

ENGLISH = frozenset(
    [
        "the",
        "is",
        "are",
        "of",
        "and",
        "to",
        "for",
        "with",
        "not",
        "no",
        "by",
        "from",
        "that",
        "it",
        "its",
        "at",
        "since",
        "this",
        "how",
        "where",
        "whether",
        "what",
        "says",
        "hears",
        "ago",
        "been",
        "has",
        "have",
        "which",
        "who",
        "there",
        "a",
        "it's",
        "nothing",
        "none",
        "be",
        "must",
        "only",
        "every",
        "another",
        "there's",
    ]
)
"""Words that no German sentence has; names of parts, topics and messages are names in every language."""
VISIBLE_TEXTS = """() => {
  const found = [];
  const names = ".mono, .cm-editor, [lang=en], .ms-robot, .q-icon";
  const isNamed = (element) => !element.checkVisibility() || element.closest(names);
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode())
    if (!isNamed(node.parentElement)) found.push(node.textContent);
  for (const element of document.querySelectorAll("[aria-label], [title], [placeholder]"))
    if (!isNamed(element))
      for (const name of ["aria-label", "title", "placeholder"]) found.push(element.getAttribute(name) || "");
  return found.map((text) => text.trim()).filter(Boolean);
}"""
DECIMAL_POINT = re.compile(r"(?<![\w.:])\d+\.\d{1,2}(?![\w.:])")
"""A number such as 0.25; not 1.234 (a thousand), not an address, not a version."""


@pytest.fixture(scope="module")
def page(browser: Browser, demo: Site) -> Iterator[Page]:
    """The tab of somebody whose browser prefers German."""
    page = new_page(browser, locale="de-DE")
    page.goto(demo.link)
    yield page
    page.context.close()


class Noticed(NamedTuple):
    """What the tab has reported."""

    errors: list[str]
    asked: list[str]
    """Addresses."""


@pytest.fixture(scope="module")
def noticed(page: Page) -> Noticed:
    found = Noticed([], [])
    page.on("request", lambda request: found.asked.append(request.url))
    page.on("pageerror", lambda error: found.errors.append(str(error)))
    page.on("console", lambda message: found.errors.append(message.text) if message.type == "error" else None)
    return found


def english_on(page: Page) -> list[str]:
    """The texts of a page that hold an English word, and numbers with a decimal point."""
    texts: list[str] = page.evaluate(VISIBLE_TEXTS)
    return [
        text for text in texts if ENGLISH & set(re.findall(r"[\w']+", text.casefold())) or DECIMAL_POINT.search(text)
    ]


FILLED = {
    "/": ".slot", "/settings": ".q-field input", "/bus": "tr[data-number]", "/wires": "svg.wires .port",
    "/plots": "#ms-plot-figures td",
    "/timeline": "svg.wide rect", "/library": "a.slot", "/library/SG90": "table", "/journal": "tbody tr",
    "/gallery": ".ms-exhibit", "/faults": "button", "/missions": "button", "/learn": ".panel .row",
    "/learn/quiz?seed=7": "pre", "/class": "a.slot", "/admin": "table",
    "/pupils": ".panel", "/projector": ".wall-groups li",
    "/doctor": "table", "/?slot=fan": "[role=dialog] input", "/?slot=knob": "[role=dialog] input",
}  # fmt: skip
"""What is there as soon as a page has something to show."""


def test_what_one_sees_of_a_simulated_part_is_said_in_german(page: Page, demo: Site) -> None:
    go(page, f"{demo.base}/?slot=headlight")
    expect(page.get_by_role("dialog")).to_contain_text("Wie hell [%]")


@pytest.mark.parametrize("path", [*PAGES, "/?slot=fan", "/?slot=knob"])
def test_every_page_opens_without_an_error_fits_and_can_be_read(
    page: Page, noticed: Noticed, demo: Site, path: str
) -> None:
    """In German, whose words are the longer ones."""
    noticed.errors.clear()
    noticed.asked.clear()
    page.set_viewport_size({"width": 1280, "height": 900})
    go(page, demo.base + path)
    assert page.evaluate("document.documentElement.lang") == "de"
    heading = languages()["de"].translate(PAGES[path.partition("?slot")[0]])
    expect(page.get_by_role("heading", level=1)).to_have_text(heading)
    expect(page.locator("#ms-stop")).to_have_text("STOPP")
    expect(page.locator("#ms-stop")).to_be_visible()
    expect(page.locator(FILLED.get(path, "h1")).first).to_be_attached()
    assert english_on(page) == []
    if path in PAGES:
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 844})
            page.wait_for_function(FITS)
        assert "<style" not in page.locator("body").inner_text(), "nothing of the page's making is read out"
        assert hurdles_by_day_and_night(page) == []
    assert {url for url in noticed.asked if not url.startswith((demo.base, "data:", "blob:"))} == set(), "works offline"
    assert noticed.errors == []


def test_a_german_makes_a_slot_and_takes_none_out(page: Page, demo: Site) -> None:
    go(page, f"{demo.base}/wires")
    page.get_by_role("button", name="Neuer Platz").click()
    page.get_by_label("Suchen").fill("taster")
    expect(page.get_by_role("radio")).to_have_count(2)  # a list that is shortened under the pointer loses the click
    page.get_by_role("radio", name="Taster · BUTTON", exact=True).click()
    expect(page.get_by_text("Bleibt es leer, heißt er")).to_be_visible()
    assert english_on(page) == []
    page.get_by_role("button", name="Abbrechen").click()
    expect(page.get_by_role("dialog")).to_have_count(0)
    page.get_by_role("button", name="Platz horn herausnehmen").click()
    expect(page.get_by_text("Platz horn aus dem Roboter nehmen?")).to_be_visible()
    assert english_on(page) == []
    page.get_by_role("button", name="Abbrechen").click()


def test_a_german_reads_why_a_part_is_lost(page: Page, demo: Site) -> None:
    go(page, demo.base)
    page.get_by_role("button", name="bumper ausstecken").click()
    card = page.get_by_role("button", name="Platz bumper öffnen")
    expect(card).to_contain_text(re.compile(r"kein Herzschlag seit \d+,\d s: Lebenszustand 0"))
    card.click()
    expect(page.get_by_role("dialog")).to_contain_text(re.compile(r"bumper \(\S+\) ist verloren seit \d+,\d s"))
    assert english_on(page) == []
    go(page, f"{demo.base}/journal")
    expect(page.get_by_text(re.compile(r"kein Herzschlag seit \d+,\d s: Lebenszustand 0")).first).to_be_visible()
    go(page, demo.base)
    page.get_by_role("button", name="bumper einstecken").click()
    expect(card).to_contain_text("aktiv")


def test_the_library_is_searched_in_german(page: Page, demo: Site) -> None:
    go(page, f"{demo.base}/library")
    page.get_by_label("Suchen").fill("Abstand")
    expect(page.get_by_text("Ultraschall-Abstandssensor")).to_be_visible()
    expect(page.get_by_text("Summer", exact=True)).to_have_count(0)
    page.get_by_label("Suchen").fill("servo")
    expect(page.get_by_text("Servo, 180 Grad", exact=True)).to_be_visible()
