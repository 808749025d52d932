"""The folder in which this user's running programs leave word for each other, and who may write there."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from msbot.errors import ConfigError


def user_folder() -> Path:
    """The user's folder for such files: `$XDG_RUNTIME_DIR/msbot`, or one in the folder for temporary files."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "msbot"
    owner = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    return Path(tempfile.gettempdir()) / f"msbot-{owner}"


def check_owner(folder: Path) -> None:
    """Make sure that a folder is the user's own; in one that others can write to, a file may be anybody's.

    Raises:
        ConfigError: it is not.
    """
    if not hasattr(os, "getuid"):
        return
    info = folder.lstat()
    if not stat.S_ISDIR(info.st_mode) or info.st_uid != os.getuid() or info.st_mode & 0o077:
        raise ConfigError(f"{folder} is not a folder that belongs to you alone: remove it")


def is_running(pid: int) -> bool:
    """Whether there is a process with that number; taken to be so where it cannot be found out."""
    if os.name != "posix":
        return True  # there, a signal 0 would be more than a question
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
