"""What faults at the agent's edge do to the packets of a part. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Protocol, runtime_checkable

from msbot.config import LeafType, PartType, Scalar
from msbot.operations.running_robot import RunningRobot
from msbot.sim import fit
from msbot_agent.agent import client_key_in
from msbot_agent.link import DisturbedLink, Link, Peer
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_school.faults.effects import Effect
from msbot_xrce.errors import ConfigError


@runtime_checkable
class PacketTreatment(Protocol):
    """A treatment of packets, whosever they are."""

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """See `Treatment`."""

    def free_at(self, peer: Peer, now: float) -> float:
        """See `Treatment`."""


class DelayedBurst:
    """What the part sends is held back, and comes all at once; what it gets comes as always.

    Args:
        period_s: longest time that a packet waits.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._opens_at = -math.inf

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:  # noqa: ARG002
        """Until the gate opens next."""
        if not inward:
            return (0.0,)
        if now >= self._opens_at:
            self._opens_at = now + self._period_s
        return (self._opens_at - now,)

    def free_at(self, peer: Peer, now: float) -> float:  # noqa: ARG002
        """At once."""
        return now


class SlowReceiver:
    """What goes to the part is taken only so often.

    Args:
        per_s: packets in a second.
    """

    def __init__(self, per_s: float) -> None:
        self._period_s = 1 / per_s
        self._next_at: dict[Peer, float] = {}

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """At once; the next one has to wait."""
        if not inward:
            self._next_at = {peer: now + self._period_s}
        return (0.0,)

    def free_at(self, peer: Peer, now: float) -> float:
        """When the last one has been digested."""
        return self._next_at.get(peer, now)


class FrozenLink:
    """Nothing comes or goes until the fault ends; what has come is then there at once."""

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:  # noqa: ARG002
        """Until the end."""
        return (math.inf,)

    def free_at(self, peer: Peer, now: float) -> float:  # noqa: ARG002
        """Not before the end."""
        return math.inf


class ErrorTolerantTreatment:
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
        missing = [f"{name}()" for name in ("delays", "free_at") if not callable(getattr(core, name, None))]
        if missing or not isinstance(core, PacketTreatment):
            raise self._left_out(TypeError(f"the class {type(core).__name__} has no {' and no '.join(missing)}"))
        self._core: PacketTreatment | None = core

    def _left_out(self, error: Exception) -> ConfigError:
        words = f"{type(error).__name__}: {error}"
        extensions().leave_out_named("faults", self._name, words)
        return ConfigError(
            said("the extension that brings the fault {name} failed: {words}", name=self._name, words=words)
        )

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """As the extension says; at once when it fails."""
        try:
            if self._core is not None:
                return [float(wait) for wait in self._core.delays(peer, now, inward=inward)]
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


class PartTreatment:
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

    def applies_to(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:
        """See `Treatment`."""
        if self._everybody or peer in self.peers:
            return True
        if inward and client_key_in(packet) in self.keys:
            self.peers.add(peer)
            return True
        return False

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        """See `Treatment`."""
        return self._core.delays(peer, now, inward=inward)

    def free_at(self, peer: Peer, now: float) -> float:
        """See `Treatment`."""
        return self._core.free_at(peer, now) if self._everybody or peer in self.peers else now


# The edge of a running agent: where packets of real and simulated parts can be disturbed, and only while they are.


class LinkInterceptors:
    """The links of one running robot; those of its own services are left alone."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._disturbed: dict[Link, DisturbedLink] = {}

    def links(self) -> tuple[Link, ...]:
        """The links by which parts come in."""
        return self.running.master.links

    def add(self, link: Link, treatment: PartTreatment) -> None:
        """Treat the packets of a link so."""
        disturbed = self._disturbed.get(link)
        if disturbed is None:
            disturbed = self._disturbed[link] = DisturbedLink(link)
            self.running.master.agent.exchange_link(link, disturbed)
        disturbed.add(treatment)

    def remove(self, link: Link, treatment: PartTreatment) -> None:
        """End that; an undisturbed link is as if nothing had been."""
        disturbed = self._disturbed[link]
        disturbed.remove(treatment)
        if disturbed.is_idle:
            del self._disturbed[link]
            self.running.master.agent.exchange_link(disturbed, link)

    def is_at(self, link: Link, place: Link) -> bool:
        """Whether the agent means that link when it names a place."""
        return place is link or place is self._disturbed.get(link)


class PacketFaultEffect(Effect):
    """A treatment of the packets of a part, wherever it is, or of all parts.

    Args:
        edge: where.
        slot: the slot of the part; empty: all parts.
        core: what happens to the packets.
    """

    def __init__(self, edge: LinkInterceptors, slot: str, core: PacketTreatment) -> None:
        self._edge = edge
        self._slot = slot
        self._core = core
        self._treatments: dict[Link, PartTreatment] = {}
        self._keys: set[int] = set()

    def begin(self) -> None:
        """See `Effect`."""
        self.sustain()

    def sustain(self) -> str:
        """Follow the part to its present address, and to links that were added meanwhile."""
        running = self._edge.running
        holder = running.holder(self._slot) if self._slot else None
        place = None
        if holder is not None:
            shown = running.inventory.shown_key(holder.client_key)
            self._keys |= {holder.client_key, *([] if shown is None else [shown])}
            place = running.master.agent.place_of(holder.client_key)
        for link in self._edge.links():
            treatment = self._treatments.get(link)
            if treatment is None:
                treatment = self._treatments[link] = PartTreatment(self._core, everybody=not self._slot)
                treatment.keys = self._keys
                self._edge.add(link, treatment)
            if place is not None and self._edge.is_at(link, place[0]):
                treatment.peers.add(place[1])
        return ""

    def end(self) -> None:
        """See `Effect`."""
        for link, treatment in self._treatments.items():
            self._edge.remove(link, treatment)
        self._treatments.clear()


# What a broken sensor says. Pure.


class StuckValue:
    """The first values are said for ever.

    Args:
        port: only this port; empty: all.
    """

    def __init__(self, port: str) -> None:
        self._port = port
        self._first: dict[str, Mapping[str, Scalar]] = {}

    def __call__(self, port: str, fields: Mapping[str, Scalar], now: float) -> Mapping[str, Scalar]:  # noqa: ARG002
        """See `Distortion`."""
        if self._port and port != self._port:
            return fields
        return self._first.setdefault(port, fields)


class DriftingValue:
    """Numbers move away from what is true.

    Args:
        port: only this port; empty: all.
        per_minute: how much they move.
        part_type: says what its messages can hold.
    """

    def __init__(self, port: str, per_minute: float, part_type: PartType) -> None:
        self._port = port
        self._per_s = per_minute / 60
        self._kinds: dict[str, Mapping[str, LeafType]] = {
            one.name: one.message.leaves for one in part_type.ports if one.message is not None
        }
        self._began_at: float | None = None

    def __call__(self, port: str, fields: Mapping[str, Scalar], now: float) -> Mapping[str, Scalar]:
        """See `Distortion`."""
        if self._port and port != self._port:
            return fields
        if self._began_at is None:
            self._began_at = now
        moved = self._per_s * (now - self._began_at)
        return {name: self._moved(port, name, value, moved) for name, value in fields.items()}

    def _moved(self, port: str, name: str, value: Scalar, moved: float) -> Scalar:
        if isinstance(value, bool | str):
            return value
        return fit(self._kinds[port][name], value + moved)
