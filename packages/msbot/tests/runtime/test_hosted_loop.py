"""A loop that a host drives, as JavaScript does in a tab."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable, Iterator
from itertools import count

import pytest

from msbot.process.hosted_loop import HostedLoop


class Host:
    """A host whose time jumps to what it was asked for next."""

    def __init__(self) -> None:
        self.now = 100.0
        self._calls: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = count()

    def call_later(self, delay: float, function: Callable[[], None]) -> None:
        assert delay >= 0
        heapq.heappush(self._calls, (self.now + delay, next(self._numbers), function))

    def go_on(self, task: asyncio.Task[object]) -> object:
        """Call what was asked for until the task has ended."""
        while not task.done():
            assert self._calls, "the loop has asked for no further turn"
            at, _, function = heapq.heappop(self._calls)
            self.now = max(self.now, at)
            function()
        return task.result()

    @property
    def waiting(self) -> int:
        return len(self._calls)


class Loop(HostedLoop):
    def __init__(self, host: Host) -> None:
        self.host = host
        super().__init__(host.call_later)

    def time(self) -> float:
        return self.host.now


@pytest.fixture
def loop() -> Iterator[Loop]:
    made = Loop(Host())
    yield made
    made.close()


def test_sleepers_wake_in_order_and_at_their_time(loop: Loop) -> None:
    told: list[tuple[str, float]] = []

    async def sleep(name: str, seconds: float) -> None:
        await asyncio.sleep(seconds)
        told.append((name, round(asyncio.get_running_loop().time() - 100, 3)))

    async def main() -> str:
        async with asyncio.TaskGroup() as tasks:
            for name, seconds in (("c", 0.3), ("a", 0.0), ("b", 0.1)):
                tasks.create_task(sleep(name, seconds))
        return "done"

    assert loop.host.go_on(loop.begin(main())) == "done"
    assert told == [("a", 0.0), ("b", 0.1), ("c", 0.3)]


def test_a_time_in_the_past_is_soon_and_a_handle_knows_when(loop: Loop) -> None:
    async def main() -> list[str]:
        told: list[str] = []
        running = asyncio.get_running_loop()
        handle = running.call_at(running.time() - 5, told.append, "late")
        assert handle.when() == running.time() - 5
        running.call_later(1.0, told.append, "never").cancel()
        await asyncio.sleep(2)
        return told

    assert loop.host.go_on(loop.begin(main())) == ["late"]


def test_what_the_host_says_is_done_at_once_and_wakes_tasks(loop: Loop) -> None:
    event = asyncio.Event()

    async def main() -> str:
        await event.wait()
        return "heard"

    task = loop.begin(main())
    while loop.host.waiting:
        at_once = loop.host._calls.pop()[2]
        at_once()
    assert not task.done()
    assert loop.host.waiting == 0, "a loop that waits for its host asks for no turns"
    loop.do(event.set)
    assert loop.host.go_on(task) == "heard"


def test_much_work_is_done_in_several_turns(loop: Loop) -> None:
    turns = 0

    async def main() -> None:
        nonlocal turns
        for _ in range(10):
            loop.host.now += 0.03  # each step takes this long
            await asyncio.sleep(0)

    task = loop.begin(main())
    while not task.done():
        turns += 1
        loop.host._calls.pop()[2]()
    assert turns >= 4


def test_the_loop_that_ran_before_runs_again_after_a_turn() -> None:
    async def outside() -> None:
        host = Host()
        inner = Loop(host)
        task = inner.begin(asyncio.sleep(0, "inside"))
        assert host.go_on(task) == "inside"
        assert asyncio.get_running_loop() is not inner
        inner.close()

    asyncio.run(outside())
