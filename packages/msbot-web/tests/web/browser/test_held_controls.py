"""A simulated button that is pressed on a page is let go when the page is closed or its connection lost."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

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


def test_a_slider_that_is_put_before_the_page_has_its_robot_is_obeyed_once_it_has(page: Page, demo: Site) -> None:
    tab = page.context.new_page()
    waiting: list[WebSocketRoute] = []

    def hold_back(route: WebSocketRoute) -> None:
        waiting.append(route)

    tab.route_web_socket("**/_nicegui_ws/**", hold_back)
    tab.goto(f"{demo.base}/?slot=knob")
    slider = tab.locator(".ms-drawer").get_by_role("slider").first
    slider.press("End")
    expect(slider).to_have_value("100")
    assert not tab.evaluate("window.did_handshake === true")
    card = page.get_by_role("button", name="Open slot fan")
    expect(card).not_to_contain_text("percent 100")
    waiting[0].connect_to_server()
    expect(card).to_contain_text(re.compile(r"percent (9[5-9]|100)"))
    tab.close()
