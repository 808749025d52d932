"""Masters elsewhere that are silent, drip, talk nonsense or break off keep nobody waiting, and stand for what they are.

Each is a socket here: what answers in a network may be anything.
"""

from __future__ import annotations

import json
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from socket import SHUT_RDWR, create_server, socket

import pytest

from msbot_school.classroom.remote_access import RemoteAccess
from msbot_school.classroom.remote_masters import (
    Answer,
    ParallelRequest,
    RemoteMasterConnection,
    RemoteMasterError,
    RemoteMasterRefusal,
    Work,
    ask_one,
    read_status,
    say_stop,
)
from msbot_school.cli.classroom.access_commands import _agreed_certificate
from msbot_xrce.errors import ConfigError, DatabaseBusy
from tests.certificate import Certificate

SHORT_S = 0.3
"""The time of those who never answer."""
PATIENCE_S = 30.0
"""The time of those who answer at once; the machine may be busy."""


def answer(status: str, found: object) -> bytes:
    body = json.dumps(found).encode()
    return f"HTTP/1.1 {status}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


class Somebody:
    """Answers connections, one after the other, each by what `serve` does."""

    def __init__(self, serve: Callable[[socket], None], tls: ssl.SSLContext | None = None) -> None:
        self._listening = create_server(("127.0.0.1", 0))
        self._serve, self._tls = serve, tls
        scheme = "http" if tls is None else "https"
        self.address = f"{scheme}://127.0.0.1:{self._listening.getsockname()[1]}"
        self.access = RemoteAccess(self.address, "msbot_secret", "R", "1")
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while True:
            try:
                taken, _ = self._listening.accept()
            except OSError:
                return
            with taken, suppress(OSError):
                if self._tls is None:
                    self._serve(taken)
                else:
                    with self._tls.wrap_socket(taken, server_side=True) as sealed:
                        self._serve(sealed)

    def close(self) -> None:
        with suppress(OSError):
            self._listening.shutdown(SHUT_RDWR)
        self._listening.close()
        self._thread.join()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


def somebody(stack: ExitStack, serve: Callable[[socket], None], tls: ssl.SSLContext | None = None) -> Somebody:
    made = Somebody(serve, tls)
    stack.callback(made.close)
    return made


def once(octets: bytes) -> Callable[[socket], None]:
    def serve(taken: socket) -> None:
        taken.recv(65536)
        taken.sendall(octets)

    return serve


def silent(taken: socket) -> None:
    while taken.recv(65536):
        pass


def drip(taken: socket) -> None:
    taken.recv(65536)
    taken.sendall(b"HTTP/1.1 200 OK\r\nX-Slow: ")
    taken.settimeout(0.02)
    while True:
        taken.sendall(b"x")
        with suppress(TimeoutError):
            if not taken.recv(1):
                return


@pytest.mark.parametrize(
    ("serve", "words"),
    [
        (silent, "no answer in time"),
        (drip, "no answer in time"),
        (once(b""), "it ended the connection without an answer"),
        (once(b"SSH-2.0-OpenSSH_9.2\r\n"), "what answers there is no page of MsBOT"),
        (once(b"HTTP/1.1 200 OK\r\n\r\n<html>"), "what answers there is no page of MsBOT"),
        (once(answer("200 OK", [1])), "what answers there is no page of MsBOT"),
        (once(b"HTTP/1.1 200 OK\r\n\r\n" + b"[" * (2 << 20)), "what answers there is no page of MsBOT"),
        (once(answer("401 Unauthorized", {"error": "sign in"})), "it does not know the API token"),
        (once(answer("403 Forbidden", {"error": "you may not do this"})), "you may not do this"),
        (once(answer("302 Found", "elsewhere")), "302 Found"),
    ],
)
def test_each_kind_of_trouble_is_one_sentence_with_the_address(
    stack: ExitStack, serve: Callable[[socket], None], words: str
) -> None:
    there = somebody(stack, serve)
    is_endless = serve in (silent, drip)
    began = time.monotonic()
    with pytest.raises(RemoteMasterError, match=there.address) as caught:
        ask_one(there.access, lambda line: line.mapping("GET", "/api/status"), SHORT_S if is_endless else PATIENCE_S)
    assert words in str(caught.value)
    assert "msbot_secret" not in str(caught.value)
    assert not is_endless or time.monotonic() - began < 2 * PATIENCE_S, "bounded"


@pytest.mark.parametrize(
    ("status", "is_refusal"),
    [
        ("400 Bad Request", True),
        ("403 Forbidden", True),
        ("423 Locked", True),
        ("409 Conflict", False),
        ("500 Server Error", False),
    ],
)
def test_only_an_answer_before_anything_is_done_says_that_nothing_has_changed(
    stack: ExitStack, status: str, is_refusal: bool
) -> None:
    there = somebody(stack, once(answer(status, {"error": "no"})))
    with pytest.raises(RemoteMasterError) as caught:
        ask_one(there.access, lambda line: line.mapping("PUT", "/api/blueprint", {}), PATIENCE_S)
    assert isinstance(caught.value, RemoteMasterRefusal) is is_refusal
    assert isinstance(caught.value, DatabaseBusy) is (status == "423 Locked"), "the same may succeed a moment later"


