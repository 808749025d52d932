"""Whose part fits: who has a message, and which part types could fill the slot of another one."""

from __future__ import annotations

import pytest

from msbot.config import Library, load_library
from msbot_bridges.bridge import Fit
from msbot_web.pages.whose_part_fits import message_lines, named, substitutes, worlds_that_fit


@pytest.fixture(scope="module")
def library() -> Library:
    return load_library()


def test_a_message_names_who_sends_it_and_whom_it_drives(library: Library) -> None:
    lines = {one.message: one for one in message_lines(library, {"mqtt": [Fit("Level", ["light"], ["light", "fan"])]})}
    assert "POT-10K" in lines["Level"].reports
    assert "FAN-5V" in lines["Level"].driven
    assert lines["Level"].worlds == ("mqtt: light; fan",)
    assert lines["Speed"].worlds == ()
    assert all(one.reports or one.driven for one in lines.values()), "a message that no part type has"


def test_a_substitute_that_loses_nothing_comes_first(library: Library) -> None:
    driver = library.require("L298N")
    first, *others = substitutes(driver, library)
    assert (first.number, first.ports) == ("TB6612FNG", ())
    assert all(one.number != "L298N" and len(one.ports) < len(driver.ports) for one in others)


def test_a_part_that_has_none_of_the_ports_is_no_substitute(library: Library) -> None:
    numbers = [one.number for one in substitutes(library.require("SG90"), library)]
    assert "MG996R" in numbers
    assert "POT-10K" not in numbers


def test_the_installed_worlds_say_what_they_fill() -> None:
    found = worlds_that_fit()
    assert {"dronecan", "modbus", "mqtt"} <= set(found)
    assert any(fit.message == "Angle" for fit in found["dronecan"])


def test_long_lists_are_cut_and_empty_ones_shown() -> None:
    assert named([]) == "–"
    assert named([str(one) for one in range(9)]) == "0, 1, 2, 3, 4, 5 …"
