"""The clockwork of the simulated bus, in virtual time and behind a clock that wakes up late."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextvars import Context
from typing import TypeVarTuple, Unpack

import pytest

from msbot.process.virtual_time import VirtualTimeLoop, run_virtual
from msbot_agent.link.can.controller import BusState, CanBus
from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.sim_bus import SimBus
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from msbot_xrce.errors import LinkDown

RATE = 500_000
AHEAD_S = 0.002

_Ts = TypeVarTuple("_Ts")


class LateLoop(VirtualTimeLoop):
    """Every timer fires up to 5 ms late, as on a busy computer."""

    def call_at(
        self, when: float, callback: Callable[[Unpack[_Ts]], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        late = when if when <= self.time() else (int(when / 0.005) + 1) * 0.005
        return super().call_at(late, callback, *args, context=context)


def ping_pong(
    rounds: int, loop_class: type[VirtualTimeLoop] = LateLoop, ahead_s: float = 0.0
) -> tuple[list[float], list[float]]:
    """Two nodes that answer each frame inside their handlers; the times of the frames, and when they were handled."""
    logical: list[float] = []
    real: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        driver = SimBusDriver(SimBus(RATE), ahead_s=ahead_s)
        nodes = [driver.attach("A"), driver.attach("B")]
        done = loop.create_future()

        def answer(node: CanBus) -> None:
            def heard(frame: Frame, now: float) -> None:
                logical.append(now)
                real.append(loop.time())
                if len(logical) < rounds:
                    node.send(Frame(frame.can_id ^ 1, frame.data))
                elif not done.done():
                    done.set_result(None)

            node.attach(frame=heard)

        for node in nodes:
            answer(node)
        nodes[0].send(Frame(0x100, b"ping"))
        await done

    with asyncio.Runner(loop_factory=loop_class) as runner:
        runner.run(main())
    return logical, real


def test_a_clock_that_wakes_late_does_not_slow_the_bus() -> None:
    logical, real = ping_pong(200)
    one, other = (frame_bits(Frame(can_id, b"ping")).nominal_bits / RATE for can_id in (0x100, 0x101))
    assert logical[-1] - logical[0] == pytest.approx(99 * one + 100 * other, abs=1e-9)
    assert any(late > at + 0.002 for at, late in zip(logical, real, strict=True))
    assert all(at <= late + 1e-9 for at, late in zip(logical, real, strict=True))


def test_a_bus_that_may_run_ahead_handles_at_once_what_happens_soon_and_changes_no_time() -> None:
    exact, _ = ping_pong(200, VirtualTimeLoop)
    logical, real = ping_pong(200, VirtualTimeLoop, AHEAD_S)
    assert logical == pytest.approx(exact, abs=1e-9)
    assert max(at - now for at, now in zip(logical, real, strict=True)) <= AHEAD_S + 1e-9
    assert all(now <= at + 1e-9 for at, now in zip(logical, real, strict=True))
    assert len(set(real)) <= len(set(exact)) / 5, "several frames are handled between two sleeps"


def test_a_frame_from_outside_queues_behind_what_the_bus_has_done_ahead_of_the_clock() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        driver = SimBusDriver(SimBus(RATE), ahead_s=AHEAD_S)
        a, b = driver.attach("A"), driver.attach("B")
        heard: list[tuple[int, float]] = []
        b.attach(frame=lambda frame, now: heard.append((frame.can_id, now)))
        a.send(Frame(0x200))
        for _ in range(3):
            await asyncio.sleep(0)
        assert loop.time() == 0.0
        assert [can_id for can_id, _ in heard] == [0x200]
        a.send(Frame(0x100))
        await asyncio.sleep(0.01)
        length = frame_bits(Frame(0x100)).nominal_bits / RATE
        assert [can_id for can_id, _ in heard] == [0x200, 0x100]
        assert heard[1][1] == pytest.approx(heard[0][1] + length, abs=4 / RATE)

    run_virtual(main())


def test_what_is_submitted_outside_a_handler_carries_the_time_of_the_clock() -> None:
    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        driver = SimBusDriver(SimBus(RATE))
        a, b = driver.attach("A"), driver.attach("B")
        times: list[float] = []
        b.attach(frame=lambda frame, now: times.append(now))
        a.send(Frame(0x100))
        await asyncio.sleep(0.5)
        assert loop.time() == driver.now() == 0.5
        a.send(Frame(0x100))
        await asyncio.sleep(0.5)
        return times

    length = (frame_bits(Frame(0x100)).nominal_bits - 3) / RATE
    assert run_virtual(main()) == [pytest.approx(length), pytest.approx(0.5 + length)]


def test_room_pending_load_tap_and_counters() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(RATE, data_bitrate=2_000_000, fd=True))
        a, b = driver.attach("A"), driver.attach("B", fd=False)
        assert (a.info.name, a.info.bits_per_second, a.info.data_bits_per_second) == ("sim:500000", RATE, 2_000_000)
        assert (b.info.fd, b.info.data_bits_per_second) == (False, None)
        tapped: list[tuple[str, int]] = []
        left: list[float] = []
        driver.tap = lambda at, name, frame: tapped.append((name, frame.can_id))
        a.attach(room=left.append)
        for can_id in (1, 2, 3):
            assert a.has_room()
            a.send(Frame(can_id))
        assert not a.has_room()
        assert a.pending() == 3
        await asyncio.sleep(0.1)
        assert (a.pending(), len(left), tapped) == (0, 3, [("A", 1), ("A", 2), ("A", 3)])
        assert driver.counters.frames == 3
        assert driver.load() == pytest.approx(driver.counters.bits / RATE)

    run_virtual(main())


def test_unplugging_and_plugging_by_name() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(RATE))
        a, b, _ = driver.attach("A"), driver.attach("B"), driver.attach("C")
        heard: list[int] = []
        b.attach(frame=lambda frame, now: heard.append(frame.can_id))
        driver.unplug("B")
        assert not driver.is_plugged("B")
        a.send(Frame(1))
        await asyncio.sleep(0.01)
        driver.plug("B")
        await asyncio.sleep(0.01)
        a.send(Frame(2))
        await asyncio.sleep(0.01)
        assert heard == [2]
        with pytest.raises(KeyError):
            driver.unplug("nobody")
        with pytest.raises(LinkDown, match="already"):
            driver.attach("A")

    run_virtual(main())


def test_a_removed_controller_is_quiet_and_its_name_is_free() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(RATE))
        a, b = driver.attach("A"), driver.attach("B")
        driver.detach("A")
        driver.detach("A")
        assert not a.has_room()
        assert a.pending() == 0
        assert a.error_counters() == (0, 0)
        a.restart()
        with pytest.raises(LinkDown, match="removed"):
            a.send(Frame(1))
        again = driver.attach("A")
        running = asyncio.create_task(a.run())
        await asyncio.sleep(0.01)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        heard: list[int] = []
        again.attach(frame=lambda frame, now: heard.append(frame.can_id))
        b.send(Frame(7))
        await asyncio.sleep(0.01)
        assert heard == [7], "the end of the old one does not remove the new one"

    run_virtual(main())


def test_a_controller_that_ends_leaves_the_bus() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(RATE))
        running = asyncio.create_task(driver.attach("A").run())
        await asyncio.sleep(0.01)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        driver.attach("A")

    run_virtual(main())


def test_a_handler_may_remove_another_node_of_the_same_moment() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(RATE))
        a, b, c = (driver.attach(name) for name in "ABC")
        heard: list[str] = []
        b.attach(frame=lambda frame, now: driver.detach("C"))
        c.attach(frame=lambda frame, now: heard.append("C"))
        a.send(Frame(1))
        await asyncio.sleep(0.01)
        assert heard == []

    run_virtual(main())


def test_a_short_circuit_is_told_in_words_and_repaired() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(RATE))
        a, b = driver.attach("A"), driver.attach("B")
        told: list[tuple[BusState, str]] = []
        a.attach(state=lambda state, words, now: told.append((state, words)))
        driver.short_circuit()
        a.send(Frame(1))
        await asyncio.sleep(0.1)
        assert [state for state, _ in told] == [BusState.PASSIVE, BusState.OFF]
        assert "short circuit" in told[1][1]
        assert not a.has_room()
        driver.repair()
        a.restart()
        await asyncio.sleep(0.1)
        assert told[-1][0] is BusState.ACTIVE
        assert a.has_room()
        assert b.has_room()

    run_virtual(main())


def test_a_bus_that_falls_behind_lets_the_others_have_their_turn() -> None:
    async def main() -> None:
        driver = SimBusDriver(SimBus(1_000_000))
        a, _ = driver.attach("A"), driver.attach("B")
        a.attach(room=lambda now: a.send(Frame(0)))
        a.send(Frame(0))
        loop = asyncio.get_running_loop()
        turns = 0
        enough = asyncio.Event()

        def count() -> None:
            nonlocal turns
            turns += 1
            if driver.counters.frames >= 3000:
                enough.set()
            else:
                loop.call_soon(count)

        loop.call_soon(count)
        assert isinstance(loop, VirtualTimeLoop)
        loop._set_clock(0.2)
        await enough.wait()
        assert turns >= 3000 / 256 - 1

    run_virtual(main())


def test_ignored_identifiers_are_not_passed_on_and_others_are() -> None:
    async def main() -> list[int]:
        driver = SimBusDriver(SimBus(RATE))
        sender, node = driver.attach("A"), driver.attach("B")
        heard: list[int] = []
        node.attach(frame=lambda frame, _: heard.append(frame.can_id))
        for ignored in ((0x101, 0x102), ()):
            node.ignore(ignored)
            for frame in (Frame(0x101), Frame(0x103), Frame(0x102, extended=True)):
                sender.send(frame)
            await asyncio.sleep(0.01)
        return heard

    heard = run_virtual(main())
    assert (sorted(heard[:2]), sorted(heard[2:])) == ([0x102, 0x103], [0x101, 0x102, 0x103])
