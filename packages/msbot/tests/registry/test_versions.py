"""A part that shows a version behind its number finds the library's entry, if its version is in the entry's range."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot.config import Library, parse_versions
from msbot.registry import Registry
from tests.registry.blueprint.test_blueprint_store import EYE, LEG, ROBOT


@pytest.mark.parametrize(
    ("versions", "shown", "found"),
    [
        ("", "EYE", "EYE"),
        ("", "EYE@2.1", "EYE"),
        (">=1, <2", "EYE", "EYE"),
        (">=1, <2", "EYE@1.9", "EYE"),
        (">=1, <2", "EYE@2", None),
        (">=1, <2", "EYE@new", None),
        ("", "EYE@", None),
        ("", "NOSE@1", None),
    ],
)
def test_number_and_version_find_the_entry(registry: Registry, versions: str, shown: str, found: str | None) -> None:
    parsed = parse_versions(versions)
    assert parsed is not None
    robot = registry.robots.apply_blueprint(ROBOT, Library([replace(EYE, versions=parsed), LEG]))
    part_type = registry.runs.begin(robot).part_type(shown)
    assert (None if part_type is None else part_type.number) == found


def test_an_entry_with_exactly_the_number_comes_first(registry: Registry) -> None:
    exact = replace(EYE, number="EYE@2", name="The second eye")
    robot = registry.robots.apply_blueprint(ROBOT, Library([EYE, LEG, exact]))
    part_type = registry.runs.begin(robot).part_type("EYE@2")
    assert part_type is not None
    assert part_type.name == "The second eye"
