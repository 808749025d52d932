"""A device that its robot leaves: it is told to be safe until it has reported that it is, and else that is said."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from random import Random
from typing import Any

import pytest

from msbot import Level, Message
from msbot.testing import robot_for
from msbot_agent.link import LossyLink
from msbot_bridges.bridge import Bridge, BridgedPart, DeviceIdentity, ForeignDevice, Input, Report, World, WorldHost
from msbot_bridges.bridge.leaving import LEAVE_S, MASTERLESS_S
from msbot_xrce.errors import LinkDown

NOT_SAFE = "the valve has not reported that it is shut"
SOME, SAFE = Level(percent=60), Level(percent=20)


class Valve(ForeignDevice):
    """A valve at the end of a wire that may lose orders and reports."""

    inputs: Sequence[Input] = (Input("flow", Level, safe=Level(percent=0)),)

    def __init__(self) -> None:
        self.identity = DeviceIdentity("test", "valve", b"1", "Valve", where="there")
        self.percent = 0.0
        """What it really has."""
        self.lost_orders = 0
        """So many orders get lost from now on."""
        self.is_mute = False
        self.orders: list[str] = []
        self.news: Callable[[ForeignDevice], None] = lambda _: None
        self.trouble = ""
        self._safe: Message = Level(percent=0)
        self._is_stopping = self._has_reported = False

    def begin(self, report: Report) -> None:
        self.orders.append("begin")

    def end(self) -> None:
        self.orders.append("end")
        self._is_stopping = False

    def act(self, port: str, message: Message) -> None:
        assert not self._is_stopping
        self._order("act", message)

    def set(self, name: str, value: object) -> None:
        raise AssertionError

    def safe_is(self, port: str, message: Message) -> None:
        self._safe = message

    def rests_at(self, port: str, message: Message) -> None:
        self._safe = message

    def stop(self) -> None:
        if not self._is_stopping:
            self._is_stopping, self._has_reported = True, False
        self._order("stop", self._safe)

    def go(self) -> None:
        self._is_stopping = False

    def _order(self, kind: str, message: Message) -> None:
        self.orders.append(kind)
        if self.lost_orders:
            self.lost_orders -= 1
            return
        assert isinstance(message, Level)
        self.percent = message.percent
        if kind == "stop" and not self.is_mute and not self._has_reported:
            self._has_reported = True
            self.news(self)

    @property
    def not_stopped(self) -> str:
        return NOT_SAFE if self._is_stopping and not self._has_reported else ""

    @property
    def fault(self) -> str:
        return self.trouble


class Pipe(World):
    """A world with one valve."""

    def __init__(self, valve: Valve) -> None:
        self._valve = valve
        self.ended = asyncio.Event()
        self.is_left = False

    async def run(self, host: WorldHost) -> None:
        self.host, self._valve.news = host, host.news
        host.found(self._valve)
        await self.ended.wait()
        raise LinkDown("the pipe has burst")

    def left(self, device: ForeignDevice) -> None:
        self.is_left = True


class Bridged:
    """A valve, its bridge, and the robot that it is in, in virtual time."""

    def __init__(self, robot: Any, valve: Valve) -> None:
        self.robot, self.valve = robot, valve
        self._links = list[Any]()
        self._unsafe = dict[bytes, Mapping[str, Message]]()
        self.begin()
        robot.send("flow", SOME)
        assert valve.percent == 60

    def begin(self) -> None:
        """A bridge begins."""
        self.world = Pipe(self.valve)
        self.bridge = Bridge(self.world, self._connect, unsafe=self._unsafe)
        before = self.valve.orders.count("begin")
        self.robot._in_loop(self._start)
        self.until(lambda: self.valve.orders.count("begin") > before)

    def _start(self) -> None:
        self.running = asyncio.create_task(self.bridge.run())

    def lose(self, *, is_reset: bool = False) -> None:
        """The valve is out of reach, with all that it is told from now on."""
        self.valve.lost_orders, self.valve.is_reset = 1000, is_reset
        self.world.host.lost(self.valve, "the valve is gone")

    def _connect(self, _: object) -> Any:
        self._links.append(LossyLink(self.robot._hub.connect(), random=Random(1), drop=0.0))
        return self._links[-1]

    def cut(self, *, is_cut: bool = True) -> None:
        """The master is out of reach."""
        self._links[-1].disturbance.drop = 1.0 if is_cut else 0.0

    def until(self, condition: Callable[[], object]) -> None:
        for _ in range(2000):
            if condition():
                return
            self.robot.advance(0.05)
        raise AssertionError(self.valve.orders[-10:])

    def leave(self) -> float:
        """End the bridge; the time that it took."""
        began = float(self.robot.now)
        self.robot._in_loop(self.bridge.end)
        self.until(self.running.done)
        return self.robot.now - began  # type: ignore[no-any-return]

    def why(self) -> str:
        return "\n".join([*self.robot._master.why("test:valve"), *self.robot.log])


@contextmanager
def bridged(**settings: float) -> Iterator[Bridged]:
    valve = Valve()
    with robot_for(BridgedPart(valve).part, join=False, settings={"flow.safe.percent": 20}) as robot:
        yield Bridged(robot, valve)


def test_a_device_that_loses_orders_is_told_until_it_has_reported() -> None:
    with bridged() as it:
        it.valve.lost_orders = 5
        took = it.leave()
        assert it.valve.percent == 20
        assert it.valve.orders[-7:] == [*["stop"] * 6, "end"]
        assert 5 * 0.2 <= took < LEAVE_S
        assert "not known to be safe" not in it.why()
        assert it.world.is_left


def test_a_device_that_reports_at_once_is_left_at_once() -> None:
    with bridged() as it:
        assert it.leave() < 0.2
        assert it.valve.orders == ["begin", "act", "stop", "end"]


def test_what_a_device_has_not_reported_is_said_in_its_robot() -> None:
    with bridged() as it:
        it.valve.is_mute = True
        assert LEAVE_S <= it.leave() < LEAVE_S + 1
        assert it.valve.orders[-1] == "end"
        assert f"it is out of its robot, and not known to be safe: {NOT_SAFE}" in it.why()


def test_a_master_that_ends_first_delays_no_more_than_the_device_does() -> None:
    with bridged() as it:
        it.cut()
        it.valve.lost_orders = 5
        assert it.leave() < LEAVE_S
        assert it.valve.percent == 20
        assert it.valve.orders[-1] == "end"


def test_nothing_else_reaches_a_device_that_is_being_left() -> None:
    with bridged() as it:
        it.valve.is_mute = True
        it.robot._in_loop(it.bridge.end)
        it.robot.send("flow", SOME)
        assert it.valve.percent == 20
        assert "act" not in it.valve.orders[it.valve.orders.index("stop") :]
        it.robot.stop()
        it.robot.advance(0.5)
        assert it.robot._master.stop.silent == ("test:valve",), "it has not reported that it has stopped"
        it.valve.is_mute = False
        it.until(it.running.done)
        it.robot.advance(1)
        assert it.robot._master.stop.silent == (), "it has said so before it left"
        assert it.robot.errors == []


def test_a_device_without_a_master_is_told_until_it_has_reported_and_obeys_a_master_that_is_back() -> None:
    with bridged() as it:
        it.valve.lost_orders = 20
        it.cut()
        it.until(lambda: "end" in it.valve.orders)
        assert it.valve.percent == 20
        assert it.valve.orders == ["begin", "act", *["stop"] * 21, "end"]
        it.cut(is_cut=False)
        it.until(lambda: it.valve.orders[-1] == "begin")
        it.robot.send("flow", SOME)
        assert it.valve.percent == 60


def test_a_master_that_is_back_before_the_report_commands_again() -> None:
    with bridged() as it:
        it.valve.is_mute = True
        it.cut()
        it.until(lambda: it.valve.orders.count("stop") >= 3)
        it.cut(is_cut=False)
        it.until(lambda: it.valve.orders[-1] == "begin")
        assert it.valve.orders[-2] == "end"
        it.robot.send("flow", SOME)
        assert it.valve.percent == 60
        told = len(it.valve.orders)
        it.robot.advance(2 * MASTERLESS_S)
        assert len(it.valve.orders) == told, "it is told to be safe no longer"


def test_a_device_without_a_master_is_not_told_for_ever() -> None:
    with bridged() as it:
        it.valve.is_mute = True
        it.cut()
        it.until(lambda: "stop" in it.valve.orders)
        it.robot.advance(MASTERLESS_S + 1)
        assert it.valve.orders[-1] == "end"
        assert NOT_SAFE in it.why()
        told = len(it.valve.orders)
        it.robot.advance(MASTERLESS_S)
        assert len(it.valve.orders) == told


def test_a_bridge_that_ends_without_a_master_waits_no_longer_than_another() -> None:
    with bridged() as it:
        it.valve.is_mute = True
        it.cut()
        it.until(lambda: "stop" in it.valve.orders)
        assert it.leave() < LEAVE_S + 0.5
        assert it.valve.orders[-1] == "end"


def test_a_device_that_gets_lost_while_it_is_being_left_is_not_waited_for() -> None:
    with bridged() as it:
        it.valve.is_mute = True
        it.robot._in_loop(it.bridge.end)
        it.robot.advance(0.5)
        it.robot._in_loop(lambda: it.world.host.lost(it.valve, "the valve is gone"))
        it.robot.advance(0.5)
        assert it.running.done()
        assert "the valve is gone" in it.why()
        assert it.valve.orders[-1] == "end"


def test_a_robot_is_told_that_the_way_to_its_device_has_ended() -> None:
    with bridged() as it:
        it.robot._in_loop(it.world.ended.set)
        it.robot.advance(0.5)
        with pytest.raises(LinkDown, match="the pipe has burst"):
            it.running.result()
        assert "the bridge to it has ended: the pipe has burst" in it.why()
        assert it.valve.orders[-1] == "end"


def test_stop_that_has_held_while_the_master_was_away_holds_for_the_device_when_it_is_back() -> None:
    with bridged() as it:
        it.robot.stop()
        it.until(lambda: it.robot._master.stop.confirmed)
        it.cut()
        it.until(lambda: it.valve.orders[-1] == "end")
        it.valve.percent = 99  # somebody else has turned it
        it.cut(is_cut=False)
        it.until(lambda: it.valve.orders[-2:] == ["begin", "stop"])
        assert it.valve.percent == 20


def test_a_device_with_a_fault_is_left_safe_too() -> None:
    with bridged() as it:
        it.valve.trouble = "the valve is too hot"
        it.valve.lost_orders = 3
        it.robot._in_loop(lambda: it.world.host.news(it.valve))
        it.until(lambda: it.valve.orders[-1] == "end")
        assert it.valve.percent == 20
        assert "the valve is too hot" in it.why()
        it.valve.trouble = ""
        it.robot._in_loop(lambda: it.world.host.news(it.valve))
        it.until(lambda: it.valve.orders[-1] == "begin")


@pytest.mark.parametrize("is_reset", [False, True])
def test_a_device_that_was_driven_when_it_was_lost_is_made_safe_when_it_is_found_again(is_reset: bool) -> None:
    with bridged() as it:
        it.robot._in_loop(lambda: it.lose(is_reset=is_reset))
        it.robot.advance(1)
        assert it.valve.percent == 60, "nothing has reached it"
        it.valve.lost_orders, told = 3, len(it.valve.orders)
        it.robot._in_loop(lambda: it.world.host.found(it.valve))
        it.until(lambda: "begin" in it.valve.orders[told:])
        assert it.valve.orders[told:] == (["begin"] if is_reset else [*["stop"] * 4, "end", "begin"])
        assert it.valve.percent == (60 if is_reset else 20)


def test_a_device_that_was_safe_when_it_was_lost_is_told_nothing_when_it_is_found_again() -> None:
    with bridged() as it:
        it.robot.send("flow", SAFE)
        it.robot.unplug_partner()
        it.robot._in_loop(it.lose)
        it.robot.advance(1)
        told = len(it.valve.orders)
        it.robot._in_loop(lambda: it.world.host.found(it.valve))
        it.until(lambda: "begin" in it.valve.orders[told:])
        assert it.valve.orders[told:] == ["begin"]


def test_a_device_that_was_driven_when_its_bus_ended_is_made_safe_by_the_next_bridge() -> None:
    with bridged() as it:
        it.valve.lost_orders = 100
        it.robot._in_loop(it.world.ended.set)
        it.until(it.running.done)
        assert it.valve.percent == 60
        it.valve.lost_orders, told = 0, len(it.valve.orders)
        it.begin()
        assert it.valve.orders[told:] == ["stop", "end", "begin"]
        assert it.valve.percent == 20


def test_a_device_that_gets_lost_again_while_it_is_made_safe_is_made_safe_the_next_time() -> None:
    with bridged() as it:
        it.robot._in_loop(it.lose)
        it.robot.advance(1)
        for _ in range(2):
            it.valve.lost_orders, it.valve.is_mute, told = 0, True, len(it.valve.orders)
            it.valve._safe = Level(percent=0)
            it.robot._in_loop(lambda: it.world.host.found(it.valve))
            it.robot.advance(1)
            assert "begin" not in it.valve.orders[told:]
            it.robot._in_loop(it.lose)
            it.robot.advance(1)
            assert it.valve.orders[-1] == "end"
            assert it.valve.percent == 20, "as its slot has it, though it was in none since"
        it.valve.lost_orders, it.valve.is_mute = 0, False
        it.robot._in_loop(lambda: it.world.host.found(it.valve))
        it.until(lambda: it.valve.orders[-3:] == ["stop", "end", "begin"])


def test_a_device_that_is_found_again_is_made_safe_before_the_part_that_lost_it_has_said_goodbye() -> None:
    with bridged() as it:
        it.cut()  # nobody acknowledges the goodbye
        it.robot._in_loop(it.lose)
        it.robot.advance(0.1)
        it.valve.lost_orders, told = 0, len(it.valve.orders)
        it.robot._in_loop(lambda: it.world.host.found(it.valve))
        it.robot.advance(0.1)
        assert it.valve.orders[told:] == ["stop", "end"]
        assert it.valve.percent == 20
        it.cut(is_cut=False)
        it.until(lambda: it.valve.orders[-1] == "begin")


def test_a_device_with_a_mistake_in_its_world_does_not_keep_others_from_being_left(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with bridged() as it:

        def fail(port: str, message: Message) -> None:
            raise ZeroDivisionError("a mistake")

        def fail_again() -> None:
            raise ZeroDivisionError("another mistake")

        it.valve.rests_at, it.valve.end = fail, fail_again  # type: ignore[method-assign]
        it.leave()
        assert "not known to be safe: ZeroDivisionError: a mistake" in it.why()
        assert "another mistake" in caplog.text
        assert it.world.is_left
        assert it.running.exception() is None


def test_a_device_that_moves_nothing_is_left_at_once() -> None:
    with bridged() as it:
        it.valve.inputs, it.valve.is_mute = (), True
        assert it.leave() < 0.2
        assert "not known to be safe" not in it.why()
        assert it.valve.orders[-1] == "end"
