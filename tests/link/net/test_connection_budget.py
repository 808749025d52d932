"""Which connection makes room."""

from __future__ import annotations

from dataclasses import dataclass

from msbot.link.net.connection_budget import IDLE_S, ConnectionBudget


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
    budget.spoke(mine[0], "mine")
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
        budget.spoke(each, "here")
    assert budget.who_makes_room("new", 1.0 + IDLE_S) is None
    assert budget.who_makes_room("new", 2.1 + IDLE_S) is speaking[1]
    assert budget.who_makes_room("new", 2.2 + IDLE_S) is None, "looked for once a second"
    for each in speaking:
        budget.remove(each, "here")
    assert len(budget) == 0
    assert not budget.is_full("here")
