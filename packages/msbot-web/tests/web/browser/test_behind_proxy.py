"""The page in a folder of another host, behind Debian's nginx and Caddy with TLS, by the files of `examples/proxy`.
In a browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from urllib.parse import urlsplit

import httpx
import pytest
from playwright.sync_api import Browser, Page, Request, Response, expect

from tests import ROOT
from tests.certificate import Certificate
from tests.e2e.processes import running
from tests.nginx import command, nginx, proxy
from tests.web.browser.conftest import ARGUMENTS, PATIENCE_MS, Site, again_until, chromium, free_port

NAME = "robots.localhost"
"""Browsers take it for this computer without asking anybody."""
LIVE = "window.did_handshake && window.socket.connected"
OUTSIDE = """[...document.querySelectorAll("a[href], img[src], form[action]")]
    .map((one) => ["href", "src", "action"].map((name) => one.getAttribute(name)).find((where) => where))
    .filter((where) => where.startsWith("/") && !where.startsWith("/rex/"))"""
"""What a page leads to that is not in the folder."""
PAGES = ("/arena", "/plots", "/wires", "/journal", "/library", "/library/POT-10K", "/handbook/howto/web_page")
"""Those with scripts, pictures and links of their own."""
EXAMPLES = ROOT / "examples" / "proxy"


def adapted(name: str, robot: Site, port: int, certificate: Certificate) -> str:
    """An example with this test's addresses, and nothing else changed."""
    text = (EXAMPLES / name).read_text()
    changes = {
        "robots.school.example {": f"{NAME}:{port} {{",
        "robots.school.example;": f"{NAME};",
        "listen 443 ssl": f"listen 127.0.0.1:{port} ssl",
        "127.0.0.1:8080": urlsplit(robot.base).netloc,
        "/etc/ssl/robots.pem": str(certificate.certificate),
        "/etc/ssl/robots.key": str(certificate.key),
    }
    for old, new in changes.items():
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    words = ("demo", "--port", "0", "--page-name", NAME, "--trusted-proxy", "127.0.0.1")
    with running(*words, cwd=tmp_path_factory.mktemp("demo")) as process:
        yield Site(process)


