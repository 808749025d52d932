"""The heap that says which client to look at when."""

from __future__ import annotations

import asyncio
import weakref
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent.flushing import MOST_STALE, Flusher, TimerHeap
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.statistics import Transit
from tests.effort import tries


def test_owners_come_in_the_order_of_their_times() -> None:
    heap: TimerHeap[str] = TimerHeap()
    heap.schedule("late", 3.0)
    heap.schedule("early", 1.0)
    heap.schedule("middle", 2.0)
    assert heap.next_at() == 1.0
    assert list(heap.pop_due(2.0)) == ["early", "middle"]
    assert list(heap.pop_due(10.0)) == ["late"]
    assert heap.next_at() is None


def test_an_earlier_time_replaces_a_later_one_and_fires_once() -> None:
    heap: TimerHeap[str] = TimerHeap()
    heap.schedule("part", 5.0)
    heap.schedule("part", 1.0)
    heap.schedule("part", 3.0)
    assert list(heap.pop_due(1.0)) == ["part"]
    assert list(heap.pop_due(9.0)) == []


def test_a_forgotten_owner_does_not_fire() -> None:
    heap: TimerHeap[str] = TimerHeap()
    heap.schedule("part", 1.0)
    heap.forget("part")
    heap.forget("stranger")
    assert list(heap.pop_due(2.0)) == []


def test_an_owner_that_always_asks_for_the_same_late_time_needs_one_entry() -> None:
    heap: TimerHeap[str] = TimerHeap()
    for _ in range(100):
        heap.schedule("part", 30.0)
    assert len(heap) == 1


def test_forgotten_owners_leave_nothing_behind_however_far_away_their_time_was() -> None:
    heap: TimerHeap[int] = TimerHeap()
    heap.schedule(-1, 5.0)
    for owner in range(10_000):
        heap.schedule(owner, 1e6)
        heap.forget(owner)
        assert len(heap) <= 4 + MOST_STALE
    heap.schedule(-2, 7.0)
    heap.suspend(-2)
    for at in range(10_000):
        heap.schedule(-3, 1e6 - at)
    assert len(heap) <= 6 + MOST_STALE
    heap.schedule(-2, 7.0)
    assert list(heap.pop_due(2e6)) == [-1, -2, -3]


def test_an_owner_that_rests_does_not_fire_until_it_is_scheduled_again() -> None:
    heap: TimerHeap[str] = TimerHeap()
    heap.schedule("part", 1.0)
    heap.suspend("part")
    heap.suspend("part")
    heap.suspend("stranger")
    heap.schedule("other", 3.0)
    heap.schedule("part", 2.0)
    assert heap.next_at() == 1.0, "earlier than needed: one look"
    heap.suspend("part")
    assert heap.next_at() == 3.0
    heap.schedule("part", 2.0)
    heap.suspend("part")
    heap.schedule("part", 0.5)
    assert list(heap.pop_due(2.9)) == ["part"]
    assert len(heap) == 1


def test_resting_and_waking_a_thousand_times_needs_one_entry() -> None:
    heap: TimerHeap[str] = TimerHeap()
    for number in range(1000):
        heap.schedule("part", 10.0 + number)
        heap.suspend("part")
    assert len(heap) == 1
    assert heap.next_at() is None
    assert len(heap) == 0


@settings(deadline=None, max_examples=tries(100, 2000))
@given(st.lists(st.tuples(st.integers(0, 5), st.floats(0, 100)), max_size=40))
def test_every_owner_fires_at_the_earliest_time_it_asked_for(wishes: list[tuple[int, float]]) -> None:
    heap: TimerHeap[int] = TimerHeap()
    expected: dict[int, float] = {}
    for owner, when in wishes:
        heap.schedule(owner, when)
        expected[owner] = min(when, expected.get(owner, when))
    fired: dict[int, float] = {}
    while (now := heap.next_at()) is not None:
        for owner in heap.pop_due(now):
            assert owner not in fired
            fired[owner] = now
    assert fired == expected


def test_a_forgotten_owner_is_not_kept_alive() -> None:
    class Client:
        pass

    heap: TimerHeap[Client] = TimerHeap()
    client = Client()
    gone = weakref.ref(client)
    heap.schedule(client, 30.0)
    heap.schedule(client, 20.0)
    heap.forget(client)
    del client
    assert gone() is None


class Waiting:
    """A client as the flusher sees it; its session may have something to do at some time."""

    is_over, place, is_timed = False, None, False

    def __init__(self, due_at: float | None) -> None:
        self.due_at = due_at
        self.handled: list[float] = []

    def timer(self) -> float | None:
        return self.due_at

    def handle_timer(self, now: float) -> None:
        self.handled.append(now)
        self.due_at = None


def test_a_check_that_comes_a_little_early_drops_what_is_done_and_does_nothing_before_its_time() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        flusher = Flusher(loop.time, lambda *_: None, transit=Transit(loop.time))
        done, due = Waiting(0.2), Waiting(0.2)
        for client in (done, due):
            flusher._serve(cast("Proxy", client), loop.time())
        done.due_at = None  # everything has been acknowledged
        await asyncio.sleep(0.195)
        flusher._ring(0.2)
        assert (done.handled, due.handled) == ([], [])
        assert len(flusher._timers) == 1
        await asyncio.sleep(0.1)
        assert done.handled == []
        assert due.handled == pytest.approx([0.2])

    run_virtual(main())


def test_a_client_that_rests_does_not_wake_the_loop() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        flusher = Flusher(loop.time, lambda *_: None, transit=Transit(loop.time))
        asked = list[float]()

        class Asked(Waiting):
            def timer(self) -> float | None:
                asked.append(loop.time())
                return super().timer()

        client = Asked(0.2)
        flusher._serve(cast("Proxy", client), loop.time())
        assert client.is_timed
        flusher.rest(cast("Proxy", client))
        assert not client.is_timed
        await asyncio.sleep(1.0)
        assert (asked, client.handled) == ([0.0], [])
        client.due_at = 1.2
        flusher._serve(cast("Proxy", client), loop.time())
        await asyncio.sleep(1.0)
        assert client.handled == pytest.approx([1.2])

    run_virtual(main())
