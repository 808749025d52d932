"""The page Program in a real browser: examples that speak to each other, mistakes, and programs that mean no good."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from urllib.parse import quote

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from msbot_web.language import COOKIE
from tests import ROOT
from tests.e2e.processes import run, running
from tests.web.browser.accessible import hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import FORGOTTEN, Site, go, new_page, told

EXAMPLES = ROOT / "examples"
PASSWORD = "correct horse"
WORK_MS = 120_000
"""How long a program may take to become active; the machine may be busy. It takes half a second."""
TEXT = "getElement(document.querySelector('.ms-prog-editor').id.slice(1)).editor.state.doc.toString()"
"""What is in the editor."""
PRESS_AT_ONCE = """new MutationObserver((_, itself) => {
  const run = [...document.querySelectorAll("button")].find((one) => one.textContent.endsWith("Run"));
  if (!run || !document.querySelector(".cm-content")) return;
  itself.disconnect();
  const opened = msbotProgram.opened;
  window.pressedBeforeOpened = false;
  msbotProgram.opened = (...those) => { window.pressedBeforeOpened = true; opened(...those); };
  run.click();
}).observe(document, { childList: true, subtree: true })"""


def set_up(browser: Browser, site: Site) -> None:
    """Make ada the robot's administrator, by the link that the master prints."""
    page = new_page(browser)
    page.goto(site.link)
    for name, text in {"name": "ada", "password": PASSWORD, "again": PASSWORD}.items():
        page.locator(f"[name={name}]").fill(text)
    page.locator("button").click()
    expect(page.get_by_role("button", name=re.compile("STOP"))).to_be_visible()
    site.owner = page.context
    page.close()


def open_as_ada(site: Site, path: str, *, width: int = 1280, height: int = 900) -> Page:
    """A tab of ada's browser, which keeps what it has loaded."""
    assert site.owner is not None
    page = site.owner.new_page()
    page.set_viewport_size({"width": width, "height": height})
    go(page, f"{site.base}{path}")
    return page


def open_elsewhere(browser: Browser, site: Site, path: str, *, width: int = 1280, height: int = 900) -> Page:
    """A browser of its own, in which ada signs in."""
    page = new_page(browser, width=width, height=height)
    page.goto(f"{site.base}/login?next={quote(path)}")
    for name, text in {"name": "ada", "password": PASSWORD}.items():
        page.locator(f"[name={name}]").fill(text)
    page.locator("button").click()
    page.wait_for_function("window.did_handshake && window.socket.connected")
    return page


