"""Which connection makes room."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.net.connection_budget import IDLE_S, ConnectionBudget
from tests.effort import tries


@dataclass(eq=False)
class Fake:
    address: str
    heard_at: float | None = None


def test_the_oldest_silent_one_of_the_same_address_goes_first() -> None:
    budget: ConnectionBudget[Fake] = ConnectionBudget(10, 3)
    mine = [Fake("mine") for _ in range(3)]
    other = Fake("other")
    for each in (other, *mine):
        budget.add(each, each.address)
    assert budget.is_full("mine")
    assert not budget.is_full("other")
    assert budget.who_makes_room("mine", 0.0) is mine[0]
    budget.first_packet_received(mine[0], "mine")
    assert budget.who_makes_room("mine", 0.0) is mine[1]


def test_of_a_full_server_the_address_with_most_silent_ones_pays() -> None:
    budget: ConnectionBudget[Fake] = ConnectionBudget(6, 6)
    many = [Fake("many") for _ in range(4)]
    few = [Fake("few") for _ in range(2)]
    for each in (*few, *many):
        budget.add(each, each.address)
    assert budget.who_makes_room("new", 0.0) is many[0]


def test_who_speaks_is_put_out_only_when_idle_for_long_and_the_idlest_first() -> None:
    budget: ConnectionBudget[Fake] = ConnectionBudget(3, 3)
    speaking = [Fake("here", heard_at=float(number)) for number in (2, 1, 3)]
    for each in speaking:
        budget.add(each, "here")
        budget.first_packet_received(each, "here")
    assert budget.who_makes_room("new", 1.0 + IDLE_S) is None
    assert budget.who_makes_room("new", 2.1 + IDLE_S) is speaking[1]
    assert budget.who_makes_room("new", 2.2 + IDLE_S) is None, "looked for once a second"
    for each in speaking:
        budget.remove(each, "here")
    assert len(budget) == 0
    assert not budget.is_full("here")


MOST, OF_ADDRESS = 5, 3


class PlainBudget:
    """The same as one list of connections in the order in which they were opened or first spoke."""

    def __init__(self) -> None:
        self.silent: list[Fake] = []
        self.speaking: list[Fake] = []
        self.looked_at = -math.inf

    def of(self, address: str) -> list[Fake]:
        return [one for one in (*self.silent, *self.speaking) if one.address == address]

    def is_full(self, address: str) -> bool:
        return len(self.silent) + len(self.speaking) >= MOST or len(self.of(address)) >= OF_ADDRESS

    def who_makes_room(self, address: str, now: float) -> list[Fake]:
        """All that may; of two addresses with as many silent ones, and of two that were last heard together, either."""
        has_its_share = len(self.of(address)) >= OF_ADDRESS
        silent, speaking = self.silent, self.speaking
        if has_its_share:
            silent, speaking = ([one for one in group if one.address == address] for group in (silent, speaking))
        firsts = {one.address: one for one in reversed(silent)}
        if firsts:
            sizes = Counter(one.address for one in silent)
            return [one for name, one in firsts.items() if sizes[name] == max(sizes.values())]
        if now < self.looked_at + 1.0:
            return []
        self.looked_at = now
        oldest = min((one.heard_at or 0.0 for one in speaking), default=now)
        return [one for one in speaking if one.heard_at == oldest and now - oldest > IDLE_S]


@settings(max_examples=tries(200, 4000))
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["add", "settle", "settle", "spoke", "remove", "ask", "ask"]),
            st.integers(0, 4),
            st.sampled_from(["one", "one", "two", "three"]),
            st.sampled_from([0.0, 0.5, 1.0, 1.0, IDLE_S, IDLE_S + 1]),
        ),
        min_size=5,
        max_size=40,
    )
)
def test_whatever_comes_and_goes_the_right_one_makes_room(steps: list[tuple[str, int, str, float]]) -> None:
    budget: ConnectionBudget[Fake] = ConnectionBudget(MOST, OF_ADDRESS)
    plain = PlainBudget()
    now = 0.0
    for what, which, address, later in steps:
        now += later
        open_now = [*plain.silent, *plain.speaking]
        connection = open_now[which % len(open_now)] if open_now else Fake("nobody")
        if what in ("add", "settle") and not plain.is_full(address):
            connection = Fake(address)
            plain.silent.append(connection)
            budget.add(connection, address)
        if what in ("spoke", "settle"):
            if connection in plain.silent:
                plain.silent.remove(connection)
                plain.speaking.append(connection)
            budget.first_packet_received(connection, connection.address)
            connection.heard_at = now
        if what == "remove":
            budget.remove(connection, connection.address)
            plain.silent = [one for one in plain.silent if one is not connection]
            plain.speaking = [one for one in plain.speaking if one is not connection]
        elif what == "ask":
            expected = plain.who_makes_room(address, now)
            found = budget.who_makes_room(address, now)
            assert found in expected or (found is None and not expected)
        assert len(budget) == len(plain.silent) + len(plain.speaking)
        for each in ("one", "two", "three"):
            assert budget.is_full(each) is plain.is_full(each)
