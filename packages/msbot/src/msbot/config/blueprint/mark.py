"""A short mark by which people see whether two robots have the same blueprint."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256

from msbot.config.blueprint.model import Blueprint, RobotProfile
from msbot.config.blueprint.writer import blueprint_toml, preset_of

MARK_LETTERS = 8
_NOBODY = RobotProfile("", "", "", "", "")


def blueprint_mark(blueprint: Blueprint) -> str:
    """Eight hexadecimal digits of all that a blueprint says but whose it is, and where its part types come from.

    The order of slots, topics, settings and receivers does not count, nor which preset the times were written with.
    """
    timing = replace(blueprint.timing, preset=preset_of(blueprint.timing))
    slots = [replace(slot, settings=dict(sorted(slot.settings.items()))) for slot in blueprint.slots]
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
