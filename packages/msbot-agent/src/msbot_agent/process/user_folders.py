"""The folders of this user: for state that survives a restart, for what running programs leave each other, and for
settings.

`platformdirs` knows the rules of each system (XDG base directories on Linux).
"""

from __future__ import annotations

import logging
import os
import platform
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from msbot_xrce.errors import ConfigError

APP = "msbot"

_log = logging.getLogger(__name__)
_told: set[Path] = set()
"""Folders of which a warning was given."""


def state_folder() -> Path:
    """Where this user's programs keep the state that must survive a restart: `$XDG_STATE_HOME/msbot` on Linux."""
    from platformdirs import user_state_path  # `msbot --help` needs no folder

    return user_state_path(APP, appauthor=False)


def cache_folder() -> Path:
    """Where this user's programs keep what they can make anew: `$XDG_CACHE_HOME/msbot` on Linux."""
    from platformdirs import user_cache_path  # as above

    return user_cache_path(APP, appauthor=False)


def settings_folder(program: str) -> Path:
    """Where another program looks for this user's settings: `$XDG_CONFIG_HOME/PROGRAM` on Linux."""
    from platformdirs import user_config_path  # as above

    return user_config_path(program, appauthor=False)


def running_folder() -> Path:
    """Where this user's running programs leave information for each other: `$XDG_RUNTIME_DIR/msbot`.

    If that variable is not set, it is a folder among the temporary files. The choice of `platformdirs` would not do: it
    depends on who is logged in at the moment, so programs could miss each other. Anybody can make a folder of that name
    first: then it is one in the user's home, for this computer (homes may be shared), and stays so, that programs which
    start when the other one is gone find those that run.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / APP
    owner = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    usual = Path(tempfile.gettempdir()) / f"{APP}-{owner}"
    instead = Path.home() / ".local" / "state" / APP / f"running-{platform.node() or 'here'}"
    if not _is_somebody_elses(usual):
        return instead if instead.is_dir() else usual
    try:
        make_own_folder(instead)
        check_owner(instead)
    except (OSError, ConfigError) as error:
        _log.warning("%s is not yours alone, and there is no other place: %s", usual, error)
        return usual
    if usual not in _told:
        _told.add(usual)
        _log.warning("%s is not yours alone: %s is used in its place", usual, instead)
    return instead


def _is_somebody_elses(folder: Path) -> bool:
    try:
        check_owner(folder)
    except FileNotFoundError:
        return False
    except (OSError, ConfigError):
        return True
    return False


def check_owner(folder: Path) -> None:
    """Make sure that a folder is the user's own; if others can write to it, a file in it may be anybody's.

    Raises:
        ConfigError: it is not.
    """
    if not hasattr(os, "getuid"):
        return
    info = folder.lstat()
    if not stat.S_ISDIR(info.st_mode) or info.st_uid != os.getuid() or info.st_mode & 0o077:
        raise ConfigError(f"{folder} is not a folder that belongs to you alone: remove it")


def make_own_folder(folder: Path) -> None:
    """Make a folder for this user alone, and those above it that are missing, whatever the umask is.

    Who may write to a folder above could put one of their own in the place of this one.

    Raises:
        OSError: it cannot be made.
    """
    missing = []
    for one in (folder, *folder.parents):
        if one.exists():
            break
        missing.append(one)
    for one in (*reversed(missing), folder):
        one.mkdir(mode=0o700, exist_ok=True)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all; one that is there already keeps its rights.

    In a folder that others may write to, it is not written through a link that somebody else has put there.

    Raises:
        OSError: it cannot be written.
    """
    import secrets  # most programs write no such file

    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    stream = draft.open("xb")
    try:
        with stream:
            stream.write(content)
        with suppress(FileNotFoundError):
            draft.chmod(path.stat().st_mode)
        draft.replace(path)
    except OSError:
        draft.unlink(missing_ok=True)
        raise


def is_running(pid: int) -> bool:
    """Whether there is a process with that number; True where the system cannot tell."""
    if os.name != "posix":
        return True  # on this system, signal 0 would do more than ask
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


# Keeps this user's processes from changing the files of one folder at the same time.


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Be the only one of this user's programs, and of the threads of this one, that changes files there.

    For what takes microseconds. Windows has no lock of a folder: there it keeps nobody out.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


# Which code is MsBOT's own: six distributions, each with a package of its own.


PACKAGES = ("msbot_xrce", "msbot_agent", "msbot", "msbot_school", "msbot_bridges", "msbot_web")
"""The import packages, from the lowest up."""
UNDIVIDED = {"msbot_xrce": "xrce", "msbot_web": "web"}
"""Packages that count as one room each; the others are divided into rooms."""


def room_of(name: str) -> str:
    """The room of MsBOT that a module belongs to; the package, for other modules."""
    package, _, rest = name.partition(".")
    if package not in PACKAGES:
        return package
    return UNDIVIDED.get(package) or rest.partition(".")[0] or package


def own_folders() -> tuple[str, ...]:
    """The folders of those that this program has loaded."""
    loaded = (sys.modules.get(name) for name in PACKAGES)
    return tuple(str(Path(one.__file__).parent) for one in loaded if one is not None and one.__file__)
