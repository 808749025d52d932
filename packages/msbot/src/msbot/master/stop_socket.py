"""The channel by which STOP always reaches a master: a socket of its own, for the user's other programs.

It is in a folder that only the user can write (`msbot.stop.socket_folders`), and looked after: if the folder is gone,
the master makes it anew. Who connects is looked at before anything is read: only programs of the same user, and root.
Where there are no such sockets at all, `msbot stop` goes the same way as all other commands.

A connection brings one request, a JSON object on a line, and gets one answer: `stop`, `go`, `status`. Nothing of it can
run out: there are at most `MOST_LINES` connections, whose descriptors are held in reserve; when one more comes, the
oldest that has said nothing goes, or the oldest that waits for its answer gets it now; no thread is needed, and no
connection lasts longer than `LINE_S`. The other end is `msbot.stop.stop_request`.
"""

from __future__ import annotations

import asyncio
import errno
import json
import logging
import os
import socket
from collections.abc import Callable, Mapping
from enum import Enum, auto
from math import inf
from time import monotonic
from typing import Final

from msbot.master.master import Master
from msbot.pnp import StopStatus
from msbot.stop.socket_folders import IS_LINUX, IS_THERE, own_user
from msbot.stop.socket_names import new_name
from msbot.stop.stop_listener import StopListener, listen, peer_of
from msbot_agent.text.sentence import said, whole
from msbot_agent.text.untrusted_input import read_program_json
from msbot_xrce.errors import ConfigError

# File descriptors held in reserve, for what must work when a process has no others left.


_log = logging.getLogger(__name__)


class DescriptorReserve:
    """Holds some descriptors, and gives them back when they are needed.

    Args:
        most: how many.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._held: list[int] = []
        self.fill()

    def fill(self) -> None:
        """Hold as many again, as far as there are any."""
        try:
            while len(self._held) < self._most:
                self._held.append(os.open(os.devnull, os.O_RDONLY))
        except OSError as error:
            _log.debug("no descriptor can be held in reserve: %s", error)

    def free_one(self) -> None:
        """Release one for the moment, if any is held."""
        if self._held:
            os.close(self._held.pop())

    def free(self) -> None:
        """Release all of them."""
        while self._held:
            os.close(self._held.pop())


MAX_REQUEST: Final = 1 << 16
MAX_ANSWER: Final = 150_000
"""Largest answer in octets; names of parts that do not fit are left out, and counted in `left_out`."""
MARGIN: Final = 20
"""Octets for the count of what is left out."""
PER_TURN: Final = 8
"""Connections that are taken in one turn of the loop."""
MOST_LINES: Final = 16
LINE_S: Final = 4.0
"""How long a connection lasts at most; longer than STOP waits to be stored, and shorter than anybody waits."""
LOOK_S: Final = 1.0
"""How often the socket's place is looked at."""
REST_S: Final = 0.01


