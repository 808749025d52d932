"""Folders for STOP of a test's own, and masters that are only a socket."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from msbot.stop import socket_folders
from msbot.stop import stop_listener as stop_abstract
from msbot.stop import stop_request as stop_asking
from msbot.stop.socket_names import new_name
from msbot.stop.stop_listener import StopListener, listen

PATIENCE_S = 60.0
"""How long a test waits for what comes at once; the machine may be busy."""


def own_places(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """From now on nobody signed in, /run is empty and nobody may write there, /tmp is a folder of the test."""
    for name in ("USERS_FOLDER", "SYSTEM_FOLDER"):
        monkeypatch.setattr(socket_folders, name, str(folder / "nowhere"))
    shared = folder / "shared"
    shared.mkdir(exist_ok=True)
    monkeypatch.setattr(socket_folders, "SHARED_FOLDER", str(shared))
    monkeypatch.setattr(stop_abstract, "PREFIX", f"msbot-stop-test{os.getpid()}-")
    monkeypatch.setattr(socket_folders, "users_meant", lambda: [socket_folders.own_user()])
    monkeypatch.setattr("msbot.stop.stop_request.users_meant", lambda: [socket_folders.own_user()])
    return shared


@contextmanager
def stuck_master(robot: str = "STUCK X9", group: str = "", database: str = "") -> Iterator[StopListener]:
    """A master that stands still: the system takes connections for it, and nobody reads them."""
    listener = listen(new_name(robot, group, database))
    try:
        yield listener
    finally:
        listener.close()


@contextmanager
def master(
    answer: Callable[[dict[str, Any]], bytes], robot: str = "R 1", group: str = ""
) -> Iterator[list[dict[str, Any]]]:
    """A master that answers as it is told; yields the requests that it has got."""
    listener, heard = listen(new_name(robot, group)), []

    def serve() -> None:
        listener.socket.setblocking(True)
        while True:
            try:
                connection, _ = listener.socket.accept()
            except OSError:
                return
            with connection, connection.makefile("rb") as lines:
                line = lines.readline()
                if not line:
                    continue
                heard.append(json.loads(line))
                with suppress(OSError):  # it has heard enough
                    connection.sendall(answer(heard[-1]))

    thread = Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield heard
    finally:
        listener.socket.shutdown(socket.SHUT_RDWR)
        thread.join(PATIENCE_S)
        listener.close()


def taken(request: dict[str, Any]) -> bytes:
    """The answer of a master that obeys."""
    return json.dumps({"meant": True, "robot": "R", "nonce": request["nonce"]}).encode() + b"\n"


class StopsWhen:
    """The time of whoever asks is over when it has so many answers, or has tried so often: no clock decides."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.answers_wanted = self.tries_wanted = 1 << 30
        self.tries = 0
        self.got = 0
        real_answer = stop_asking.answer_in
        real_step = stop_asking._StopRequest._go_on

        def answer_in(octets: bytes, word: str) -> dict[str, object] | None:
            found = real_answer(octets, word)
            self.got += found is not None
            return found

        def step(asking: Any, waiting: Any, *others: Any) -> None:
            self.tries += bool(waiting)
            real_step(asking, waiting, *others)

        def monotonic() -> float:
            over = self.got >= self.answers_wanted or self.tries >= self.tries_wanted
            return time.monotonic() + 2 * PATIENCE_S * over

        monkeypatch.setattr(stop_asking, "answer_in", answer_in)
        monkeypatch.setattr(stop_asking._StopRequest, "_go_on", step)
        monkeypatch.setattr(stop_asking, "time", type("Clock", (), {"monotonic": staticmethod(monotonic)}))
        monkeypatch.setattr(stop_asking, "AGAIN_S", 0.001)