def answers_when_one_is_noted(
    accesses: list[RemoteAccess], work: Work[Answer]
) -> dict[str, Answer | RemoteMasterError]:
    """What is known when the time is over, which is as soon as something is: then no clock decides what that is."""
    noted = threading.Event()

    def telling(line: RemoteMasterConnection, note: Callable[[Answer], None]) -> None:
        def tell(found: Answer) -> None:
            note(found)
            noted.set()

        work(line, tell)

    asking = ParallelRequest(accesses, telling, PATIENCE_S)
    assert noted.wait(2 * PATIENCE_S), "nothing is known of anybody"
    asking._until = time.monotonic()
    return asking.answers()


def test_one_that_hangs_holds_up_no_other_one(stack: ExitStack) -> None:
    well = somebody(stack, once(answer("200 OK", {"robot": "R"})))
    hangs = [somebody(stack, silent) for _ in range(5)]
    found = answers_when_one_is_noted([*(one.access for one in hangs), well.access], read_status)
    assert found[well.address] == {"robot": "R"}
    assert all(isinstance(found[one.address], RemoteMasterError) for one in hangs)


def test_stop_that_was_taken_counts_although_nobody_says_who_has_confirmed(stack: ExitStack) -> None:
    def serve(taken: socket) -> None:
        asked = taken.recv(65536)
        assert asked.startswith(b"POST /api/stop ")
        assert b"Authorization: Bearer msbot_secret" in asked
        taken.sendall(answer("200 OK", {"words": "STOP"}))
        silent(taken)

    there = somebody(stack, serve)
    found = answers_when_one_is_noted([there.access], say_stop("fire"))[there.address]
    assert isinstance(found, dict)
    assert (found["stopped"], found["told"]) == (True, None)


def test_stop_is_asked_after_until_all_parts_have_confirmed(stack: ExitStack) -> None:
    left = [2, 1, 0]

    def serve(taken: socket) -> None:
        asking = taken.makefile("rb")
        while line := asking.readline():
            if line.startswith(b"POST"):
                taken.sendall(answer("200 OK", {"words": "STOP"}))
            elif b"GET /api/status" in line:  # the reason of STOP stands before it in the same line
                count = left.pop(0)
                taken.sendall(answer("200 OK", {"stopped": True, "told": 2, "not_confirmed": count}))

    there = somebody(stack, serve)
    found = ParallelRequest([there.access], say_stop(""), PATIENCE_S).answers()[there.address]
    assert isinstance(found, dict)
    assert found["not_confirmed"] == 0
    assert left == []


def test_a_token_goes_only_to_the_certificate_that_was_agreed_on(stack: ExitStack, tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("right", "other")]
    for folder in folders:
        folder.mkdir()
    right, other = (Certificate(folder) for folder in folders)

    def tls(certificate: Certificate) -> ssl.SSLContext:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate.certificate, certificate.key)
        return context

    asked: list[bytes] = []

    def serve(taken: socket) -> None:
        asked.append(taken.recv(65536))
        taken.sendall(answer("200 OK", {"robot": "R"}))

    there, false = somebody(stack, serve, tls(right)), somebody(stack, serve, tls(other))
    with pytest.raises(ConfigError, match="its certificate is another one") as caught:
        _agreed_certificate(there.address, "00" * 32)
    shown = str(caught.value).partition("another one, ")[2].partition(";")[0]
    pinned = _agreed_certificate(there.address, shown)

    def status(line: RemoteMasterConnection) -> dict[str, object]:
        return line.mapping("GET", "/api/status")

    assert ask_one(RemoteAccess(there.address, "msbot_secret", "R", "1", pinned), status, PATIENCE_S) == {"robot": "R"}
    before = len(asked)
    for wrong in (RemoteAccess(false.address, "msbot_secret", "R", "1", pinned), there.access):
        with pytest.raises(RemoteMasterError, match="its certificate is not the one that is trusted here"):
            ask_one(wrong, status, PATIENCE_S)
    assert not any(b"secret" in one for one in asked[before:])


def test_without_a_thread_nobody_is_asked_and_each_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    asking = ParallelRequest([RemoteAccess("http://127.0.0.1:9", "t", "R", "1")], say_stop(""), PATIENCE_S)
    ((address, found),) = asking.answers().items()
    assert isinstance(found, RemoteMasterError)
    assert str(found) == f"{address}: this computer has no thread left to ask it"
    assert asking.unfinished() == []
