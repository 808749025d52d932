"""Loads what extensions bring for robots, as it is loaded when it is used: for `msbot extensions`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msbot_agent.startup.extensions import extensions
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.config import Library


def load_for_robots() -> None:
    """Part types with their drivers, messages, worlds, and checks of the doctor."""
    from msbot.config import load_library
    from msbot.doctor import all_checks
    from msbot.sim.arena.world_reader import brought_worlds

    _check_drivers(load_library())
    brought_worlds()
    list(all_checks())


def _check_drivers(library: Library) -> None:
    """Look whether the drivers that part types of extensions name are there."""
    from msbot.hardware import driver_class

    brought = extensions()
    folders = {folder.absolute(): name for name, folder in brought.folders("part_types").items()}
    for part_type in library:
        name = folders.get(Path(part_type.source).absolute().parent)
        if name is None or not part_type.driver.entry_point:
            continue
        try:
            driver_class(part_type)
        except ConfigError as error:
            brought.add_problem("part_types", name, str(error))
