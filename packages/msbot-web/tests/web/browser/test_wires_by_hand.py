"""Wires, topics and slots made and taken away on the wires page, by mouse and keyboard, and undone. In a browser."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from msbot_web.svg.wiring_graph import STATE_COLOURS
from tests.web.browser.accessible import hurdles, hurdles_by_day_and_night
from tests.web.browser.conftest import Site, again_until, call, go, new_page, told, undo_newest


@pytest.fixture
def page(blank: Page, demo: Site) -> Page:
    """The wires in a teacher's browser."""
    go(blank, f"{demo.base}/wires")
    blank.locator("[data-wired]").wait_for()  # the drawing listens
    return blank


def port(page: Page, words: str) -> Locator:
    return page.locator(".port").and_(page.get_by_role("button", name=words))  # in the drawing, not in the list below


def test_wires_are_drawn_by_keyboard_and_by_mouse_and_undone(page: Page) -> None:
    # By keyboard: hand.holding is wired to nothing yet, and fits what takes a Switch.
    port(page, "hand.holding (Switch): not wired").focus()
    page.keyboard.press("Enter")
    expect(page.locator(".port.fits")).to_have_count(2)  # headlight.on and horn.on
    port(page, "horn.on (Switch): subscribes to obstacle").focus()
    page.keyboard.press("Enter")
    name = page.get_by_label("Name of the topic")
    expect(name).to_have_value("hand_holding")
    expect(name).to_be_focused()
    name.fill("obstacle")
    page.keyboard.press("Enter")
    told(page, "There is a topic obstacle already")
    name.fill("grab")
    page.keyboard.press("Enter")
    expect(port(page, "horn.on (Switch): subscribes to grab")).to_be_visible()
    expect(port(page, "hand.holding (Switch): publishes on grab")).to_be_visible()
    # By mouse: back to the bumper, which has its topic; nobody is asked for a name.
    port(page, "bumper.near (Switch)").drag_to(port(page, "horn.on (Switch)"))
    horn = port(page, "horn.on (Switch): subscribes to obstacle")
    expect(horn).to_be_visible()
    undo_newest(page)  # leaving one topic and hearing the other is one change
    expect(port(page, "horn.on (Switch): subscribes to grab")).to_be_visible()
    port(page, "knob.level (Level)").drag_to(port(page, "horn.on (Switch)"))
    told(page, "knob.level carries Level, horn.on carries")
    port(page, "bumper.near (Switch)").drag_to(port(page, "horn.on (Switch)"))
    expect(horn).to_be_visible()
    horn.focus()
    page.keyboard.press("Delete")
    expect(port(page, "horn.on (Switch): not wired")).to_be_visible()
    undo_newest(page)
    expect(port(page, "horn.on (Switch): subscribes to obstacle")).to_be_visible()


def test_a_part_that_goes_changes_the_colour_of_its_box_and_takes_nobody_the_focus(page: Page) -> None:
    hand, box = port(page, "hand.holding (Switch)"), page.locator("[data-box=horn]").first
    expect(box).to_have_attribute("stroke", STATE_COLOURS["active"])
    hand.focus()
    for is_plugged, state in ((False, "lost"), (True, "active")):
        assert call(page, "PUT", "/api/sim/horn/plugged", {"value": is_plugged}) == 200
        expect(box).to_have_attribute("stroke", STATE_COLOURS[state])
    expect(hand).to_be_focused()


def test_a_new_topic_is_dragged_named_and_taken_back_at_once(page: Page) -> None:
    for free in ("hand.holding (Switch)", "horn.on (Switch)"):
        port(page, free).focus()
        page.keyboard.press("Delete")
        expect(port(page, f"{free}: not wired")).to_be_visible()
    # By the empty circle itself, as everybody does.
    port(page, "hand.holding (Switch)").locator("circle").drag_to(port(page, "horn.on (Switch)").locator("circle"))
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(port(page, "horn.on (Switch): not wired")).to_be_visible()
    port(page, "hand.holding (Switch)").drag_to(port(page, "horn.on (Switch)"))
    page.get_by_label("Name of the topic").fill("beep when held")
    page.get_by_role("button", name="Join").click()
    expect(port(page, "horn.on (Switch): subscribes to beep when held")).to_be_visible()
    expect(page.get_by_role("cell", name="beep when held")).to_be_visible()
    undo_newest(page)
    expect(port(page, "horn.on (Switch): not wired")).to_be_visible()
    expect(port(page, "hand.holding (Switch): not wired")).to_be_visible()


def test_a_slot_is_made_by_keyboard_and_taken_back(page: Page) -> None:
    search, name = page.get_by_label("Search"), page.get_by_label("Name of the slot")

    def ask() -> None:
        if not search.is_visible():
            page.get_by_role("button", name="New slot").focus()
            page.keyboard.press("Enter")

    again_until(ask, lambda ms: expect(search).to_be_focused(timeout=ms))
    page.keyboard.type("nothing like it")
    expect(page.get_by_text("No part type fits these words")).to_be_visible()
    page.get_by_role("button", name="Make the slot").click()
    told(page, "Choose a part type first.")
    search.fill("SG90")
    expect(page.get_by_role("radio")).to_have_count(1)
    search.press("Enter")
    expect(page.get_by_text("Left empty, it is called servo.")).to_be_visible()
    name.fill("horn")
    name.press("Enter")
    expect(page.get_by_role("alert").filter(has_text="there is a slot horn already")).to_be_visible()
    assert hurdles(page, dark=False) == []  # also the toast with its button
    name.fill("arm")
    name.press("Enter")
    expect(port(page, "arm.angle (Angle): not wired")).to_be_visible()
    undo_newest(page)
    expect(port(page, "horn.on (Switch)")).to_be_visible()
    expect(port(page, "arm.angle (Angle)")).to_have_count(0)


