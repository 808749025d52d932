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
from msbot.doctor.finding import CannotSee, Examined, Unavailable
from msbot_agent.process.user_folders import state_folder
from msbot_agent.text.sentence import printable, said
from msbot_agent.text.untrusted_input import read_system_file

# The programs that run on this computer, as far as the system tells everybody.


def running_programs() -> Iterator[tuple[int, str]]:
    """`(process number, name)`; nothing where there is no /proc."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            yield int(folder.name), printable(read_system_file(folder / "comm").strip())
        except OSError:
            continue  # ended in the meantime


def command_line_of(pid: int) -> str:
    """The command line of a process; empty if it may not be read."""
    try:
        return printable(read_system_file(f"/proc/{pid}/cmdline").replace("\0", " ").strip())
    except OSError:
        return ""


def target_of(file: Path) -> str:
    """What an entry of /proc/PID/fd is; empty: it was closed in the meantime."""
    try:
        return os.readlink(file)
    except OSError:
        return ""


# What several checks read of the robot's database.


def database_of(patient: Examined) -> str:
    """The address of the database.

    Raises:
        CannotSee: there is none.
    """
    file = patient.database_file
    if patient.database is None or (file is not None and not file.exists()):
        raise CannotSee(said("there is no database yet: `msbot master` makes it, --db names another one"))
    return patient.database


def newest_record_s(patient: Examined) -> float | None:
    """The newest line of the journal, seconds since 1970; None: there is none."""
    try:
        address = database_of(patient)
    except CannotSee:
        return None
    from msbot.registry.maintenance.health import look_at_health

    newest_ns = look_at_health(address, thorough=False).newest_record_ns
    return None if newest_ns is None else newest_ns / 1e9


MB = 1_000_000
CLOCK_ERROR = 5
"""What adjtimex(2) returns while the clock is not synchronised (TIME_ERROR)."""
TIMEX_OCTETS = 512
"""More than `struct timex` has; with modes 0 it is only written to."""


def clock(patient: Examined) -> ClockFacts:
    """The clock."""
    package = Path(str(msbot.__file__))
    return ClockFacts(time.time(), package.stat().st_mtime, _is_synchronised(), newest_record_s(patient))


def _is_synchronised() -> bool | Unavailable:
    if not sys.platform.startswith("linux"):
        return Unavailable(said("only Linux tells everybody whether a time server sets the clock"))
    library = ctypes.CDLL(None, use_errno=True)
    state = library.adjtimex(ctypes.create_string_buffer(TIMEX_OCTETS))
    if state < 0:
        return Unavailable(said("the kernel does not tell whether a time server sets the clock"))
    return bool(state != CLOCK_ERROR)


def disk(patient: Examined) -> tuple[WrittenFolder, ...]:
    """The folders that a robot writes to."""
    return tuple(_places(patient))


def _places(patient: Examined) -> Iterator[WrittenFolder]:
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
