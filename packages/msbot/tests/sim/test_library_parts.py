"""Every part type that MsBOT brings has a simulator that works in a robot: joins, speaks, obeys, becomes safe."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import pytest

from msbot.config import (
    Control,
    ControlKind,
    Direction,
    FieldKind,
    ListType,
    MessageType,
    Parameter,
    ParameterKind,
    Port,
    Scalar,
)
from msbot.part import JoinState
from tests.sim.robot import LIBRARY, Bench, play

NUMBERS = LIBRARY.numbers()
THESIS = ("ABCD", "EFGH", "WXYZ")


def other_values(control: Control) -> Iterator[Scalar]:
    """Values of a control that differ from each other."""
    match control.kind:
        case ControlKind.BOOL:
            yield from (True, False)
        case ControlKind.CHOICE:
            yield from control.choices[::-1]
        case ControlKind.TEXT:
            yield from ("one", "two")
        case ControlKind.NUMBER:
            least = -100.0 if control.least is None else control.least
            most = 100.0 if control.most is None else control.most
            yield from (most, least, (least + most) / 2)


def other_setting(parameter: Parameter) -> Scalar:
    """A value that is not the default."""
    default = parameter.default
    if isinstance(default, bool):
        return not default
    if isinstance(default, str):
        return f"{default}x"
    least = default - 1 if parameter.least is None else parameter.least
    most = default + 1 if parameter.most is None else parameter.most
    value = least if default - least >= most - default else most
    return int(value) if parameter.kind is ParameterKind.INT else value


def messages_for(port: Port) -> Iterator[dict[str, Scalar]]:
    """Messages that no part in its safe state would take for nothing."""
    assert port.message is not None
    texts = ("turn-on 3", "turn-on 4", "on")
    numbers = ((1, 1.0), (3, 3.0), (90, 90.0))
    for text, (whole, number) in zip(texts, numbers, strict=True):
        yield {
            name: True
            if kind is FieldKind.BOOL
            else text
            if kind is FieldKind.TEXT
            else f"[{[whole] * len(kind.element.fields)}]"
            if isinstance(kind, ListType) and isinstance(kind.element, MessageType)
            else kind.zero
            if not isinstance(kind, FieldKind)
            else whole
            if kind.is_whole
            else number
            for name, kind in port.message.leaves.items()
        }


def ports(bench: Bench, direction: Direction) -> list[Port]:
    return [port for port in bench.part_type.ports if port.direction is direction]


def impression(bench: Bench) -> tuple[object, ...]:
    """Everything one sees of the part from outside, rounded so that noise is no news."""
    seen = {name: round(value) if isinstance(value, float) else value for name, value in bench.unit.readings().items()}
    said = {port: bench.last(port) for port, messages in bench.heard.items() if messages}
    rounded = {
        port: {name: round(value) if isinstance(value, float) else value for name, value in fields.items()}
        for port, fields in said.items()
    }
    return seen, rounded


@pytest.mark.parametrize("number", NUMBERS)
def test_it_joins_and_every_port_speaks_when_a_person_plays_with_it(number: str) -> None:
    async def scene(bench: Bench) -> None:
        assert bench.unit.part.slot == "unit"
        for port in ports(bench, Direction.SUBSCRIBE):
            for fields in messages_for(port):
                bench.send(port.name, **fields)
                await asyncio.sleep(1)
        for control in bench.unit.controls:
            changes = set()
            for value in other_values(control):
                bench.unit.set(control.name, value)
                assert bench.unit.value(control.name) == value
                await asyncio.sleep(5)
                changes.add(repr(impression(bench)))
            assert len(changes) > 1, f"control {control.name} does nothing"
        await asyncio.sleep(5)
        silent = [port.name for port in ports(bench, Direction.PUBLISH) if not bench.heard[port.name]]
        assert silent == []
        assert bench.unit.part.counters.handler_errors == 0

    play(number, scene)


@pytest.mark.parametrize("number", NUMBERS)
def test_every_port_that_listens_does_something_one_can_see(number: str) -> None:
    async def scene(bench: Bench) -> None:
        for port in ports(bench, Direction.SUBSCRIBE):
            seen = [dict(bench.unit.readings())]
            for fields in messages_for(port):
                bench.send(port.name, **fields)
                await asyncio.sleep(0.1)
                seen.append(dict(bench.unit.readings()))
                await asyncio.sleep(3)
                seen.append(dict(bench.unit.readings()))
            assert any(reading != seen[0] for reading in seen), f"port {port.name} does nothing"
        assert bench.unit.part.counters.handler_errors == 0

    play(number, scene)


@pytest.mark.parametrize("number", NUMBERS)
def test_the_slots_settings_hold(number: str) -> None:
    part_type = LIBRARY.get(number)
    assert part_type is not None
    settings = {parameter.name: other_setting(parameter) for parameter in part_type.parameters}

    async def scene(bench: Bench) -> None:
        bench.unit.readings()
        assert {name: bench.unit._world.value(name) for name in settings} == settings

    play(number, scene, settings)


@pytest.mark.parametrize("number", [number for number in NUMBERS if number not in THESIS])
def test_safe_values_hold_when_the_master_is_lost(number: str) -> None:
    async def scene(bench: Bench) -> None:
        for port in ports(bench, Direction.SUBSCRIBE):
            # A trigger does nothing by itself: silence is its safe state.
            assert port.safe is not None or port.type_name == "Trigger", f"port {port.name} has no safe value"
            for fields in messages_for(port):
                bench.send(port.name, **fields)
            await asyncio.sleep(1)
        bench.end_master()
        await asyncio.sleep(30)
        assert bench.unit.part.state is not JoinState.ACTIVE
        for port in ports(bench, Direction.SUBSCRIBE):
            for name, value in (port.safe or {}).items():
                assert bench.unit._world.value(f"{port.name}.{name}") == value

    play(number, scene)
