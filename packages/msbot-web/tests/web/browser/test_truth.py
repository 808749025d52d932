"""What the page says is so: a dead master is seen, STOP is always there, cards show what parts do. In a browser."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.processes import running
from tests.web.browser.conftest import Site, again_until, go, new_page

DEAD = "document.documentElement?.classList.contains('ms-dead')"
GO_ON = "[...document.querySelectorAll('button')].find((one) => one.textContent.includes('Go on'))"


@pytest.fixture
def phone(blank: Page) -> Page:
    """A tab on a phone."""
    blank.set_viewport_size({"width": 390, "height": 844})
    return blank


@pytest.fixture
def page(phone: Page, demo: Site) -> Page:
    """The robot page on it."""
    go(phone, demo.base)
    return phone


def press_go(page: Page) -> None:
    page.get_by_role("button", name="Go on").click()
    expect(page.get_by_text("STOP by")).to_have_count(0)


def test_stop_tells_who_confirmed_it_and_the_cards_show_what_the_parts_do(page: Page) -> None:
    fan = page.get_by_role("button", name="Open slot fan")
    expect(fan).to_contain_text("active")
    page.locator("#ms-stop").click()
    expect(page.locator("#ms-stop-says")).to_have_text(re.compile(r"STOP was sent to all parts\. \(\d+ ms\)"))
    expect(page.get_by_text("parts have confirmed that they are in their safe state")).to_be_visible()
    told, banner = (page.locator(which).bounding_box() for which in ("#ms-stop-says", ".ms-banner.bad >> visible=true"))
    assert told is not None
    assert banner is not None
    assert told["y"] >= banner["y"] + banner["height"], "what was said covers neither who said it nor the way back"
    page.get_by_text("Confirmed by").click()
    expect(page.get_by_text(re.compile(r"^fan \d+ ms"))).to_be_visible()
    expect(fan).to_contain_text("stopped: at its safe values")
    expect(fan).to_contain_text(re.compile(r"percent\s+0"))
    press_go(page)
    expect(fan).not_to_contain_text("stopped")


def test_an_actuator_without_its_partner_shows_its_safe_value(page: Page) -> None:
    lamp = page.get_by_role("button", name="Open slot headlight")
    page.get_by_role("button", name="Unplug button").click()
    expect(lamp).to_contain_text("partner lost: it applies its safe values")
    expect(page.get_by_role("button", name="Open slot button")).to_contain_text("stale:")
    page.get_by_role("button", name="Plug button in").click()
    expect(lamp).not_to_contain_text("partner lost")


HAS_ENTRY = "(history.state || {}).msbot?.open.length"
"""Whether Back closes something: a moment after it is seen, when the robot's next word has come."""


def test_stop_is_reachable_with_the_drawer_open_and_back_closes_the_drawer(page: Page, demo: Site) -> None:
    page.get_by_role("button", name="Open slot fan").click()
    expect(page.get_by_role("heading", name="fan")).to_be_visible()
    page.locator("#ms-stop").click()  # fails when something lies over it
    expect(page.locator("#ms-stop-says")).to_contain_text("STOP")
    page.wait_for_function(HAS_ENTRY)
    page.go_back()
    expect(page.get_by_role("heading", name="fan")).to_have_count(0)
    expect(page.get_by_role("button", name="Open slot fan")).to_be_visible()
    press_go(page)


IS_OPEN = "ids => String(((history.state || {}).msbot || {open: []}).open) === String(ids)"
"""Whether these are open, as the browser's history has it."""


