from __future__ import annotations

import asyncio
import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from msbot.runtime import virtual_time
from msbot.runtime.virtual_time import VirtualTimeLoop, run_virtual


def test_a_day_passes_at_once() -> None:
    async def main() -> tuple[float, str]:
        await asyncio.sleep(86400 * 3)
        return asyncio.get_running_loop().time(), "done"

    assert run_virtual(main(), start=5.0) == (5.0 + 86400 * 3, "done")


def test_timers_fire_in_order_and_exactly_on_time() -> None:
    moments = [0.3, 0.1 + 0.2, 0.1, 7e-10, 1e5, 1e5 + 1e-10]
    fired: list[tuple[float, float]] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        def fire(moment: float) -> None:
            fired.append((moment, loop.time()))

        for moment in moments:
            loop.call_at(moment, fire, moment)
        await asyncio.sleep(2e5)

    run_virtual(main())
    assert fired == [(moment, moment) for moment in sorted(moments)]


def test_a_state_machine_that_wants_to_be_woken_one_ulp_later_is() -> None:
    async def main() -> int:
        loop = asyncio.get_running_loop()
        due = math.nextafter(1.0, 2.0)
        woken = 0
        done = loop.create_future()

        def wake() -> None:
            nonlocal woken
            woken += 1
            if loop.time() < due:
                loop.call_at(due, wake)
            else:
                done.set_result(None)

        loop.call_at(1.0, wake)
        await done
        return woken

    assert run_virtual(main()) == 2


def test_a_cancelled_timer_does_not_move_the_clock() -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        loop.call_later(1.0, lambda: None).cancel()
        await asyncio.sleep(0.5)
        await asyncio.sleep(0)
        return loop.time()

    assert run_virtual(main()) == 0.5


def test_timeouts_work_in_virtual_time() -> None:
    async def main() -> float:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(60.0):
                await asyncio.get_running_loop().create_future()
        return asyncio.get_running_loop().time()

    assert run_virtual(main()) == 60.0


def test_the_clock_stands_still_while_a_thread_works() -> None:
    async def main() -> tuple[int, float]:
        loop = asyncio.get_running_loop()
        loop.call_later(1.0, lambda: None)

        def job(number: int) -> int:
            time.sleep(0.02)  # the thread must still be at work when the loop has nothing else to do
            return number

        with ThreadPoolExecutor(1) as pool:
            return await loop.run_in_executor(pool, job, 4), loop.time()

    assert run_virtual(main()) == (4, 0.0)


def test_a_call_from_another_thread_wakes_the_loop() -> None:
    async def main() -> str:
        loop = asyncio.get_running_loop()
        news: asyncio.Future[str] = loop.create_future()
        with ThreadPoolExecutor(1) as pool:
            pool.submit(loop.call_soon_threadsafe, news.set_result, "hello")
            return await news

    assert run_virtual(main()) == "hello"


def test_a_loop_where_nothing_can_happen_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual_time, "STUCK_AFTER_S", 0.01)

    async def main() -> None:
        await asyncio.get_running_loop().create_future()

    with pytest.raises(RuntimeError, match="virtual time is stuck"):
        run_virtual(main())


def test_a_thread_that_takes_long_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual_time, "STUCK_AFTER_S", 0.01)
    asked, ended = threading.Event(), threading.Event()

    def job() -> str:
        asked.wait()
        time.sleep(0.05)  # five times as long as a loop without timers waits for news
        ended.set()
        return "done"

    async def awaited() -> str:
        asked.set()
        return await asyncio.get_running_loop().run_in_executor(None, job)

    assert run_virtual(awaited()) == "done"
    asked.clear()
    ended.clear()

    async def left_behind() -> float:
        waiting = asyncio.get_running_loop().run_in_executor(None, job)
        waiting.cancel()
        asyncio.get_running_loop().call_later(1000.0, lambda: None)
        asked.set()
        return asyncio.get_running_loop().time()

    assert run_virtual(left_behind()) == 0.0
    assert ended.is_set()


def test_it_is_an_ordinary_loop_for_a_runner() -> None:
    async def main() -> float:
        return asyncio.get_running_loop().time()

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        assert runner.run(main()) == 0.0
