"""The groups of a class: which pupils and which slots are in one."""

from msbot.config import Blueprint, Library
from msbot.pnp import Group
from msbot.registry import Registry


def test_groups_are_read_as_they_were_kept(registry: Registry, blueprint: Blueprint, library: Library) -> None:
    robot = registry.robots.apply_blueprint(blueprint, library)
    groups = [Group("blue", ("ada", "bob"), ("AA", "BB")), Group("red", ("eve",), ()), Group("zoo", (), ("CC",))]
    registry.class_groups.replace(robot, reversed(groups))
    assert registry.class_groups.of(robot) == groups
    registry.class_groups.replace(robot, groups[1:2])
    assert registry.class_groups.of(robot) == groups[1:2]
