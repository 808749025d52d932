"""CAN addresses that outlive the master."""

from pathlib import Path

import pytest

from msbot.config import Blueprint, Library
from msbot.registry import Registry, RobotRecord, open_registry

A, B, C = b"part   A", b"part   B", b"part   C"


@pytest.fixture
def robot(registry: Registry, blueprint: Blueprint, library: Library) -> RobotRecord:
    return registry.robots.apply_blueprint(blueprint, library)


def test_a_part_has_the_same_address_after_a_restart(registry: Registry, robot: RobotRecord, path: Path) -> None:
    node_ids = registry.runs.node_ids(robot, "can:can0")
    node_ids.assign(5, A)
    node_ids.assign(3, B)
    assert (node_ids.find(A), node_ids.find(B), node_ids.find(C)) == (5, 3, None)
    registry.close()
    with open_registry(path) as again:
        kept = again.runs.node_ids(robot, "can:can0")
        assert (kept.find(A), kept.find(B), kept.find(C)) == (5, 3, None)
        assert list(kept.oldest_first()) == [5, 3]
        assert list(again.runs.node_ids(robot, "can:can1").oldest_first()) == []


def test_a_confirmed_address_is_the_newest_even_when_the_clock_jumps_back(
    registry: Registry, robot: RobotRecord, path: Path
) -> None:
    node_ids = registry.runs.node_ids(robot, "can:can0")
    for node_id, uid in ((1, A), (2, B), (3, C)):
        node_ids.assign(node_id, uid)
    registry.close()
    with open_registry(path, epoch_ns=lambda: 0) as again:
        node_ids = again.runs.node_ids(robot, "can:can0")
        node_ids.assign(1, A)
        node_ids.assign(9, B)
        assert list(node_ids.oldest_first()) == [3, 1, 9]
    with open_registry(path) as again:
        node_ids = again.runs.node_ids(robot, "can:can0")
        assert list(node_ids.oldest_first()) == [3, 1, 9]
        assert node_ids.find(B) == 9


def test_an_address_given_to_another_part_is_gone_for_the_first(
    registry: Registry, robot: RobotRecord, path: Path
) -> None:
    node_ids = registry.runs.node_ids(robot, "can:can0")
    node_ids.assign(1, A)
    node_ids.assign(1, B)
    registry.storage.flush()
    kept = registry.runs.node_ids(robot, "can:can0")
    assert (kept.find(A), kept.find(B)) == (None, 1)