class StopSocket:
    """Accepts STOP and GO for one master from programs of the same user (and of root).

    Args:
        master: the robot.
        details: what other programs need to find the robot: its name, serial number and database.
    """

    def __init__(self, master: Master, details: Callable[[], Mapping[str, str]]) -> None:
        self.refused = 0
        """Connections from other users."""
        self._master = master
        self._details = details
        self._lines: dict[_Connection, None] = {}
        """The open connections, the oldest first."""
        self._reserve = DescriptorReserve(MOST_LINES)
        self._listener: StopListener | None = None
        self._called: tuple[str, str, str] | None = None
        """What it listens for: the robot, its STOP group and its database."""
        self._resting: asyncio.TimerHandle | None = None

    async def run(self) -> None:
        """Serve until cancelled; logs a warning where that is not possible, and tries again."""
        if not IS_THERE:
            return
        said_trouble = ""
        try:
            while True:
                try:
                    self._keep_in_place()
                except OSError as error:
                    if str(error) != said_trouble:
                        _log.warning("`msbot stop` has only the ordinary way to this process: %s", error)
                    said_trouble = str(error)
                await asyncio.sleep(LOOK_S)
        finally:
            self._stop_listening()
            for line in tuple(self._lines):
                self._close(line)
            self._reserve.free()

    def _keep_in_place(self) -> None:
        """Listen where others look for it: folders are cleaned, users sign out, robots change their names.

        Raises:
            OSError: there is no way to listen.
        """
        known, group = self._details(), self._master.stop_group
        robot = f"{known.get('robot', '')} {known.get('serial_number', '')}".strip()
        called, now = (robot, group, known.get("database", "")), self._listener
        if now is not None and called == self._called and now.is_in_place():
            return
        new = listen(new_name(*called))
        if now is not None and new.folder is None and now.folder is None and now.name.group == group:
            new.close()  # there is still no folder, and nothing to gain
            return
        self._stop_listening()
        self._listener, self._called = new, called
        asyncio.get_running_loop().add_reader(new.socket, self._readable)
        if new.folder is None:
            _log.warning("there is no folder for the socket of STOP (a full disk?): it has a name without one")

    def _stop_listening(self) -> None:
        if self._resting is not None:
            self._resting.cancel()
            self._resting = None
        if self._listener is not None:
            asyncio.get_running_loop().remove_reader(self._listener.socket)
            self._listener.close()
            self._listener = None

    def _readable(self) -> None:
        listener = self._listener
        assert listener is not None
        for _ in range(PER_TURN):
            try:
                connection = self._accepted(listener.socket)
            except BlockingIOError:
                return
            except OSError as error:
                _log.debug("a connection for STOP could not be taken: %s", error)
                self._rest(listener)
                return
            connection.setblocking(False)
            if IS_LINUX and peer_of(connection)[1] not in (0, own_user()):
                self.refused += 1
                connection.close()
                continue
            self._make_room()
            line = _Connection(connection)
            self._lines[line] = None
            line.timer = asyncio.get_running_loop().call_later(LINE_S, self._close, line)
            self._read(line)

    def _accepted(self, listening: socket.socket) -> socket.socket:
        try:
            return listening.accept()[0]
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE):
                raise
            self._reserve.free_one()
            return listening.accept()[0]

    def _rest(self, listener: StopListener) -> None:
        """Not even a reserved descriptor helps: try again in a moment, not in every turn of the loop."""
        loop = asyncio.get_running_loop()
        loop.remove_reader(listener.socket)
        self._resting = loop.call_later(REST_S, loop.add_reader, listener.socket, self._readable)

    def _make_room(self) -> None:
        """There are never more connections than there is room for: the oldest that has said nothing is closed, or else
        the oldest that waits is answered with what is known now."""
        if len(self._lines) < MOST_LINES:
            return
        silent = next((line for line in self._lines if line.state is _State.LISTENING), None)
        if silent is not None:
            self._close(silent)
            return
        oldest = next(iter(self._lines))
        if oldest.state is _State.WAITING:
            self._answer(oldest, self._status(self._master.stop))
        self._close(oldest)

    def _close(self, line: _Connection) -> None:
        if line in self._lines:
            del self._lines[line]
            loop = asyncio.get_running_loop()
            loop.remove_reader(line.connection)
            loop.remove_writer(line.connection)
            line.close()
            self._reserve.fill()

    def _read(self, line: _Connection) -> None:
        try:
            octets = line.connection.recv(MAX_REQUEST)
        except BlockingIOError:
            asyncio.get_running_loop().add_reader(line.connection, self._read, line)
            return
        except OSError:
            octets = b""
        line.octets += octets
        request, end, _ = line.octets.partition(b"\n")
        if end:
            asyncio.get_running_loop().remove_reader(line.connection)
            self._take(line, request)
        elif not octets or len(line.octets) > MAX_REQUEST:
            self._close(line)
        else:
            asyncio.get_running_loop().add_reader(line.connection, self._read, line)

    def _take(self, line: _Connection, octets: bytes) -> None:
        try:
            request = read_program_json(octets)
            do, who = request["do"], whole(str(request.get("who") or "somebody")[:64])
            line.word = whole(str(request.get("nonce") or "")[:64])
            known = self._details()
            is_robot = request.get("robot") in (None, known.get("robot"), known.get("serial_number"))
            if not is_robot or any(
                request.get(word) not in (None, known.get(word)) for word in ("serial_number", "database")
            ):
                self._answer(line, {"meant": False})
                return
            if do == "stop":
                # STOP is said at once, before anything that could fail; the answer follows when it is stored.
                reason, page_of = (whole(str(request.get(name) or "")[:200]) for name in ("reason", "page_of"))
                on_page = said("the page of {robot}", robot=page_of)
                self._master.say_stop(who, reason, on_page if page_of else said("a terminal of the robot's computer"))
            elif do == "go":
                if monotonic() > float(request.get("expires") or inf):
                    _log.warning("a GO was not obeyed: it came while this program stood still, and nobody waits for it")
                    self._close(line)
                    return
                stop = request.get("stop")
                self._master.say_go(who, None if stop is None else int(stop))
        except ConfigError as error:
            self._answer(line, {"meant": True, "error": str(error)})
            return
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            _log.debug("a request for STOP that makes no sense: %s", error)
            self._answer(line, {"meant": False})
            return
        if do in ("stop", "go"):
            line.state = _State.WAITING
            line.answering = asyncio.get_running_loop().create_task(self._answer_when_stored(line))
        else:
            self._answer(line, self._status(self._master.stop))

    async def _answer_when_stored(self, line: _Connection) -> None:
        status = await self._master.until_stop_is_stored()
        if line in self._lines:
            self._answer(line, self._status(status))

    def _status(self, status: StopStatus) -> dict[str, object]:
        return fitting({"meant": True, **self._details()} | answer_of(status))

    def _answer(self, line: _Connection, answer: Mapping[str, object]) -> None:
        line.state = _State.ANSWERING
        line.octets = json.dumps({**answer, "nonce": line.word}).encode() + b"\n"
        self._write(line)

    def _write(self, line: _Connection) -> None:
        try:
            line.octets = line.octets[line.connection.send(line.octets) :]
        except BlockingIOError:
            pass  # it reads slowly
        except OSError as error:
            _log.debug("nobody waits for the answer about STOP: %s", error)
            line.octets = b""
        if not line.octets:
            self._close(line)
        elif line in self._lines:
            asyncio.get_running_loop().add_writer(line.connection, self._write, line)


