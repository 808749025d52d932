"""Compares two blueprints: what would have to change to get from one to the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields

from msbot.config.blueprint.model import Blueprint, InDds, Options, RobotProfile, RosOptions, Slot, Timing
from msbot.config.library.library import scalar_text
from msbot.config.toml.table import Scalar

LATER = "holds from the master's next start on"
"""What follows from a change of profile, timing or options."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that is different in the second blueprint."""

    change: str
    """`added`, `removed` or `changed`."""
    where: str
    """For example `slot AA, part`."""
    before: str
    """Empty when it was added."""
    after: str
    """Empty when it was removed."""
    consequence: str = ""
    """What follows from it, if that is not obvious."""

    def __str__(self) -> str:
        """For example `~ slot AA, part: ABCD -> EFGH (a part that does not fit any more is delisted)`."""
        match self.change:
            case "added":
                line = f"+ {self.where}: {self.after}"
            case "removed":
                line = f"- {self.where}: {self.before}"
            case _:
                line = f"~ {self.where}: {self.before} -> {self.after}"
        return f"{line} ({self.consequence})" if self.consequence else line


def differences(old: Blueprint, new: Blueprint) -> tuple[Difference, ...]:
    """What is different in `new`, in the order of a blueprint; the order of slots and bindings does not matter."""
    return (
        *_fields("robot", old.robot, new.robot),
        *_fields("timing", old.timing, new.timing),
        *_fields("options", old.options, new.options),
        *_fields("ros", old.ros, new.ros),
        *_slots(old, new),
        *_topics(old, new),
    )


def _fields(
    where: str, old: RobotProfile | Timing | Options | RosOptions, new: RobotProfile | Timing | Options | RosOptions
) -> Iterator[Difference]:
    for field in fields(old):
        before, after = getattr(old, field.name), getattr(new, field.name)
        # A preset only says where the other values come from.
        if before != after and field.name != "preset":
            yield Difference("changed", f"{where}, {field.name}", _words(before), _words(after), LATER)


def _slots(old: Blueprint, new: Blueprint) -> Iterator[Difference]:
    before, after = ({slot.name: slot for slot in blueprint.slots} for blueprint in (old, new))
    for name, slot in before.items():
        if name not in after:
            consequence = "a part in it is delisted; settings and memory are kept in case it comes back"
            yield Difference("removed", f"slot {name}", _slot_words(slot), "", consequence)
    for name, slot in after.items():
        if name not in before:
            yield Difference("added", f"slot {name}", "", _slot_words(slot))
        else:
            yield from _slot(before[name], slot)


def _slot(old: Slot, new: Slot) -> Iterator[Difference]:
    where = f"slot {new.name}"
    if old.part_number != new.part_number:
        consequence = "a part in it that does not fit any more is delisted"
        yield Difference("changed", f"{where}, part", old.part_number, new.part_number, consequence)
    for name, before, after in (
        ("local_name", old.local_name, new.local_name),
        ("description", old.description, new.description),
    ):
        if before != after:
            yield Difference("changed", f"{where}, {name}", _words(before), _words(after))
    for name in dict.fromkeys((*old.settings, *new.settings)):
        yield from _setting(f"{where}, {name}", old.settings.get(name), new.settings.get(name))


def _setting(where: str, old: Scalar | None, new: Scalar | None) -> Iterator[Difference]:
    if old is None and new is not None:
        yield Difference("added", where, "", _words(new))
    elif new is None and old is not None:
        yield Difference("removed", where, _words(old), "", "the library's value holds again")
    elif old is not None and new is not None and (old != new or isinstance(old, bool) != isinstance(new, bool)):
        yield Difference("changed", where, _words(old), _words(new))


@dataclass(slots=True)
class _Topic:
    type_name: str
    reliable: bool
    sources: dict[str, None]
    targets: dict[str, None]
    in_dds: InDds

    def __str__(self) -> str:
        kind = self.type_name if self.reliable else f"{self.type_name}, best effort"
        kind += ", exported" if self.in_dds.export else ""
        if self.in_dds.ros:
            fields = ", ".join(f"{ours} = {theirs}" for ours, theirs in self.in_dds.ros_fields)
            kind += " ".join(
                filter(None, (", in ROS 2", self.in_dds.ros_type and f"as {self.in_dds.ros_type}", fields))
            )
        return f"{', '.join(self.sources) or 'nobody'} -> {', '.join(self.targets) or 'nobody'} [{kind}]"


def _topics(old: Blueprint, new: Blueprint) -> Iterator[Difference]:
    before, after = _by_topic(old), _by_topic(new)
    for name, topic in before.items():
        if name not in after:
            yield Difference("removed", f"topic {name}", str(topic), "")
    for name, topic in after.items():
        if name not in before:
            yield Difference("added", f"topic {name}", "", str(topic))
        elif _unordered(before[name]) != _unordered(topic):
            yield Difference("changed", f"topic {name}", str(before[name]), str(topic))


def _by_topic(blueprint: Blueprint) -> Mapping[str, _Topic]:
    topics: dict[str, _Topic] = {}
    for binding in blueprint.bindings:
        topic = topics.setdefault(binding.topic, _Topic(binding.type_name, binding.reliable, {}, {}, binding.in_dds))
        if binding.source.slot:
            topic.sources[str(binding.source)] = None
        topic.targets |= dict.fromkeys(str(target) for target in binding.targets)
    return topics


def _unordered(topic: _Topic) -> tuple[object, ...]:
    return topic.type_name, topic.reliable, topic.in_dds, set(topic.sources), set(topic.targets)


def _slot_words(slot: Slot) -> str:
    words = [f"part {slot.part_number}", *(f"{name} = {_words(value)}" for name, value in slot.settings.items())]
    return ", ".join(words)


def _words(value: Scalar | tuple[str, ...]) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(f'"{item}"' for item in value) + "]"
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:g}" if isinstance(value, float) else scalar_text(value)
