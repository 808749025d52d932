"""The driver over an adapter that does only what the test says, in virtual time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can.adapters.can_driver import (
    FRAMES_PER_TURN,
    MOST_WORDS,
    RING_FULL,
    CanDriver,
    Channel,
    ChannelOwner,
)
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LinkDown, LinkFull

FRAME = Frame(0x123, b"\1")


class FakeChannel:
    def __init__(self, owner: ChannelOwner) -> None:
        self.owner = owner
        self.room = 1000
        self.sent: list[Frame] = []
        self.restarts = 0
        self.closed = False

    def send(self, frame: Frame) -> bool:
        if not self.room:
            return False
        self.room -= 1
        self.sent.append(frame)
        return True

    def pending(self) -> int:
        return 0

    def restart(self) -> None:
        self.restarts += 1

    async def close(self) -> None:
        self.closed = True


class FakeAdapter:
    """Opens when `absent` is empty, otherwise says those words."""

    def __init__(self) -> None:
        self.info = CanBusInfo("can:fake", 500_000)
        self.absent = ""
        self.opened: list[tuple[float, FakeChannel]] = []
        self.tried_at: list[float] = []

    async def open(self, owner: ChannelOwner) -> Channel:
        now = asyncio.get_running_loop().time()
        self.tried_at.append(now)
        if self.absent:
            raise LinkDown(self.absent)
        channel = FakeChannel(owner)
        self.opened.append((now, channel))
        return channel

    @property
    def channel(self) -> FakeChannel:
        return self.opened[-1][1]


class Bench:
    """A driver that runs, and what it told."""

    def __init__(self, *, ring_frames: int = 4096) -> None:
        self.adapter = FakeAdapter()
        self.driver = CanDriver(self.adapter, ring_frames=ring_frames)
        self.states: list[tuple[float, BusState, str]] = []
        self.frames: list[tuple[Frame, float]] = []
        self.rooms = 0
        self.driver.attach(frame=lambda frame, now: self.frames.append((frame, now)))
        self.driver.attach(state=lambda state, words, now: self.states.append((round(now, 3), state, words)))
        self.driver.attach(room=lambda now: self._count_room())

    def _count_room(self) -> None:
        self.rooms += 1

    async def __aenter__(self) -> Bench:
        self._stack = AsyncExitStack()
        tasks = await self._stack.enter_async_context(asyncio.TaskGroup())
        serving = tasks.create_task(self.driver.run())
        self._stack.callback(serving.cancel)
        await asyncio.sleep(0)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    def now(self) -> float:
        return asyncio.get_running_loop().time()


def virtually(test: Callable[[Bench], Coroutine[object, object, None]]) -> Callable[[], None]:
    async def main() -> None:
        async with Bench() as bench:
            await test(bench)

    return lambda: run_virtual(main())


def test_an_adapter_that_is_not_there_at_the_start_is_an_error() -> None:
    bench = Bench()
    bench.adapter.absent = "there is no interface can0"
    with pytest.raises(LinkDown, match="there is no interface can0"):
        run_virtual(bench.driver.run())
    assert bench.states == [(0.0, BusState.GONE, "opening")]


@virtually
async def _opens(bench: Bench) -> None:
    assert bench.states == [(0.0, BusState.GONE, "opening"), (0.0, BusState.ACTIVE, "open")]
    assert bench.driver.has_room()
    bench.driver.send(FRAME)
    assert bench.adapter.channel.sent == [FRAME]
    assert bench.driver.pending() == 0


def test_it_opens_says_so_and_sends() -> None:
    _opens()


def test_before_it_is_open_nothing_can_be_sent() -> None:
    driver = CanDriver(FakeAdapter())
    assert not driver.has_room()
    with pytest.raises(LinkDown, match="can:fake: the controller is gone"):
        driver.send(FRAME)


@virtually
async def _holds_one_frame(bench: Bench) -> None:
    driver, channel = bench.driver, bench.adapter.channel
    channel.room = 0
    driver.send(FRAME)
    assert not driver.has_room()
    assert driver.pending() == 1
    with pytest.raises(LinkFull):
        driver.send(FRAME)
    driver.room_available(channel, 0.0)
    assert bench.rooms == 0
    channel.room = 5
    driver.room_available(channel, 0.0)
    assert (bench.rooms, channel.sent, driver.pending()) == (1, [FRAME], 0)
    assert driver.has_room()


def test_the_frame_that_found_no_room_is_held_and_sent_first() -> None:
    _holds_one_frame()


@virtually
async def _comes_back(bench: Bench) -> None:
    adapter, first = bench.adapter, bench.adapter.channel
    first.room = 0
    bench.driver.send(FRAME)
    adapter.absent = "the interface can0 is down"
    await asyncio.sleep(10)
    bench.driver.lost(first, "the interface can0 is down: do something")
    bench.driver.lost(first, "and once more")
    await asyncio.sleep(3)
    assert first.closed
    assert bench.states[-1] == (10.0, BusState.GONE, "the interface can0 is down: do something")
    assert [round(at, 3) for at in adapter.tried_at] == [0.0, 10.1, 10.3, 10.7, 11.5, 12.5]
    adapter.absent = ""
    await asyncio.sleep(1)
    assert bench.states[-1] == (13.5, BusState.ACTIVE, "back")
    assert bench.driver.has_room()
    bench.driver.send(FRAME)
    assert adapter.channel.sent == [FRAME]


def test_an_adapter_that_has_gone_is_opened_again_with_growing_pauses() -> None:
    _comes_back()


@virtually
async def _flaps(bench: Bench) -> None:
    for _ in range(5):
        bench.driver.lost(bench.adapter.channel, "gone")
        await asyncio.sleep(1.2)
    pauses = [round(at - 1.2 * number, 2) for number, at in enumerate(bench.adapter.tried_at[1:])]
    assert pauses == [0.1, 0.2, 0.4, 0.8, 1.0]
    await asyncio.sleep(10)
    lost_at = bench.now()
    bench.driver.lost(bench.adapter.channel, "gone")
    await asyncio.sleep(1)
    assert round(bench.adapter.tried_at[-1] - lost_at, 3) == 0.1


def test_an_adapter_that_comes_and_goes_is_opened_ever_more_slowly_until_it_stays() -> None:
    _flaps()


@virtually
async def _ignores_old_channels(bench: Bench) -> None:
    old = bench.adapter.channel
    bench.driver.lost(old, "gone")
    await asyncio.sleep(1)
    told = list(bench.states)
    bench.driver.lost(old, "gone again")
    bench.driver.room_available(old, 0.0)
    bench.driver.state(old, BusState.OFF, "too late", 0.0)
    await asyncio.sleep(1)
    assert bench.states == told
    assert bench.rooms == 0


def test_what_a_former_channel_tells_does_not_matter() -> None:
    _ignores_old_channels()


@virtually
async def _bus_off(bench: Bench) -> None:
    driver, channel = bench.driver, bench.adapter.channel
    driver.restart()
    assert channel.restarts == 0
    channel.room = 0
    driver.send(FRAME)
    driver.state(channel, BusState.OFF, "short circuit", 1.0)
    assert not driver.has_room()
    assert driver.pending() == 0
    with pytest.raises(LinkDown, match="bus-off"):
        driver.send(FRAME)
    driver.restart()
    assert channel.restarts == 1
    channel.room = 1
    driver.state(channel, BusState.ACTIVE, "back on the bus", 2.0)
    assert driver.has_room()
    assert bench.rooms == 0
    driver.take([FRAME], 3.0)
    assert bench.rooms == 1  # so that the port's pauses begin anew
    driver.take([FRAME], 3.0)
    assert bench.rooms == 1


def test_bus_off_takes_what_was_held_and_ends_with_a_restart() -> None:
    _bus_off()


def numbered(first: int, count: int) -> list[Frame]:
    return [Frame(0x100, number.to_bytes(4)) for number in range(first, first + count)]


@virtually
async def _in_order(bench: Bench) -> None:
    driver = bench.driver
    driver.take(numbered(0, 10), 1.0)
    assert len(bench.frames) == 10
    driver.take(numbered(10, 1000), 2.0)
    assert len(bench.frames) == 10
    driver.take(numbered(1010, 5), 3.0)  # must not overtake
    turns = 0
    while len(bench.frames) < 1015:
        await asyncio.sleep(0)
        turns += 1
    assert [frame for frame, _ in bench.frames] == numbered(0, 1015)
    assert [at for _, at in bench.frames] == 10 * [1.0] + 1000 * [2.0] + 5 * [3.0]
    assert turns >= 1005 // FRAMES_PER_TURN
    assert driver.free_slots() == 4096


def test_a_burst_is_handled_in_order_and_the_loop_gets_its_turn() -> None:
    _in_order()


def test_what_does_not_fit_the_ring_is_counted() -> None:
    async def main() -> None:
        async with Bench(ring_frames=300) as bench:
            shared = Tally()
            bench.driver.dropped = shared
            bench.driver.take(numbered(0, 290), 0.0)
            bench.driver.take(numbered(290, 30), 0.0)
            assert bench.driver.free_slots() == 0
            bench.driver.take(numbered(320, 7), 0.0)
            await asyncio.sleep(1)
            assert [frame for frame, _ in bench.frames] == numbered(0, 300)
            assert shared == {RING_FULL: 27}

    run_virtual(main())


def test_what_waits_in_the_ring_when_it_is_closed_is_not_delivered() -> None:
    async def main() -> Bench:
        async with Bench() as bench:
            bench.driver.take(numbered(0, 400), 0.0)
        await asyncio.sleep(1)
        return bench

    bench = run_virtual(main())
    assert len(bench.frames) == FRAMES_PER_TURN  # what was under way
    assert bench.adapter.channel.closed


def test_events_are_counted_by_reason() -> None:
    async def main() -> None:
        async with Bench() as bench:
            bench.driver.events(("nobody acknowledges", "bit error"), 0.0)
            bench.driver.events(("bit error",), 0.0, times=3)
            assert bench.driver.dropped == {"nobody acknowledges": 1, "bit error": 4}

    run_virtual(main())


def test_the_user_is_told_once_a_minute_and_of_each_plug_that_is_pulled(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with Bench() as bench:
            caplog.set_level(logging.INFO)
            for _ in range(3):
                channel = bench.adapter.channel
                bench.driver.state(channel, BusState.PASSIVE, "check the wires", bench.now())
                bench.driver.state(channel, BusState.ACTIVE, "all is well again", bench.now())
                bench.driver.lost(channel, "vanished")
                await asyncio.sleep(2)
            await asyncio.sleep(60)
            bench.driver.state(bench.adapter.channel, BusState.PASSIVE, "check the wires", bench.now())

    run_virtual(main())
    said = [(record.levelname, record.getMessage().removeprefix("can:fake: ")) for record in caplog.records]
    passive, well = ("WARNING", "error-passive: check the wires"), ("WARNING", "all is well again")
    gone, back = ("WARNING", "vanished"), ("WARNING", "back")
    assert said == [passive, well, gone, back, gone, back, gone, back, passive]


def test_words_that_are_never_the_same_are_not_remembered_for_ever() -> None:
    async def main() -> None:
        async with Bench() as bench:
            for number in range(3 * MOST_WORDS):
                bench.driver.state(bench.adapter.channel, BusState.PASSIVE, f"error {number}", 0.0)
            assert len(bench.driver._said) <= MOST_WORDS

    run_virtual(main())


def test_the_first_opening_is_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def main() -> None:
        async with Bench():
            pass

    run_virtual(main())
    assert [(record.levelname, record.getMessage()) for record in caplog.records] == [("INFO", "can:fake: open")]


@pytest.mark.parametrize("before", [BusState.ACTIVE, BusState.PASSIVE, BusState.OFF])
@pytest.mark.parametrize("after", [BusState.ACTIVE, BusState.PASSIVE, BusState.OFF])
def test_room_is_told_with_the_first_frame_after_bus_off_and_with_no_other(before: BusState, after: BusState) -> None:
    async def scene(bench: Bench) -> None:
        driver, channel = bench.driver, bench.adapter.channel
        driver.take([FRAME], 1.0)
        assert bench.rooms == 0
        driver.state(channel, before, "test", 2.0)
        driver.state(channel, after, "test", 3.0)
        driver.take([FRAME], 4.0)
        driver.take([FRAME], 5.0)
        assert bench.rooms == int(before is BusState.OFF and after is not BusState.OFF)
        assert [at for _, at in bench.frames] == [1.0, 4.0, 5.0]

    virtually(scene)()


@pytest.mark.parametrize("more", [0, 1])
def test_so_many_frames_are_handled_in_one_turn(more: int) -> None:
    async def scene(bench: Bench) -> None:
        bench.driver.take([FRAME] * (FRAMES_PER_TURN + more), 1.0)
        assert len(bench.frames) == (0 if more else FRAMES_PER_TURN)
        await asyncio.sleep(0)
        assert len(bench.frames) == FRAMES_PER_TURN
        await asyncio.sleep(0)
        assert len(bench.frames) == FRAMES_PER_TURN + more

    virtually(scene)()


def test_what_the_bus_tells_is_counted_each_time_and_said_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    driver = CanDriver(FakeAdapter())
    assert driver.pending() == 0
    said: list[tuple[float, list[str]]] = []
    with caplog.at_level(logging.INFO):
        for at in (100.0, 101.0, 159.5, 160.0, 219.5, 220.5):
            driver.events(("stuff error", "no acknowledgement"), at, times=2)
            said.append((at, [record.message for record in caplog.records]))
            caplog.clear()
    both = ["can:fake: stuff error", "can:fake: no acknowledgement"]
    assert [at for at, words in said if words == both] == [100.0, 160.0, 220.5]
    assert [at for at, words in said if not words] == [101.0, 159.5, 219.5]
    assert driver.dropped == {"stuff error": 12, "no acknowledgement": 12}


def test_so_many_messages_are_remembered_and_then_all_are_forgotten(caplog: pytest.LogCaptureFixture) -> None:
    driver = CanDriver(FakeAdapter())
    with caplog.at_level(logging.INFO):
        for number in range(MOST_WORDS):
            driver._say(logging.INFO, f"words {number}", 1.0)
        driver._say(logging.INFO, "words 0", 2.0)
        assert len(caplog.records) == MOST_WORDS, "it has been said"
        driver._say(logging.INFO, "one more", 3.0)
        driver._say(logging.INFO, "words 0", 4.0)
        assert [record.message for record in caplog.records[MOST_WORDS:]] == ["one more", "words 0"]
    assert len(driver._said) == 2


def test_why_an_adapter_cannot_be_opened_again_is_said(caplog: pytest.LogCaptureFixture) -> None:
    async def scene(bench: Bench) -> None:
        bench.adapter.absent = "there is no interface can0"
        bench.driver.lost(bench.adapter.channel, "unplugged")
        await asyncio.sleep(5.0)
        bench.adapter.absent = ""
        await asyncio.sleep(2.0)
        assert [state for _, state, _ in bench.states[2:]] == [BusState.GONE, BusState.ACTIVE]

    with caplog.at_level(logging.WARNING):
        virtually(scene)()
    assert [record.message for record in caplog.records] == [
        "can:fake: unplugged",
        "there is no interface can0",
        "can:fake: back",
    ]


@pytest.mark.parametrize(("steady_s", "pause_s"), [(4.5, 0.2), (5.0, 0.1), (5.5, 0.1)])
def test_who_was_open_for_long_is_looked_for_soon(steady_s: float, pause_s: float) -> None:
    async def scene(bench: Bench) -> None:
        for open_s in (1.0, steady_s):
            opened_at, channel = bench.adapter.opened[-1]
            await asyncio.sleep(opened_at + open_s - bench.now())
            bench.driver.lost(channel, "unplugged")
            gone_at = bench.now()
            await asyncio.sleep(1.0)
        assert bench.adapter.opened[-1][0] - gone_at == pytest.approx(pause_s)

    virtually(scene)()