def test_back_closes_one_thing_after_another_however_they_were_closed_and_opened(page: Page, demo: Site) -> None:
    go(page, f"{demo.base}/bus")
    page.evaluate("[91, 92, 93].forEach(id => msbot.opened(id)); msbot.closed(92)")
    page.go_back()
    page.wait_for_function(IS_OPEN, arg=[91])
    page.go_back()
    page.wait_for_function(IS_OPEN, arg=[])
    page.evaluate("msbot.opened(91); msbot.closed(91); msbot.opened(92)")
    page.wait_for_function(IS_OPEN, arg=[92])
    page.go_back()
    page.wait_for_function(IS_OPEN, arg=[])
    page.evaluate(
        "window.steps = 0; addEventListener('popstate', () => steps++);"
        "msbot.opened(91); msbot.opened(92); msbot.closed(92)"
    )
    page.go_back()
    page.wait_for_function(IS_OPEN, arg=[])
    assert page.evaluate("steps") == 1, "a step of ours would become one with a Back of that moment, which were lost"
    assert page.url == f"{demo.base}/bus"
    page.evaluate("msbot.opened(91); msbot.closed(91)")
    page.go_back()  # nothing is open
    expect(page).to_have_url(f"{demo.base}/")


def test_back_knows_what_is_closed_as_soon_as_it_is_seen(page: Page) -> None:
    page.get_by_role("button", name="Open slot fan").click()
    page.wait_for_function(HAS_ENTRY)
    page.evaluate(
        "() => { const closed = msbot.closed; msbot.closed = (id) => {"
        " window.wasSeen = document.querySelector('.ms-drawer') !== null; closed(id); }; }"
    )
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    page.wait_for_function(IS_OPEN, arg=[])
    assert page.evaluate("wasSeen"), "while it goes, and not when the robot has heard that it has gone"


def test_stop_is_reachable_over_dialogs_toasts_and_the_menu(phone: Page, demo: Site) -> None:
    page = phone
    go(page, f"{demo.base}/admin")
    page.get_by_role("button", name="Menu").click()
    page.locator("#ms-stop").click(trial=True)
    page.keyboard.press("Escape")
    go(page, f"{demo.base}/arrivals")
    page.get_by_role("button", name="Why?").first.click()
    expect(page.get_by_role("dialog")).to_be_visible()
    page.locator("#ms-stop").click(trial=True)
    page.evaluate("for (let i = 0; i < 9; i++) Quasar.Notify.create({message: 'x '.repeat(400), multiLine: true})")
    page.locator("#ms-stop").click(trial=True)


def test_a_click_on_a_toast_is_for_what_is_under_it_and_one_on_its_button_for_the_toast(page: Page) -> None:
    page.evaluate(
        "Quasar.Notify.create({message: 'The part in slot fan is lost.', timeout: 0, actions: [{label: 'Close it'}]})"
    )
    close = page.get_by_role("button", name="Close it")
    expect(close).to_be_visible()
    words = page.get_by_text("The part in slot fan is lost.").bounding_box()
    assert words is not None
    x, y = words["x"] + 4, words["y"] + 4
    drawer = page.get_by_role("dialog")  # of the card that lies there

    def click() -> None:
        if not drawer.is_visible():
            page.mouse.click(x, y)

    again_until(click, lambda ms: expect(drawer).to_be_visible(timeout=ms))
    page.wait_for_function(HAS_ENTRY)
    page.go_back()
    close.click()
    expect(close).to_have_count(0)


def test_an_update_of_the_page_does_not_set_light_or_dark_anew(phone: Page, demo: Site) -> None:
    page = phone
    go(page, f"{demo.base}/bus")
    page.evaluate(
        "const count = (name, seen, what) => {"
        "  window[name] = 0; new MutationObserver(() => window[name]++).observe(seen, what); };"
        "count('set', document.getElementById('nicegui-color-scheme'), {attributes: true});"
        "count('updates', document.getElementById('content'), {subtree: true, childList: true, characterData: true})"
    )
    page.wait_for_function("updates > 2")  # by then it has been set once
    page.evaluate("window.set = window.updates = 0")
    page.wait_for_function("updates > 4")
    assert page.evaluate("window.set") == 0


