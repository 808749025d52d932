"""Facts about clock and disk."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msbot
from msbot.doctor.facts import ClockFacts, WrittenFolder
from msbot.doctor.finding import NotSeen
from msbot.doctor.gather.opened import newest_record_s
from msbot.doctor.patient import Patient
from msbot_agent.process.user_folders import state_folder
from msbot_agent.text.sentence import said

MB = 1_000_000
CLOCK_ERROR = 5
"""What adjtimex(2) returns while the clock is not synchronised (TIME_ERROR)."""
TIMEX_OCTETS = 512
"""More than `struct timex` has; with modes 0 it is only written to."""


def clock(patient: Patient) -> ClockFacts:
    """The clock."""
    package = Path(str(msbot.__file__))
    return ClockFacts(time.time(), package.stat().st_mtime, _is_synchronised(), newest_record_s(patient))


def _is_synchronised() -> bool | NotSeen:
    if not sys.platform.startswith("linux"):
        return NotSeen(said("only Linux tells everybody whether a time server sets the clock"))
    library = ctypes.CDLL(None, use_errno=True)
    state = library.adjtimex(ctypes.create_string_buffer(TIMEX_OCTETS))
    if state < 0:
        return NotSeen(said("the kernel does not tell whether a time server sets the clock"))
    return bool(state != CLOCK_ERROR)


def disk(patient: Patient) -> tuple[WrittenFolder, ...]:
    """The folders that a robot writes to."""
    return tuple(_places(patient))


def _places(patient: Patient) -> Iterator[WrittenFolder]:
    file = patient.database_file
    folders = [("database", Path.cwd() if file is None else file.absolute().parent), ("recordings", state_folder())]
    for what, folder in folders:
        there = next(path for path in (folder, *folder.parents) if path.exists())
        if not hasattr(os, "statvfs"):  # Windows, where a disk has no bound of its own for the number of files
            usage = shutil.disk_usage(there)
            yield WrittenFolder(
                what, str(folder), usage.free / MB, usage.total / MB, 1.0, os.access(there, os.W_OK), False
            )
            continue
        room = os.statvfs(there)
        yield WrittenFolder(
            what=what,
            path=str(folder),
            free_mb=room.f_bavail * room.f_frsize / MB,
            size_mb=room.f_blocks * room.f_frsize / MB,
            free_files=room.f_favail / room.f_files if room.f_files else 1.0,
            is_writable=os.access(there, os.W_OK | os.X_OK),
            read_only=bool(room.f_flag & os.ST_RDONLY),
        )
