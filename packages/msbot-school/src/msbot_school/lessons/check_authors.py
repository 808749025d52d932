"""Whose hand made a check of a lesson tick. Pure."""

from __future__ import annotations

from enum import Enum


class Doing(Enum):
    """The value is what the registry keeps."""

    OWN = "own"
    """The person's."""
    GROUP = "group"
    """That of somebody of the person's group."""
    HELPED = "helped"
    """That of somebody with more rights, who did what a pupil may not do."""
    ROBOT = "robot"
    """Nobody's: the robot did it by itself."""
