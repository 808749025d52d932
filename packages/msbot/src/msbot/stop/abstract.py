"""Names of sockets for STOP that need no folder: what remains on Linux where none can be had (a full disk).

Everybody on the computer may listen at such a name and connect to it. So both ends check who the other one is before
anything is read or sent, names are read as octets, and a name that cannot be connected to counts as a master only if a
process of the user holds it.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from msbot.stop.places import IS_LINUX, PREFIX

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
