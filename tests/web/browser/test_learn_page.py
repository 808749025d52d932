"""The page Learn: a lesson is begun, its checks tick by themselves, a question is answered, all is put back."""

from __future__ import annotations

import re

from playwright.sync_api import Page, expect

from tests.web.browser.accessible import hurdles
from tests.web.browser.conftest import Site, go


def test_a_lesson_on_the_page(blank: Page, demo: Site) -> None:
    page = blank
    go(page, f"{demo.base}/learn")
    expect(page.get_by_text("Nobody has begun a lesson yet.")).to_be_visible()
    page.get_by_role("button", name="Begin: The first part").click()
    expect(page.get_by_text("1 of 8 checks have ticked.")).to_be_visible()  # the fan is active, the knob is pulled out
    expect(page.get_by_text("Taking part: demo")).to_be_visible()
    assert hurdles(page, dark=False) == []
    answer = page.get_by_label("Answer").first
    answer.fill("eleven")
    answer.press("Enter")
    expect(page.get_by_text("that is not right yet")).to_be_visible()
    answer.fill("10")
    answer.press("Enter")
    expect(page.get_by_text("2 of 8 checks have ticked.")).to_be_visible()
    page.get_by_role("button", name="Ask for help").click()
    expect(page.get_by_text("Asking for help: demo")).to_be_visible()
    page.get_by_role("button", name="No help needed").click()
    expect(page.get_by_text("Asking for help: demo")).to_be_hidden()
    go(page, demo.base)
    page.get_by_role("button", name="Plug knob in").click()
    go(page, f"{demo.base}/learn")
    expect(page.get_by_text("3 of 8 checks have ticked.")).to_be_visible()
    row = page.get_by_role("row").filter(has_text="demo")
    expect(row).to_contain_text("The first part")
    expect(row).to_contain_text(re.compile("[23] of 8"))
    page.get_by_role("button", name="End the lesson").click()
    page.get_by_role("button", name="Yes").click()
    expect(page.get_by_text("everything is as it was before")).to_be_visible()
    expect(page.get_by_role("button", name="Begin: The ring")).to_be_visible()
    go(page, f"{demo.base}/learn/certificate/first_part")
    expect(page.get_by_text("demo has not done this lesson to its end yet")).to_be_visible()
