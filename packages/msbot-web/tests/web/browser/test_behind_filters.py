"""What stands between a page and its robot lets not everything through: the page lives all the same, or says why not.
In a browser, with Debian's nginx as its package comes: it passes no WebSockets and changes the address."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.nginx import nginx
from tests.web.browser.conftest import Site, free_port, new_page

DEAD = "document.documentElement.classList.contains('ms-dead')"
LIVE = "window.did_handshake && window.socket.connected"
SERVER = "server {{ listen 127.0.0.1:{0}; location / {{ {1} proxy_pass {2}; }} {3} }}\n"
NO_CHANNEL = "location /_nicegui_ws/ { return 403; }"


class Ways:
    """Addresses of the robot behind nginx."""

    def __init__(self) -> None:
        self.rewritten, self.passed_on, self.no_channel = (f"http://127.0.0.1:{free_port()}" for _ in range(3))


@pytest.fixture(scope="module")
def ways(demo: Site, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ways]:
    ways, host = Ways(), "proxy_set_header Host $http_host;"
    servers = "".join(
        SERVER.format(address.rpartition(":")[2], more, demo.base, last)
        for address, more, last in (
            (ways.rewritten, "", ""),
            (ways.passed_on, host, ""),
            (ways.no_channel, host, NO_CHANNEL),
        )
    )
    ports = [int(one.rpartition(":")[2]) for one in vars(ways).values()]
    with nginx(Path(tmp_path_factory.mktemp("proxy")) / "nginx", servers, *ports):
        yield ways


@pytest.fixture
def visitor(browser: Browser, demo: Site) -> Iterator[Page]:
    page = new_page(browser, waits=False)
    yield page
    page.context.close()


def enter(page: Page, demo: Site, base: str) -> None:
    page.goto(demo.link.replace(demo.base, base))


@pytest.mark.parametrize("way", ["rewritten", "passed_on"])
def test_where_no_websocket_passes_a_page_lives_by_long_polling(
    way: str, visitor: Page, demo: Site, ways: Ways
) -> None:
    enter(visitor, demo, getattr(ways, way))
    visitor.wait_for_function(LIVE)
    assert visitor.evaluate("socket.io.engine.transport.name") == "polling"
    visitor.get_by_role("button", name="Unplug knob").click()
    expect(visitor.get_by_role("button", name="Plug knob in")).to_be_visible()
    visitor.get_by_role("button", name="Plug knob in").click()
    expect(visitor.get_by_role("button", name="Unplug knob")).to_be_visible()
    visitor.locator("#ms-stop").click()
    expect(visitor.locator("#ms-stop-says")).to_have_text(re.compile(r"STOP was sent to all parts\. \(\d+ ms\)"))
    visitor.get_by_role("button", name="Go on").click()
    expect(visitor.get_by_text("STOP by")).to_have_count(0)
    visitor.wait_for_function(f"!{DEAD}")


def test_a_connection_that_never_comes_up_is_no_life_and_stop_works(visitor: Page, demo: Site, ways: Ways) -> None:
    enter(visitor, demo, ways.no_channel)
    visitor.wait_for_function(DEAD)
    expect(visitor.locator("#ms-lost")).to_contain_text("lets neither WebSockets nor long polling pass")
    visitor.locator("#ms-stop").click()
    expect(visitor.locator("#ms-stop-says")).to_have_text(re.compile(r"STOP was sent to all parts\. \(\d+ ms\)"))
    # It goes on trying, and where it works again it lives.
    visitor.goto(ways.passed_on)
    visitor.wait_for_function(f"{LIVE} && !{DEAD}")
    visitor.get_by_role("button", name="Go on").click()
    expect(visitor.get_by_text("STOP by")).to_have_count(0)
