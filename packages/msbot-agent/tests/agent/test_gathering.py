"""The pauses of a loop in virtual time: kept where datagrams come by themselves, given up where they are answers."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from msbot_agent.process.gathering import FIRST_BACKOFF_S, KEPT_S, LAST_BACKOFF_S, LONGEST_S, Gathering

LOOK_S = 10e-6
"""What a look takes."""


class Loop:
    """A loop with a clock of its own; what waits at a moment is told by `arrived`."""

    def __init__(self, gathering: Gathering, arrived: Callable[[float], int]) -> None:
        self.gathering, self.arrived = gathering, arrived
        self.now = 100.0
        self.taken = arrived(self.now)
        self.turns = self.paused = 0
        self.tries: list[float] = []

    def run(self, seconds: float) -> None:
        """Sleep until something is there, take it, and pause where it says so."""
        until = self.now + seconds
        while self.now < until:
            self.now += self.gathering.delay_s
            while (count := self.arrived(self.now) - self.taken) <= 0:
                self.now += LOOK_S
            self.taken += count
            self.now += LOOK_S
            before = self.gathering.delay_s
            pause_s = self.gathering.turn(self.now, count)
            assert pause_s == self.gathering.delay_s
            if pause_s and not before:
                self.tries.append(self.now)
            self.turns += 1
            self.paused += before > 0


def paced(rate: float) -> Callable[[float], int]:
    return lambda now: int(now * rate)


class Answered:
    """So many clients that each send the next datagram a moment after the last one was taken."""

    def __init__(self, clients: int, moment_s: float) -> None:
        self.ready = [0.0] * clients
        self.moment_s = moment_s
        self.count = 0

    def __call__(self, now: float) -> int:
        for number, at in enumerate(self.ready):
            if at <= now:
                self.count += 1
                self.ready[number] = now + self.moment_s
        return self.count


def test_what_comes_one_by_one_at_a_steady_rate_is_gathered() -> None:
    loop = Loop(Gathering(), paced(20_000))
    loop.run(0.2)
    loop.turns = loop.paused = 0
    taken = loop.taken
    loop.run(0.5)
    assert (loop.taken - taken) / loop.turns >= 2
    assert loop.paused > 0.95 * loop.turns
    assert 0.0 < loop.gathering.delay_s <= LONGEST_S


@pytest.mark.parametrize("clients", [1, 2])
def test_a_client_that_waits_for_each_answer_is_not_slowed_down(clients: int) -> None:
    loop = Loop(Gathering(), Answered(clients, 30e-6))
    loop.run(10.0)
    assert loop.paused < 0.002 * loop.turns
    assert 1 <= len(loop.tries) <= 10


def test_tries_in_vain_come_each_time_twice_as_late_up_to_a_bound() -> None:
    loop = Loop(Gathering(), Answered(1, 30e-6))
    loop.run(25.0)
    waits = [later - earlier for earlier, later in zip(loop.tries, loop.tries[1:], strict=False)]
    expected = FIRST_BACKOFF_S
    for wait in waits:
        assert wait == pytest.approx(expected, abs=0.02)
        expected = min(2 * expected, LAST_BACKOFF_S)
    assert waits[-1] == pytest.approx(LAST_BACKOFF_S, abs=0.02)


def test_few_datagrams_and_bursts_are_left_alone() -> None:
    seldom = Loop(Gathering(), paced(1_000))
    seldom.run(3.0)
    bursts = Loop(Gathering(), lambda now: int(now * 5_000) * 8)
    bursts.run(1.0)
    assert seldom.paused == bursts.paused == 0


def test_a_longer_pause_gathers_what_comes_more_seldom() -> None:
    loop = Loop(Gathering(0.002), paced(1_200))
    loop.run(3.0)
    assert loop.paused > 0.7 * loop.turns
    assert 0.001 < loop.gathering.delay_s <= 0.002


def test_a_pause_ends_when_the_rate_falls_and_is_measured_anew_now_and_then() -> None:
    loop = Loop(Gathering(), paced(20_000))
    loop.run(3 * KEPT_S)
    assert 3 <= len(loop.tries) <= 5
    loop.arrived, loop.taken = paced(2_000), int(loop.now * 2_000)
    loop.run(0.3)
    assert loop.gathering.delay_s == 0.0


def test_a_client_that_waits_for_answers_is_noticed_where_a_pause_had_proved_itself() -> None:
    loop = Loop(Gathering(), paced(20_000))
    loop.run(0.5)
    assert loop.gathering.delay_s
    loop.arrived, loop.taken = Answered(1, 30e-6), 0
    loop.run(0.1)
    assert loop.gathering.delay_s == 0.0


def test_after_a_long_silence_the_next_datagram_ends_the_pause() -> None:
    gathering = Gathering()
    loop = Loop(gathering, paced(20_000))
    loop.run(0.5)
    assert gathering.delay_s
    assert gathering.turn(loop.now + 3600.0, 1) == 0.0


@pytest.mark.parametrize("now", [0.0, 5.0])
def test_a_clock_that_stands_still_makes_no_pause(now: float) -> None:
    gathering = Gathering()
    assert {gathering.turn(now, 1) for _ in range(1_000)} == {0.0}


def test_no_pause_is_made_where_that_is_turned_off() -> None:
    loop = Loop(Gathering(0.0), paced(20_000))
    loop.run(1.0)
    assert loop.paused == 0
