"""The service `teaching` of `msbot master`: faults on purpose, missions and lessons."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from msbot_agent.cli.command_services import Beside, CommandService

if TYPE_CHECKING:
    from msbot.cli.run.master_services import MasterContext
    from msbot_school.lessons.catalog import LessonCatalog

lessons_option = click.option(
    "--lessons",
    "lessons",
    multiple=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="A folder with more lessons (Markdown files), besides MsBOT's own; repeatable.",
)


class Teaching(CommandService["LessonCatalog", "MasterContext"]):
    """Offers the robot's `LessonController`."""

    options = (lessons_option,)

    def check(self, given: Mapping[str, Any]) -> LessonCatalog:
        """The lessons that there are."""
        from msbot_school.lessons.catalog import LessonCatalog

        return LessonCatalog(given["lessons"])

    def coroutines(self, wanted: LessonCatalog, context: MasterContext) -> Iterable[Beside]:
        """Faults, missions and lessons."""
        from msbot_school.faults.fault_lab import FaultLab
        from msbot_school.lessons.lesson_controller import LessonController
        from msbot_school.missions.mission_lab import MissionLab

        faults = FaultLab(context.operations)
        desk = LessonController(context.operations, wanted)
        context.offers["teaching"] = desk
        return [faults.run(), MissionLab(context.operations, faults).run(), desk.run()]


TEACHING = Teaching()
