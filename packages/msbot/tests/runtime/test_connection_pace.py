"""A flood of connections is bounded by its address and in all; who is known has a share of their own."""

from __future__ import annotations

import pytest

from msbot_agent.pace import BURST_S, KNOWN_TIMES, ConnectionPace

OF_ADDRESS, IN_ALL = 50.0, 100.0


def flooded(pace: ConnectionPace, addresses: int, seconds: float) -> int:
    """How many of 1,000 connections a second are taken."""
    return sum(pace.takes(f"10.0.0.{number % addresses}", number / 1000) for number in range(int(seconds * 1000)))


@pytest.mark.parametrize(("addresses", "most"), [(1, OF_ADDRESS), (200, IN_ALL)])
def test_strangers_are_bounded(addresses: int, most: float) -> None:
    pace = ConnectionPace(OF_ADDRESS, IN_ALL, lambda _: False)
    assert flooded(pace, addresses, 20.0) <= most * (20.0 + BURST_S) + 1


def test_another_stranger_comes_in_beside_a_flood_from_one_address() -> None:
    pace = ConnectionPace(OF_ADDRESS, IN_ALL, lambda _: False)
    flooded(pace, 1, 20.0)
    assert pace.takes("10.1.1.1", 20.0)


def test_who_is_known_comes_in_beside_a_flood_from_everywhere() -> None:
    pace = ConnectionPace(OF_ADDRESS, IN_ALL, lambda address: address == "10.1.1.1")
    flooded(pace, 250, 20.0)
    pace.takes("10.2.2.2", 20.0)  # what was made up for in the last millisecond
    assert not pace.takes("10.3.3.3", 20.0)
    burst = int(KNOWN_TIMES * OF_ADDRESS * BURST_S)
    assert all(pace.takes("10.1.1.1", 20.0) for _ in range(burst))
    assert not pace.takes("10.1.1.1", 20.0)


def test_an_address_that_passes_on_what_others_ask_has_no_bound() -> None:
    pace = ConnectionPace(1.0, 1.0, lambda _: False, lambda address: address == "10.0.0.1")
    assert all(pace.takes("10.0.0.1", 0.0) for _ in range(10_000))
    assert not all(pace.takes("10.0.0.2", 0.0) for _ in range(10_000))
