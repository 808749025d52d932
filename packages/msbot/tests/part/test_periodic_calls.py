"""`@part.every`: on a grid, never twice for one moment."""

import asyncio
from collections.abc import Callable
from contextvars import Context
from math import inf
from typing import TypeVarTuple

from msbot.part.handler_guard import Guard
from msbot.part.program import Every
from msbot.process.virtual_time import VirtualTimeLoop, run_virtual

_Ts = TypeVarTuple("_Ts")


def test_every_calls_at_once_and_then_on_a_grid() -> None:
    calls: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        every = Every(0.25, lambda: calls.append(loop.time()))
        every.start(Guard(lambda _: None))
        await asyncio.sleep(1.1)
        every.cancel()
        await asyncio.sleep(1.0)
        every.cancel()

    run_virtual(main())
    assert calls == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_every_skips_what_it_missed() -> None:
    calls: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def late() -> None:
            calls.append(loop.time())
            if len(calls) == 2:
                loop._now += 2.5  # type: ignore[attr-defined]  # as if the machine had been busy

        every = Every(1.0, late)
        every.start(Guard(lambda _: None))
        await asyncio.sleep(5.5)
        every.cancel()

    run_virtual(main())
    assert calls == [0.0, 1.0, 3.5, 4.0, 5.0]


def test_who_rests_is_called_at_the_next_point_of_the_grid_after_its_rest() -> None:
    calls: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def work() -> None:
            calls.append(loop.time())
            every.rest_until(inf)

        every = Every(0.25, work)
        every.start(Guard(lambda _: None))
        await asyncio.sleep(1.1)
        assert every.is_resting
        every.resume(1.6)
        every.resume(inf)
        await asyncio.sleep(1.0)
        assert calls == [0.0], "it rests until something else happens"
        every.resume(2.6)
        await asyncio.sleep(1.0)
        every.resume()
        await asyncio.sleep(1.0)
        every.cancel()

    run_virtual(main())
    assert calls == [0.0, 2.75, 3.25]


def test_a_call_sets_one_timer_whether_or_not_it_asks_for_a_rest() -> None:
    timers: list[float] = []

    class Loop(VirtualTimeLoop):
        def call_at(
            self, when: float, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
        ) -> asyncio.TimerHandle:
            if callback.__name__ == "_due":
                timers.append(when)
            return super().call_at(when, callback, *args, context=context)

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def work() -> None:
            if 0.5 <= loop.time() < 2.0:
                every.rest_until(loop.time() + 0.4)

        every = Every(0.25, work)
        every.start(Guard(lambda _: None))
        await asyncio.sleep(2.1)
        every.cancel()

    with asyncio.Runner(loop_factory=Loop) as runner:
        runner.run(main())
    assert timers == [0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 2.25]


def test_a_call_may_end_the_calls_or_change_their_period() -> None:
    calls: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def work() -> None:
            calls.append(loop.time())
            if len(calls) == 2:
                every.change(0.5)
            elif len(calls) == 5:
                every.cancel()

        every = Every(0.25, work)
        every.start(Guard(lambda _: None))
        await asyncio.sleep(5.0)

    run_virtual(main())
    assert calls == [0.0, 0.25, 0.25, 0.75, 1.25]
