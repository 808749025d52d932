"""Where recorders have their rings, and which of them are left of robots that do not run any more."""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path

from msbot_agent.process.user_folders import state_folder


def ring_folder(robot: str, database: str) -> Path:
    """Where the recorder of that robot has its ring.

    Args:
        robot: its name.
        database: what `database_identity` says of its database.
    """
    return _rings() / f"{_words(robot)}-{_mark(database)}"


def rings_left(robot: str | None, database: str | None) -> list[Path]:
    """The folders of rings that this user's recorders have written, by name.

    Args:
        robot: only those of robots of this name; None: of any.
        database: only those of robots in this database; None: in any.
    """
    if not _rings().is_dir():
        return []
    return [
        folder
        for folder in sorted(_rings().iterdir())
        if (robot is None or folder.name.rpartition("-")[0] == _words(robot))
        and (database is None or folder.name.endswith(f"-{_mark(database)}"))
    ]


def _rings() -> Path:
    return state_folder() / "recordings"


def _words(robot: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", robot).strip("-")[:40] or "robot"


def _mark(database: str) -> str:
    return sha256(database.encode()).hexdigest()[:8]
