"""The helper's socket: one line of JSON each way, one request at a time, from the robot's service alone.

{"do": "state"}                                   -> {"done": {...}}
{"do": "change", "settings": {"name": "robot-3"}} -> {"done": {...}}, or {"error": "name: ..."}
{"do": "update", "running": "0.1.0"}, {"do": "back"}, {"do": "restart"}
"""

from __future__ import annotations

import contextlib
import json
import socket

from msbot_card.settings import SettingsError
from msbot_card.system import System, say
from msbot_card.updates import VERSION, UpdateError

LARGEST = 65_536
"""Octets of a request."""
PATIENCE_S = 10.0
"""How long a request may take to come in."""
IDLE_S = 60.0
"""The helper ends after that; systemd starts it for the next request."""


class RequestError(Exception):
    """A request makes no sense; the text says why."""


def answer(system: System, line: bytes) -> dict[str, object]:
    """Do what a request asks for."""
    try:
        return {"done": _done(system, line)}
    except (SettingsError, UpdateError) as error:
        say(f"refused: {error}")
        return {"error": str(error), "reason": error.reason}
    except RequestError as error:
        return {"error": str(error)}
    except OSError as error:
        say(f"a request failed: {error!r}")
        return {"error": f"the card cannot do that: {error.strerror or error}"}


def _done(system: System, line: bytes) -> dict[str, object]:
    try:
        request = json.loads(line)
    except ValueError:
        raise RequestError("a request is one line of JSON") from None
    if not isinstance(request, dict) or not isinstance(request.get("do"), str):
        raise RequestError('a request says what to do: {"do": "state"}')
    match request["do"]:
        case "state":
            return system.state()
        case "change":
            system.change(request.get("settings"))
            return system.state()
        case "update":
            running = request.get("running")
            if not isinstance(running, str) or not VERSION.fullmatch(running):
                raise RequestError("an update needs the version that is running")
            return system.update(running)
        case "back":
            system.store.ask_back()
            return system.state()
        case "restart":
            system.restart()
            return {}
        case other:
            raise RequestError(f"{other!r} is not known; known are state, change, update, back, restart")


def serve(listening: socket.socket, system: System, idle_s: float = IDLE_S) -> None:
    """Answer requests until none has come for a while."""
    listening.settimeout(idle_s)
    while True:
        try:
            connection, _ = listening.accept()
        except TimeoutError:
            return
        with connection, contextlib.suppress(OSError):  # who asked is gone
            connection.settimeout(PATIENCE_S)
            line = _line(connection)
            connection.sendall(json.dumps(answer(system, line)).encode() + b"\n")


def _line(connection: socket.socket) -> bytes:
    got = b""
    while b"\n" not in got and len(got) <= LARGEST:
        piece = connection.recv(LARGEST)
        if not piece:
            break
        got += piece
    return got.split(b"\n")[0][:LARGEST]
