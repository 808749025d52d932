"""Safe values that a blueprint states for a slot: read, checked against the library, written, compared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from msbot.cli.blueprint.files import hints
from msbot.config import Blueprint, blueprint_mark, blueprint_toml, differences, load_library, parse_blueprint
from msbot_xrce.errors import ConfigError

LIBRARY = load_library()
ROBOT = """\
[robot]
name = "R"
[[slot]]
name = "fan"
part = "FAN-5V"
[slot.safe]
power = { percent = 20 }
"""
OWN = """\
number = "TIP"
name = "Tip"
[[type]]
name = "Move"
fields = { tip = "Vector", joints = "float32[2]", mode = "text" }
[[port]]
name = "move"
direction = "subscribe"
type = "Move"
safe = { mode = "rest", joints = [1, 2] }
"""


def read(text: str) -> Blueprint:
    return parse_blueprint(text, LIBRARY)


def test_a_field_that_the_slot_states_goes_before_the_librarys() -> None:
    (slot,) = read(ROBOT).slots
    fan = LIBRARY.require("FAN-5V").port("power")
    assert fan is not None
    assert fan.safe == {"percent": 0}
    assert slot.safe_at(fan) == {"percent": 20}
    assert replace(slot, safe={}).safe_at(fan) == {"percent": 0}


def test_fields_inside_and_lists_are_written_and_read(tmp_path: Path) -> None:
    (tmp_path / "tip.toml").write_text(OWN)
    library = load_library(tmp_path)
    text = '[robot]\nname = "R"\n[[slot]]\nname = "a"\npart = "TIP"\n'
    text += "[slot.safe]\nmove = { tip = { x = 1.5 }, joints = [3, 4] }\n"
    found = parse_blueprint(text, library)
    assert found.slots[0].safe == {"move": {"tip.x": 1.5, "joints": "[3, 4]"}}
    assert parse_blueprint(blueprint_toml(found), library).slots == found.slots
    port = library.require("TIP").port("move")
    assert port is not None
    assert found.slots[0].safe_at(port) == {"mode": "rest", "tip.x": 1.5, "joints": "[3, 4]"}


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            "powr = { percent = 20 }",
            'slot[0].safe.powr: part FAN-5V has no port "powr" that is driven; did you mean "power"?',
        ),
        ("power = { percnt = 20 }", 'safe.power.percnt: a Level has no field "percnt"; did you mean "percent"?'),
        ("power = { percent = 140 }", "safe.power.percent: must be from 0 to 100 %; it is 140"),
        ('power = { percent = "x" }', "safe.power.percent: "),
        ("power = { percent = nan }", "safe.power.percent: "),
        ("power = 20", "slot[0].safe.power: must be a table"),
        ("power = { percent = [20] }", "safe.power.percent: "),
    ],
)
def test_what_no_port_takes_is_refused_with_line_and_remedy(wrong: str, words: str) -> None:
    with pytest.raises(ConfigError, match=r"robot\.toml, line ") as caught:
        read(ROBOT.replace("power = { percent = 20 }", wrong))
    assert words in str(caught.value)


def test_a_port_that_publishes_has_none() -> None:
    text = '[robot]\nname = "R"\n[[slot]]\nname = "dial"\npart = "POT-10K"\n[slot.safe]\nlevel = { percent = 1 }\n'
    with pytest.raises(ConfigError, match='no port "level" that is driven; it has none that is driven'):
        read(text)


def test_a_change_is_told_and_gives_another_mark() -> None:
    one, other = read(ROBOT), read(ROBOT.replace("20", "30"))
    none = read(ROBOT.partition("[slot.safe]")[0])
    assert [str(each) for each in differences(one, other)] == ["~ slot fan, safe power.percent: 20 -> 30"]
    assert [str(each) for each in differences(none, one)] == ["+ slot fan, safe power.percent: 20"]
    assert [str(each) for each in differences(one, none)] == [
        "- slot fan, safe power.percent: 20 (the library's value holds again)"
    ]
    assert len({blueprint_mark(each) for each in (one, other, none)}) == 3


DRIVE = """\
number = "DRIVE"
name = "Drive"
[[port]]
name = "speed"
direction = "subscribe"
type = "Speed"
safe = { rpm = 0 }
stops_by = "quick stop"
[[port]]
name = "turns"
direction = "publish"
type = "Speed"
"""


def test_a_value_that_does_not_hold_at_stop_is_a_hint_that_says_what_does(tmp_path: Path) -> None:
    (tmp_path / "drive.toml").write_text(DRIVE)
    library = load_library(tmp_path)
    text = '[robot]\nname = "R"\n[[slot]]\nname = "arm"\npart = "DRIVE"\n'
    with_safe = parse_blueprint(f"{text}[slot.safe]\nspeed = {{ rpm = 30 }}\n", library)
    words = "slot arm: at STOP speed gets quick stop, and not its value in [slot.safe]"
    assert words in hints(with_safe, library)
    assert words not in hints(parse_blueprint(text, library), library)


def test_a_port_that_publishes_is_stopped_by_nothing(tmp_path: Path) -> None:
    (tmp_path / "drive.toml").write_text(DRIVE + 'stops_by = "quick stop"\n')
    with pytest.raises(ConfigError, match=r"stops_by.*: only a port that subscribes can be stopped; remove it"):
        load_library(tmp_path)
