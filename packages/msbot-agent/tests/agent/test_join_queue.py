"""A bounded number joins at a time, in order, and every computer has its share."""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.agent import ClientInfo, OpenGate
from msbot_agent.agent.join_queue import (
    FORGET_S,
    LONGEST_S,
    LONGEST_WAIT_S,
    QUIET_S,
    SHORTEST_WAIT_S,
    JoinQueue,
)

PLACES = 4


class Places(OpenGate):
    """Some clients are settled."""

    def __init__(self) -> None:
        self.settled: set[int] = set()

    def is_settled(self, client: ClientInfo) -> bool:
        return client.key in self.settled


@dataclass(eq=False)
class Client:
    """One that joins."""

    info: ClientInfo
    last_heard: float
    is_over: bool = False


@dataclass
class Door:
    """A queue and those who have come in."""

    gate: Places = field(default_factory=Places)
    clients: dict[int, Client] = field(default_factory=dict)
    most_waiting: int = 100

    def __post_init__(self) -> None:
        self.queue = JoinQueue(self.gate, places=PLACES, most_waiting=self.most_waiting)

    def ask(self, number: int, now: float, origin: str = "here") -> float:
        """Log in; returns for how long it was put off."""
        wait_s = self.queue.wait_s(number, origin, now)
        if not wait_s:
            self.clients[number] = Client(ClientInfo(number, "udp", number, ""), now)
            self.queue.enter(self.clients[number], origin, now)
        return wait_s

    def settle(self, number: int) -> None:
        self.gate.settled.add(number)


def test_the_first_come_in_and_the_others_come_one_by_one_as_places_fall_free() -> None:
    door = Door()
    assert [door.ask(number, 0.0) == 0.0 for number in range(8)] == [True] * PLACES + [False] * 4
    assert door.ask(4, 0.1) > 0.0
    door.settle(0)
    assert door.ask(4, 0.2) == 0.0
    assert door.ask(5, 0.2) >= SHORTEST_WAIT_S


def test_who_comes_late_does_not_go_before_those_who_wait() -> None:
    door = Door()
    for number in range(4 * PLACES):
        door.ask(number, 0.0)
    door.settle(0)
    assert door.ask(99, 0.1) > 0.0
    assert door.ask(PLACES, 0.1) == 0.0


def test_the_further_behind_the_longer_the_wait_and_never_too_long() -> None:
    door = Door(most_waiting=10_000)
    waits = [door.ask(number, 0.0) for number in range(3000)][PLACES:]
    assert waits == sorted(waits)
    assert (waits[0], waits[-1]) == (SHORTEST_WAIT_S, LONGEST_WAIT_S)


def test_who_falls_silent_or_takes_too_long_gives_its_place_away() -> None:
    door = Door()
    for number in range(PLACES):
        door.ask(number, 0.0)
    assert door.ask(50, QUIET_S / 2) > 0.0
    assert door.ask(50, QUIET_S + 0.1) == 0.0, "the four have said nothing since they logged in"
    busy = Door()
    for number in range(PLACES):
        busy.ask(number, 0.0)
    for now in (0.4, LONGEST_S - 0.1, LONGEST_S + 0.1):
        for client in busy.clients.values():
            client.last_heard = now
        assert (busy.ask(50, now) == 0.0) == (now > LONGEST_S)


def test_who_does_not_come_back_keeps_nobody_waiting() -> None:
    door = Door()
    for number in range(4 * PLACES):
        door.ask(number, 0.0)
    later = FORGET_S + 1.0
    assert door.ask(99, later) == 0.0


def test_a_crowd_at_one_computer_leaves_another_one_its_share() -> None:
    door = Door(most_waiting=1000)
    for number in range(200):
        door.ask(number, 0.0, "crowd")
    assert door.ask(1000, 0.0, "lonely") > 0.0
    for number in range(2):
        door.settle(number)
    for number in range(PLACES, 200):
        assert door.ask(number, 0.1, "crowd") > 0.0, "it has its half while somebody else waits"
    assert door.ask(1000, 0.2, "lonely") == 0.0


@given(st.lists(st.tuples(st.integers(0, 30), st.sampled_from(["a", "b", "c"]), st.floats(0, 2), st.booleans())))
def test_there_are_never_more_at_a_time_and_everybody_comes_in(
    story: list[tuple[int, str, float, bool]],
) -> None:
    door, now = Door(most_waiting=8), 0.0
    for number, origin, passed_s, settles in story:
        now += passed_s
        if number not in door.clients:
            door.ask(number, now, f"{origin}{number}"[: 1 + number % 2])
        elif settles:
            door.settle(number)
        joining = [
            client
            for number, client in door.clients.items()
            if number not in door.gate.settled and now - client.last_heard <= QUIET_S
        ]
        assert len(joining) <= PLACES
    for number in range(31):
        tries = 0
        while number not in door.clients:
            now += door.ask(number, now, "a")
            tries += 1
            assert tries < 100
