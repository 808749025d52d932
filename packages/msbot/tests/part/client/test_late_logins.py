"""A network that makes copies of every login, which come at any time, and loses the answers to some of them.

Between stock peers each copy starts the agent's streams over; the client's go on, and what is under way is lost.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part.client.client_settings import ClientSettings
from msbot_agent.link import Link, Peer
from msbot_agent.link.disturbed_link import DisturbedLink
from msbot_xrce.messages import SESSION_NONE
from tests.effort import tries
from tests.hearing_client import HearingClient
from tests.part.client.test_client import Bench, make_reader, make_writer, play

COPIES = st.lists(st.tuples(st.integers(1, 3000), st.booleans()), min_size=1, max_size=4)
"""When each copy of a login comes, in milliseconds after it, and whether the agent's answer to it is lost."""


class Echoes:
    """A treatment: copies of logins come late, and of the answers to them only some."""

    def __init__(self, copies: list[tuple[int, bool]]) -> None:
        self._copies = copies
        self._lost: list[float] = []

    def applies_to(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:
        return packet[4] == 0x04 if inward else packet[0] == SESSION_NONE and packet[4] == 0

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        if not inward:
            self._lost += [now + after / 1000 for after, is_lost in self._copies if is_lost]
            return [0.0, *(after / 1000 for after, _ in self._copies)]
        # The hub takes no time: an answer comes at the time of its login.
        return [] if any(abs(now - at) < 1e-6 for at in self._lost) else [0.0]

    def free_at(self, peer: Peer, now: float) -> float:
        return now


def echoing(link: Link, copies: list[tuple[int, bool]]) -> DisturbedLink:
    return DisturbedLink(link, Echoes(copies))


@settings(max_examples=tries(25, 1000), deadline=None)
@given(of_writer=COPIES, of_reader=COPIES, pause_ms=st.integers(1, 60), restart_at=st.none() | st.integers(0, 39))
def test_copies_of_logins_that_come_late_lose_and_double_nothing(
    of_writer: list[tuple[int, bool]], of_reader: list[tuple[int, bool]], pause_ms: int, restart_at: int | None
) -> None:
    """The writer may be told to log in again: what it then writes arrives as well, all of it."""

    async def scenario(bench: Bench) -> None:
        a, b = (
            HearingClient(echoing(bench.hub.connect(), copies), key=key, settings=ClientSettings(numbers_logins=True))
            for key, copies in ((1, of_writer), (2, of_reader))
        )
        bench.tasks += [asyncio.get_running_loop().create_task(client.run()) for client in (a, b)]
        writer = make_writer(a)
        reader, got = make_reader(b)
        b.read(reader)
        for client in (a, b):
            await client.connect(1.0)
            await client.until_all_statuses(1.0)
        for number in range(40):
            if number == restart_at:
                await asyncio.sleep(1.0)
                a.reconnect("for the test")
                await a.connect(1.0)
                await a.until_all_statuses(1.0)
            assert a.has_room()
            a.write(writer, b"%d" % number)
            await asyncio.sleep(pause_ms / 1000)
        await asyncio.sleep(5.0)
        assert got == [b"%d" % number for number in range(40)]
        assert (a.counters.logins, b.counters.logins) == (1 + (restart_at is not None), 1)

    play(scenario)
