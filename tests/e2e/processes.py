"""Runs `msbot` as a user does: in processes of its own, with what they print at hand."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

from tests.e2e.prepared import start

PATIENCE_S = 90.0
"""How long a test waits for a line before it fails; nothing in the product is this slow."""


class Process:
    """One running command; its output is read line by line."""

    def __init__(
        self, *arguments: str, cwd: Path, env: dict[str, str] | None = None, errors: IO[bytes] | None = None
    ) -> None:
        read, write = os.pipe()
        self._output = os.fdopen(read)
        try:
            whole = {**os.environ, "PYTHONUNBUFFERED": "1", **(env or {})}
            self._process = start(arguments, cwd=cwd, env=whole, stdout=write, stderr=errors or write)
        finally:
            os.close(write)
        self.lines: list[str] = []
        self._queue: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._output:
            self._queue.put(line.rstrip("\n"))
        self._queue.put(None)

    def wait_for(self, *words: str, patience_s: float = PATIENCE_S) -> str:
        """The next line that has all the words; fails when the process ends or takes too long."""
        until = time.monotonic() + patience_s
        while True:
            try:
                line = self._queue.get(timeout=max(0.0, until - time.monotonic()))
            except queue.Empty:
                line = None
            if line is None:
                self._queue.put(None)
                raise AssertionError(f"no line with {words}; the process said:\n" + "\n".join(self.lines))
            self.lines.append(line)
            if all(word in line for word in words):
                return line

    def waiting(self) -> int:
        """How many lines it has written that nobody has waited for yet."""
        return self._queue.qsize()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process."""
        self._process.send_signal(number)

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """End it and return its exit status."""
        if self._process.poll() is None:
            self._process.send_signal(number)
        status = self._process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        self._output.close()
        while not self._queue.empty():
            line = self._queue.get()
            if line is not None:
                self.lines.append(line)
        return status


@contextlib.contextmanager
def running(
    *arguments: str, cwd: Path, env: dict[str, str] | None = None, errors: IO[bytes] | None = None
) -> Iterator[Process]:
    """A command that is killed at the latest when the test is over; standard error goes to `errors`, if given, and
    else where standard output goes."""
    process = Process(*arguments, cwd=cwd, env=env, errors=errors)
    try:
        yield process
    finally:
        process.end(signal.SIGKILL)


def run(
    *arguments: str,
    cwd: Path | None = None,
    timeout_s: float = 60.0,
    env: dict[str, str] | None = None,
    limits: tuple[int, int] | None = None,
) -> subprocess.CompletedProcess[str]:
    """A command that ends by itself, at the latest at its limits: processor seconds, octets of memory."""
    whole = {**os.environ, **(env or {})}
    with TemporaryFile() as out, TemporaryFile() as error:
        process = start(arguments, cwd=cwd, env=whole, stdout=out, stderr=error, limits=limits)
        try:
            status = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(PATIENCE_S)
            raise
        said = [(file.seek(0), file.read().decode())[1] for file in (out, error)]
    return subprocess.CompletedProcess(process.args, status, *said)


def wait_for_states(wanted: dict[str, str], *, cwd: Path, env: dict[str, str] | None = None) -> None:
    """List a robot's parts until their states by slot are these; a part may be late for a moment on a busy computer."""
    until = time.monotonic() + PATIENCE_S
    while True:
        listing = run("parts", "--json", cwd=cwd, env=env)
        assert listing.returncode == 0, listing.stderr
        states = {row["slot"]: row["state"] for row in json.loads(listing.stdout)}
        if states == wanted:
            return
        assert time.monotonic() < until, f"{states}, and not {wanted}"
        time.sleep(0.2)
