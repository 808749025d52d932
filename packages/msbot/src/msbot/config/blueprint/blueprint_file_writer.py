"""A blueprint as the text of a `robot.toml`: what `msbot export` writes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from hashlib import sha256

from msbot.config.blueprint.blueprint_model import (
    PRESETS,
    Binding,
    Blueprint,
    BridgeTable,
    RobotProfile,
    RosOptions,
    Slot,
    Timing,
)
from msbot_agent.toml.table import toml_key, toml_value


def blueprint_toml(blueprint: Blueprint, notes: Mapping[tuple[str, str], str] | None = None) -> str:
    """The text that `load_blueprint` reads as this blueprint.

    Nothing is lost on the way, not even a topic that has no sender or no receiver yet.

    Args:
        blueprint: what to write.
        notes: (slot, parameter), (topic, "") or ("", slot) -> a comment to write behind it.
    """
    return "\n".join(_lines(blueprint, notes or {})) + "\n"


def _lines(blueprint: Blueprint, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    robot, options = blueprint.robot, blueprint.options
    if blueprint.library:
        yield f"library = {_list(blueprint.library)}"
        yield ""
    yield "[robot]"
    for name in ("name", "version", "serial_number", "released", "manufacturer"):
        yield f"{name} = {toml_value(getattr(robot, name))}"
    if robot.stop_group:
        yield f"stop_group = {toml_value(robot.stop_group)}"
    yield ""
    yield "[timing]"
    yield from _timing(blueprint.timing)
    yield ""
    yield "[options]"
    yield f"explain = {toml_value(options.explain)}"
    yield f"free_topics = {_list(options.free_topics)}"
    yield f"authentication = {toml_value(options.authentication)}"
    if blueprint.ros != RosOptions():
        yield ""
        yield from _ros(blueprint.ros)
    for bridge in blueprint.bridges:
        yield ""
        yield from _bridge(bridge)
    for slot in blueprint.slots:
        yield ""
        yield from _slot(slot, notes)
    for binding in blueprint.bindings:
        yield ""
        yield from _binding(binding, notes)


def slot_toml(slot: Slot) -> str:
    """One slot as the table of a `robot.toml`."""
    return "\n".join(_slot(slot, {})) + "\n"


def preset_of(timing: Timing) -> str:
    """The preset from which the fewest values differ."""
    return min(PRESETS, key=lambda name: len(list(_overrides(timing, PRESETS[name]))))


def _timing(timing: Timing) -> Iterator[str]:
    yield f"preset = {toml_value(timing.preset)}"
    yield from _overrides(timing, PRESETS[timing.preset])


def _overrides(timing: Timing, preset: Timing) -> Iterator[str]:
    for name in ("beat_period_s", "tick_period_s", "life", "profile_period_s"):
        value = getattr(timing, name)
        if value != getattr(preset, name):
            yield f"{name} = {toml_value(value)}"


def _ros(ros: RosOptions) -> Iterator[str]:
    yield "[ros]"
    for name in ("urdf", "clock", "parameters"):
        value = getattr(ros, name)
        if value != getattr(RosOptions(), name):
            yield f"{name} = {toml_value(value)}"
    if ros.global_topics:
        yield f"global_topics = {_list(ros.global_topics)}"


def _bridge(bridge: BridgeTable) -> Iterator[str]:
    yield "[[bridge]]"
    yield f"world = {toml_value(bridge.world)}"
    yield f"link = {toml_value(bridge.link)}"
    if bridge.options:
        pairs = ", ".join(f"{toml_key(name)} = {toml_value(value)}" for name, value in bridge.options.items())
        yield f"options = {{ {pairs} }}"
    if bridge.simulate:
        yield f"simulate = {_list(bridge.simulate)}"


def _slot(slot: Slot, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    yield f"[[slot]]{_note(notes, '', slot.name)}"
    yield f"name = {toml_value(slot.name)}"
    yield f"part = {toml_value(slot.part_number)}"
    if slot.local_name:
        yield f"local_name = {toml_value(slot.local_name)}"
    if slot.description:
        yield f"description = {toml_value(slot.description)}"
    if slot.settings:
        yield ""
        yield "[slot.settings]"
        for name, value in slot.settings.items():
            yield f"{toml_key(name)} = {toml_value(value)}{_note(notes, slot.name, name)}"
    if slot.safe:
        yield ""
        yield "[slot.safe]"
        for port, values in slot.safe.items():
            pairs = ", ".join(f"{toml_key(name)} = {toml_value(value)}" for name, value in values.items())
            yield f"{toml_key(port)} = {{ {pairs} }}"


def _binding(binding: Binding, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    yield f"[[binding]]{_note(notes, binding.topic, '')}"
    yield f"topic = {toml_value(binding.topic)}"
    yield f"type = {toml_value(binding.type_name)}"
    yield f"from = {toml_value(str(binding.source))}"
    yield f"to = {_list(tuple(str(target) for target in binding.targets))}"
    if not binding.reliable:
        yield "reliable = false"
    if binding.in_dds.export:
        yield "export = true"
    if binding.in_dds.ros:
        yield "ros = true"
    if binding.in_dds.ros_type:
        yield f"ros_type = {toml_value(binding.in_dds.ros_type)}"
    if binding.in_dds.ros_topic:
        yield f"ros_topic = {toml_value(binding.in_dds.ros_topic)}"
    if binding.in_dds.ros_fields:
        pairs = ", ".join(f"{toml_key(ours)} = {toml_value(theirs)}" for ours, theirs in binding.in_dds.ros_fields)
        yield f"ros_fields = {{ {pairs} }}"


def _note(notes: Mapping[tuple[str, str], str], *place: str) -> str:
    remark = notes.get((place[0], place[1]), "")
    return f"  # {' '.join(remark.split())}" if remark else ""


def _list(texts: tuple[str, ...]) -> str:
    return f"[{', '.join(toml_value(text) for text in texts)}]"


# A short mark by which people see whether two robots have the same blueprint.


MARK_LETTERS = 8
_NOBODY = RobotProfile("", "", "", "", "")


def blueprint_mark(blueprint: Blueprint) -> str:
    """Eight hexadecimal digits of all that a blueprint says but whose it is, and where its part types come from.

    The order of slots, topics, settings and receivers does not count, nor which preset the times were written with.
    """
    timing = replace(blueprint.timing, preset=preset_of(blueprint.timing))
    slots = [
        replace(
            slot,
            settings=dict(sorted(slot.settings.items())),
            safe={port: dict(sorted(values.items())) for port, values in sorted(slot.safe.items())},
        )
        for slot in blueprint.slots
    ]
    bindings = [replace(one, targets=tuple(sorted(one.targets, key=str))) for one in blueprint.bindings]
    plain = replace(
        blueprint,
        robot=_NOBODY,
        timing=timing,
        library=(),
        slots=tuple(sorted(slots, key=lambda slot: slot.name)),
        bindings=tuple(sorted(bindings, key=lambda binding: binding.topic)),
    )
    return sha256(blueprint_toml(plain).encode()).hexdigest()[:MARK_LETTERS]
