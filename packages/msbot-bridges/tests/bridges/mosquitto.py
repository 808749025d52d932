"""Debian's mosquitto on a port of its own, and its clients, for tests."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

NEEDED = "MSBOT_NEED_MQTT"
"""Set where no test with a broker may be skipped, as in CI."""
PATIENCE_S = 120.0


def command(name: str, package: str) -> str:
    """Where a program is; without it the test is skipped, in CI it fails."""
    found = shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if found is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)(
            f"no {name} on this machine: apt-get install {package}"
        )
    return found


@contextmanager
def mosquitto(folder: Path, port: int = 0) -> Iterator[int]:
    """A broker that runs as long as the block; gives its port."""
    program = command("mosquitto", "mosquitto")
    if not port:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
    file = folder / "mosquitto.conf"
    file.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\nuser root\n")
    process = subprocess.Popen([program, "-c", str(file)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        _wait_for(port, process)
        yield port
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def publish(port: int, topic: str, payload: str, *, retained: bool = False) -> None:
    """Say something with mosquitto_pub."""
    words = [command("mosquitto_pub", "mosquitto-clients"), "-h", "127.0.0.1", "-p", str(port), "-q", "1", "-t", topic]
    words += (["-m", payload] if payload else ["-n"]) + (["-r"] if retained else [])
    subprocess.run(words, check=True, timeout=PATIENCE_S)


def kept(port: int, topic: str) -> str:
    """The next message of a topic, as mosquitto_sub hears it: at once where the broker has kept one."""
    words = [command("mosquitto_sub", "mosquitto-clients"), "-h", "127.0.0.1", "-p", str(port), "-t", topic]
    words += ["-C", "1", "-W", str(int(PATIENCE_S))]
    return subprocess.run(words, check=True, timeout=2 * PATIENCE_S, capture_output=True, text=True).stdout.strip()


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        time.sleep(0.05)
    process.kill()
    raise AssertionError(f"mosquitto does not listen on {port}: {process.communicate()[1].decode()}")


def wait_until_kept(port: int, topic: str, text: str) -> None:
    """Until the broker keeps this message for a topic."""
    until = time.monotonic() + PATIENCE_S
    while (found := kept(port, topic)) != text:
        assert time.monotonic() < until, f"{topic} is {found!r}, and not {text!r}"
        time.sleep(0.1)


def wait_until_near(port: int, topic: str, number: float) -> None:
    """Until the broker keeps a number within a half of this one for a topic."""
    until = time.monotonic() + PATIENCE_S
    while not (found := kept(port, topic)) or abs(float(found) - number) > 0.5:
        assert time.monotonic() < until, f"{topic} is {found!r}, and not near {number}"
        time.sleep(0.1)