def test_a_refused_setting_goes_back_and_other_tabs_follow(phone: Page, demo: Site) -> None:
    page = phone
    other = page.context.new_page()
    for tab in (page, other):
        go(tab, f"{demo.base}/?slot=fan")
    field, elsewhere = (tab.get_by_label("start_at [%]") for tab in (page, other))
    expect(field).to_have_value("15")
    field.fill("700")
    field.blur()
    expect(page.get_by_role("alert").filter(has_text="it must be 0 to 50 %")).to_be_visible()
    expect(field).to_have_value("15")
    field.fill("20")
    field.blur()
    expect(elsewhere).to_have_value("20")
    page.get_by_role("button", name="Forget what was set by hand").click()
    expect(elsewhere).to_have_value("15")
    other.close()


def test_what_is_being_typed_stays_when_others_change_something_and_when_the_connection_is_lost(
    phone: Page, demo: Site
) -> None:
    page = phone
    other = page.context.new_page()
    for tab in (page, other):
        go(tab, f"{demo.base}/?slot=knob")

    def set_elsewhere(period: str) -> None:
        def act() -> None:
            other.get_by_label("period_s [s]").fill(period)
            other.get_by_label("period_s [s]").blur()

        again_until(act, lambda ms: expect(page.get_by_label("period_s [s]")).to_have_value(period, timeout=ms))

    page.get_by_label("change [%]").fill("7")
    set_elsewhere("0.3")
    expect(page.get_by_label("change [%]")).to_have_value("7")
    # Out of reach for a while.
    page.context.set_offline(offline=True)
    page.evaluate("window.stays = true, socket.io.engine.close()")
    expect(page.locator("#ms-lost")).to_have_text(re.compile(r"is ([4-9]|\d\d+) s old"))
    page.context.set_offline(offline=False)
    page.wait_for_function(f"!{DEAD} && socket.connected")
    set_elsewhere("0.4")
    expect(page.get_by_label("change [%]")).to_have_value("7")
    assert page.evaluate("window.stays"), "the same page, not one made anew"
    page.get_by_label("change [%]").blur()
    expect(other.get_by_label("change [%]")).to_have_value(re.compile(r"7(\.0)?"))
    other.close()


def test_a_master_that_is_frozen_or_gone_is_seen_and_stop_says_so(browser: Browser, tmp_path: Path) -> None:
    with running("demo", "--port", "0", cwd=tmp_path) as process:
        site = Site(process)
        page = new_page(browser, waits=False)
        page.goto(site.link)
        go(page, site.base)
        lost = page.locator("#ms-lost")
        expect(page.get_by_role("button", name="Open slot knob")).to_contain_text("active")
        page.wait_for_function(f"!{DEAD}")
        process.send(signal.SIGSTOP)
        page.wait_for_function(DEAD)
        expect(lost).to_have_text(re.compile(r"The robot does not answer\. What is shown here is \d+ s old\."))
        page.locator("#ms-stop").click()
        expect(page.locator("#ms-stop-says")).to_contain_text("STOP was NOT delivered")
        process.send(signal.SIGCONT)
        page.wait_for_function(f"!{DEAD}")
        # It went on trying.
        expect(page.get_by_text("STOP by demo")).to_be_visible()
        process.send(signal.SIGSTOP)
        page.wait_for_function(DEAD)
        # The alarm covers nothing of who said STOP.
        alarm, banner = page.locator(".ms-alarms").bounding_box(), page.get_by_text("STOP by demo").bounding_box()
        assert alarm is not None
        assert banner is not None
        assert alarm["y"] + alarm["height"] <= banner["y"]
        # In one turn with the look: the page must be grey still.
        page.wait_for_function(f"{DEAD} && ({GO_ON}.click(), true)")
        process.send(signal.SIGCONT)
        page.wait_for_function(f"!{DEAD}")
        page.reload()
        expect(page.get_by_text("STOP by demo")).to_be_visible()  # nobody knew when the GO would be obeyed
        process.send(signal.SIGKILL)
        page.wait_for_function(DEAD)
        page.context.close()
