"""Tests for parts: a part's program in a robot of its own, in virtual time (docs/howto/test_your_part.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from msbot.testing.part_robot import PartRobot, robot_for

__all__ = ["PartRobot", "robot_for"]


def __getattr__(name: str) -> object:
    """Imported when it is used: pytest loads this package in every run."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from msbot.testing import part_robot

    return getattr(part_robot, name)
