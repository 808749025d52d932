"""A simulated button that is pressed on a page is let go when the page is closed or its connection lost."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.web.browser.conftest import Site, again_until, go, new_page


def close_the_tab(page: Page) -> None:
    page.close()


def close_the_browser(page: Page) -> None:
    page.context.close()


def lose_the_connection(page: Page) -> None:
    page.context.set_offline(offline=True)
    page.evaluate("socket.io.engine.close()")


@pytest.mark.promise(
    "What somebody holds by hand is let go when the page, session or API token with which they hold it is gone"
)
@pytest.mark.parametrize("leave", [close_the_tab, close_the_browser, lose_the_connection])
def test_a_button_is_let_go_when_whoever_presses_it_is_gone(
    browser: Browser, page: Page, demo: Site, leave: Callable[[Page], None]
) -> None:
    card = page.get_by_role("button", name="Open slot button")
    expect(card).to_contain_text("on off")
    presser = new_page(browser)
    presser.goto(demo.link)
    go(presser, f"{demo.base}/?slot=button")
    press = presser.locator(".ms-drawer .panel button").filter(has_text="press").first

    def hold() -> None:
        presser.mouse.up()
        press.hover()
        presser.mouse.down()

    again_until(hold, lambda ms: expect(card).to_contain_text("on on", timeout=ms))
    leave(presser)
    expect(card).to_contain_text("on off")
    if leave is not close_the_browser:
        presser.context.close()