@pytest.fixture(scope="module", params=["nginx", "caddy"])
def base(request: pytest.FixtureRequest, robot: Site, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The page's address behind a proxy."""
    folder, port = tmp_path_factory.mktemp("proxy"), free_port()
    certificate = Certificate(folder)
    with ExitStack() as stack:
        if request.param == "nginx":
            servers = adapted("nginx.conf", robot, port, certificate)
            stack.enter_context(nginx(folder / "nginx", servers, port))
        else:
            file = folder / "Caddyfile"
            free = "{\n\tadmin off\n\tauto_https disable_redirects\n\tskip_install_trust\n}\n"
            file.write_text(free + adapted("Caddyfile", robot, port, certificate))
            words = [command("caddy"), "run", "--config", str(file), "--adapter", "caddyfile"]
            stack.enter_context(proxy(words, port, env={"HOME": str(folder), "XDG_DATA_HOME": str(folder)}))
        yield f"https://{NAME}:{port}/rex"


class Visitor:
    """Somebody's tab, and what went wrong in it."""

    def __init__(self, browser: Browser, base: str) -> None:
        context = browser.new_context(ignore_https_errors=True, viewport={"width": 1280, "height": 900})
        context.set_default_timeout(PATIENCE_MS)
        self.base, self.wrong = base, list[str]()
        context.on("request", self._asked)
        context.on("response", self._answered)
        self.page: Page = context.new_page()

    def _asked(self, request: Request) -> None:
        if request.url.startswith("http") and not request.url.startswith((self.base + "/", "https://x/")):
            self.wrong.append(f"asked outside of the folder: {request.url}")

    def _answered(self, response: Response) -> None:
        if response.status >= 400:
            self.wrong.append(f"{response.status} {response.url}")

    def go(self, path: str) -> None:
        self.page.goto(self.base + path)
        self.page.wait_for_function(LIVE)


@pytest.fixture(scope="module")
def visitor(browser: Browser, robot: Site, base: str) -> Visitor:
    found = Visitor(browser, base)
    found.page.goto(robot.link.replace(robot.base, base))
    found.page.wait_for_function(LIVE)
    return found


def test_the_page_lives_and_its_cookies_are_of_the_folder_and_secure(visitor: Visitor, base: str) -> None:
    page = visitor.page
    assert page.url == f"{base}/"
    assert page.evaluate("socket.io.engine.transport.name") == "websocket"
    cookies = [one for one in page.context.cookies() if one["name"].startswith("msbot_session")]
    assert [(one["secure"], one["httpOnly"], one["path"]) for one in cookies] == [(True, True, "/rex")]
    page.locator("#ms-stop").click()
    expect(page.locator("#ms-stop-says")).to_have_text(re.compile(r"STOP was sent to all parts\. \(\d+ ms\)"))
    page.get_by_role("button", name="Go on").click()
    expect(page.get_by_text("STOP by")).to_have_count(0)
    page.get_by_role("button", name="Open slot knob").click()
    page.wait_for_function("location.href.endsWith('/rex/?slot=knob')")
    page.reload()
    page.wait_for_function(LIVE)
    expect(page.get_by_role("heading", name="knob")).to_be_visible()
    assert visitor.wrong == []


def test_pages_with_all_that_belongs_to_them_are_in_the_folder(visitor: Visitor, base: str) -> None:
    visitor.go("/")
    page = visitor.page
    page.wait_for_function(
        "[...document.querySelectorAll('.ms-nav a')].every((one) => one.pathname.startsWith('/rex/'))"
    )
    ways = page.eval_on_selector_all(".ms-nav a", "all => all.map((one) => one.pathname.slice(4))")
    assert len(ways) > 15
    assert set(ways) > set(PAGES[:5])
    for path in PAGES:
        visitor.go(path)
        outside = page.evaluate(OUTSIDE)
        assert outside == [], path
    assert visitor.wrong == []


def test_a_program_has_its_files_and_reaches_the_robot_through_the_proxy(visitor: Visitor) -> None:
    visitor.go("/program?name=01_hello.py")
    page = visitor.page
    page.evaluate(
        """() => new Promise((done, failed) => {
            const link = new WebSocket(location.origin.replace("http", "ws") + msbotAt("/api/link"));
            link.onopen = () => (link.close(), done());
            link.onerror = failed;
        })"""
    )
    # What its worker loads; this browser takes no certificate of a test's making for a worker.
    statuses = page.evaluate(
        """paths => Promise.all(paths.map(async (path) => (await fetch(msbotAt(path))).status))""",
        ["/program/worker.js", "/program/files.json", "/web/program/home.js", "/web/micropython/micropython.wasm"],
    )
    assert statuses == [200] * 4
    assert visitor.wrong == []


PROGRAM = """from msbot import Part, Switch
part = Part("HI-1", describes="a program behind a proxy")
part.publishes("out", Switch)
print("it runs")
part.run()
"""


def test_a_program_of_a_pupil_runs_behind_tls_in_the_folder(browser: Browser, robot: Site, base: str) -> None:
    words = [*ARGUMENTS, "--ignore-certificate-errors"]  # for workers, too
    trusting = browser.browser_type.launch(executable_path=chromium(), args=words, timeout=PATIENCE_MS)
    try:
        page = trusting.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(robot.link.replace(robot.base, base))
        page.wait_for_function(LIVE)
        kept = """async (text) => {
            const { csrf } = await (await fetch(msbotAt("/api/me"))).json();
            const headers = { "content-type": "application/json", "x-csrf-token": csrf };
            const body = JSON.stringify({ text });
            return (await fetch(msbotAt("/api/programs/hi.py"), { method: "PUT", headers, body })).status;
        }"""
        assert page.evaluate(kept, PROGRAM) == 200
        page.goto(f"{base}/program?name=hi.py")
        page.wait_for_function(LIVE)
        log = page.get_by_role("log")
        again_until(
            page.get_by_role("button", name="Run").click,
            lambda ms: expect(log).to_contain_text("it runs", timeout=ms),
        )
        page.wait_for_function(
            """async () => (await (await fetch(msbotAt("/api/arrivals"))).text()).includes("HI-1")""",
        )
    finally:
        trusting.close()


def test_a_class_comes_in_by_its_code_and_by_the_link_of_its_qr_code(
    visitor: Visitor, browser: Browser, base: str
) -> None:
    """Over the proxy's one port: no other of this computer is asked."""
    visitor.go("/pupils")
    teacher = visitor.page
    teacher.get_by_role("button", name="Show a class ticket").click()
    code = teacher.locator(".q-dialog .mono").first.inner_text()
    link = re.search(r"https://\S+/come\?ticket=\S+", teacher.get_by_role("dialog").inner_text())
    assert link is not None
    assert link[0].startswith(f"{base}/come?ticket=")
    teacher.get_by_role("button", name="Close").first.click()
    name = "Dora" + base[-9:-4]
    for way in (f"{base}/come", link[0]):
        pupil = Visitor(browser, base)
        page = pupil.page
        page.goto(way)
        if way != link[0]:
            page.get_by_label("Code of the class").fill(code.lower())
            page.get_by_role("button", name="Next").click()
            page.get_by_label("Your name").fill(name)
            page.get_by_role("button", name="Ask to come in").click()
            teacher.get_by_role("button", name=f"Let {name} in").click()
            expect(page.get_by_text(f"You are in, {name}")).to_be_visible()
            pictures = [one.inner_text().split()[-1] for one in page.locator(".own li").all()]
        else:
            page.get_by_role("button", name=name, exact=True).click()
            for number, picture in enumerate(pictures, 1):
                page.get_by_role("group", name=f"Picture {number}").get_by_label(picture).check()
        page.get_by_role("button", name="Come in").click()
        page.wait_for_url(f"{base}/program*")
        page.wait_for_function(LIVE)
        assert pupil.wrong == []
        page.context.close()
    assert visitor.wrong == []


def test_who_is_not_signed_in_gets_the_form_in_the_folder_and_another_name_is_refused(base: str, robot: Site) -> None:
    place = urlsplit(base)

    def get(path: str, host: str = NAME) -> httpx.Response:
        request = client.build_request(
            "GET",
            f"https://127.0.0.1:{place.port}{path}",
            headers={"host": f"{host}:{place.port}"},
            extensions={"sni_hostname": NAME},
        )
        return client.send(request)

    with httpx.Client(verify=False, timeout=60) as client:
        away = get("/rex/journal?x=1")
        assert (away.status_code, away.headers["location"]) == (303, "/rex/login?next=/journal%3Fx%3D1")
        assert 'action="/rex/login"' in get("/rex/login").text
        assert get("/rex").headers["location"].endswith("/rex/")
        # A name that was not given: nginx passes it on, Caddy has no site of that name.
        other = get("/rex/login", "evil.example")
        assert (other.status_code, "<form" in other.text) in ((421, False), (200, False))
        named = client.get(f"{robot.base}/login", headers={"host": NAME})
        assert named.status_code == 200, "on 127.0.0.1, too"
        direct = client.get(f"{robot.base}/login", headers={"host": "evil.example", "x-forwarded-host": "127.0.0.1"})
        assert direct.status_code == 200, "this computer is a trusted proxy"
