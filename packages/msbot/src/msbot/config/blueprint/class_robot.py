"""A robot for a class: the same slots and wires for each group, under the group's name. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from msbot.config.blueprint.blueprint_model import Binding, Blueprint, SlotPort
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

MOST_GROUPS = 40
LONGEST_GROUP = 20
"""Characters of a group's name in the names of its slots."""

GROUP_ROBOT_TOML = """\
# The robot of one group: a program of the pupils drives it. `msbot pupils robot` makes one for each group.

[robot]
name = "CLASS"
version = "CLASS_V1"
serial_number = "C-0001"
released = "2026"
manufacturer = "MsBOT"

[timing]
preset = "thesis"

[options]
explain = true

[[slot]]
name = "program"
part = "PILOT"
description = "The program of a pupil"

[[slot]]
name = "eyes"
part = "HC-SR04"
description = "Looks ahead"

[[slot]]
name = "bumper"
part = "BUTTON"
description = "At the front edge"

[[slot]]
name = "wheels"
part = "TB6612FNG"
description = "Two motors"

[[slot]]
name = "lamp"
part = "RGB-LED"
description = "Shines"

[[binding]]
topic = "distance"
type = "Distance"
from = "eyes.distance"
to = ["program.distance"]
reliable = false

[[binding]]
topic = "touch"
type = "Switch"
from = "bumper.pressed"
to = ["program.touch"]

[[binding]]
topic = "power_left"
type = "Level"
from = "program.left"
to = ["wheels.left"]

[[binding]]
topic = "power_right"
type = "Level"
from = "program.right"
to = ["wheels.right"]

[[binding]]
topic = "colour"
type = "Colour"
from = "program.lamp"
to = ["lamp.colour"]
"""


def for_groups(blueprint: Blueprint, groups: Iterable[str]) -> Blueprint:
    """The robot with every slot and topic once for each group: `fan` becomes `fan_Red`, `fan_Blue`.

    Raises:
        ConfigError: no groups, too many, one twice, or a name that no slot can end with.
    """
    names = tuple(groups)
    if not 1 <= len(names) <= MOST_GROUPS or len(set(names)) < len(names):
        raise ConfigError(said("a class has 1 to {most} groups, each with a name of its own", most=MOST_GROUPS))
    for name in names:
        if not (name.isalnum() and name.isascii() and len(name) <= LONGEST_GROUP):
            raise ConfigError(
                said(
                    "{name!r} is no name for a group here: 1 to {most} letters and digits, without accents",
                    name=name[:60],
                    most=LONGEST_GROUP,
                )
            )
    return replace(
        blueprint,
        slots=tuple(replace(slot, name=f"{slot.name}_{group}") for group in names for slot in blueprint.slots),
        bindings=tuple(_of_group(binding, group) for group in names for binding in blueprint.bindings),
    )


def groups_by_slots(slots: Sequence[str]) -> dict[str, list[str]]:
    """The groups that the names of slots tell, as `for_groups` makes them: what stands behind the last underscore, if
    several slots have it and as many as every other group."""
    found: dict[str, list[str]] = {}
    for slot in slots:
        stem, _, group = slot.rpartition("_")
        if stem:
            found.setdefault(group, []).append(slot)
    stems = {group: {slot.rpartition("_")[0] for slot in named} for group, named in found.items()}
    most = max(map(len, stems.values()), default=0)
    return {group: found[group] for group, named in stems.items() if most > 1 and len(named) == most}


def _of_group(binding: Binding, group: str) -> Binding:
    def end(port: SlotPort) -> SlotPort:
        return replace(port, slot=f"{port.slot}_{group}") if port.slot else port

    return replace(
        binding,
        topic=f"{binding.topic}_{group}",
        source=end(binding.source),
        targets=tuple(end(target) for target in binding.targets),
    )
