"""Who a STOP is meant for, and how it gets there: all masters of the user, or those of one group."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from msbot.runtime import stop_datagram
from msbot.runtime.stop_datagram import GROUP_VARIABLE, IS_ABSTRACT, ask_masters, new_name

pytestmark = pytest.mark.skipif(not IS_ABSTRACT, reason="names of sockets without files are known to Linux only")
PATIENCE_S = 60.0
"""How long a test waits for what comes at once; the machine may be busy."""


def listening(monkeypatch: pytest.MonkeyPatch, group: str) -> socket.socket:
    """What a master of that group listens at; it never answers."""
    monkeypatch.setenv(GROUP_VARIABLE, group)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sock.bind(new_name())
    sock.setblocking(False)
    return sock


def over_after(monkeypatch: pytest.MonkeyPatch, name: str, is_last: Callable[[Any], bool]) -> None:
    """The time of whoever asks is over as soon as that function gives such a result: no clock decides what it gets."""
    function, ended = getattr(stop_datagram, name), threading.Event()

    def watched(*args: object) -> object:
        result = function(*args)
        if is_last(result):
            ended.set()
        return result

    monkeypatch.setattr(stop_datagram, name, watched)
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + 2 * PATIENCE_S * ended.is_set())
    monkeypatch.setattr(stop_datagram, "time", clock)


def hears(sock: socket.socket) -> bool:
    try:
        return bool(sock.recv(4096))
    except BlockingIOError:
        return False


def test_a_group_stops_its_own_and_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    word = f"x{os.getpid()}"
    with listening(monkeypatch, f"{word}a") as mine, listening(monkeypatch, f"{word}b") as other:
        monkeypatch.setenv(GROUP_VARIABLE, f"{word}a")
        over_after(monkeypatch, "_send", lambda sent: sent is stop_datagram._Sent.YES)
        monkeypatch.setattr(stop_datagram, "_receive", lambda *_: None)  # nobody answers, and it waits for nobody
        assert ask_masters({"do": "status"}, PATIENCE_S) == ([], 1)
        assert (hears(mine), hears(other)) == (True, False)


def test_signs_in_a_group_do_not_make_another_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GROUP_VARIABLE, "../a b\n")
    assert "-ab-" in new_name()


def test_a_queue_that_others_have_filled_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any user of the computer may send to the socket: that must not make a STOP fail that somebody else says."""
    word = f"y{os.getpid()}"
    with listening(monkeypatch, word) as master, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.setblocking(False)
        filled = 0
        with suppress(BlockingIOError):
            while True:
                other.sendto(b"noise", master.getsockname())
                filled += 1
        results: list[stop_datagram._Sent] = []

        def no_room(*args: object) -> stop_datagram._Sent:
            if len(results) == 2:
                for _ in range(filled):
                    assert master.recv(4096) == b"noise"
            results.append(send(*args))  # type: ignore[arg-type]
            if len(results) == 3:
                request, sender = master.recvfrom(4096)
                assert json.loads(request)["do"] == "stop"
                master.sendto(json.dumps({"meant": True}).encode(), sender)
            return results[-1]

        send = stop_datagram._send
        monkeypatch.setattr(stop_datagram, "_send", no_room)
        assert ask_masters({"do": "stop"}, PATIENCE_S) == ([{"meant": True}], 0)
        no, yes = stop_datagram._Sent.NO_ROOM, stop_datagram._Sent.YES
        assert results == [no, no, yes]


def test_a_master_that_takes_nothing_is_counted_and_keeps_no_other_from_answering(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    word = f"z{os.getpid()}"
    with listening(monkeypatch, word) as stuck, listening(monkeypatch, word) as good:
        good.setblocking(True)
        good.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other, suppress(BlockingIOError):
            other.setblocking(False)
            while True:
                other.sendto(b"noise", stuck.getsockname())

        def serve() -> None:
            _, sender = good.recvfrom(4096)
            good.sendto(b"nonsense", sender)
            good.sendto(json.dumps({"meant": True, "robot": "R"}).encode(), sender)

        over_after(monkeypatch, "_receive", lambda answer: answer is not None and answer[1].get("meant") is True)
        with ThreadPoolExecutor(1) as aside:
            done = aside.submit(serve)
            assert ask_masters({"do": "stop"}, PATIENCE_S) == ([{"meant": True, "robot": "R"}], 1)
            done.result()
