from __future__ import annotations

import pytest

from msbot_agent.link.net.batched_receive import LINGER_S, LOOKS_MAX, WAKING_S, AdaptivePolling

LOOK_S = 1e-6


class Socket:
    """A clock on which every look takes its time, and packets that come at times of their own."""

    def __init__(self) -> None:
        self.now = 100.0
        self.next_at = float("inf")
        self.looks = 0

    def clock(self) -> float:
        return self.now

    def look(self) -> bool:
        self.looks += 1
        self.now += LOOK_S
        return self.now >= self.next_at

    def follow(self, lingering: AdaptivePolling, pauses: list[float]) -> int:
        """Packets that come after these pauses; for how many of them the program was awake."""
        awake = 0
        for pause_s in pauses:
            self.next_at = self.now + pause_s
            if lingering.watch(self.look, self.clock):
                awake += 1
            else:
                self.now = max(self.now, self.next_at) + WAKING_S
                lingering.woken(self.now)
        return awake


def test_a_socket_whose_packets_follow_each_other_is_watched_and_one_with_pauses_is_not() -> None:
    socket, lingering = Socket(), AdaptivePolling()
    assert socket.follow(lingering, [0.5 * LINGER_S] * 40) > 10
    assert socket.follow(lingering, [0.5 * LINGER_S] * 100) == 100
    socket.follow(lingering, [0.01] * 20)
    socket.looks = 0
    assert socket.follow(lingering, [0.01] * 100) == 0
    assert socket.looks == 0  # pauses of 10 ms cost nothing


def test_one_long_pause_stops_the_watch_only_for_a_while() -> None:
    socket, lingering = Socket(), AdaptivePolling()
    socket.follow(lingering, [0.2 * LINGER_S] * 60)
    assert socket.follow(lingering, [3600.0] + [0.2 * LINGER_S] * 20) >= 10


def test_a_watch_in_vain_takes_no_longer_than_it_may() -> None:
    socket, lingering = Socket(), AdaptivePolling()
    socket.follow(lingering, [0.2 * LINGER_S] * 60)
    before, socket.next_at = socket.now, float("inf")
    assert not lingering.watch(socket.look, socket.clock)
    assert LINGER_S <= socket.now - before < LINGER_S + 2 * LOOK_S


def test_a_clock_that_stands_still_does_not_hold_it_up() -> None:
    socket, lingering = Socket(), AdaptivePolling()
    socket.follow(lingering, [0.2 * LINGER_S] * 60)
    looks: list[None] = []
    assert not lingering.watch(lambda: looks.append(None), lambda: 5.0)
    assert len(looks) == LOOKS_MAX


@pytest.mark.parametrize("pause_s", [0.0, 1e-6, 1.0])
def test_nothing_is_watched_where_that_is_turned_off(pause_s: float) -> None:
    socket, lingering = Socket(), AdaptivePolling(0.0)
    assert socket.follow(lingering, [pause_s] * 100) == 0
    assert socket.looks == 0
