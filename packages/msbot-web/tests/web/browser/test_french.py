"""The page in a language that is nothing but a file: its words, its numbers, its place in the menu; and it fits."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from tests.web.browser.conftest import Site, go, new_page
from tests.web.browser.test_demo_pages import FITS


@pytest.mark.promise("A further language of the page is one file")
def test_the_page_speaks_french_and_the_menu_names_it_so(browser: Browser, demo: Site) -> None:
    page = new_page(browser, locale="fr-FR")
    page.goto(demo.link)
    for path, heading in (("/", "Robot"), ("/library", "Biblioth\u00e8que"), ("/learn", "Apprendre")):
        go(page, demo.base + path)
        assert page.evaluate("document.documentElement.lang") == "fr"
        expect(page.get_by_role("heading", level=1)).to_have_text(heading)
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 844})
            page.wait_for_function(FITS)
    expect(page.get_by_text("en anglais").first).to_be_visible()  # a lesson that has no French text says so
    page.get_by_role("button", name="Vous").click()
    expect(page.get_by_text("Fran\u00e7ais", exact=True)).to_be_visible()
    page.context.close()
