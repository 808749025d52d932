"""HTML in every name that a part or a person can set: shown as text on every page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest
from playwright.sync_api import Browser, Dialog, expect

from tests.e2e.processes import running
from tests.web.browser.conftest import free_port, link_in, new_page, told, violations
from tests.web.browser.test_demo_pages import FITS, PAGES

PASSWORD = "correct horse"


def evil(word: str) -> str:
    """A name that would make an element, and run a script, if it were taken for HTML."""
    return f"<img class=evil src=x onerror=alert(1)>{word}"


PICTURE = (
    "<!--><img class=evil src=x onerror=alert(1)>--><?x ><img class=evil src=x onerror=alert(2)>?><svg>"
    "<text>&lt;img class=evil&gt;</text></svg>"
)
"""Well-formed XML, a picture of shapes and words; to a reader of HTML its remark ends at once, and elements follow."""
LIBRARY = f"""
number = "EVIL"
picture = {PICTURE!r}
name = {evil("type")!r}
description = {evil("about")!r}
manufacturer = {evil("maker")!r}
[[port]]
name = "out"
direction = "publish"
type = "HelloWorld"
[[port]]
name = "in"
direction = "subscribe"
type = "HelloWorld"
[[parameter]]
name = "label"
type = "text"
default = {evil("value")!r}
description = {evil("parameter")!r}
"""
BLUEPRINT = f"""
[robot]
name = "{evil("robot")}"
version = "{evil("version")}"
serial_number = "{evil("serial")}"
released = "{evil("released")}"
manufacturer = "{evil("factory")}"
[[slot]]
name = "{evil("slot")}"
part = "EVIL"
description = "{evil("place")}"
[[slot]]
name = "empty"
part = "SG90"
[[binding]]
topic = "{evil("topic")}"
type = "HelloWorld"
from = "{evil("slot")}.out"
to = ["{evil("slot")}.in"]
"""


class Site:
    """A robot whose every name is hostile, with a part in its slot and one that waits."""

    def __init__(self, folder: Path) -> None:
        (folder / "home").mkdir()
        (folder / "home" / "EVIL.toml").write_text(LIBRARY)
        (folder / "robot.toml").write_text(BLUEPRINT)
        self.base = ""

    def add_people(self, link: str) -> None:
        """An administrator and somebody with a hostile name, who both have done something."""
        found = re.search(r"(http://[^/]+)/setup\?token=(\S+)", link)
        assert found is not None
        self.base = found[1]
        with httpx.Client(base_url=self.base, timeout=30) as ada:
            form = {"token": found[2], "name": evil("ada"), "password": PASSWORD, "again": PASSWORD}
            assert ada.post("/setup", data=form).status_code == 303
            ada.headers["x-csrf-token"] = ada.get("/api/me").json()["csrf"]
            for method, path, body in (
                ("POST", "/api/users", {"name": evil("bob"), "role": "student", "password": PASSWORD}),
                ("POST", f"/api/users/{quote(evil('ada'))}/tokens", {"words": evil("token")}),
                ("PUT", f"/api/slots/{quote(evil('slot'))}/values/label", {"value": evil("set")}),
                ("POST", "/api/stop", {"reason": evil("reason")}),
                ("POST", "/api/go", None),
            ):
                answer = ada.request(method, path, json=body)
                assert answer.status_code == 200, (path, answer.text)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("hostile")
    site, link = Site(folder), f"udp:127.0.0.1:{free_port()}"
    library = ("--library", "home", "--link", link)
    with ExitStack() as stack:
        master = stack.enter_context(running("master", *library, "--port", "0", cwd=folder))
        for name in ("part", "spare"):
            part = stack.enter_context(running("part", "EVIL", "--name", evil(name), *library, cwd=folder))
            part.wait_for("active" if name == "part" else "claiming")
        site.add_people(link_in(master))
        yield site


def test_names_are_shown_as_text_on_every_page(browser: Browser, site: Site) -> None:
    page = new_page(browser)
    scripts: list[str] = []

    def noticed(dialog: Dialog) -> None:
        scripts.append(dialog.message)
        dialog.dismiss()

    page.on("dialog", noticed)
    page.goto(site.base)
    page.locator("[name=name]").fill(evil("ada"))
    page.locator("[name=password]").fill(PASSWORD)
    page.locator("button").click()
    shown = ""
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    instead = {"/library/SG90": "/library/EVIL", "/bus": f"/bus?find={quote(evil('x'))}"}
    headings = {instead.get(path, path): title for path, title in PAGES.items()}
    for path, title in {**headings, f"/?slot={quote(evil('slot'))}": "Robot"}.items():
        page.goto(site.base + path)
        expect(page.get_by_role("heading", level=1)).to_have_text(title)
        expect(page.locator("#ms-stop")).to_be_visible()
        if path.startswith("/library"):
            expect(page.locator("img.ms-part-picture").first).to_be_visible()
        for width in (390, 1280):
            page.set_viewport_size({"width": width, "height": 844})
            page.wait_for_function(FITS)
        tabs = page.get_by_role("tab")
        for number in range(max(tabs.count(), 1)):
            if tabs.count():
                tabs.nth(number).click()
                expect(tabs.nth(number)).to_have_attribute("aria-selected", "true")
            if path == "/journal" and number == 1:  # the list is read when the page is there
                expect(page.get_by_role("tabpanel").last).to_contain_text(evil("set"))
            expect(page.locator(".evil")).to_have_count(0)
            shown += page.locator("body").inner_text() + page.content()
    for word in (
        "robot",
        "version",
        "serial",
        "factory",
        "slot",
        "place",
        "topic",
        "part",
        "spare",
        "type",
        "about",
        "maker",
        "parameter",
        "set",
        "ada",
        "bob",
        "token",
    ):
        assert evil(word) in shown, word
    page.goto(f"{site.base}/arrivals")
    page.get_by_role("button", name="Identify").click()
    told(page, "<img class=evil")
    expect(page.locator(".evil")).to_have_count(0)
    assert scripts == []
    assert errors == []
    page.context.close()


def test_the_forms_before_signing_in_show_names_as_text(browser: Browser, site: Site) -> None:
    page = new_page(browser)
    page.goto(f"{site.base}/setup?token={quote(evil('token'))}")
    expect(page.get_by_role("heading", level=1)).to_have_text(evil("robot"))
    page.goto(f"{site.base}/login?next={quote('/' + evil('x'))}")
    expect(page.get_by_role("heading", level=1)).to_have_text(evil("robot"))
    expect(page.locator(".evil")).to_have_count(0)
    page.context.close()


PLANTS = {
    "an attribute": "document.body.append(Object.assign(document.createElement('div'), {innerHTML:"
    ' \'<img src=x onerror="ran.push(1)"><a href="javascript:ran.push(1)" id=link>x</a>\'})), link.click()',
    "an element": "document.body.append(Object.assign(document.createElement('script'), {textContent: 'ran.push(1)'}))",
    "another site": "document.body.append(Object.assign(document.createElement('script'),"
    " {src: 'http://localhost:1/x.js', onerror: () => null}))",
}


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_html_that_reaches_a_page_runs_no_script(browser: Browser, site: Site, plant: str) -> None:
    page = new_page(browser)
    page.goto(f"{site.base}/login")
    page.evaluate(
        f"window.ran = []; new Promise((done) => {{ addEventListener('securitypolicyviolation', done); {plant} }})"
    )
    assert page.evaluate("ran") == []
    violations.clear()
    page.context.close()


def test_a_page_sends_nothing_to_another_site(browser: Browser, site: Site) -> None:
    page = new_page(browser)
    page.goto(f"{site.base}/login")
    for address in ("ws://localhost:1/", "wss://127.0.0.2/"):
        refused = (
            "new Promise((done) => { addEventListener('securitypolicyviolation', (event) => done(event.blockedURI));"
        )
        assert page.evaluate(f"{refused} try {{ new WebSocket('{address}') }} catch {{}} }})").startswith(address[:-1])
    violations.clear()
    page.context.close()
