"""Loads what extensions bring for robots, as it is loaded when it is used: for `msbot extensions`."""

from __future__ import annotations


def load_for_robots() -> None:
    """Part types, messages, worlds, and checks of the doctor."""
    from msbot.config import load_library
    from msbot.doctor import all_checks
    from msbot.sim.arena.world_reader import brought_worlds

    load_library()
    brought_worlds()
    list(all_checks())
