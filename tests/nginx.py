"""Debian's nginx in front of a robot, in a folder of its own, as any user, with a configuration that a test gives."""

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

NEEDED = "MSBOT_NEED_PROXIES"
"""Set where no test with a reverse proxy may be skipped, as in CI."""
PATIENCE_S = 30.0
WHOLE = """
{user}
pid {folder}/nginx.pid;
error_log {folder}/error.log;
worker_processes 1;
daemon off;
events {{ worker_connections 256; }}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
{servers}
}}
"""


def command(name: str, package: str = "") -> str:
    """Where a program is; without it the test is skipped, in CI it fails."""
    found = shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if found is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)(
            f"no {name} on this machine: apt-get install {package or name}"
        )
    return found


@contextmanager
def nginx(folder: Path, servers: str, *ports: int) -> Iterator[Path]:
    """nginx with these `server` blocks, as soon as it listens on the ports; gives the file of its errors."""
    folder.mkdir()
    file = folder / "nginx.conf"
    # Started by root, nginx works as nobody, who cannot write into the folder what a slow browser has not read yet.
    user = "user root;" if os.geteuid() == 0 else ""
    file.write_text(WHOLE.format(user=user, folder=folder, servers=servers))
    with proxy([command("nginx"), "-p", str(folder), "-c", str(file), "-e", str(folder / "error.log")], *ports):
        yield folder / "error.log"


@contextmanager
def proxy(words: list[str], *ports: int, env: dict[str, str] | None = None) -> Iterator[None]:
    """A proxy that runs as long as the block, as soon as it listens on the ports."""
    whole = {**os.environ, **(env or {})}
    process = subprocess.Popen(words, env=whole, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        for port in ports:
            _wait_for(port, process)
        yield
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
            return
        time.sleep(0.05)
    process.kill()
    raise AssertionError(f"{process.args!r} does not listen on {port}: {process.communicate()[0].decode()}")
