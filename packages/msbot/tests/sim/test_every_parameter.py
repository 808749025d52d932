"""Every parameter of every part type does something: a setting without effect would be a lie on the page."""

from __future__ import annotations

from random import Random

import pytest

from msbot.config import ControlKind, Direction, FieldKind, LeafType, Parameter, PartType, Scalar
from msbot.sim.part_model import PartModel
from tests.sim.robot import LIBRARY

PLAYED_S = 30.0
STEP_S = 0.05
BOARD = "BOARD-8"
"""Its settings are the parts that a real board carries (tests.homes.test_generic_board): nothing to simulate."""
PARAMETERS = [
    (part_type, parameter) for part_type in LIBRARY if part_type.number != BOARD for parameter in part_type.parameters
]


def other_values(parameter: Parameter) -> list[Scalar]:
    """Some values that differ from the default, in its range."""
    default = parameter.default
    if isinstance(default, bool):
        return [not default]
    if isinstance(default, str):
        return [f"{default}x"]
    least = default - 10 if parameter.least is None else parameter.least
    most = default + 10 if parameter.most is None else parameter.most
    wanted = (least, most, (least + most) / 2, default * 2, default / 2)
    values = [type(default)(value) for value in wanted if least <= value <= most]
    return [value for value in values if value != default]


def played(part_type: PartType, settings: dict[str, Scalar]) -> list[object]:
    """What the part shows and says while somebody plays with all of it; the same game every time."""
    world, random = PartModel(part_type, Random(1)), Random(7)
    world.start_at(0.0)
    for name, value in settings.items():
        world.set(name, value, 0.0)
    world.join(0.0)
    seen: list[object] = []
    for step in range(round(PLAYED_S / STEP_S)):
        now = round(step * STEP_S, 6)
        if step % 7 == 0:
            play_once(part_type, world, random, now)
        world.advance(now)
        seen.append((dict(world.readings()), world.due_messages(now)))
    return seen


def play_once(part_type: PartType, world: PartModel, random: Random, now: float) -> None:
    for control in part_type.simulator.controls if part_type.simulator else ():
        match control.kind:
            case ControlKind.BOOL:
                world.set(control.name, random.random() < 0.5, now)
            case ControlKind.CHOICE:
                world.set(control.name, random.choice(control.choices), now)
            case ControlKind.TEXT:
                world.set(control.name, random.choice(("one", "two")), now)
            case ControlKind.NUMBER:
                least = -100.0 if control.least is None else control.least
                most = 100.0 if control.most is None else control.most
                world.set(control.name, random.uniform(least, most), now)
    for port in part_type.ports:
        if port.direction is Direction.SUBSCRIBE and port.message is not None:
            fields = {name: any_value(kind, random) for name, kind in port.message.leaves.items()}
            world.receive(port.name, fields, now)


def any_value(kind: LeafType, random: Random) -> Scalar:
    if not isinstance(kind, FieldKind):
        return kind.zero
    if kind is FieldKind.BOOL:
        return random.random() < 0.5
    if kind is FieldKind.TEXT:
        return random.choice(("one", "turn-on 3"))
    return random.randrange(100) if kind.is_whole else random.uniform(-100.0, 200.0)


@pytest.mark.parametrize(
    ("part_type", "parameter"), PARAMETERS, ids=[f"{one.number}-{parameter.name}" for one, parameter in PARAMETERS]
)
def test_a_parameter_changes_what_the_part_shows_or_says(part_type: PartType, parameter: Parameter) -> None:
    usual = played(part_type, {})
    assert usual == played(part_type, {})  # else any difference below would mean nothing
    assert any(played(part_type, {parameter.name: value}) != usual for value in other_values(parameter))


def said(world: PartModel, until: float, begin: float = 0.0) -> list[float]:
    values = []
    for step in range(1, round((until - begin) / STEP_S) + 1):
        now = round(begin + step * STEP_S, 6)
        world.advance(now)
        values += [fields["percent"] for _, fields in world.due_messages(now)]
    return [value for value in values if isinstance(value, float)]


def test_a_knob_does_not_tell_movements_smaller_than_its_change() -> None:
    world = PartModel(LIBRARY.require("POT-10K"), Random(1))
    world.start_at(0.0)
    world.set("change", 5.0, 0.0)
    world.join(0.0)
    (first,) = set(said(world, 3.0))
    world.set("knob", 53.0, 3.0)
    assert set(said(world, 5.0, 3.0)) == {first}
    world.set("knob", 56.0, 5.0)
    later = said(world, 7.0, 5.0)
    assert len(set(later)) == 1
    assert abs(later[-1] - 56.0) < 0.5


def test_a_knob_that_nobody_turns_goes_on_saying_where_it_stands() -> None:
    world = PartModel(LIBRARY.require("POT-10K"), Random(1))
    world.start_at(0.0)
    world.join(0.0)
    assert len(said(world, 5.0)) >= 45
