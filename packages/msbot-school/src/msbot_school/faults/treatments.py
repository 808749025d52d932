"""What faults at the agent's edge do to the packets of a part. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Protocol, runtime_checkable

from msbot_agent.agent import client_key_in
from msbot_agent.link import Peer
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


@runtime_checkable
class PacketTreatment(Protocol):
    """A treatment of packets, whosever they are."""

    def waits(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """See `Treatment`."""

    def free_at(self, peer: Peer, now: float) -> float:
        """See `Treatment`."""


class HeldBack:
    """What the part sends is held back, and comes all at once; what it gets comes as always.

    Args:
        period_s: longest time that a packet waits.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._opens_at = -math.inf

    def waits(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:  # noqa: ARG002
        """Until the gate opens next."""
        if not inward:
            return (0.0,)
        if now >= self._opens_at:
            self._opens_at = now + self._period_s
        return (self._opens_at - now,)

    def free_at(self, peer: Peer, now: float) -> float:  # noqa: ARG002
        """At once."""
        return now


class SlowlyTaken:
    """What goes to the part is taken only so often.

    Args:
        per_s: packets in a second.
    """

    def __init__(self, per_s: float) -> None:
        self._period_s = 1 / per_s
        self._next_at: dict[Peer, float] = {}

    def waits(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """At once; the next one has to wait."""
        if not inward:
            self._next_at = {peer: now + self._period_s}
        return (0.0,)

    def free_at(self, peer: Peer, now: float) -> float:
        """When the last one has been digested."""
        return self._next_at.get(peer, now)


class Frozen:
    """Nothing comes or goes until the fault ends; what has come is then there at once."""

    def waits(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:  # noqa: ARG002
        """Until the end."""
        return (math.inf,)

    def free_at(self, peer: Peer, now: float) -> float:  # noqa: ARG002
        """Not before the end."""
        return math.inf


class Guarded:
    """A treatment that an extension brings: where it fails, packets pass as if it were not there.

    Args:
        name: of the fault.
        make: makes it.
        amount: how strong it is.
        random: its chance.

    Raises:
        ConfigError: it cannot be made.
    """

    def __init__(self, name: str, make: Callable[[float, Random], object], amount: float, random: Random) -> None:
        self._name = name
        try:
            core = make(amount, random)
        except Exception as error:
            raise self._left_out(error) from error
        if not isinstance(core, PacketTreatment):
            raise self._left_out(TypeError(f"a {type(core).__name__} has no waits() or no free_at()"))
        self._core: PacketTreatment | None = core

    def _left_out(self, error: Exception) -> ConfigError:
        words = f"{type(error).__name__}: {error}"
        extensions().leave_out_named("faults", self._name, words)
        return ConfigError(
            said("the extension that brings the fault {name} failed: {words}", name=self._name, words=words)
        )

    def waits(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """As the extension says; at once when it fails."""
        try:
            if self._core is not None:
                return [float(wait) for wait in self._core.waits(peer, now, inward=inward)]
        except Exception as error:
            self._core = None
            self._left_out(error)
        return (0.0,)

    def free_at(self, peer: Peer, now: float) -> float:
        """As the extension says; now when it fails."""
        try:
            if self._core is not None:
                return float(self._core.free_at(peer, now))
        except Exception as error:
            self._core = None
            self._left_out(error)
        return now


class OfPart:
    """A treatment of the packets of one part on one link; satisfies `Treatment`.

    Args:
        core: what happens to its packets; None in place of a part: of all parts.
        everybody: whether all packets are treated.
    """

    def __init__(self, core: PacketTreatment, *, everybody: bool = False) -> None:
        self._core = core
        self._everybody = everybody
        self.peers: set[Peer] = set()
        """The addresses of the part."""
        self.keys: set[int] = set()
        """Client keys that it has shown: it may log in from a new address."""

    def concerns(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:
        """See `Treatment`."""
        if self._everybody or peer in self.peers:
            return True
        if inward and client_key_in(packet) in self.keys:
            self.peers.add(peer)
            return True
        return False

    def waits(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """See `Treatment`."""
        return self._core.waits(peer, now, inward=inward)

    def free_at(self, peer: Peer, now: float) -> float:
        """See `Treatment`."""
        return self._core.free_at(peer, now) if self._everybody or peer in self.peers else now
