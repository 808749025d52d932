from __future__ import annotations

import asyncio
import math
import selectors
import signal
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from msbot.process import virtual_time
from msbot.process.virtual_time import VirtualTimeLoop, run_virtual


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


def _polls(loop: asyncio.AbstractEventLoop, monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """How often, and how long, the system is asked for news of this loop's files."""
    asked: list[float | None] = []
    real = selectors.DefaultSelector.select

    def select(
        selector: selectors.DefaultSelector, timeout: float | None = None
    ) -> list[tuple[selectors.SelectorKey, int]]:
        if selector is loop._selector:  # type: ignore[attr-defined]  # no public way to see it
            asked.append(timeout)
        return real(selector, timeout)

    monkeypatch.setattr(selectors.DefaultSelector, "select", select)
    return asked


def test_the_system_is_asked_only_for_sockets_and_beside_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading, "active_count", lambda: 1)  # whatever other tests have left

    async def main() -> tuple[int, int, int]:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(0)
        asked = _polls(loop, monkeypatch)

        async def turns() -> int:
            asked.clear()
            for _ in range(50):
                await asyncio.sleep(0.1)
            return len(asked)

        alone = await turns()
        here, there = socket.socketpair()
        with here, there:
            here.setblocking(False)
            loop.add_reader(here, lambda: None)
            with_a_socket = await turns()
            loop.remove_reader(here)
        monkeypatch.setattr(threading, "active_count", lambda: 2)
        return alone, with_a_socket, await turns()

    alone, with_a_socket, beside_a_thread = run_virtual(main())
    assert alone == 0
    assert with_a_socket >= 50
    assert beside_a_thread >= 50


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="this system has no such signal")
def test_a_signal_is_heeded_while_time_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading, "active_count", lambda: 1)

    async def main() -> str:
        loop = asyncio.get_running_loop()
        heard = asyncio.Event()
        loop.add_signal_handler(signal.SIGUSR1, heard.set)
        signal.raise_signal(signal.SIGUSR1)
        for _ in range(10):
            await asyncio.sleep(1.0)
            if heard.is_set():
                return "heard"
        return "deaf"

    assert run_virtual(main()) == "heard"


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
