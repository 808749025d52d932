"""Hears everything: what functions of parts get, and what the master sends to parts by any link.

STOP is the parts' own: samples may still be sent to them, and none may reach a function after its part has confirmed.
So the links of the master are watched as well: only where samples were on their way has anybody obeyed. They carry
numbers that nothing else has, so that they are found in any packet, whatever is around them.
"""

from __future__ import annotations

import asyncio
import struct
from dataclasses import dataclass, field

from msbot.master import Master
from msbot_agent.agent import Agent
from msbot_agent.link import Peer

POWER, SPEED = 77.125, 33.0625
"""What the samples of a story carry: what the part hears, and what it says."""
_MARKS = tuple(struct.pack(form, value) for form in ("<f", "<d") for value in (POWER, SPEED))


@dataclass
class Verdict:
    """What came of one story."""

    confirmed_ms: float | None = 0.0
    """From STOP until the last part had confirmed; None: in real time, where it is not measured."""
    before: dict[str, int] = field(default_factory=dict)
    """How often each function got something before STOP."""
    after: dict[str, int] = field(default_factory=dict)
    """After all had confirmed, until GO."""
    again: dict[str, int] = field(default_factory=dict)
    """After GO."""
    on_the_way: int = 0
    """Samples that the master sent to parts after all had confirmed."""

    @property
    def is_right(self) -> bool:
        """Whether STOP held, and the oracle would have noticed if it had not."""
        return (
            not any(self.after.values())
            and all(self.before.values())
            and all(self.again.values())
            and self.on_the_way > 0
        )


class Oracle:
    """Counts what is heard, in phases."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        """By function."""
        self.on_the_way = 0
        """Samples that have left a master or an agent."""

    def watch(self, agent: Agent) -> None:
        """Listen to all links of an agent, as every master has one."""

        def tap(_now: float, way: str, _peer: Peer, packet: bytes) -> None:
            if way == "out" and any(mark in packet for mark in _MARKS):
                self.on_the_way += 1

        agent.tap = tap

    def expect(self, *names: str) -> None:
        """These are listened to: they count from 0."""
        for name in names:
            self.counts.setdefault(name, 0)

    def heard(self, name: str) -> None:
        """Somebody has heard a sample."""
        self.counts[name] = self.counts.get(name, 0) + 1

    def since(self, before: dict[str, int]) -> dict[str, int]:
        """What was heard since then."""
        return {name: count - before.get(name, 0) for name, count in self.counts.items()}


async def until_all_confirm(master: Master, parts: int, patience_s: float = 30.0) -> float:
    """Wait until nobody is silent and so many parts have confirmed; ms until the last one had."""
    async with asyncio.timeout(patience_s):
        while (status := master.stop).silent or len(status.confirmed) < parts:  # noqa: ASYNC110 - virtual time
            await asyncio.sleep(0.001)
    return max((one.ms for one in status.confirmed), default=0.0)
