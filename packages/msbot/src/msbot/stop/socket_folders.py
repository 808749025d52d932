"""Where the sockets for STOP are: in folders that only their user can write, and that every program of the user finds.

Nothing in the environment decides it (HOME, XDG folders, TMPDIR), so that any shell, cron and sudo find the same
masters. A master takes the first of these that it can use; whoever says STOP looks into all of them:

1. `/run/user/UID/msbot-stop-UID`, where the system keeps a folder for users who are signed in;
2. `/run/msbot-stop-...`, which systemd makes for a service of the computer (`RuntimeDirectory=`), or root for itself;
3. `/tmp/msbot-stop-UID`, or `/tmp/msbot-stop-UID-...` if somebody else has taken that name.

A folder counts if it is one (no link), belongs to the user, and nobody else may do anything in it. It is opened,
checked, and used by its descriptor: what was checked is what is used.
"""

from __future__ import annotations

import errno
import os
import secrets
import socket
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Final

from msbot_xrce.lazy import dataclass

IS_LINUX: Final = sys.platform == "linux"
IS_THERE: Final = hasattr(socket, "AF_UNIX")
"""Whether the system has such sockets."""
USERS_FOLDER: Final = "/run/user"
SYSTEM_FOLDER: Final = "/run"
SHARED_FOLDER: Final = "/tmp"  # noqa: S108 - each folder in it is checked
PREFIX: Final = "msbot-stop-"
MOST_FOLDERS: Final = 64
"""So many folders of one user in one place are looked into."""


def own_user() -> int:
    """The number of the user that this program acts for; 0 where the system has none."""
    return os.geteuid() if hasattr(os, "geteuid") else 0


@dataclass(frozen=True, slots=True)
class StopFolder:
    """A folder for sockets that is one user's alone, open."""

    path: str
    descriptor: int
    owner: int

    def address(self, name: str) -> str:
        """What a socket of that name is bound or connected to: short, and in the folder that was checked."""
        if IS_LINUX and os.access("/proc/self/fd", os.X_OK):
            return f"/proc/self/fd/{self.descriptor}/{name}"
        return f"{self.path}/{name}"

    def names(self) -> list[str]:
        """What is in it, but for what is not ready yet."""
        return sorted(name for name in os.listdir(self.descriptor) if not name.startswith("."))

    def remove(self, name: str) -> None:
        """Remove a socket at which nobody listens any more; what is no socket stays."""
        with suppress(OSError):
            if stat.S_ISSOCK(os.stat(name, dir_fd=self.descriptor, follow_symlinks=False).st_mode):
                os.unlink(name, dir_fd=self.descriptor)

    def close(self) -> None:
        """Give the descriptor back."""
        os.close(self.descriptor)


def open_folder(path: str, owner: int) -> StopFolder | None:
    """That folder, if it is there and that user's alone.

    Raises:
        OSError: no descriptor is left.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):
            raise
        return None  # nothing, a link, a file, or closed to us: nobody's folder for STOP
    info = os.fstat(descriptor)
    if info.st_mode & 0o077 or info.st_uid != owner:
        os.close(descriptor)
        return None
    return StopFolder(path, descriptor, info.st_uid)


def own_folder() -> StopFolder:
    """The folder that a master of this user takes, made if need be.

    Raises:
        OSError: there is none, and none can be made.
    """
    own = own_user()
    usual = f"{PREFIX}{own}"
    in_run, in_tmp = f"{USERS_FOLDER}/{own}", SHARED_FOLDER
    made = open_folder(f"{in_run}/{usual}", own) or _made(f"{in_run}/{usual}")
    made = made or next(_opened(own, _names_in(SYSTEM_FOLDER, PREFIX), SYSTEM_FOLDER), None)
    made = made or _made(f"{SYSTEM_FOLDER}/{usual}")
    made = made or next(_opened(own, (usual, *_names_in(in_tmp, f"{usual}-")), in_tmp), None)
    made = made or _made(f"{in_tmp}/{usual}") or _made(f"{in_tmp}/{usual}-{secrets.token_hex(4)}")
    if made is None:
        raise OSError(errno.ENOENT, f"no folder can be made for it, neither in /run nor in {in_tmp}")
    return made


def _made(path: str) -> StopFolder | None:
    try:
        os.mkdir(path, 0o700)
    except OSError:
        return None  # there is no such place, it is full, or somebody else has taken the name
    return open_folder(path, own_user())


@dataclass(frozen=True, slots=True)
class Search:
    """Where sockets of a user may be; looking there may take as long as whoever has made it wants."""

    user: int
    where: str
    """In words."""
    paths: tuple[str, ...]

    def folders(self) -> Iterator[StopFolder]:
        """Those that are the user's alone, one after the other; each is to be closed."""
        count = 0
        for path in self.paths:
            if (folder := open_folder(path, self.user)) is not None:
                yield folder
                count += 1
                if count == MOST_FOLDERS:
                    return


def searches(users: Sequence[int]) -> Iterator[Search]:
    """Where sockets of these users may be; first the places that nobody else can write to."""
    in_run = _names_in(SYSTEM_FOLDER, PREFIX)
    for user in users:
        usual = f"{USERS_FOLDER}/{user}/{PREFIX}{user}"
        yield Search(user, SYSTEM_FOLDER, (usual, *(f"{SYSTEM_FOLDER}/{name}" for name in in_run)))
    in_tmp = _names_in(SHARED_FOLDER, PREFIX)
    for user in users:
        usual = f"{PREFIX}{user}"
        if usual in in_tmp:
            yield Search(user, SHARED_FOLDER, (f"{SHARED_FOLDER}/{usual}",))
        others = [f"{SHARED_FOLDER}/{name}" for name in in_tmp if name.startswith(f"{usual}-")]
        if others:
            yield Search(user, SHARED_FOLDER, tuple(others))


def users_meant() -> list[int]:
    """Whose robots a STOP of this program reaches: its own; from root, those of everybody who runs anything."""
    own = own_user()
    if own != 0:
        return [own]
    found = {int(name) for name in _names_in(USERS_FOLDER, "") if name.isascii() and name.isdecimal()}
    for name in _names_in("/proc", ""):
        if name.isascii() and name.isdecimal():
            with suppress(OSError):  # it has ended
                found.add(os.stat(f"/proc/{name}").st_uid)
    return [own, *sorted(found - {own})]


def _opened(owner: int, names: Sequence[str], base: str) -> Iterator[StopFolder]:
    for name in names:
        if (folder := open_folder(f"{base}/{name}", owner)) is not None:
            yield folder


def _names_in(base: str, start: str) -> list[str]:
    try:
        return sorted(name for name in os.listdir(base) if name.startswith(start))
    except OSError:
        return []
