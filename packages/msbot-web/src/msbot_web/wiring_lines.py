"""Topics, ports and frames as pages show them, of the present robot and of one in the past."""

from __future__ import annotations

from msbot.config import Blueprint, Direction, Library
from msbot_web.api.bus_lines import FrameLine
from msbot_web.api.models import TopicLine, WirePort
from msbot_web.frames import FrameRow
from msbot_web.live import Live


def topic_lines(blueprint: Blueprint, live: Live, now: float) -> list[TopicLine]:
    """All bound topics."""
    lines = []
    for binding in blueprint.bindings:
        watch = live.topic(binding.topic)
        lines.append(
            TopicLine(
                topic=binding.topic,
                type_name=binding.type_name,
                publishers=[str(binding.source)] if binding.source.slot else [],
                subscribers=[str(target) for target in binding.targets],
                rate_hz=0.0 if watch is None else watch.rate_hz(now),
                count=0 if watch is None else watch.count,
                fields={} if watch is None else live.fields(watch),
            )
        )
    return lines


def wire_ports(blueprint: Blueprint, library: Library) -> list[WirePort]:
    """All ports of all slots, in the order of the blueprint, with the topics they are wired to."""
    wired = {str(end): binding for binding in blueprint.bindings for end in (binding.source, *binding.targets)}
    lines: dict[str, WirePort] = {}
    for slot in blueprint.slots:
        part_type = library.get(slot.part_number)
        for port in () if part_type is None else part_type.ports:
            end = f"{slot.name}.{port.name}"
            lines[end] = WirePort(
                slot=slot.name, port=port.name, type_name=port.type_name,
                publishes=port.direction is Direction.PUBLISH, topic=wired[end].topic if end in wired else "",
            )  # fmt: skip
    for end, binding in wired.items():  # of parts that the library does not know
        slot_name, _, port_name = end.rpartition(".")
        if end not in lines:
            lines[end] = WirePort(
                slot=slot_name, port=port_name, type_name=binding.type_name,
                publishes=str(binding.source) == end, topic=binding.topic,
            )  # fmt: skip
    return list(lines.values())


def spark_of(live: Live, topic: str) -> list[float]:
    """The first number on a topic over the last minute, or on and off as 1 and 0 where there is none; oldest first."""
    watch = live.topic(topic)
    if watch is None:
        return []
    fields = live.fields(watch)
    numbers = (name for name, value in fields.items() if not isinstance(value, str))
    field = min(numbers, key=lambda name: isinstance(fields[name], bool), default=None)
    return [] if field is None else live.spark(watch, field)


def frame_line_of(row: FrameRow, now: float) -> FrameLine:
    """A frame, with its age."""
    return FrameLine(
        number=row.number,
        age_s=max(now - row.at, 0.0),
        sender=row.sender,
        text=row.text,
        node=row.node,
        plain=list(row.plain),
        about=list(row.about),
        words=list(row.words),
        notation=row.notation,
    )
