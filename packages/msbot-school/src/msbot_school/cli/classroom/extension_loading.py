"""Loads what extensions bring for classes, as it is loaded when it is used: for `msbot extensions`."""

from __future__ import annotations

from msbot_agent.startup.extensions import extensions


def load_for_classes() -> None:
    """Lessons, missions and faults."""
    from msbot_school.faults.fault_kinds import KINDS
    from msbot_school.missions.mission_file import ready_missions

    extensions().folders("lessons")
    ready_missions()
    len(KINDS)
