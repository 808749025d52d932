"""A blueprint as the text of a `robot.toml`: what `msbot export` writes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping

from msbot.config.blueprint.model import PRESETS, Binding, Blueprint, Slot, Timing
from msbot.config.toml.table import Scalar

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def blueprint_toml(blueprint: Blueprint, notes: Mapping[tuple[str, str], str] | None = None) -> str:
    """The text that `load_blueprint` reads as this blueprint.

    Nothing is lost on the way, not even a topic that has no sender or no receiver yet.

    Args:
        blueprint: what to write.
        notes: (slot, parameter) or (topic, "") -> a comment to write behind it.
    """
    return "\n".join(_lines(blueprint, notes or {})) + "\n"


def _lines(blueprint: Blueprint, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    robot, options = blueprint.robot, blueprint.options
    if blueprint.library:
        yield f"library = {_list(blueprint.library)}"
        yield ""
    yield "[robot]"
    for name in ("name", "version", "serial_number", "released", "manufacturer"):
        yield f"{name} = {_value(getattr(robot, name))}"
    yield ""
    yield "[timing]"
    yield from _timing(blueprint.timing)
    yield ""
    yield "[options]"
    yield f"explain = {_value(options.explain)}"
    yield f"free_topics = {_list(options.free_topics)}"
    yield f"authentication = {_value(options.authentication)}"
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
    yield f"preset = {_value(timing.preset)}"
    yield from _overrides(timing, PRESETS[timing.preset])


def _overrides(timing: Timing, preset: Timing) -> Iterator[str]:
    for name in ("beat_period_s", "tick_period_s", "life", "profile_period_s"):
        value = getattr(timing, name)
        if value != getattr(preset, name):
            yield f"{name} = {_value(value)}"


def _slot(slot: Slot, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    yield "[[slot]]"
    yield f"name = {_value(slot.name)}"
    yield f"part = {_value(slot.part_number)}"
    if slot.local_name:
        yield f"local_name = {_value(slot.local_name)}"
    if slot.description:
        yield f"description = {_value(slot.description)}"
    if slot.settings:
        yield ""
        yield "[slot.settings]"
        for name, value in slot.settings.items():
            yield f"{_key(name)} = {_value(value)}{_note(notes, slot.name, name)}"


def _binding(binding: Binding, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    yield f"[[binding]]{_note(notes, binding.topic, '')}"
    yield f"topic = {_value(binding.topic)}"
    yield f"type = {_value(binding.type_name)}"
    yield f"from = {_value(str(binding.source))}"
    yield f"to = {_list(tuple(str(target) for target in binding.targets))}"
    if not binding.reliable:
        yield "reliable = false"
    if binding.in_dds.export:
        yield "export = true"
    if binding.in_dds.ros:
        yield "ros = true"
    if binding.in_dds.ros_type:
        yield f"ros_type = {_value(binding.in_dds.ros_type)}"
    if binding.in_dds.ros_fields:
        pairs = ", ".join(f"{_key(ours)} = {_value(theirs)}" for ours, theirs in binding.in_dds.ros_fields)
        yield f"ros_fields = {{ {pairs} }}"


def _note(notes: Mapping[tuple[str, str], str], *place: str) -> str:
    remark = notes.get((place[0], place[1]), "")
    return f"  # {' '.join(remark.split())}" if remark else ""


def _list(texts: tuple[str, ...]) -> str:
    return f"[{', '.join(_value(text) for text in texts)}]"


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _value(name)


def _value(value: Scalar) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # TOML understands what JSON escapes, but also needs DEL escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    return repr(value)
