"""Where recorders keep their rings, and which ring folders there are, of running robots and of others."""

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


def find_ring_folders(robot: str | None, database: str | None) -> list[Path]:
    """The ring folders that exist in this user's state folder, sorted by name; the robot may still run.

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
