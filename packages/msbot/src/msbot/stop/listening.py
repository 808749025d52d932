"""The socket at which a master takes STOP: where it is, and that it stays there (`msbot.stop.places`)."""

from __future__ import annotations

import os
import secrets
import socket
from typing import Final

from msbot.stop.abstract import abstract_address
from msbot.stop.names import SocketName, name_in
from msbot.stop.places import IS_LINUX, StopFolder, own_folder, own_user
from msbot_xrce.common.lazy_dataclass import dataclass

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
