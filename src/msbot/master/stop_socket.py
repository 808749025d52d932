"""The channel by which STOP always reaches a master: a datagram socket of its own, for the user's other programs.

It needs no database, no file and no folder: on Linux its name is an abstract one, and the system reports who is sending
(peer credentials). A datagram needs no connection, so nobody can block the socket by holding one open, and no file
descriptor can be lacking: the one socket exists from the start. Elsewhere the socket is a file in a folder that is the
user's alone; where there are no such sockets at all, `msbot stop` goes the same way as all other commands.

Each request is one JSON object, and so is each answer: `stop`, `go`, `status`. The other end is
`msbot.runtime.stop_datagram`.
"""

from __future__ import annotations

import asyncio
import json
import logging
import socket
from collections.abc import Callable, Mapping
from math import inf
from time import monotonic
from typing import Final

from msbot.errors import ConfigError
from msbot.master.master import Master
from msbot.pnp import StopStatus
from msbot.runtime.json_reading import read_json
from msbot.runtime.printable import whole
from msbot.runtime.stop_datagram import CREDENTIALS, IS_ABSTRACT, IS_THERE, is_own, new_name, withdraw

MAX_REQUEST: Final = 4096
MAX_ANSWER: Final = 150_000
"""Largest answer in octets; names of parts that do not fit are left out, and counted in `left_out`."""
MARGIN: Final = 20
"""Octets for the count of what is left out."""
PER_TURN: Final = 8
"""Requests that are answered in one turn of the loop."""

_log = logging.getLogger(__name__)


class StopSocket:
    """Accepts STOP and GO for one master from programs of the same user (and of root).

    Args:
        master: the robot.
        details: what other programs need to find the robot: its name, serial number and database.
    """

    def __init__(self, master: Master, details: Callable[[], Mapping[str, str]]) -> None:
        self.refused = 0
        """Requests from other users."""
        self._master = master
        self._details = details
        self._answers: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Serve until cancelled; logs a warning where that is not possible."""
        if not IS_THERE:
            return
        name = ""
        try:
            name = new_name()
            listening = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            listening.setblocking(False)
            if IS_ABSTRACT:
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
            listening.bind(name)
        except OSError as error:
            _log.warning("`msbot stop` has only the ordinary way to this process: %s", error)
            return
        loop = asyncio.get_running_loop()
        loop.add_reader(listening, self._readable, listening)
        try:
            await loop.create_future()
        finally:
            loop.remove_reader(listening)
            listening.close()
            withdraw(name)

    def _readable(self, listening: socket.socket) -> None:
        for _ in range(PER_TURN):
            try:
                octets, ancillary, _, sender = listening.recvmsg(MAX_REQUEST, socket.CMSG_SPACE(CREDENTIALS.size))
            except BlockingIOError:
                return
            except OSError as error:
                _log.debug("a request for STOP could not be read: %s", error)
                return
            if IS_ABSTRACT and not is_own(ancillary):
                self.refused += 1
                continue
            self._take(listening, octets, sender)

    def _take(self, listening: socket.socket, octets: bytes, sender: str | bytes) -> None:
        try:
            request = read_json(octets)
            do, who = request["do"], whole(str(request.get("who") or "somebody")[:64])
            known = self._details()
            is_robot = request.get("robot") in (None, known.get("robot"), known.get("serial_number"))
            if not is_robot or any(
                request.get(word) not in (None, known.get(word)) for word in ("serial_number", "database")
            ):
                self._send(listening, sender, {"meant": False})
                return
            if do == "stop":
                # STOP is said at once, before anything that could fail; the answer follows when it is stored.
                self._master.say_stop(who, whole(str(request.get("reason") or "")[:200]))
            elif do == "go":
                if monotonic() > float(request.get("expires") or inf):
                    _log.warning("a GO was not obeyed: it came while this program stood still, and nobody waits for it")
                    return
                self._master.say_go(who)
        except ConfigError as error:
            self._send(listening, sender, {"meant": True, "error": str(error)})
            return
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            _log.debug("a request for STOP that makes no sense: %s", error)
            return
        if do in ("stop", "go"):
            task = asyncio.get_running_loop().create_task(self._answer_when_stored(listening, sender))
            self._answers.add(task)
            task.add_done_callback(self._answers.discard)
        else:
            self._send(listening, sender, self._answer(self._master.stop))

    async def _answer_when_stored(self, listening: socket.socket, sender: str | bytes) -> None:
        self._send(listening, sender, self._answer(await self._master.until_stop_is_stored()))

    def _answer(self, status: StopStatus) -> dict[str, object]:
        return fitting({"meant": True, **self._details()} | answer_of(status))

    def _send(self, listening: socket.socket, sender: str | bytes, answer: Mapping[str, object]) -> None:
        try:
            listening.sendto(json.dumps(answer).encode(), sender)
        except OSError as error:
            _log.debug("nobody waits for the answer about STOP: %s", error)


def answer_of(status: StopStatus) -> dict[str, object]:
    """The state of STOP, as JSON; times in ms, `since` in seconds since 1970."""
    return {
        "stopped": status.stopped,
        "number": status.number,
        "by": status.by if status.stopped else None,
        "also_by": list(status.also_by),
        "reason": status.reason,
        "since": None if status.since_ns is None else status.since_ns / 1e9,
        "told": status.told,
        "confirmed": [{"part": one.part, "ms": round(one.ms, 1)} for one in status.confirmed],
        "silent": list(status.silent),
        "not_confirmed": len(status.silent),
        "stored": status.is_stored and not status.trouble,
        "trouble": status.trouble,
    }


def fitting(answer: Mapping[str, object], most: int = MAX_ANSWER) -> dict[str, object]:
    """The answer, or as much of it as one datagram takes: parts that have not confirmed come first.

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
