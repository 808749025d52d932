"""Timers that come together: near ones exactly, far ones at the points of one grid, circles with their period."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import time
from asyncio import selector_events

import pytest

from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.timer_grid import (
    EARLY_S,
    MOST_IN_TURN,
    MOST_READ,
    STEPS,
    TimerGridLoop,
    first_time,
    on_grid,
    rounds_timers,
    until_step,
)

FAR_S, NEAR_S = STEPS[0][1], STEPS[-1][1]


def test_timers_that_are_far_away_come_in_the_same_turn() -> None:
    (point,) = {on_grid(0.1, at) for at in (100.101, 100.11, 100.13, 100.1499)}
    assert point == pytest.approx(100.15)


def test_no_timer_comes_early_and_none_later_than_a_step() -> None:
    for delay in (0.0, 0.001, 0.01, 0.02, 0.07, 0.08, 0.5, 60.0):
        for now in (0.0, 1.2345, 86400.777):
            step = next(step for least, step in STEPS if delay >= least)
            assert -1e-6 <= on_grid(delay, now + delay) - (now + delay) <= step


def test_a_point_of_the_grid_stays_where_it_is() -> None:
    for delay in (0.1, 60.0):
        for number in range(1, 100_000, 997):
            assert on_grid(delay, number * FAR_S) == pytest.approx(number * FAR_S, abs=1e-9)


def test_who_sleeps_in_a_circle_keeps_the_period() -> None:
    now = 50 * FAR_S
    for _ in range(100):
        woken = now + EARLY_S / 2  # the work of a turn takes its time
        after = on_grid(0.1, woken + 0.1, EARLY_S)
        assert after == pytest.approx(now + 0.1)
        now = after


@pytest.mark.parametrize("step", [0.1, 0.2])
def test_who_waits_for_a_step_of_the_clock_is_in_step_again_after_a_late_turn(step: float) -> None:
    now = 7.77
    for late_s in (0.0, 0.001, 0.6 * step, 0.0, 0.99 * step, 3.2 * step, 0.0):
        wait_s = until_step(now + late_s, step)
        assert step / 4 <= wait_s <= step * 1.25
        now += late_s + wait_s
        assert now / step == pytest.approx(round(now / step), abs=1e-6)


def test_the_loop_rounds_its_timers_and_begins_circles_on_the_grid() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert rounds_timers(loop)
        now = loop.time()
        exact, far = loop.call_at(now + NEAR_S, print), loop.call_at(now + 1.0, print)
        assert 0.0 <= far.when() - (now + 1.0) <= FAR_S
        assert far.when() / FAR_S == pytest.approx(round(far.when() / FAR_S), abs=1e-5)
        assert 0.0 <= exact.when() - (now + NEAR_S) <= NEAR_S * 1.001
        assert first_time(loop) / FAR_S == pytest.approx(round(first_time(loop) / FAR_S), abs=1e-5)
        for timer in (exact, far):
            timer.cancel()
        began = time.monotonic()
        await asyncio.sleep(0.05)
        assert time.monotonic() - began >= 0.05 - EARLY_S

    run_to_end(main(), TimerGridLoop)


def test_a_connection_makes_no_room_that_the_kernel_has_to_give_and_take_for_each_message() -> None:
    async def main() -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            reader, writer = await asyncio.open_connection(sock=ours)
            assert vars(writer.transport)["max_size"] == MOST_READ < 128 * 1024 < asyncio_default()
            whole = os.urandom(3 * MOST_READ)
            sending = asyncio.to_thread(theirs.sendall, whole)
            read, _ = await asyncio.gather(reader.readexactly(len(whole)), sending)
            assert read == whole
            writer.close()

    run_to_end(main(), TimerGridLoop)


def asyncio_default() -> int:
    """What asyncio makes room for by itself."""
    size = vars(vars(selector_events)["_SelectorTransport"])["max_size"]
    assert isinstance(size, int)
    return size


def test_any_other_loop_begins_circles_at_once() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        before = loop.time()
        assert not rounds_timers(loop)
        assert before <= first_time(loop) <= loop.time()

    run_to_end(main())


def test_what_comes_in_waits_for_a_few_timers_and_not_for_all() -> None:
    async def main() -> list[str]:
        loop, called = asyncio.get_running_loop(), list[str]()

        def timer() -> None:
            called.append("timer")
            if len(called) == 1:
                loop.call_soon(called.append, "STOP")

        at = loop.time() + 0.05
        for _ in range(10 * MOST_IN_TURN):
            loop.call_at(at, timer)
        await asyncio.sleep(0.3)
        return called

    called = run_to_end(main(), TimerGridLoop)
    assert len(called) == 10 * MOST_IN_TURN + 1
    assert called.index("STOP") <= 2 * MOST_IN_TURN


def test_timers_of_a_point_are_called_once_in_their_order_and_those_cancelled_not_at_all() -> None:
    async def main() -> list[object]:
        loop, called = asyncio.get_running_loop(), list[object]()
        loop.set_exception_handler(lambda _, context: called.append(type(context["exception"])))
        at = loop.time() + 0.02
        later = list[asyncio.TimerHandle]()

        def cancel_one() -> None:
            later[0].cancel()

        loop.call_at(at, cancel_one)
        first = loop.call_at(at, called.append, 1)
        loop.call_at(at, called.append, 2)
        loop.call_at(at, lambda: 1 / 0)
        loop.call_at(at, called.append, 4)
        later.append(loop.call_at(at, called.append, 5))
        first.cancel()
        first.cancel()
        await asyncio.sleep(0.1)
        later[0].cancel()
        return called

    assert run_to_end(main(), TimerGridLoop) == [2, ZeroDivisionError, 4]


def test_timers_that_are_cancelled_leave_nothing() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        for number in range(1000):
            loop.call_later(60 + number / 10, print).cancel()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.sleep(0), 60 + number / 10)
        assert not vars(loop)["_points"]

    run_to_end(main(), TimerGridLoop)
