"""Who a STOP is meant for: all masters of the user, or those of one group."""

from __future__ import annotations

import os
import socket

import pytest

from msbot.runtime.stop_datagram import GROUP_VARIABLE, IS_ABSTRACT, ask_masters, new_name

pytestmark = pytest.mark.skipif(not IS_ABSTRACT, reason="names of sockets without files are known to Linux only")


def listening(monkeypatch: pytest.MonkeyPatch, group: str) -> socket.socket:
    """What a master of that group listens at; it never answers."""
    monkeypatch.setenv(GROUP_VARIABLE, group)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sock.bind(new_name())
    sock.setblocking(False)
    return sock


def hears(sock: socket.socket) -> bool:
    try:
        return bool(sock.recv(4096))
    except BlockingIOError:
        return False


def test_a_group_stops_its_own_and_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    word = f"x{os.getpid()}"
    with listening(monkeypatch, f"{word}a") as mine, listening(monkeypatch, f"{word}b") as other:
        monkeypatch.setenv(GROUP_VARIABLE, f"{word}a")
        assert ask_masters({"do": "status"}, 0.05) == ([], 1)
        assert (hears(mine), hears(other)) == (True, False)


def test_signs_in_a_group_do_not_make_another_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GROUP_VARIABLE, "../a b\n")
    assert "-ab-" in new_name()