class _State(Enum):
    LISTENING = auto()
    """Its request has not come, or not as a whole."""
    WAITING = auto()
    """STOP or GO is said; it is answered when that is stored."""
    ANSWERING = auto()


class _Connection:
    """One connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.state = _State.LISTENING
        self.octets = b""
        """What has come of the request, or what is left to send of the answer."""
        self.word = ""
        """The word that the answer must repeat."""
        self.timer: asyncio.TimerHandle | None = None
        self.answering: asyncio.Task[None] | None = None

    def close(self) -> None:
        if self.timer is not None:
            self.timer.cancel()
        self.connection.close()


def answer_of(status: StopStatus) -> dict[str, object]:
    """The state of STOP, as JSON; times in ms, `since` in seconds since 1970."""
    return {
        "stopped": status.stopped,
        "number": status.number,
        "by": status.by if status.stopped else None,
        "also_by": list(status.also_by),
        "place": status.place,
        "reason": status.reason,
        "since": None if status.since_ns is None else status.since_ns / 1e9,
        "told": status.told_count,
        "confirmed": [{"part": one.part, "ms": round(one.ms, 1)} for one in status.confirmed],
        "silent": list(status.silent),
        "not_confirmed": len(status.silent),
        "stored": status.is_stored and not status.trouble,
        "trouble": status.trouble,
    }


def fitting(answer: Mapping[str, object], most: int = MAX_ANSWER) -> dict[str, object]:
    """The answer, or as much of it as is read: parts that have not confirmed come first.

    Args:
        answer: an answer with `confirmed` and `silent`.
        most: largest size in octets.
    """
    if len(json.dumps(answer)) <= most:
        return dict(answer)
    short: dict[str, object] = {**answer, "left_out": 0}
    left_out = 0
    lists: dict[str, list[object]] = {"silent": [], "confirmed": []}
    room = most - len(json.dumps({**short, **lists})) - MARGIN
    for name, kept in lists.items():
        whole = answer[name]
        assert isinstance(whole, list)
        for one in whole:
            room -= len(json.dumps(one)) + len(", ")
            if room >= 0:
                kept.append(one)
        left_out += len(whole) - len(kept)
    return {**short, **lists, "left_out": left_out}
