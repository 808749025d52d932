"""How a program of the same user sends STOP to a running master: one datagram there, one back.

Imports nothing that is slow to load. For the master's end, and why it has a socket of its own, see
`msbot.master.stop_socket`.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import secrets
import socket
import struct
import sys
import time
from collections.abc import Mapping
from enum import Enum, auto
from pathlib import Path
from typing import Final

from msbot.runtime.json_reading import read_json
from msbot.runtime.user_folders import socket_folder

IS_ABSTRACT: Final = sys.platform == "linux"
"""Whether such a socket needs no file."""
IS_THERE: Final = hasattr(socket, "AF_UNIX")
"""Whether the system has such sockets."""

ANSWER_S: Final = 5.0
"""How long a command waits for an answer; a master whose loop runs gives it within milliseconds."""
AGAIN_S: Final = 0.001
"""After so long a request is sent again that a master had no room for: its queue holds ten, and others may fill it."""

CREDENTIALS: Final = struct.Struct("3i")
"""Process, user and group of a sender, as the system reports them."""

GROUP_VARIABLE: Final = "MSBOT_STOP_GROUP"
"""A program with this variable set sends STOP only to masters with the same value; one without it reaches all."""
_PREFIX = "msbot-stop-"
MOST_OCTETS: Final = 1 << 18
"""Longest answer that is read."""

_log = logging.getLogger(__name__)


def ask_masters(request: Mapping[str, object], timeout_s: float = ANSWER_S) -> tuple[list[dict[str, object]], int]:
    """Send one request to every master of this user on this computer at once.

    A master that stands still may find the request when it goes on again. STOP is then still right; GO is not, as
    whoever said it was told that nobody answers: `expires` says until when it holds, by the system's monotonic clock.

    Args:
        request: `do`: `stop`, `go` or `status`; `who`, `reason`; `robot` (a name or serial number),
            `serial_number` and `database` select the masters, None = any.
        timeout_s: how long to wait for the slowest of them.

    Returns:
        The answers of the selected masters, and how many masters run but do not answer.
    """
    unsent = set(_names())
    if not unsent:
        return [], 0
    until = time.monotonic() + timeout_s
    octets = json.dumps({**request, "expires": until}).encode()
    answers: list[dict[str, object]] = []
    silent: set[str] = set()
    own = "" if IS_ABSTRACT else str(socket_folder() / f".asks-{os.getpid()}-{secrets.token_hex(2)}")
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
            if IS_ABSTRACT:
                asking.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
            asking.bind(own)
            while (unsent or silent) and (left := until - time.monotonic()) > 0:
                for name in tuple(unsent):
                    sent = _send(asking, name, octets)
                    if sent is not _Sent.NO_ROOM:
                        unsent.discard(name)
                    if sent is _Sent.YES:
                        silent.add(name)
                if not unsent and not silent:
                    break
                answer = _receive(asking, min(left, AGAIN_S) if unsent else left)
                if answer is None or answer[0] not in silent:
                    continue  # nothing yet, or another user has taken such a name
                silent.discard(answer[0])
                if answer[1].get("meant"):
                    answers.append(answer[1])
    except OSError as error:
        _log.debug("no further answer about STOP: %s", error)
    finally:
        if own:
            Path(own).unlink(missing_ok=True)
    return answers, len(silent | unsent)


class _Sent(Enum):
    YES = auto()
    NO_ROOM = auto()
    """The queue of the master is full: it stands still, or others fill it."""
    NOBODY = auto()
    """Nobody is there (any more)."""


def _send(asking: socket.socket, name: str, octets: bytes) -> _Sent:
    """Send a request, without waiting."""
    asking.setblocking(False)
    try:
        asking.sendto(octets, name)
    except BlockingIOError:
        return _Sent.NO_ROOM
    except OSError as error:
        if error.errno == errno.ENOBUFS:  # the same, on macOS
            return _Sent.NO_ROOM
        _log.debug("%r: %s", name, error)
        return _Sent.NOBODY
    return _Sent.YES


def _receive(asking: socket.socket, timeout_s: float) -> tuple[str, dict[str, object]] | None:
    """The next answer and the name it comes from; None: there is none, or it is not of this user."""
    asking.settimeout(timeout_s)
    try:
        octets, ancillary, _, sender = asking.recvmsg(MOST_OCTETS, socket.CMSG_SPACE(CREDENTIALS.size))
    except TimeoutError:
        return None
    if IS_ABSTRACT and not is_own(ancillary):
        return None
    answer = answer_in(octets)
    return None if answer is None else (os.fsdecode(sender), answer)


def answer_in(octets: bytes) -> dict[str, object] | None:
    """The answer in a datagram; None: it makes no sense."""
    try:
        answer = read_json(octets)
    except ValueError as error:
        _log.debug("an answer about STOP that makes no sense: %s", error)
        return None
    return answer if isinstance(answer, dict) else None


def new_name() -> str:
    """A name for the socket of this process.

    Raises:
        OSError: the folder for it cannot be made.
    """
    word = f"{_prefix()}{os.getpid()}-{secrets.token_hex(2)}"
    if IS_ABSTRACT:
        return f"\0{word}"
    place = socket_folder()
    place.mkdir(mode=0o700, parents=True, exist_ok=True)
    return str(place / f"{word}.sock")


def _names() -> list[str]:
    prefix = _prefix()
    if not IS_THERE:
        return []
    if not IS_ABSTRACT:
        return [str(path) for path in sorted(socket_folder().glob(f"{prefix}*.sock"))]
    try:
        lines = Path("/proc/net/unix").read_text().splitlines()
    except OSError:
        return []
    words = {line.rpartition(" ")[2] for line in lines if f"@{prefix}" in line}
    return sorted(f"\0{word[1:]}" for word in words if word.startswith(f"@{prefix}"))


def _prefix() -> str:
    group = "".join(letter for letter in os.environ.get(GROUP_VARIABLE, "") if letter.isalnum())[:32]
    return f"{_PREFIX}{_user()}-{group}{'-' if group else ''}"


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0


def withdraw(name: str) -> None:
    """Remove the file that such a name leaves behind."""
    if not IS_ABSTRACT:
        Path(name).unlink(missing_ok=True)


def is_own(ancillary: list[tuple[int, int, bytes]]) -> bool:
    """Whether the system says that the sender is this user, or root."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == socket.SCM_CREDENTIALS and len(data) >= CREDENTIALS.size:
            _, user, _ = CREDENTIALS.unpack_from(data)
            return user in (0, _user())
    return False