def test_the_arrivals_and_the_page_of_a_type_make_a_slot(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/arrivals")
    page.get_by_role("button", name="Adopt into slot").first.click()
    page.get_by_role("menuitem", name="Into a new slot").click()
    expect(page.get_by_text("Nobody waits.")).to_be_visible()
    undo_newest(page)
    expect(page.get_by_role("button", name="Adopt into slot")).to_be_visible()
    page.get_by_role("button", name="Block").first.click()
    page.get_by_role("button", name="Unblock").click()
    expect(page.get_by_role("button", name="Unblock")).to_have_count(0)
    go(page, f"{demo.base}/library/SG90")
    page.get_by_role("button", name="New slot for this type").click()
    expect(page.get_by_text("Left empty, it is called servo.")).to_be_visible()


def test_on_a_phone_a_slot_is_made_and_wired_and_another_taken_out_with_its_wires(page: Page, demo: Site) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_role("button", name="New slot").click()
    page.get_by_label("Search").fill("push button")
    expect(page.get_by_role("radio")).to_have_count(1)  # a list that is shortened under the pointer loses the click
    page.get_by_role("radio", name="Push button · BUTTON").click()
    expect(page.get_by_text("Left empty, it is called push_button.")).to_be_visible()
    assert hurdles_by_day_and_night(page) == []
    page.get_by_role("button", name="Make the slot").click()
    # One port after the other is clicked: on a phone they do not fit on the screen together.
    port(page, "push_button.pressed (Switch): not wired").click()
    port(page, "headlight.on (Switch)").click()
    page.get_by_role("button", name="Join").click()
    expect(port(page, "headlight.on (Switch): subscribes to push_button_pressed")).to_be_visible()
    cross = page.get_by_role("button", name="Take slot headlight out")
    cross.click()
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("dialog")).to_have_count(0)
    cross.focus()
    page.keyboard.press("Enter")
    expect(page.get_by_text("Take slot headlight out of the robot?")).to_be_visible()
    page.get_by_role("button", name="Yes").click()
    expect(cross).to_have_count(0)
    expect(port(page, "headlight.on (Switch)")).to_have_count(0)
    undo_newest(page)
    expect(port(page, "headlight.on (Switch): subscribes to push_button_pressed")).to_be_visible()
    go(page, demo.base)
    expect(page.get_by_role("button", name="Open slot headlight")).to_contain_text("active")
    expect(page.get_by_role("button", name="Open slot push_button")).to_contain_text("empty")


def test_a_finger_that_trembles_picks_a_port_and_one_that_swipes_moves_the_drawing(
    browser: Browser, demo: Site
) -> None:
    page = new_page(browser, width=390, height=844, by_finger=True)
    phone = page.context
    phone.add_cookies([{"name": "msbot_tour", "value": "seen", "url": demo.base}])
    page.goto(demo.link)
    go(page, f"{demo.base}/wires")
    expect(page.get_by_text("The drawing goes on to the right: swipe, or scroll.")).to_be_visible()
    page.locator("[data-wired]").wait_for()
    finger, scrolled = phone.new_cdp_session(page), "document.querySelector('svg.wires').parentElement.scrollLeft"

    def touch(*steps: int) -> None:
        """Put a finger on a port, move it to the left by so many pixels, and take it off."""
        dot = port(page, "ear.loud").bounding_box()
        assert dot is not None
        x, y = dot["x"] + dot["width"] / 2, dot["y"] + dot["height"] / 2
        for number, step in enumerate((0, *steps)):
            kind = "touchMove" if number else "touchStart"
            finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x - step, "y": y + step / 9}]})
        finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    port(page, "ear.loud").click(trial=True)  # it is in sight, stands still, and nothing lies over it
    touch(2, 3)
    expect(page.locator(".port.picked")).to_have_count(1)
    page.keyboard.press("Escape")
    # A wired port that is picked can be taken off its topic: a finger has no Delete.
    expect(page.get_by_text("Delete disconnects a port")).to_be_hidden()
    disconnect = page.get_by_role("button", name="Disconnect")
    expect(disconnect).to_be_hidden()
    port(page, "ear.level").tap()
    disconnect.tap()
    expect(port(page, "ear.level (Level): not wired")).to_be_visible()
    expect(disconnect).to_be_hidden()
    undo_newest(page)
    expect(port(page, "ear.level (Level): publishes on loudness")).to_be_visible()
    # On a phone the cells of a table say what they are.
    cells = "[...document.querySelectorAll('.ms-table tbody tr:first-child td')]"
    heads = page.evaluate(f"{cells}.map((one) => getComputedStyle(one, '::before').content)")
    assert heads[2:4] == ['"From "', '"To "']
    page.evaluate(f"{scrolled} = 0")
    touch(*range(10, 130, 10))
    page.wait_for_function(f"{scrolled} > 20")
    expect(page.locator(".port.picked, line.dragged")).to_have_count(0)
    phone.close()
