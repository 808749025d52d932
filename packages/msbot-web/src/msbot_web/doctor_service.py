"""The doctor on the page: examines in a thread, at most every few seconds, however many people look."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msbot.process.daemon_threads import DaemonThreads
from msbot.registry.maintenance import database_maintenance
from msbot_agent.process.user_folders import make_own_folder
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError

if TYPE_CHECKING:
    from msbot.doctor import Examination, Examined

KEPT_S = 5.0
"""How long one examination serves everybody."""


class DoctorService:
    """Examines this robot and its computer.

    Args:
        patient: says, in a thread, whom to examine; it may ask the running masters.
        clock: the robot's clock.
        look: what examines; the doctor if absent.
    """

    def __init__(
        self,
        patient: Callable[[], Examined],
        clock: Callable[[], float],
        look: Callable[[Examined], Examination] | None = None,
    ) -> None:
        self._patient = patient
        self._clock = clock
        self._look = look or _examine
        self._aside = DaemonThreads(1, "msbot doctor")
        self._one_at_a_time = asyncio.Lock()
        self._found: tuple[float, Examination] | None = None

    async def examine(self, *, anew: bool = False) -> Examination:
        """What is wrong; `anew`: also when somebody has asked a moment ago."""
        async with self._one_at_a_time:
            if anew or self._found is None or self._clock() - self._found[0] >= KEPT_S:
                loop = asyncio.get_running_loop()
                found = await loop.run_in_executor(self._aside, lambda: self._look(self._patient()))
                self._found = (self._clock(), found)
            return self._found[1]

    async def back_up(self) -> str:
        """Write a backup of the database where the doctor looks for one; returns what was done, in words.

        Raises:
            RegistryError: it cannot be written.
        """
        return await asyncio.get_running_loop().run_in_executor(self._aside, partial(_back_up, self._patient))


def _examine(patient: Examined) -> Examination:
    from msbot.doctor import examine  # a large room, and most robots are well

    return examine(patient)


def _back_up(patient_of: Callable[[], Examined]) -> str:
    patient = patient_of()
    folder, database = patient.backup_folder, patient.database
    if folder is None or database is None:
        raise RegistryError(said("this robot runs without a database file: there is nothing to back up"))
    try:
        make_own_folder(folder)  # a backup contains the keys of parts
    except OSError as error:
        raise RegistryError(
            said("{folder} cannot be used for backups: {reason}", folder=str(folder), reason=error.strerror)
        ) from None
    file = folder / f"{Path(database).stem}-{datetime.now():%Y%m%d-%H%M%S}.db"
    database_maintenance.back_up(database, file)
    written = said("{file} is written", file=str(file))
    if words := database_maintenance.too_large_for_page(file.stat().st_size):
        return said("{written}; {words}", written=written, words=words)
    return written
