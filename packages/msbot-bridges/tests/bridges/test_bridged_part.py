"""A device of another world as a part: description, settings, STOP that only the device confirms, faults."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from examples.extension.src.msbot_hello.bridge import Lamp
from msbot import Level
from msbot.config import load_library
from msbot.config.library.description_reader import read_description
from msbot.part.description import describe
from msbot.testing import robot_for
from msbot_bridges.bridge import BridgedPart, DeviceIdentity, DeviceSetting

Robot = Any


@contextmanager
def lamp_robot() -> Iterator[tuple[Lamp, Robot]]:
    lamp = Lamp(b"1", lambda _: bridged.news())
    bridged = BridgedPart(lamp)
    with robot_for(bridged.part) as robot:
        yield lamp, robot


def test_it_describes_itself_so_that_a_robot_can_adopt_it() -> None:
    bridged = BridgedPart(Lamp(b"1", lambda _: None))
    text = describe("hello:lamp", bridged.device.identity.words, bridged.part.program)
    found = read_description(text, "hello:lamp", load_library()).part_type
    assert [(port.name, port.type_name, port.safe) for port in found.ports] == [
        ("brightness", "Level", None),
        ("power", "Level", {"percent": 0.0}),
    ]
    assert [(one.name, one.default, one.least, one.most, one.unit) for one in found.parameters] == [
        ("most", 100.0, 0.0, 100.0, "%")
    ]


def test_messages_settings_and_reports_go_through() -> None:
    with lamp_robot() as (lamp, robot):
        robot.send("power", Level(percent=40))
        assert robot.last("brightness") == Level(percent=40)
        robot.set("most", 30.0)
        robot.advance(1)
        robot.send("power", Level(percent=90))
        assert lamp.percent == 30.0
        assert robot.errors == []


def test_a_lost_partner_leaves_the_safe_value() -> None:
    with lamp_robot() as (lamp, robot):
        robot.send("power", Level(percent=40))
        robot.unplug_partner()
        assert lamp.percent == 0.0


def test_stop_is_confirmed_when_the_device_reports_it_and_not_before() -> None:
    with lamp_robot() as (lamp, robot):
        robot.send("power", Level(percent=40))
        lamp.answers = False
        robot.stop()
        robot.advance(3)
        assert lamp.percent == 0.0
        assert not robot.part._runner.safety.number
        robot._in_loop(lamp.answer)
        robot.advance(0.01)
        assert robot.part._runner.safety.number == 1
        assert robot.errors == [], "a device that has not answered yet is no mistake of the program"
        robot.go()
        robot.advance(0.5)
        robot.send("power", Level(percent=20))
        assert lamp.percent == 20.0


def test_a_cut_cable_makes_it_safe() -> None:
    with lamp_robot() as (lamp, robot):
        robot.send("power", Level(percent=40))
        robot.unplug()
        assert lamp.percent == 0.0


def test_settings_beyond_the_room_of_a_description_are_left_out_and_named() -> None:
    lamp = Lamp(b"1", lambda _: None)
    lamp.settings = tuple(DeviceSetting(f"parameter_{number}", int, 1, 0, 10) for number in range(80))
    bridged = BridgedPart(lamp)
    assert bridged.left_out
    kept = [one.name for one in lamp.settings[: 80 - len(bridged.left_out)]]
    assert kept + bridged.left_out == [one.name for one in lamp.settings]
    assert list(bridged.part.program.settings.declared) == kept


@pytest.mark.parametrize(
    ("maker", "product", "number"),
    [("com.acme", "servo", "com.acme:servo"), ("Ä@B", " x ", "Ä_B:x"), ("", "\n", "unknown:unknown")],
)
def test_its_part_number_has_only_characters_that_every_part_number_may_have(
    maker: str, product: str, number: str
) -> None:
    assert DeviceIdentity(maker, product, b"1", "x").part_number == number


def test_two_devices_of_a_kind_have_two_uids_and_one_device_has_one() -> None:
    one, same, other = (DeviceIdentity("a", "b", unique, "x").uid for unique in (b"1", b"1", b"2"))
    assert one == same != other
    assert DeviceIdentity("a", "c", b"1", "x").uid != one
    assert len(one) == 8
