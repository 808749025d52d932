"""The docs' page "Try it in this tab", from a static server, in a real browser: the real master under Pyodide."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import markdown2
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests import ROOT
from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import new_page
from tools.assets import is_stored
from tools.tab_site import build_tab, with_robot

NEEDED = "MSBOT_NEED_PYODIDE"
FRAME = """<!doctype html><html lang="en"><head><title>Try it in this tab</title>
<meta name="viewport" content="width=device-width"></head><body><main>{}</main></body></html>"""


class Quiet(SimpleHTTPRequestHandler):
    """A plain static server."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The page as a site has it, without the site's own look."""
    if not is_stored("pyodide"):
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)(
            "Pyodide is not here: python tools/assets.py pyodide fetches it (12 MB, needs npm)"
        )
    site = tmp_path_factory.mktemp("site")
    octets = build_tab(site / "tutorial" / "tab")
    text = (ROOT / "docs/tutorial/try_in_this_tab.md").read_text("utf-8")
    page = site / "tutorial" / "try" / "index.html"
    page.parent.mkdir()
    page.write_text(FRAME.format(markdown2.markdown(with_robot(text, octets))), "utf-8")
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=site))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/tutorial/try/"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def asked() -> list[str]:
    """What the visitor's browser has asked for."""
    return []


@pytest.fixture(scope="module")
def visitor(browser: Browser, address: str, asked: list[str]) -> Page:
    """Somebody with a phone, whose robot is loaded."""
    page = new_page(browser, width=390, height=844)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    assert not [url for url in asked if "pyodide" in url], "nothing large is loaded unasked"
    button = page.get_by_role("button", name="Load the robot (about 14 MB)")
    button.focus()
    page.keyboard.press("Enter")
    expect_state(page, "spare fan", "standby")
    return page


def test_a_robot_that_cannot_be_loaded_says_so(browser: Browser, address: str) -> None:
    page = new_page(browser)
    page.route("**/pyodide.js", lambda route: route.abort())
    page.goto(address)
    press(page, "Load the robot (about 14 MB)")
    expect(page.get_by_role("status")).to_contain_text("The robot does not run: ")
    page.context.close()


def card(page: Page, place: str) -> Locator:
    return page.locator(f'[data-place="{place}"]')


def expect_state(page: Page, place: str, state: str) -> None:
    expect(card(page, place)).to_have_attribute("data-state", state)


def press(page: Page, name: str) -> None:
    """By keyboard."""
    page.get_by_role("button", name=name, exact=True).focus()
    page.keyboard.press("Enter")


def test_everybody_can_use_it_also_on_a_phone(visitor: Page) -> None:
    press(visitor, "Hold")  # the lines of the bus, for the time in which axe looks
    assert hurdles(visitor, dark=False) == []
    press(visitor, "Hold")
    assert visitor.evaluate("document.documentElement.scrollWidth") <= 390


def test_a_spare_takes_over(visitor: Page) -> None:
    press(visitor, "Unplug fan")
    expect_state(visitor, "spare fan", "active")
    expect(card(visitor, "spare fan")).to_contain_text("takes over slot fan")
    expect_state(visitor, "fan", "lost")
    press(visitor, "Plug in fan")
    expect_state(visitor, "fan", "standby")


def test_three_lines_join_and_stop_holds(visitor: Page) -> None:
    visitor.get_by_label("Turn the knob").focus()
    visitor.keyboard.press("End")
    press(visitor, "Run")
    expect_state(visitor, "yours", "active")
    expect(card(visitor, "lamp")).to_contain_text("Whether it shines: yes")
    expect(visitor.get_by_role("region", name="Frames on the bus")).to_contain_text("knob says level")
    press(visitor, "STOP")
    expect(visitor.get_by_text("STOP by you. Confirmed:")).to_contain_text("yours after")
    expect(card(visitor, "lamp")).to_contain_text("Whether it shines: no")
    press(visitor, "GO")
    expect(visitor.get_by_text("No STOP holds.")).to_be_visible()
    expect(card(visitor, "lamp")).to_contain_text("Whether it shines: yes")


def test_mistakes_and_programs_that_never_end(visitor: Page, address: str, asked: list[str]) -> None:
    lines = visitor.get_by_label("Your lines")
    lines.fill("def light(:")
    press(visitor, "Run")
    expect(visitor.get_by_label("What your program says")).to_contain_text("yours.py:5: invalid syntax")
    lines.fill("while True:\n    pass")
    press(visitor, "Run")
    expect(visitor.get_by_text("A program that never ends stops this whole robot.")).to_be_visible()
    press(visitor, "Start again")
    expect_state(visitor, "spare fan", "standby")
    expect(lines).to_have_value("while True:\n    pass")
    assert [url for url in asked if not url.startswith(address.partition("/tutorial")[0])] == [], "from the site itself"
