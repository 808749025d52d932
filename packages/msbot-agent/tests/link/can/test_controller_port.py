"""The port between an end and its controller, with a controller that does only what the test says."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can.controller import BusState, CanBusInfo, FrameHandler, StateHandler
from msbot_agent.link.can.controller_port import CanPort
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import CanIds, stop_frame
from msbot_xrce.errors import LinkDown, LinkFull


class FakeBus:
    """A controller by hand; like many adapters it cannot tell what is pending."""

    def __init__(self) -> None:
        self.info = CanBusInfo("can:fake", None)
        self.sent: list[Frame] = []
        self.room = 100
        self.restarts = 0
        self.closed = False
        self.ending: asyncio.Future[None] | None = None

    def attach(
        self,
        *,
        frame: FrameHandler | None = None,
        room: Callable[[float], None] | None = None,
        state: StateHandler | None = None,
    ) -> None:
        """See `CanBus`."""
        assert frame is not None
        assert room is not None
        assert state is not None
        self.frame, self.left, self.state = frame, room, state

    def has_room(self) -> bool:
        return len(self.sent) < self.room

    def pending(self) -> int:
        return 0

    def send(self, frame: Frame) -> None:
        self.sent.append(frame)

    def restart(self) -> None:
        self.restarts += 1

    async def run(self) -> None:
        self.ending = asyncio.get_running_loop().create_future()
        try:
            await self.ending
        finally:
            self.closed = True


@dataclass
class Owner:
    """An end that writes down what it is told."""

    told: list[object] = field(default_factory=list)
    alarm: float | None = None
    alarms: list[float] = field(default_factory=list)

    def stopped(self, reason: int, now: float) -> None:
        self.told.append(("stop", reason))

    def frame_received(self, frame: Frame, now: float) -> None:
        self.told.append(frame.can_id)

    def room_again(self, peer: int) -> None:
        self.told.append(("room", peer))

    def drained(self, now: float) -> None:
        self.told.append("drained")

    def bus_up(self, now: float) -> None:
        self.told.append("up")

    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        self.told.append((reason, lost_frames))

    def timer(self) -> float | None:
        return self.alarm

    def handle_timer(self, now: float) -> None:
        self.alarms.append(now)
        self.alarm = None


def with_port(scene: Callable[[CanPort, FakeBus, Owner], object], *, queue_frames: int = 32) -> tuple[FakeBus, Owner]:
    """Run a coroutine function with a port that is up."""
    bus, owner = FakeBus(), Owner()

    async def main() -> None:
        port = CanPort(bus, owner, ids=CanIds(), queue_frames=queue_frames)
        running = asyncio.create_task(port.run())
        await asyncio.sleep(0.001)
        result = scene(port, bus, owner)
        if asyncio.iscoroutine(result):
            await result
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())
    return bus, owner


def test_a_port_goes_up_when_it_runs_and_down_when_it_is_closed() -> None:
    bus, owner = with_port(lambda port, bus, owner: None)
    assert owner.told == ["up", ("the link was closed", 0)]
    assert bus.closed


def test_before_it_runs_nothing_can_be_sent() -> None:
    port = CanPort(FakeBus(), Owner(), ids=CanIds())
    with pytest.raises(LinkDown, match="link can:fake does not run"):
        port.check_up()


def test_frames_wait_while_the_controller_is_full_and_the_end_of_the_queue_is_told() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.room = 2
        port.queue.put(1, [Frame(1), Frame(2), Frame(3)])
        port.pump(0.0)
        assert [frame.can_id for frame in bus.sent] == [1, 2]
        assert "drained" not in owner.told
        bus.room = 10
        bus.left(0.0)
        assert [frame.can_id for frame in bus.sent] == [1, 2, 3]
        assert owner.told[-1] == "drained"

    with_port(scene)


def test_room_is_checked_and_told() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.room = 1
        port.queue.put(7, [Frame(number) for number in range(4)])
        port.pump(0.0)
        with pytest.raises(LinkFull, match="the queue to part seven is full"):
            port.check_room(7, "part seven")
        bus.room = 2
        bus.left(0.0)
        assert ("room", 7) in owner.told
        port.check_room(7, "part seven")

    with_port(scene, queue_frames=3)


def test_who_had_no_room_when_the_bus_was_left_or_a_peer_is_forgotten_is_told_when_there_is_room() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.room = 0
        port.queue.put(7, [Frame(number) for number in range(4)])
        port.queue.put(8, [Frame(9)])
        bus.state(BusState.OFF, "too many errors", 1.0)
        port.pump(1.0)
        assert ("room", 7) not in owner.told, "off the bus nobody can send"
        bus.state(BusState.ACTIVE, "", 2.0)
        assert owner.told[-2:] == ["up", ("room", 7)]
        port.queue.put(8, [Frame(number) for number in range(4)])
        port.queue.clear(8)
        port.tell_room()
        assert owner.told[-1] == ("room", 8)
        assert ("room", 8) not in owner.told[:-1]

    with_port(scene, queue_frames=3)


def test_stop_is_sent_three_times_and_heard_once() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        port.send_stop(1)
        assert bus.sent == [stop_frame(1, CanIds())] * 3
        for at, reason in ((0.0, 1), (0.001, 1), (0.002, 1), (0.003, 2), (0.5, 2)):
            bus.frame(stop_frame(reason, CanIds()), at)
        bus.frame(Frame(0x008, b"\1", extended=True), 1.0)
        bus.frame(Frame(0x123), 1.0)
        assert owner.told[-5:] == [("stop", 1), ("stop", 2), ("stop", 2), 0x008, 0x123]

    with_port(scene)


def test_stop_is_said_again_after_more_than_a_tenth_of_a_second() -> None:
    """Counted from the last one heard, told or not."""

    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        told = []
        for at in (10.0, 10.09, 10.18, 10.29, 11.0, 11.05):
            before = len(owner.told)
            bus.frame(stop_frame(1, CanIds()), at)
            told.append(len(owner.told) - before)
        assert told == [1, 0, 0, 1, 1, 0]

    with_port(scene)


def test_a_tap_gets_what_is_handed_over_and_what_comes_in() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        tapped: list[tuple[float, str, Frame]] = []
        port.frame_tap = lambda at, whose, frame: tapped.append((at, whose, frame))
        port.send_urgent([Frame(1)], 3.0)
        bus.frame(Frame(2), 4.0)
        bus.frame(stop_frame(1, CanIds()), 5.0)
        assert tapped == [(3.0, "here", Frame(1)), (4.0, "bus", Frame(2)), (5.0, "bus", stop_frame(1, CanIds()))]

    with_port(scene)


def test_the_timer_is_set_again_by_whatever_may_have_moved_it() -> None:
    async def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        owner.alarm = 1.0
        port.send_urgent([Frame(1)], 0.0)
        await asyncio.sleep(2.0)
        assert owner.alarms == [1.0]
        bus.state(BusState.OFF, "off", 2.0)
        owner.alarm = 3.0
        bus.state(BusState.ACTIVE, "back", 2.5)
        await asyncio.sleep(2.0)
        assert owner.alarms == [1.0, 3.0]
        owner.alarm = 5.0
        port.arm()
        bus.state(BusState.OFF, "off", 4.0)
        await asyncio.sleep(2.0)
        assert owner.alarms == [1.0, 3.0], "off the bus there is nothing to do"

    with_port(scene)


def test_urgent_frames_that_find_no_room_are_told() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.room = 0
        assert port.send_urgent([Frame(number) for number in range(300)], 0.0) == 300 - 256

    with_port(scene)


def test_the_timer_is_the_owners() -> None:
    async def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        owner.alarm = 5.0
        port.arm()
        owner.alarm = 2.0
        port.arm()
        port.arm()
        await asyncio.sleep(10.0)

    _, owner = with_port(scene)
    assert owner.alarms == [2.0]


def test_bus_off_is_left_with_pauses_that_double_until_a_frame_gets_through() -> None:
    async def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        port.queue.put(1, [Frame(1), Frame(2)])
        bus.state(BusState.PASSIVE, "warning", 0.0)
        assert port.is_up
        assert port.state is BusState.PASSIVE
        restarts: list[int] = []
        for pause in (0.1, 0.2, 0.4):
            bus.state(BusState.OFF, "short circuit", 0.0)
            bus.state(BusState.OFF, "short circuit", 0.0)
            assert not port.is_up
            with pytest.raises(LinkDown, match="is not on the bus"):
                port.check_up()
            await asyncio.sleep(pause - 0.001)
            restarts.append(bus.restarts)
            await asyncio.sleep(0.002)
            restarts.append(bus.restarts)
            bus.state(BusState.ACTIVE, "back", 0.0)
        assert restarts == [0, 1, 1, 2, 2, 3]
        assert owner.told[:3] == ["up", ("bus-off: short circuit", 2), "up"]
        bus.left(0.0)
        bus.state(BusState.OFF, "again", 0.0)
        await asyncio.sleep(0.101)
        assert bus.restarts == 4

    with_port(scene)


def test_a_controller_that_came_back_by_itself_is_not_restarted() -> None:
    async def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.state(BusState.OFF, "short circuit", 0.0)
        bus.state(BusState.ACTIVE, "back", 0.0)
        assert port.is_up
        await asyncio.sleep(1.0)
        assert bus.restarts == 0

    with_port(scene)


def test_a_vanished_adapter_is_down_and_not_restarted() -> None:
    async def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.state(BusState.GONE, "the adapter was pulled out", 0.0)
        await asyncio.sleep(20.0)
        assert bus.restarts == 0
        assert owner.told == ["up", ("gone: the adapter was pulled out", 0)]

    with_port(scene)


def test_closing_while_bus_off_leaves_no_restart_behind() -> None:
    def scene(port: CanPort, bus: FakeBus, owner: Owner) -> None:
        bus.state(BusState.OFF, "short circuit", 0.0)

    bus, owner = with_port(scene)
    assert bus.restarts == 0
    bus.state(BusState.ACTIVE, "late", 0.0)
    assert owner.told == ["up", ("bus-off: short circuit", 0)]


@pytest.mark.parametrize(("how", "words"), [("fail", "the owner"), ("raise", "the adapter"), ("end", "has closed")])
def test_run_ends_with_the_reason(how: str, words: str) -> None:
    async def main() -> None:
        bus, owner = FakeBus(), Owner()
        port = CanPort(bus, owner, ids=CanIds())
        port.fail(LinkDown("before it runs: without effect"))
        running = asyncio.create_task(port.run())
        await asyncio.sleep(1.0)
        assert bus.ending is not None
        if how == "fail":
            port.fail(LinkDown("the owner says no"))
            port.fail(LinkDown("the second reason does not count"))
        elif how == "raise":
            bus.ending.set_exception(LinkDown("the adapter cannot be opened"))
        else:
            bus.ending.set_result(None)
        with pytest.raises(LinkDown, match=words):
            await running
        assert bus.closed
        assert owner.told[-1] == ("the link was closed", 0)

    run_virtual(main())


def test_a_controller_that_cannot_be_opened_never_goes_up() -> None:
    class Absent(FakeBus):
        async def run(self) -> None:
            raise LinkDown("no such adapter: bring it up with `ip link set can0 up`")

    async def main() -> None:
        owner = Owner()
        with pytest.raises(LinkDown, match="ip link"):
            await CanPort(Absent(), owner, ids=CanIds()).run()
        assert owner.told == []

    run_virtual(main())