@pytest.fixture(scope="module")
def lesson(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The sample robot's master without a part."""
    folder = tmp_path_factory.mktemp("lesson")
    assert run("init", cwd=folder).returncode == 0
    with ExitStack() as stack:
        process = stack.enter_context(running("master", "--link", "udp:127.0.0.1:0", "--port", "0", cwd=folder))
        site = Site(process)
        set_up(browser, site)
        yield site


@pytest.fixture
def open_desk(browser: Browser, lesson: Site) -> Iterator[Callable[..., Page]]:
    """Opens the page Program for ada, in a tab or in a browser of its own."""
    opened: list[Page] = []

    def open_it(query: str = "", *, elsewhere: bool = False, width: int = 1280, height: int = 900) -> Page:
        path = f"/program{query}"
        page = (
            open_elsewhere(browser, lesson, path, width=width, height=height)
            if elsewhere
            else open_as_ada(lesson, path, width=width, height=height)
        )
        expect(page.locator(".cm-content")).to_be_visible()
        opened.append(page)
        return page

    yield open_it
    for page in opened:
        page.close() if page.context is lesson.owner else page.context.close()


def write(page: Page, program: str) -> None:
    """Put a program into the editor, as if it was pasted."""
    content = page.locator(".cm-content")
    expect(content).to_have_attribute("contenteditable", "true")  # the program that is opened first is in it
    content.click()
    page.keyboard.press("Control+A")
    page.keyboard.insert_text(program)


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def expect_state(page: Page, word: str) -> None:
    try:
        expect(page.locator("#ms-prog-state")).to_have_attribute("data-state", word, timeout=WORK_MS)
    except AssertionError as error:
        raise AssertionError(f"{error}\nConsole: {page.locator('#ms-console').inner_text()}") from None


def expect_said(page: Page, words: str | re.Pattern[str]) -> None:
    expect(page.locator("#ms-console")).to_contain_text(words, timeout=WORK_MS)


def test_two_examples_in_two_browsers_speak_to_each_other(open_desk: Callable[..., Page]) -> None:
    speaker = open_desk("?name=01_hello.py")
    listener = open_desk("?name=02_listen.py", elsewhere=True, width=390, height=844)
    for page, name in ((speaker, "01_hello.py"), (listener, "02_listen.py")):
        page.wait_for_function(f"{TEXT} !== ''")
        assert page.evaluate(TEXT) == (EXAMPLES / name).read_text(), "unchanged"
        press(page, "Run")
    for page in (speaker, listener):
        expect_state(page, "active")
    expect_said(listener, "Publisher A(1) turn-on 3")
    expect(speaker.locator("#ms-prog-ports")).to_contain_text("HelloWorld(index=1, message='Publisher A(1) turn-on 3')")
    expect(listener.locator("#ms-prog-reason")).to_contain_text("In slot BB")
    for width in (1280, 390):
        speaker.set_viewport_size({"width": width, "height": 844})
        speaker.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert hurdles_by_day_and_night(speaker) == []
    press(speaker, "Stop")
    expect_state(speaker, "not running")
    expect_said(speaker, "# ABCD has ended")


def test_run_is_obeyed_as_soon_as_it_can_be_pressed(lesson: Site) -> None:
    assert lesson.owner is not None
    page = lesson.owner.new_page()
    page.add_init_script(PRESS_AT_ONCE)
    page.goto(f"{lesson.base}/program?name=phone.py")
    expect_state(page, "refused")
    assert page.evaluate("pressedBeforeOpened"), "before the server has told which program it is"
    page.close()


def test_a_mistake_is_said_and_marked_at_its_line(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    write(page, "from msbot import Part\n\npart = Part('ABCD')\nprint('begins')\nprnt('x')\npart.run()\n")
    press(page, "Run")
    expect_said(page, re.compile(r"begins.*program\.py|begins.*:5: NameError: name 'prnt' isn't defined", re.DOTALL))
    expect(page.locator(".cm-line.ms-wrong-line")).to_have_text("prnt('x')")
    expect_state(page, "not running")
    write(page, "from msbot import Part\nif True\n    pass\n")
    press(page, "Run")
    expect_said(page, "SyntaxError: invalid syntax")
    expect(page.locator(".cm-line.ms-wrong-line")).to_have_text("if True")


def test_an_error_in_a_function_is_marked_and_the_part_goes_on(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    program = (EXAMPLES / "01_hello.py").read_text().replace("    part.publish", "    1 / 0\n    part.publish")
    write(page, program)
    press(page, "Run")
    expect_state(page, "active")
    expect_said(page, "in speak: ZeroDivisionError: divide by zero")
    expect(page.locator(".cm-line.ms-wrong-line")).to_have_text("    1 / 0")
    expect_state(page, "active")


def test_what_python_and_the_part_say_is_in_the_persons_language(open_desk: Callable[..., Page], lesson: Site) -> None:
    page = open_desk()
    page.context.add_cookies([{"name": COOKIE, "value": "de", "url": lesson.base}])
    go(page, page.url)
    expect(page.locator(".cm-line", has_text="import").first).to_be_visible()  # the program has come
    write(page, "from msbot import Part\n\nPart('NOPE').run()\n")
    press(page, "Start")
    expect(page.locator("#ms-prog-reason")).to_contain_text("die Bibliothek kennt diese Teilenummer nicht")
    expect_said(page, "NOPE: abgelehnt; die Bibliothek kennt diese Teilenummer nicht")
    hello = "from msbot import HelloWorld, Part\n\npart = Part('ABCD')\n\n\n@part.every(0.2)\ndef f():\n"
    write(page, hello + "    part.publish('lefft', HelloWorld())\n\n\npart.run()\n")
    press(page, "Start")
    expect_said(page, ":8 in f: es gibt keinen Anschluss 'lefft' zum Senden; verbunden sind in diesem Roboter")
    expect(page.locator(".cm-line.ms-wrong-line")).to_have_text("    part.publish('lefft', HelloWorld())")
    for wrong, words in (
        ("x = [1,\n", "SyntaxError: invalid syntax – Fehlt eine Klammer"),
        ("x = y\n", ":1: NameError: name 'y' isn't defined – Ist der Name richtig geschrieben"),
        ("x = input('how far?')\n", "auf input() kann hier niemand antworten"),
    ):
        write(page, wrong)
        press(page, "Start")
        expect_said(page, words)
        expect_state(page, "not running")
    write(page, hello + "    pass\n\n\npart.run()\n")
    press(page, "Start")
    expect_state(page, "active")
    go(page, page.url)
    expect_said(page, "endete, als diese Seite verlassen oder neu geladen wurde")
    page.context.clear_cookies(name=COOKIE)


def test_an_endless_loop_is_told_and_ended(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    write(page, "n = 0\nwhile True:\n    n += 1\n    print(n)\n")
    press(page, "Run")
    expect_said(page, "left out, too many lines at once")
    expect_said(page, "A function of the program does not end")
    expect_state(page, "busy")
    page.evaluate("document.getElementById('ms-console').replaceChildren()")  # as its further lines may push it out
    expect_said(page, "A function of the program does not end")
    assert page.locator("#ms-console > div").count() <= 500
    press(page, "Stop")
    expect_state(page, "not running")
    expect_said(page, "The program did not answer and was ended.")


def test_a_machine_that_loads_slowly_is_no_function_that_does_not_end(
    open_desk: Callable[..., Page], lesson: Site
) -> None:
    page = open_desk()

    held: list[str] = []

    def late(route: Route) -> None:
        held.append(route.request.url)
        time.sleep(4)
        route.continue_()

    page.context.route("**/program/home.js", late)
    write(page, "print('begins')\n")
    press(page, "Run")
    expect_said(page, "begins")
    page.context.unroute("**/program/home.js")
    assert held
    assert "does not end" not in page.locator("#ms-console").inner_text()


def test_memory_without_end_is_an_error_of_the_program(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    write(page, "kept = []\nwhile True:\n    kept.append(bytes(1000000))\n")
    press(page, "Run")
    expect_said(page, ":3: MemoryError: memory allocation failed")
    expect_state(page, "not running")


def test_a_flood_is_told_and_the_part_stays(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    program = (EXAMPLES / "01_hello.py").read_text()
    program = program.replace("every(1.0)", "every(0.01)").replace(
        "    part.publish", "    for n in range(100):\n        part.publish"
    )
    write(page, program)
    press(page, "Run")
    expect_state(page, "active")
    expect_said(
        page,
        re.compile("Messages not sent: |this part sends more than the robot takes"),
    )
    press(page, "Stop")
    expect_state(page, "not running")


def test_a_program_of_somebody_else_reaches_nothing_but_the_link(open_desk: Callable[..., Page], lesson: Site) -> None:
    page = open_desk()
    asked: list[str] = []
    page.context.on("request", lambda request: asked.append(request.url))
    write(
        page,
        f"""import js
print("tries")
js.fetch("{lesson.base}/api/me")
js.fetch("{lesson.base}/api/stop?worker")
try:
    js.Worker.new("{lesson.base}/web/program/worker.js")
except Exception as error:
    print("no worker")
js.WebSocket.new("{lesson.base.replace("http", "ws")}/_nicegui_ws/socket.io/?transport=websocket")
print("has tried")
""",
    )
    press(page, "Run")
    expect_said(page, re.compile("has tried|SecurityError|refused|violat", re.IGNORECASE))
    page.wait_for_timeout(500)
    assert any(url.endswith("micropython.wasm") for url in asked), "what a worker asks for is seen here"
    assert [url for url in asked if "/api/me" in url or "/api/stop" in url] == []


def test_a_program_is_kept_by_version_and_shared(open_desk: Callable[..., Page], lesson: Site) -> None:
    page = open_desk()
    press(page, "More")
    page.get_by_text("New program", exact=True).click()
    expect(page.locator(".ms-prog-choice")).to_contain_text("program1.py")
    write(page, "print('first')\n")
    press(page, "Save")
    told(page, "program1.py is saved, version 2.")
    write(page, "print('second')\n")
    press(page, "Run")
    expect_said(page, "second")
    press(page, "More")
    page.get_by_text("Earlier versions").click()
    page.get_by_role("button", name=re.compile(r"^2: ")).click()
    expect(page.locator(".cm-content")).to_contain_text("print('first')")
    press(page, "More")
    page.get_by_text("Share, or open on a phone").click()
    page.get_by_text("People with an account").click()
    link = page.get_by_text(re.compile(r"/program\?shared=")).text_content()
    assert link is not None
    other = open_desk(link[link.index("?") :], width=390, height=844)
    expect(other.locator(".cm-content")).to_contain_text("print('first')")
    told(other, "A copy of program1.py by ada. Read it before you run it.")


def test_an_editor_looks_like_its_page(lesson: Site) -> None:
    page = open_as_ada(lesson, "/program")
    for path, light, dark in (
        ("/program", "rgb(255, 255, 255)", "rgb(13, 17, 23)"),
        ("/settings", "rgb(255, 255, 255)", "rgb(13, 17, 23)"),
    ):
        go(page, f"{lesson.base}{path}")
        if path == "/settings":
            page.get_by_role("tab", name="Blueprint").click()
        for colour in (dark, light, dark):
            page.emulate_media(color_scheme="dark" if colour == dark else "light")
            expect(page.locator(".cm-editor")).to_have_css("background-color", colour)
    go(page, f"{lesson.base}/program")
    editor = page.locator(".cm-editor")
    expect(editor).to_have_css("background-color", "rgb(13, 17, 23)")
    page.wait_for_function(f"{TEXT} !== ''")
    page.locator(".cm-content").click()
    page.keyboard.press("Control+a")
    written = ""
    for letter, colour in (("a", "rgb(255, 255, 255)"), ("b", "rgb(13, 17, 23)"), ("c", "rgb(255, 255, 255)")):
        page.emulate_media(color_scheme="dark" if letter == "b" else "light")
        page.keyboard.type(letter * 150)
        written += letter * 150
        expect(editor).to_have_css("background-color", colour)
    assert page.evaluate(TEXT) == written, "what was typed meanwhile stays"
    page.close()


def test_what_is_typed_stays_while_lines_are_marked(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    write(page, "one\ntwo\nthree\n")
    page.keyboard.press("Control+End")
    written = "one\ntwo\nthree\n"
    for line, letter in enumerate("abc", start=1):
        page.evaluate("(line) => emitEvent('ms_program_line', { lines: [line] })", line)
        page.keyboard.type(letter * 100)
        written += letter * 100
        expect(page.locator(".cm-line.ms-wrong-line")).to_have_count(line)
    assert page.evaluate(TEXT) == written
    page.get_by_role("button", name="Save", exact=True).click()
    told(page, "is saved, version")
    assert kept(page) == written, "and the robot has the same"


def kept(page: Page) -> str:
    """The text of the program that is open, as it is kept."""
    name = page.url.rpartition("=")[2]
    found: str = page.evaluate("async (name) => (await (await fetch(`/api/programs/${name}`)).json()).text", name)
    return found


def test_what_is_typed_while_the_robot_is_out_of_reach_is_kept_as_it_was_typed(open_desk: Callable[..., Page]) -> None:
    page = open_desk()
    page.wait_for_url("**/program?name=*")
    before = page.url
    press(page, "More")
    page.get_by_text("New program", exact=True).click()
    page.wait_for_function("before => location.href !== before", arg=before)
    write(page, "one = 1\n")
    # What is under way when a connection breaks never arrives.
    page.evaluate("socket.io.engine.write = () => {}")
    page.keyboard.insert_text("two = 2\n")
    page.evaluate("socket.io.engine.close()")
    page.wait_for_function("socket.connected")
    page.keyboard.press("Control+Home")
    page.keyboard.insert_text("zero = 0\n")
    press(page, "Save")
    told(page, "is saved, version")
    assert kept(page) == "zero = 0\none = 1\ntwo = 2\n"
    # Without Keep: a page is made anew before the server keeps what was typed into the one before.
    page.locator(".cm-content").click()
    page.keyboard.press("Control+Home")
    page.keyboard.press("Delete")
    page.add_init_script("const now = Date.now; Date.now = () => now() + 30_000")  # it takes its time to be loaded
    page.reload()
    page.wait_for_function(f"window.did_handshake && {TEXT} === 'ero = 0\\none = 1\\ntwo = 2\\n'")
    # It has been away for so long that the page makes itself anew.
    page.locator(".cm-content").click()
    page.keyboard.press("Control+End")
    page.evaluate(FORGOTTEN)
    page.keyboard.insert_text("three = 3\n")
    page.wait_for_function(f"!window.isOld && window.did_handshake && {TEXT}.endsWith('two = 2\\nthree = 3\\n')")
    told(page, "What you typed while the robot was out of reach is here again.")
    press(page, "Save")
    told(page, "is saved, version")
    assert kept(page) == "ero = 0\none = 1\ntwo = 2\nthree = 3\n"


def test_the_device_is_a_part(open_desk: Callable[..., Page]) -> None:
    page = open_desk("?name=03_ring_member.py", width=390, height=844)
    program = """import device
from msbot import HelloWorld, Part

part = Part("ABCD", robot="MSBOT_MASTER")


@part.every(0.1)
def tell():
    tilt = device.tilt()
    device.colour(0, 128, 255)
    device.vibrate(0)
    device.tone(0)
    words = f"{tilt.x:.0f} {tilt.y:.0f} {device.slider():.0f} {device.button(2)} {len(device.clock())}"
    part.publish("out", HelloWorld(index=1, message=words))


part.run()
"""
    write(page, program)
    press(page, "Run")
    expect_state(page, "active")
    expect(page.locator("#ms-device-colour")).to_have_css("background-color", "rgb(0, 128, 255)")
    expect(page.locator("#ms-prog-ports")).to_contain_text("'0 0 0 False 3'")
    page.evaluate("dispatchEvent(new DeviceOrientationEvent('deviceorientation', {alpha: 0, beta: -20, gamma: 45}))")
    page.get_by_label("Slider").fill("70")
    page.get_by_role("button", name="2", exact=True).dispatch_event("pointerdown")
    expect(page.locator("#ms-prog-ports")).to_contain_text("'45 -20 70 True 3'")
    page.get_by_role("button", name="2", exact=True).dispatch_event("pointerup")
    expect(page.locator("#ms-prog-ports")).to_contain_text("'45 -20 70 False 3'")
    page.wait_for_function("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert hurdles(page, dark=True) == []
    press(page, "Stop")


@pytest.mark.parametrize("name", ["phone_stick.py", "phone_lamp.py", "phone.py"])
def test_the_ready_programs_of_a_phone_reach_the_robot(open_desk: Callable[..., Page], name: str) -> None:
    page = open_desk(f"?name={name}", width=390, height=844)
    press(page, "Run")
    expect_state(page, "refused")  # the sample robot has no slot for it
    expect(page.locator("#ms-prog-reason")).to_contain_text("Under Arrivals a teacher can let")
    assert page.locator(".ms-said-error").count() == 0


def test_a_second_program_for_a_slot_is_told_that_it_waits(open_desk: Callable[..., Page]) -> None:
    first, second = open_desk("?name=01_hello.py"), open_desk("?name=01_hello.py", elsewhere=True)
    for page in (first, second):
        write(page, (EXAMPLES / "01_hello.py").read_text())  # ada has another program of that name by now
    press(first, "Run")
    expect_state(first, "active")
    press(second, "Run")
    expect_state(second, "standby")
    expect(second.locator("#ms-prog-reason")).to_contain_text("It waits until the part in such a slot ends")
    press(first, "Stop")
    expect_state(second, "active")
    press(second, "Stop")
