"""Compares a blueprint text with the present robot, in one call, so that another process can do it."""

from __future__ import annotations

from msbot.config.blueprint.differences import Difference, differences
from msbot.config.blueprint.model import Blueprint
from msbot.config.blueprint.reader import parse_blueprint
from msbot.config.library.library import Library


def compare_text(text: str, library: Library, present: Blueprint) -> tuple[Difference, ...]:
    """What a blueprint would change.

    Raises:
        ConfigError: it is wrong; the text names every problem with line and remedy.
    """
    return differences(present, parse_blueprint(text, library))
