"""Which wires would fit a slot by the types of its ports: offered to a person, never made without one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msbot.config import Blueprint, Direction, Library, Port, SlotPort
from msbot_xrce.common.lazy_dataclass import dataclass

MOST_OFFERED = 24


@dataclass(frozen=True, slots=True)
class FittingWire:
    """One wire that could be made, in the words of the operation `bind`."""

    topic: str
    type_name: str
    source: SlotPort
    target: SlotPort

    def as_json(self) -> dict[str, object]:
        """The arguments of `bind`."""
        return {"topic": self.topic, "type": self.type_name, "from": str(self.source), "to": [str(self.target)]}


def fitting_wires(blueprint: Blueprint, library: Library, slot: str) -> list[FittingWire]:
    """Wires between the unwired ports of a slot and ports of other slots that carry the same message type.

    Where the other port has a topic already, the wire joins it.
    """
    topics = {end: binding.topic for binding in blueprint.bindings for end in binding.ends}
    ports = list(_ports(blueprint, library))
    own = [(end, port) for end, port in ports if end.slot == slot and end not in topics]
    others = [(end, port) for end, port in ports if end.slot != slot]
    return list(_fitting(own, others, topics))[:MOST_OFFERED]


def _ports(blueprint: Blueprint, library: Library) -> Iterator[tuple[SlotPort, Port]]:
    for slot in blueprint.slots:
        part_type = library.get(slot.part_number)
        for port in () if part_type is None else part_type.ports:
            yield SlotPort(slot.name, port.name), port


def _fitting(
    own: list[tuple[SlotPort, Port]], others: list[tuple[SlotPort, Port]], topics: Mapping[SlotPort, str]
) -> Iterator[FittingWire]:
    for end, port in own:
        for other, their in others:
            if their.type_name == port.type_name and their.direction is not port.direction:
                source, target = (end, other) if port.direction is Direction.PUBLISH else (other, end)
                topic = topics.get(other) or f"{source.slot}_{source.port}"
                yield FittingWire(topic, port.type_name, source, target)
