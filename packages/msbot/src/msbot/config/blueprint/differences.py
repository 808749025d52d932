"""Compares two blueprints: what would have to change to get from one to the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields

from msbot.config.blueprint.blueprint_file_reader import parse_blueprint
from msbot.config.blueprint.blueprint_model import (
    Blueprint,
    BridgeTable,
    InDds,
    Options,
    RobotProfile,
    RosOptions,
    Slot,
    Timing,
)
from msbot.config.library.part_library import Library, scalar_text
from msbot_agent.text.sentence import joined, said
from msbot_agent.toml.table import Scalar
from msbot_xrce.lazy import dataclass

LATER = said("holds from the master's next start on")
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
                line = said("+ {where}: {after}", where=self.where, after=self.after)
            case "removed":
                line = said("- {where}: {before}", where=self.where, before=self.before)
            case _:
                line = said("~ {where}: {before} -> {after}", where=self.where, before=self.before, after=self.after)
        return said("{line} ({consequence})", line=line, consequence=self.consequence) if self.consequence else line


def differences(old: Blueprint, new: Blueprint) -> tuple[Difference, ...]:
    """What is different in `new`, in the order of a blueprint; the order of slots and bindings does not matter."""
    return (
        *_fields("robot", old.robot, new.robot),
        *_fields("timing", old.timing, new.timing),
        *_fields("options", old.options, new.options),
        *_fields("ros", old.ros, new.ros),
        *_bridges(old, new),
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
            consequence = "" if field.name == "stop_group" else LATER  # the next STOP goes by it
            yield Difference("changed", f"{where}, {field.name}", _words(before), _words(after), consequence)


def _bridges(old: Blueprint, new: Blueprint) -> Iterator[Difference]:
    before, after = ({f"bridge, {one.world} {one.link}": one for one in each.bridges} for each in (old, new))
    for where in [*before, *(where for where in after if where not in before)]:
        one, other = before.get(where), after.get(where)
        if one != other:
            change = "added" if one is None else "removed" if other is None else "changed"
            yield Difference(change, where, _bridge_words(one), _bridge_words(other), LATER)


def _bridge_words(bridge: BridgeTable | None) -> str:
    if bridge is None:
        return ""
    return ", ".join([*(f"{name} = {value}" for name, value in bridge.options.items()), *bridge.simulate])


def _slots(old: Blueprint, new: Blueprint) -> Iterator[Difference]:
    before, after = ({slot.name: slot for slot in blueprint.slots} for blueprint in (old, new))
    for name, slot in before.items():
        if name not in after:
            consequence = said("a part in it is delisted; settings and memory are kept in case it comes back")
            yield Difference("removed", said("slot {name}", name=name), _slot_words(slot), "", consequence)
    for name, slot in after.items():
        if name not in before:
            yield Difference("added", said("slot {name}", name=name), "", _slot_words(slot))
        else:
            yield from _slot(before[name], slot)


def _slot(old: Slot, new: Slot) -> Iterator[Difference]:
    where = said("slot {name}", name=new.name)
    if old.part_number != new.part_number:
        consequence = said("a part in it that does not fit any more is delisted")
        yield Difference("changed", said("{where}, part", where=where), old.part_number, new.part_number, consequence)
    for name, before, after in (
        ("local_name", old.local_name, new.local_name),
        ("description", old.description, new.description),
    ):
        if before != after:
            yield Difference("changed", joined(", ", (where, name)), _words(before), _words(after))
    for name in dict.fromkeys((*old.settings, *new.settings)):
        yield from _setting(joined(", ", (where, name)), old.settings.get(name), new.settings.get(name))
    before_safe, after_safe = _safe_words(old), _safe_words(new)
    for name in dict.fromkeys((*before_safe, *after_safe)):
        yield from _setting(joined(", ", (where, name)), before_safe.get(name), after_safe.get(name))


def _safe_words(slot: Slot) -> dict[str, Scalar]:
    """The safe values of a slot, by `safe PORT.FIELD`."""
    return {
        said("safe {port}", port=f"{port}.{field}"): value
        for port, values in slot.safe.items()
        for field, value in values.items()
    }


def _setting(where: str, old: Scalar | None, new: Scalar | None) -> Iterator[Difference]:
    if old is None and new is not None:
        yield Difference("added", where, "", _words(new))
    elif new is None and old is not None:
        yield Difference("removed", where, _words(old), "", said("the library's value holds again"))
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
        kind = [self.type_name]
        if not self.reliable:
            kind.append(said("best effort"))
        if self.in_dds.export:
            kind.append(said("exported"))
        if self.in_dds.ros:
            fields = ", ".join(f"{ours} = {theirs}" for ours, theirs in self.in_dds.ros_fields)
            named = self.in_dds.ros_type and said("as {type}", type=self.in_dds.ros_type)
            kind.append(joined(" ", filter(None, (said("in ROS 2"), self.in_dds.ros_topic, named, fields))))
        sources, targets = (", ".join(ends) or said("nobody") for ends in (self.sources, self.targets))
        return said("{sources} -> {targets} [{kind}]", sources=sources, targets=targets, kind=joined(", ", kind))


def _topics(old: Blueprint, new: Blueprint) -> Iterator[Difference]:
    before, after = _by_topic(old), _by_topic(new)
    for name, topic in before.items():
        if name not in after:
            yield Difference("removed", said("topic {name}", name=name), str(topic), "")
    for name, topic in after.items():
        if name not in before:
            yield Difference("added", said("topic {name}", name=name), "", str(topic))
        elif _unordered(before[name]) != _unordered(topic):
            yield Difference("changed", said("topic {name}", name=name), str(before[name]), str(topic))


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
    part = said("part {number}", number=slot.part_number)
    values = {**slot.settings, **_safe_words(slot)}
    return joined(", ", (part, *(f"{name} = {_words(value)}" for name, value in values.items())))


def _words(value: Scalar | tuple[str, ...]) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(f'"{item}"' for item in value) + "]"
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:g}" if isinstance(value, float) else scalar_text(value)


# Compares a blueprint text with the present robot, in one call, so that another process can do it.


def compare_text(text: str, library: Library, present: Blueprint) -> tuple[Difference, ...]:
    """What a blueprint would change.

    Raises:
        ConfigError: it is wrong; the text names every problem with line and remedy.
    """
    return differences(present, parse_blueprint(text, library))
