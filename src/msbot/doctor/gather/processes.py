"""The programs that run on this computer, as far as the system tells everybody."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path


def running_programs() -> Iterator[tuple[int, str]]:
    """`(process number, name)`; nothing where there is no /proc."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            yield int(folder.name), (folder / "comm").read_text().strip()
        except OSError:
            continue  # ended in the meantime


def program_of(pid: int) -> str:
    """The command line of a process; empty if it may not be read."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace").strip()
    except OSError:
        return ""


def target_of(file: Path) -> str:
    """What an entry of /proc/PID/fd is; empty: it was closed in the meantime."""
    try:
        return os.readlink(file)
    except OSError:
        return ""
