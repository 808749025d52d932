"""How a program of the same user sends STOP to running masters: a connection to each, all at the same time.

Imports nothing that is slow to load. For the master's end see `msbot.master.stop_socket`, for where the sockets are
`msbot.stop.socket_folders`.

Each connection goes its own way: connect (again, while the master's queue is full), see that the other end is the user
whose folder it is, send one line, read one line. The answer must repeat a word that the request has brought. A refused
connection means that the master is dead, and its socket is removed. A connection that is closed without an answer is
made anew, except for GO, which may have been obeyed. What is looked for in places where others can write is done in a
thread of its own: whoever makes such a place slow delays nobody's STOP.
"""

from __future__ import annotations

import errno
import json
import logging
import secrets
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from typing import Final

from msbot.stop.socket_folders import IS_LINUX, IS_THERE, Search, own_user, searches, users_meant
from msbot.stop.socket_names import SocketName, name_in, own_group
from msbot.stop.stop_listener import abstract_address, abstract_names, held_by, peer_of
from msbot_agent.text.sentence import printable
from msbot_agent.text.untrusted_input import read_program_json
from msbot_xrce.lazy import dataclass

_NO_ROOM: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_GRACE_S: Final = 0.1
"""How much longer than its time a thread is waited for."""
ANSWER_S: Final = 5.0
"""How long a command waits for an answer; a master whose loop runs gives it within milliseconds."""
AGAIN_S: Final = 0.002
"""After so long a connection is tried again for which there was no room."""
_CLOSED_S: Final = 0.02
"""The same for one that was closed without an answer."""
MOST_AT_ONCE: Final = 256
"""Connections that one search has open at a time."""
MOST_OCTETS: Final = 1 << 18
"""Longest answer that is read."""
_ONE_READ: Final = 1 << 16
LONGEST_WORDS: Final = 200
"""Letters of a reason, and of who says it, that are sent: STOP is refused for no text, however long."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class SilentMaster:
    """A master that runs and gives no answer, as far as its socket says who it is."""

    name: SocketName | None
    """None: nothing is known, as `where` does not answer."""
    pid: int
    user: int
    where: str = ""

    def __str__(self) -> str:
        """In words."""
        owner = "" if self.user == own_user() else f" of {user_words(self.user)}"
        if self.name is None:
            return f"whatever has its socket in {self.where}{owner}"
        return f"{printable(self.name.robot) or 'a robot'} (process {self.pid}{owner})"


def user_words(user: int) -> str:
    """A user of the computer, for people."""
    try:
        from pwd import getpwuid  # not everywhere

        return f"user {getpwuid(user).pw_name}"
    except (ImportError, KeyError):
        return f"user {user}"


def ask_masters(
    request: Mapping[str, object], timeout_s: float = ANSWER_S, group: str | None = None
) -> tuple[list[dict[str, object]], list[SilentMaster]]:
    """Send one request to every master of this user on this computer at once; root reaches those of all users.

    A master that stands still may find the request when it goes on again. STOP is then still right; GO is not, as
    whoever said it was told that nobody answers: `expires` says until when it holds, by the system's monotonic clock.

    Args:
        request: `do`: `stop`, `go` or `status`; `who`, `reason`, `page_of` (on whose page it is
            said; none: in a terminal); `robot` (a name or serial number),
            `serial_number` and `database` select the masters, None = any.
        timeout_s: how long to wait for the slowest of them.
        group: only masters of this STOP group; empty: all; None: as `$MSBOT_STOP_GROUP` says.

    Returns:
        The answers of the selected masters, and those that run but do not answer.

    Raises:
        ConfigError: the variable names no group.
    """
    if not IS_THERE:
        return [], []
    group = own_group() if group is None else group
    until = time.monotonic() + timeout_s
    asking = _StopRequest({**request, "expires": until}, until, group)
    users = users_meant()
    running: list[tuple[threading.Thread, Search]] = []
    for search in (*searches(users), *(Search(user, "", ()) for user in users if IS_LINUX)):
        thread = threading.Thread(target=asking.ask, args=(search,), name="msbot stop", daemon=True)
        try:
            thread.start()
        except RuntimeError:  # there can be no more threads
            asking.ask(search)
        else:
            running.append((thread, search))
    for thread, search in running:
        thread.join(max(0.0, until - time.monotonic()) + _GRACE_S)
        if thread.is_alive():
            asking.silent.append(SilentMaster(None, 0, search.user, search.where))
    return list(asking.answers), list(asking.silent)


def answer_in(octets: bytes, word: str) -> dict[str, object] | None:
    """The answer in a line; None: it makes no sense, or is none to the request with that word."""
    try:
        answer = read_program_json(octets)
    except ValueError as error:
        _log.debug("an answer about STOP that makes no sense: %s", error)
        return None
    return answer if isinstance(answer, dict) and answer.pop("nonce", None) == word else None


class _MasterConnection:
    """The connection to one master."""

    def __init__(self, address: str, name: SocketName, user: int, dead: Callable[[], None], inode: int = 0) -> None:
        self.address, self.name, self.user, self.dead = address, name, user, dead
        self.inode = inode
        """Of an abstract name; 0: it is in a folder."""
        self.pid = 0
        self.heard = b""
        self.again_at = 0.0
        """When it may be tried again."""
        self.connection: socket.socket | None = None

    def close(self) -> None:
        if self.connection is not None:
            self.connection.close()
        self.connection, self.heard = None, b""

    def silent(self) -> SilentMaster:
        return SilentMaster(self.name, self.pid or self.name.pid, self.user)


class _StopRequest:
    """One request to many masters; each search has a thread of its own."""

    def __init__(self, request: Mapping[str, object], until: float, group: str) -> None:
        self.answers: list[dict[str, object]] = []
        self.silent: list[SilentMaster] = []
        self._word = secrets.token_hex(8)
        words = {
            name: str(request[name] or "")[:LONGEST_WORDS] for name in ("who", "reason", "page_of") if name in request
        }
        self._line = json.dumps({**request, **words, "nonce": self._word}).encode() + b"\n"
        self._is_go = request.get("do") == "go"
        self._until = until
        self._group, self._robot, self._database = group, request.get("robot"), request.get("database")

    def ask(self, search: Search) -> None:
        """Everybody who is found there."""
        with ExitStack() as folders, selectors.PollSelector() as selector:
            waiting: deque[_MasterConnection] = deque()
            asked: set[_MasterConnection] = set()
            held: set[int] | None = None
            for line in self._found(search, folders):
                waiting.append(line)
                self._go_on(waiting, asked, selector)
            while (waiting or asked) and (left := self._until - time.monotonic()) > 0:
                stuck = [line for line in waiting if line.inode]
                if stuck and held is None:
                    held = held_by(search.user)
                for line in stuck:
                    if held is not None and line.inode not in held:
                        waiting.remove(line)  # somebody else's
                may_begin = waiting and len(asked) < MOST_AT_ONCE
                for key, _ in selector.select(min(left, AGAIN_S) if may_begin else left):
                    self._read(key.data, waiting, asked, selector)
                for _ in range(len(waiting)):
                    self._go_on(waiting, asked, selector)
            for line in (*asked, *waiting):
                self.silent.append(line.silent())
                line.close()

    def _found(self, search: Search, folders: ExitStack) -> Iterator[_MasterConnection]:
        if not search.paths:
            for text, inode in abstract_names(search.user):
                if (name := self._meant(text)) is not None:
                    address = abstract_address(search.user, text)
                    yield _MasterConnection(address, name, search.user, lambda: None, inode)
            return
        for folder in search.folders():
            folders.callback(folder.close)
            for text in folder.names():
                if (name := self._meant(text)) is None:
                    continue
                is_own = folder.owner == own_user()
                dead = partial(folder.remove, text) if is_own else lambda: None
                yield _MasterConnection(folder.address(text), name, folder.owner, dead)

    def _meant(self, text: str) -> SocketName | None:
        name = name_in(text)
        is_meant = name is not None and self._group in ("", name.group) and name.may_be(self._robot, self._database)
        return name if is_meant else None

    def _go_on(
        self, waiting: deque[_MasterConnection], asked: set[_MasterConnection], selector: selectors.BaseSelector
    ) -> None:
        """Connect to the first that waits, and send the request."""
        if len(asked) >= MOST_AT_ONCE:
            return
        line = waiting.popleft()
        if line.again_at > time.monotonic():
            waiting.append(line)
            return
        try:
            line.connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            line.connection.setblocking(False)
            line.connection.connect(line.address)
            if IS_LINUX:
                line.pid, user = peer_of(line.connection)
                if user != line.user:
                    _log.debug("%r belongs to user %d", line.address, user)
                    line.close()
                    return
            line.connection.sendall(self._line)
        except ConnectionRefusedError:
            line.close()
            line.dead()
        except OSError as error:
            line.close()
            if isinstance(error, BlockingIOError | ConnectionError) or error.errno in _NO_ROOM:
                waiting.append(line)
            else:
                _log.debug("%r: %s", line.address, error)  # it has just ended, or is no socket
        else:
            asked.add(line)
            selector.register(line.connection, selectors.EVENT_READ, line)

    def _read(
        self,
        line: _MasterConnection,
        waiting: deque[_MasterConnection],
        asked: set[_MasterConnection],
        selector: selectors.BaseSelector,
    ) -> None:
        assert line.connection is not None
        try:
            octets = line.connection.recv(_ONE_READ)
        except BlockingIOError:
            return
        except OSError:
            octets = b""
        line.heard += octets
        is_whole = line.heard.endswith(b"\n")
        if octets and not is_whole and len(line.heard) <= MOST_OCTETS:
            return
        selector.unregister(line.connection)
        asked.discard(line)
        answer = answer_in(line.heard, self._word) if is_whole else None
        line.close()
        if answer is not None:
            if answer.get("meant"):
                self.answers.append(answer | {"user": line.user})
        elif octets or self._is_go:
            self.silent.append(line.silent())
        else:  # it had to close the connection for others; asked twice, STOP is the same
            line.again_at = time.monotonic() + _CLOSED_S
            waiting.append(line)
