"""The edge of a running agent: where packets of real and simulated parts can be disturbed, and only while they are."""

from __future__ import annotations

from msbot.operations.running_robot import RunningRobot
from msbot_agent.link import DisturbedLink, Link
from msbot_school.faults.effects import Effect
from msbot_school.faults.treatments import OfPart, PacketTreatment


class Edge:
    """The links of one running robot; those of its own services are left alone."""

    def __init__(self, running: RunningRobot) -> None:
        self.running = running
        self._disturbed: dict[Link, DisturbedLink] = {}

    def links(self) -> tuple[Link, ...]:
        """The links by which parts come in."""
        return self.running.master.links

    def add(self, link: Link, treatment: OfPart) -> None:
        """Treat the packets of a link so."""
        disturbed = self._disturbed.get(link)
        if disturbed is None:
            disturbed = self._disturbed[link] = DisturbedLink(link)
            self.running.master.agent.exchange_link(link, disturbed)
        disturbed.add(treatment)

    def remove(self, link: Link, treatment: OfPart) -> None:
        """End that; an undisturbed link is as if nothing had been."""
        disturbed = self._disturbed[link]
        disturbed.remove(treatment)
        if disturbed.is_idle:
            del self._disturbed[link]
            self.running.master.agent.exchange_link(disturbed, link)

    def is_at(self, link: Link, place: Link) -> bool:
        """Whether the agent means that link when it names a place."""
        return place is link or place is self._disturbed.get(link)


class EdgeEffect(Effect):
    """A treatment of the packets of a part, wherever it is, or of all parts.

    Args:
        edge: where.
        slot: the slot of the part; empty: all parts.
        core: what happens to the packets.
    """

    def __init__(self, edge: Edge, slot: str, core: PacketTreatment) -> None:
        self._edge = edge
        self._slot = slot
        self._core = core
        self._treatments: dict[Link, OfPart] = {}
        self._keys: set[int] = set()

    def begin(self) -> None:
        """See `Effect`."""
        self.keep()

    def keep(self) -> str:
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
                treatment = self._treatments[link] = OfPart(self._core, everybody=not self._slot)
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
