"""A device of another world as a part: description, settings, STOP that only the device confirms, faults."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import pytest

from examples.extension.src.msbot_hello.bridge import Lamp
from msbot import Level, Message
from msbot.config import load_library
from msbot.config.library.description_reader import read_description
from msbot.part.description import describe
from msbot.testing import robot_for
from msbot_bridges.bridge import BridgedPart, DeviceIdentity, DeviceSetting, Input

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


class Listening(Lamp):
    """One that writes down how it was told."""

    def __init__(self) -> None:
        super().__init__(b"1", lambda _: None)
        self.story: list[tuple[str, str, Message]] = []

    def act(self, port: str, message: Message) -> None:
        self.story.append(("act", port, message))
        super().act(port, message)

    def rests_at(self, port: str, message: Message) -> None:
        self.story.append(("rests_at", port, message))
        super().act(port, message)

    def safe_is(self, port: str, message: Message) -> None:
        self.story.append(("safe_is", port, message))


def test_a_safe_value_of_the_slot_comes_as_such_without_partner_at_stop_and_at_the_end() -> None:
    lamp, most, few = Listening(), Level(percent=40), Level(percent=20)
    bridged = BridgedPart(lamp)
    with robot_for(bridged.part, settings={"power.safe.percent": 20}) as robot:
        robot.send("power", most)
        robot.unplug_partner()
        robot.plug_partner()
        robot.send("power", few)
        robot.stop()
        robot.advance(0.5)
        robot.go()
        robot.advance(0.5)
        robot.unplug()
    steps = [step for before, step in pairwise([None, *lamp.story]) if step != before]
    assert steps == [
        ("act", "power", most),
        ("rests_at", "power", few),
        ("act", "power", few),  # the same value of a partner is an order
        ("safe_is", "power", few),
        ("rests_at", "power", few),
    ]


def test_a_port_of_which_the_robot_says_nothing_is_safe_when_the_part_leaves() -> None:
    lamp = Listening()
    bridged = BridgedPart(lamp)
    with robot_for(bridged.part) as robot:
        bridged.part._runner.safety.configure({})  # it has no wire, and a person drives it
        robot.send("power", Level(percent=40))
        robot.unplug()
        assert lamp.story[-1] == ("rests_at", "power", Level(percent=0))


def test_what_stop_does_instead_of_a_safe_value_is_in_the_description() -> None:
    lamp = Lamp(b"1", lambda _: None)
    lamp.inputs = (Input("power", Level, safe=Level(percent=0), stops_by="quick stop"),)
    text = describe("hello:lamp", "lamp", BridgedPart(lamp).part.program)
    found = read_description(text, "hello:lamp", load_library()).part_type
    assert {port.name: port.stops_by for port in found.ports} == {"brightness": "", "power": "quick stop"}


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


def test_the_lamp_of_the_example_is_at_stop_as_bright_as_its_slot_says() -> None:
    lamp = Lamp(b"1", lambda _: bridged.news())
    bridged = BridgedPart(lamp)
    with robot_for(bridged.part, settings={"power.safe.percent": 20}) as robot:
        robot.send("power", Level(percent=90))
        robot.stop()
        robot.advance(0.5)
        assert lamp.percent == 20.0
        assert robot.part._runner.safety.number == 1


def _who_may_still_move(robot: Robot) -> tuple[str, ...]:
    robot.advance(20)
    silent: tuple[str, ...] = robot._master.stop.silent
    return silent


@pytest.mark.promise("Only a part itself confirms STOP")
@pytest.mark.parametrize("why", ["the broker is gone", ""])
def test_a_device_out_of_reach_before_it_has_stopped_stays_named_though_its_part_says_goodbye(why: str) -> None:
    lamp = Lamp(b"1", lambda _: None)
    bridged = BridgedPart(lamp)
    with robot_for(bridged.part) as robot:
        robot.send("power", Level(percent=40))
        lamp.answers = False
        robot.stop()
        robot.advance(1)
        robot._in_loop(lambda: bridged.end(why))
        assert _who_may_still_move(robot) == ("hello:lamp",)


def test_a_device_that_has_stopped_need_not_be_named_when_its_part_says_goodbye() -> None:
    lamp = Lamp(b"1", lambda _: None)
    bridged = BridgedPart(lamp)
    with robot_for(bridged.part) as robot:
        robot.stop()
        robot.advance(1)
        robot._in_loop(lambda: bridged.end("the broker is gone"))
        assert _who_may_still_move(robot) == ()


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
