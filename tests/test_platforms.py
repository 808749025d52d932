"""What is Linux only is said at run time; importing never fails elsewhere. Windows and macOS are played."""

from __future__ import annotations

import subprocess
import sys
from functools import cache

import pytest

PLAYED = """
import asyncio, subprocess, multiprocessing, ssl, tempfile, signal, socket, sys, os, getpass, logging.handlers
import click, rich.live, nicegui, sqlalchemy, alembic, uvicorn, pydantic, serialx

loop = asyncio.new_event_loop()  # before the sockets are gone that it is made of

class NotHere:
    missing = MISSING
    def find_spec(self, name, path=None, target=None):
        if name in self.missing:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, NotHere())
for name in NotHere.missing:
    sys.modules.pop(name, None)
windows = "fcntl" in NotHere.missing
for name in dir(socket):
    if name.startswith(("AF_CAN", "CAN_", "PF_CAN", "SO_PEERCRED", *["AF_UNIX"] * windows)):
        delattr(socket, name)
for name in ("getuid", "geteuid", "nice", "mkfifo", "openpty") if windows else ():
    delattr(os, name)
sys.platform = PLATFORM
"""
IMPORT_ALL = """
import importlib, pkgutil, msbot
failed = []
for module in pkgutil.walk_packages(msbot.__path__, "msbot."):
    if ".migrations" in module.name or module.name == "msbot.__main__":
        continue
    try:
        importlib.import_module(module.name)
    except Exception as error:
        failed.append(f"{module.name}: {type(error).__name__}: {error}")
print("\\n".join(failed))
"""
OPEN_CAN = """
print()
from msbot.errors import LinkDown
from msbot.link import open_link

async def main():
    try:
        await open_link("can:can0").run()
    except LinkDown as error:
        print(error)

loop.run_until_complete(main())
"""
MISSING = {
    "win32": ("fcntl", "termios", "tty", "pty", "resource", "grp", "pwd", "readline"),
    "darwin": (),
}


@cache
def played(platform: str) -> tuple[str, str]:
    """What the two scripts print on that system, one after the other in one process."""
    setting = PLAYED.replace("MISSING", repr(MISSING[platform]), 1).replace("PLATFORM", repr(platform))
    run = subprocess.run(
        [sys.executable, "-c", setting + IMPORT_ALL + OPEN_CAN], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    failed, _, said = run.stdout.strip("\n").rpartition("\n")
    return failed.strip(), said


@pytest.mark.parametrize("platform", MISSING)
def test_every_module_can_be_imported_elsewhere(platform: str) -> None:
    failed, _ = played(platform)
    assert failed == ""


@pytest.mark.parametrize("platform", MISSING)
def test_socketcan_elsewhere_is_one_sentence_without_commands_of_linux(platform: str) -> None:
    _, said = played(platform)
    assert said.startswith("can:can0: SocketCAN is a part of Linux"), said
    assert "ip link" not in said
    assert "can:slcan:COM3" in said
