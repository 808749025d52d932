"""The tiles of the class view: what a robot says of itself is text, never HTML."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from msbot_web.models.class_models import RobotTile
from msbot_web.pages.classroom import _tile
from msbot_web.pages.page import Page

PAGE = cast("Page", SimpleNamespace(translate=lambda words, **values: words.format(**values) if values else words))


def test_names_owners_events_and_addresses_are_escaped() -> None:
    bad = '<img src=x onerror="alert(1)">'
    tile = RobotTile(
        name=bad,
        serial_number=bad,
        running=True,
        here=False,
        owner=bad,
        slots=2,
        active=2,
        last_event=bad,
        last_event_age_s=30.0,
        reachable=True,
        address='http://127.0.0.1:1/"onclick="alert(1)',
    )
    html = str(_tile(PAGE, tile, "127.0.0.1"))
    assert "<img" not in html
    assert 'onclick="' not in html
    assert html.count("&lt;img src=x onerror=&#34;alert(1)&#34;&gt;") == 4
    assert "all well" in html
    assert "&lt; 1 min ago" in html


def test_of_a_master_that_does_not_answer_nothing_is_said_but_that() -> None:
    tile = RobotTile(
        name="R",
        serial_number="1",
        running=True,
        here=False,
        owner="",
        slots=2,
        active=2,
        last_event="",
        last_event_age_s=None,
    )
    html = str(_tile(PAGE, tile, "127.0.0.1"))
    assert "all well" not in html
    assert "its master does not answer on this computer" in html


def test_a_robot_without_a_page_is_no_link() -> None:
    tile = RobotTile(
        name="R",
        serial_number="1",
        running=False,
        here=False,
        owner="",
        slots=3,
        active=0,
        last_event="",
        last_event_age_s=None,
    )
    html = str(_tile(PAGE, tile, "127.0.0.1"))
    assert "<a " not in html
    assert "no master runs it" in html
