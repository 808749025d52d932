from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.net.connection_budget import ConnectionRateLimit


def test_a_steady_part_is_never_slowed_down() -> None:
    budget = ConnectionRateLimit(packets_s=100.0, octets_s=10_000.0)
    assert all(budget.spend(100, place / 100) == 0.0 for place in range(1, 1000))


def test_after_the_burst_reading_waits_as_long_as_was_taken_too_much() -> None:
    budget = ConnectionRateLimit(packets_s=10.0, octets_s=1e9)
    assert [budget.spend(1, 0.0) for _ in range(12)] == [0.0] * 10 + [0.1, 0.2]
    assert budget.spend(1, 5.0) == 0.0
    assert ConnectionRateLimit(packets_s=1e9, octets_s=100.0).spend(350, 0.0) == 2.5


@given(st.lists(st.tuples(st.integers(0, 70_000), st.floats(0, 10)), max_size=200))
def test_who_obeys_the_pauses_never_brings_more_than_the_rate(steps: list[tuple[int, float]]) -> None:
    packets_s, octets_s, now, octets = 50.0, 100_000.0, 0.0, 0
    budget = ConnectionRateLimit(packets_s, octets_s)
    for count, (size, rest_s) in enumerate(steps, 1):
        octets += size
        now += budget.spend(size, now)
        assert count <= packets_s * (now + 1) + 1e-6
        assert octets <= octets_s * (now + 1) + 1e-3
        now += rest_s
