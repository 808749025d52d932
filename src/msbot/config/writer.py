"""A blueprint as the text of a `robot.toml`: what `msbot export` writes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping

from msbot.config.blueprint import Blueprint
from msbot.config.plan import PRESETS, Binding, Slot, Timing
from msbot.config.reader import Scalar

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def blueprint_toml(blueprint: Blueprint, notes: Mapping[tuple[str, str], str] | None = None) -> str:
    """The text that `load_blueprint` reads as this blueprint.

    A topic that has no sender or no receiver, which only people can make by hand, becomes a comment.

    Args:
        blueprint: what to write.
        notes: (slot, parameter) or (topic, "") -> a remark that goes behind it.
    """
    return "\n".join(_lines(blueprint, notes or {})) + "\n"


def _lines(blueprint: Blueprint, notes: Mapping[tuple[str, str], str]) -> Iterator[str]:
    robot, options = blueprint.robot, blueprint.options
    yield "[robot]"
    for name in ("name", "version", "serial_number", "released", "manufacturer"):
        yield f"{name} = {_value(getattr(robot, name))}"
    yield ""
    yield "[timing]"
    yield from _timing(blueprint.timing)
    yield ""
    yield "[options]"
    yield f"explain = {_value(options.explain)}"
    yield f"free_topics = [{', '.join(_value(topic) for topic in options.free_topics)}]"
    yield f"authentication = {_value(options.authentication)}"
    for slot in blueprint.slots:
        yield ""
        yield from _slot(slot, notes)
    for binding in blueprint.bindings:
        yield ""
        yield from _binding(binding, notes)


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
    yield f"part = {_value(slot.part)}"
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
    targets = ", ".join(_value(str(target)) for target in binding.targets)
    sign = "" if binding.source.slot and targets else "# "
    yield f"{sign}[[binding]]{_note(notes, binding.topic, '')}"
    yield f"{sign}topic = {_value(binding.topic)}"
    yield f"{sign}type = {_value(binding.type_name)}"
    yield f"{sign}from = {_value(str(binding.source))}"
    yield f"{sign}to = [{targets}]"
    if not binding.reliable:
        yield f"{sign}reliable = false"


def _note(notes: Mapping[tuple[str, str], str], *place: str) -> str:
    remark = notes.get((place[0], place[1]), "")
    return f"  # {' '.join(remark.split())}" if remark else ""


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _value(name)


def _value(value: Scalar) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # What JSON escapes, TOML understands; besides, TOML wants DEL escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    return repr(value)
