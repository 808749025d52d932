"""The socket at which a master takes STOP: where it is, and that it stays there (`msbot.stop.socket_folders`)."""

from __future__ import annotations

import os
import secrets
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from msbot.stop.socket_folders import IS_LINUX, PREFIX, StopFolder, own_folder, own_user
from msbot.stop.socket_names import SocketName, name_in
from msbot_xrce.lazy import dataclass

# Names of sockets for STOP that need no folder: what remains on Linux where none can be had (a full disk).
#
# Everybody on the computer may listen at such a name and connect to it. So both ends check who the other one is
# before anything is read or sent, names are read as octets, and a name that cannot be connected to counts as a master
# only if a process of the user holds it.


_LISTENING: Final = b"00010000"
_INODE_FIELD: Final = 6
_NAME_FIELD: Final = 7
_PEER: Final = struct.Struct("3i")


def peer_of(connection: socket.socket) -> tuple[int, int]:
    """Process and user at the other end of a connection, as the system says; (0, -1): it does not."""
    if not hasattr(socket, "SO_PEERCRED"):
        return 0, -1
    pid, user, _ = _PEER.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
    return pid, user


def abstract_address(user: int, name: str) -> str:
    """The address of that name."""
    return f"\0{PREFIX}{user}-{name}"


def abstract_names(user: int) -> Iterator[tuple[str, int]]:
    """Names at which somebody listens, perhaps masters of that user, each with the number of its socket."""
    if not IS_LINUX:
        return
    try:
        lines = Path("/proc/net/unix").read_bytes().splitlines()
    except OSError:
        return
    start = b"@" + f"{PREFIX}{user}-".encode()
    for line in lines:
        fields = line.split(maxsplit=_NAME_FIELD)
        if len(fields) <= _NAME_FIELD or not fields[_NAME_FIELD].startswith(start) or fields[3] != _LISTENING:
            continue
        with suppress(UnicodeDecodeError):  # ours are ASCII
            yield fields[_NAME_FIELD][len(start) :].decode("ascii"), int(fields[_INODE_FIELD])


def held_by(user: int) -> set[int]:
    """The numbers of all sockets that processes of that user have open."""
    found: set[int] = set()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended, or is not to be looked into
            if process.stat().st_uid != user:
                continue
            for one in os.scandir(process / "fd"):
                with suppress(OSError, ValueError):
                    target = os.readlink(one.path)
                    if target.startswith("socket:["):
                        found.add(int(target[len("socket:[") : -1]))
    return found


BACKLOG: Final = 128


@dataclass(frozen=True, slots=True)
class StopListener:
    """A socket that listens, and its name."""

    socket: socket.socket
    name: SocketName
    folder: StopFolder | None
    """None: an abstract name."""
    inode: int

    def is_in_place(self) -> bool:
        """Whether who looks for it finds it; an abstract name is a makeshift."""
        if self.folder is None:
            return False
        try:
            folder, file = os.lstat(self.folder.path), os.lstat(f"{self.folder.path}/{self.name}")
        except OSError:
            return False
        return folder.st_ino == os.fstat(self.folder.descriptor).st_ino and file.st_ino == self.inode

    def close(self) -> None:
        """Listen no more, and leave nothing behind."""
        if self.folder is not None:
            self.folder.remove(str(self.name))
        self.socket.close()
        if self.folder is not None:
            self.folder.close()


def listen(name: SocketName) -> StopListener:
    """Listen under that name, in a folder if there can be one, and remove what dead masters left in it.

    Raises:
        OSError: nothing of it can be.
    """
    try:
        folder = own_folder()
    except OSError:
        if not IS_LINUX:
            raise
        return _listen_without_folder(name)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    draft = f".{secrets.token_hex(8)}"
    try:
        _remove_dead(folder)
        listening.bind(folder.address(draft))
        listening.listen(BACKLOG)
        listening.setblocking(False)
        inode = os.stat(draft, dir_fd=folder.descriptor, follow_symlinks=False).st_ino
        # Who connects is refused until it listens, and would take it for dead: it has its name only from now on.
        os.rename(draft, str(name), src_dir_fd=folder.descriptor, dst_dir_fd=folder.descriptor)
    except OSError:
        folder.remove(draft)
        listening.close()
        folder.close()
        if not IS_LINUX:
            raise
        return _listen_without_folder(name)
    return StopListener(listening, name, folder, inode)


def _listen_without_folder(name: SocketName) -> StopListener:
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listening.bind(abstract_address(own_user(), str(name)))
        listening.listen(BACKLOG)
        listening.setblocking(False)
    except OSError:
        listening.close()
        raise
    return StopListener(listening, name, None, 0)


def _remove_dead(folder: StopFolder) -> None:
    """Remove the sockets of masters that were killed: nobody listens there."""
    for text in folder.names():
        if name_in(text) is None:
            continue
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as trying:
            trying.setblocking(False)
            try:
                trying.connect(folder.address(text))
            except ConnectionRefusedError:
                folder.remove(text)
            except OSError:
                continue  # it is alive and busy, or has just ended
