"""`@part.every`: on a grid, never twice for one moment."""

import asyncio

from msbot.part.handler_guard import Guard
from msbot.part.program import Every
from msbot.process.virtual_time import run_virtual


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
