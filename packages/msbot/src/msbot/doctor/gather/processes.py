"""The programs that run on this computer, as far as the system tells everybody."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from msbot_agent.text.given_file import read_of_system
from msbot_agent.text.printable import printable


def running_programs() -> Iterator[tuple[int, str]]:
    """`(process number, name)`; nothing where there is no /proc."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            yield int(folder.name), printable(read_of_system(folder / "comm").strip())
        except OSError:
            continue  # ended in the meantime


def program_of(pid: int) -> str:
    """The command line of a process; empty if it may not be read."""
    try:
        return printable(read_of_system(f"/proc/{pid}/cmdline").replace("\0", " ").strip())
    except OSError:
        return ""


def target_of(file: Path) -> str:
    """What an entry of /proc/PID/fd is; empty: it was closed in the meantime."""
    try:
        return os.readlink(file)
    except OSError:
        return ""
