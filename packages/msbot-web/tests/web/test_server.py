"""Where the pages are served: ports and addresses that cannot be had, certificates, and a silent end."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import re
import signal
import socket
import ssl
import sys
import threading
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path
from typing import cast

import httpx
import pytest
from fastapi import FastAPI

from msbot.config import write_sample
from msbot_web.nicegui_internals.startup import undisturbed
from msbot_web.server import NEXT_PORTS, WebServer, WebSettings, _bind
from msbot_web.service import Service
from msbot_xrce.errors import ConfigError
from tests.certificate import Certificate
from tests.e2e.processes import run, running

NO_SERVICE = cast("Service", None)
"""What is refused is refused before anybody asks the service anything."""
ANY = WebSettings(port=0)


def refusal(settings: WebSettings) -> str:
    with pytest.raises(ConfigError) as caught:
        WebServer(NO_SERVICE, settings)
    return str(caught.value)


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that another program uses."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def test_a_port_in_use_is_told_with_the_way_out(taken: int) -> None:
    assert refusal(WebSettings(port=taken)) == (
        f"the page cannot be served on 127.0.0.1 port {taken}: another program uses it; "
        "choose another one with --port, or --port 0 for any free one"
    )


def test_without_a_wish_the_next_free_port_is_taken_so_that_it_is_the_same_after_a_restart(taken: int) -> None:
    found = []
    for _ in range(2):
        with _bind(WebSettings(port=taken, or_any_port=True)) as bound:
            found.append(bound.getsockname()[1])
    assert found[0] == found[1] or found[0] not in range(taken + 1, taken + NEXT_PORTS)


@pytest.mark.parametrize("host", ["192.0.2.1", "no-such-host.invalid", "x" * 300, "a..b", "2001:db8::1"])
def test_an_address_of_another_computer_is_told_with_the_way_out(host: str) -> None:
    words = refusal(replace(ANY, host=host))
    assert words.startswith(f"the page cannot be served on {host} port 0: ")
    assert "use --host 127.0.0.1" in words


def test_a_port_that_the_system_refuses_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    assert "ports below 1024 need more rights" in refusal(WebSettings(port=80))


@pytest.fixture
def mine(tmp_path: Path) -> Certificate:
    return Certificate(tmp_path)


def test_certificates_that_cannot_be_used_are_told(mine: Certificate, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Certificate(tmp_path / "other")
    for certificate, key, words in (
        (mine.certificate, other.key, "do not go together, or are no PEM files"),
        (mine.certificate, None, f"the key {mine.certificate} do not go together"),
        (mine.key, mine.key, "do not go together"),
        (mine.certificate, mine.locked, f"the key {mine.locked} is protected by a password"),
        (tmp_path / "nowhere.pem", None, "cannot read"),
        (mine.certificate, tmp_path, "cannot read|do not go together"),
    ):
        assert re.search(words, refusal(replace(ANY, certificate=certificate, key=key)))


def test_with_a_certificate_the_page_is_served_by_tls(mine: Certificate, tmp_path: Path) -> None:
    write_sample(tmp_path / "robot.toml")
    options = ("--certificate", str(mine.certificate), "--certificate-key", str(mine.key))
    with running("master", "--link", "udp:127.0.0.1:0", "--port", "0", *options, cwd=tmp_path) as master:
        found = re.search(r"https://127\.0\.0\.1:(\d+)/setup\?token=(\S+)", master.wait_for("The page is at"))
        assert found is not None
        trusted = ssl.create_default_context(cafile=str(mine.certificate))
        with httpx.Client(base_url=f"https://localhost:{found[1]}", verify=trusted, timeout=30) as visitor:
            assert visitor.get("/api/health").json() == {"status": "ok"}
            form = {"token": found[2], "name": "ada", "password": "correct horse", "again": "correct horse"}
            cookie = visitor.post("/setup", data=form).headers["set-cookie"]
            assert "Secure" in cookie
            assert "HttpOnly" in cookie
        with pytest.raises(httpx.TransportError):
            httpx.get(f"http://127.0.0.1:{found[1]}/api/health", timeout=30)
        assert master.end() == 0


@pytest.mark.parametrize(("number", "moment"), [(signal.SIGINT, "is up on"), (signal.SIGTERM, "The page is at")])
def test_the_end_is_silent(number: signal.Signals, moment: str, tmp_path: Path) -> None:
    write_sample(tmp_path / "robot.toml")
    with running("master", "--link", "udp:127.0.0.1:0", "--port", "0", cwd=tmp_path) as master:
        master.wait_for(moment)
        master.send(number)
        assert master.end(number) == 0  # twice, as people in a hurry do
        for line in master.lines:
            assert "is up on" in line or "The page is at" in line


def test_a_page_that_cannot_be_served_ends_the_command_with_one_line(taken: int, tmp_path: Path) -> None:
    write_sample(tmp_path / "robot.toml")
    for command in (["master", "--link", "udp:127.0.0.1:0"], ["demo"]):
        done = run(*command, "--port", str(taken), cwd=tmp_path)
        assert done.returncode == 2
        assert done.stdout == ""
        (line,) = done.stderr.splitlines()
        assert line.startswith("msbot: the page cannot be served")


@contextlib.asynccontextmanager
async def as_nicegui_begins(_app: FastAPI) -> AsyncIterator[None]:
    for thing in gc.get_objects():
        isinstance(thing, WebServer)
    yield


def test_the_server_begins_without_a_mistake_in_a_thread_that_fills_a_tuple_at_that_moment() -> None:
    over = threading.Event()
    failed: list[SystemError] = []

    def fill() -> None:
        while not over.is_set():
            try:
                tuple(number for number in range(500))
            except SystemError as error:
                failed.append(error)

    async def begin_often() -> None:
        begin = undisturbed(as_nicegui_begins)
        for _ in range(8):
            async with begin(FastAPI()):
                await asyncio.sleep(0)

    usual_s = sys.getswitchinterval()
    filling = threading.Thread(target=fill)
    filling.start()
    try:
        asyncio.run(begin_often())
    finally:
        over.set()
        filling.join()
        gc.unfreeze()
    assert failed == []
    assert sys.getswitchinterval() == usual_s
