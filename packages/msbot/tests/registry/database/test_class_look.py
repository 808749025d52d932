"""All robots of a class in short: each with its own slots, parts, newest line of the journal and newest change."""

from __future__ import annotations

from dataclasses import replace

from msbot.config import Blueprint, Library
from msbot.pnp import Claim, PartState
from msbot.registry import Registry
from tests.registry.events import CLAIM, UID, changed
from tests.registry.hand import Hand


def test_every_robot_is_counted_by_itself(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    assert list(registry.robots.in_class()) == []
    small = replace(
        blueprint,
        robot=replace(blueprint.robot, name="SMALL", serial_number="small"),
        slots=blueprint.slots[:1],
        bindings=(),
    )
    robot = registry.robots.apply_blueprint(blueprint, library)
    other = registry.robots.apply_blueprint(small, library)
    store = registry.runs.begin(robot)
    states = {"AA": PartState.ACTIVE, "BB": PartState.ACTIVE, "CC": PartState.LOST}
    for number, (slot, state) in enumerate(states.items()):
        uid = bytes((*UID[:-1], number))
        store.remember(uid, slot, replace(CLAIM, uid=uid))
        store.journal(changed(state, slot=slot, uid=uid, reason=f"line {number}"))
    registry.storage.flush()
    empty = replace(small, robot=replace(small.robot, serial_number="empty"), slots=())
    registry.robots.apply_blueprint(empty, library)
    edits = [Hand(registry).block(robot, "number", number, "hot", "Ann") for number in ("WXYZ", "VWXY")]

    look = {one.robot.serial_number: one for one in registry.robots.in_class()}
    assert [one.robot for one in registry.robots.in_class()] == registry.robots.all()
    first, second = look[robot.serial_number], look["small"]
    assert (first.slots, first.filled) == (3, 2)  # the third part is lost
    assert (second.slots, second.filled) == (1, 0)
    assert (look["empty"].slots, look["empty"].filled, look["empty"].newest_edit) == (0, 0, 0)
    assert first.newest is not None
    assert (first.newest.robot, first.newest.event.reason) == (robot.name, "line 2")
    assert second.newest is None
    assert first.newest_edit == edits[-1].id
    assert second.newest_edit == 0
    Hand(registry).block(other, "number", "WXYZ", "hot", "Ann")
    assert {one.robot.serial_number: one.newest_edit > edits[-1].id for one in registry.robots.in_class()} == {
        robot.serial_number: False,
        "small": True,
        "empty": False,
    }


def test_two_parts_of_one_slot_fill_it_once(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    store = registry.runs.begin(robot)
    for uid in (UID, UID[::-1]):
        store.remember(uid, "AA", Claim("ABCD", "", uid))
        store.journal(changed(PartState.ACTIVE, uid=uid))
    registry.storage.flush()
    (look,) = registry.robots.in_class()
    assert (look.slots, look.filled) == (3, 1)
