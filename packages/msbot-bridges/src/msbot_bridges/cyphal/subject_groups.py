"""What several nodes are told by one message: the set points of a group of motor controllers, their readiness. Pure.

Each node is a part of its own, and a part knows nothing of the others. So each says what it wants, and the message is
made of all of it: a vector with the set point of each in its place and 0 elsewhere; ENGAGED only when all nodes that
hear it are in the robot and want it, because those that are not must not move.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Final

from msbot_bridges.cyphal.aspect import READINESS, STANDBY
from msbot_bridges.cyphal.node_registers import SubjectPort
from msbot_bridges.cyphal.service_types import VECTORS, vector_type

Owner = Hashable
NOBODYS: Final = 0.0


class SubjectGroups:
    """All groups of a bus, by their subjects."""

    def __init__(self) -> None:
        self._points: dict[int, dict[Owner, tuple[int, float]]] = {}
        self._types: dict[int, str] = {}
        """The vector of each group; it may grow, and never shrinks while somebody is in."""
        self._wishes: dict[int, dict[Owner, int]] = {}

    def vector(self, subject: int, owner: Owner, place: int, value: float) -> tuple[str, list[float]]:
        """A node is to get a set point: the type of the message for all, and its elements."""
        points = self._points.setdefault(subject, {})
        points[owner] = place, value
        size = VECTORS.get(self._types.get(subject, ""), 0)
        if place >= size:
            self._types[subject] = vector_type(max(place + 1, 2))
            size = VECTORS[self._types[subject]]
        elements = [NOBODYS] * size
        for where, what in points.values():
            elements[where] = what
        return self._types[subject], elements

    def readiness(self, subject: int, owner: Owner, wanted: int, hearing: Iterable[Owner]) -> int:
        """A node is to have a readiness: what all that hear the subject are told."""
        wishes = self._wishes.setdefault(subject, {})
        wishes[owner] = wanted
        return min(wishes.get(one, STANDBY) for one in {owner, *hearing})

    def leave(self, owner: Owner) -> None:
        """A node is out of the robot."""
        for wishes in self._wishes.values():
            wishes.pop(owner, None)
        self._wishes = {subject: wishes for subject, wishes in self._wishes.items() if wishes}
        for points in self._points.values():
            points.pop(owner, None)
        for subject in [subject for subject, points in self._points.items() if not points]:
            del self._points[subject], self._types[subject]


def may_share(one: SubjectPort, other: SubjectPort) -> bool:
    """Whether two nodes can be told by one message: each its own part of it."""
    if one.places and other.places:
        return None not in (one.place, other.place) and one.place != other.place
    return one.type_name == other.type_name == READINESS
