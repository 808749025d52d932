"""What is Linux only is said at run time; importing never fails elsewhere. Windows and macOS are played."""

from __future__ import annotations

import subprocess
import sys
from functools import cache

import pytest

PLAYED = """
import asyncio, subprocess, multiprocessing, ssl, tempfile, select, signal, socket, sys, os, getpass, logging.handlers
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
local = socket.AF_UNIX
for name in dir(socket):
    if name.startswith(("AF_CAN", "CAN_", "PF_CAN", "SO_PEERCRED", *["AF_UNIX"] * windows)):
        delattr(socket, name)
for name in ("getuid", "geteuid", "nice", "mkfifo", "openpty") if windows else ():
    delattr(os, name)
sys.platform = PLATFORM
if windows:
    del select.poll, select.epoll
    pair = socket.socketpair
    socket.socketpair = lambda *_: pair(local)  # made of two TCP sockets there

    class Selecting(asyncio.selector_events.BaseSelectorEventLoop):
        pass

    class Proactor(Selecting):  # the loop that is usual there watches no sockets
        def add_reader(self, *_):
            raise NotImplementedError

        add_writer = remove_reader = remove_writer = add_reader

    class Policy(asyncio.DefaultEventLoopPolicy):
        _loop_factory = Proactor

    asyncio.SelectorEventLoop = Selecting
    asyncio.set_event_loop_policy(Policy())
"""
IMPORT_ALL = """
import importlib, pkgutil, msbot, msbot_agent, msbot_bridges, msbot_school, msbot_web, msbot_xrce
failed = []
packages = (msbot_xrce, msbot_agent, msbot, msbot_school, msbot_bridges, msbot_web)
for module in (one for package in packages for one in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")):
    if ".migrations" in module.name or module.name.endswith(".__main__"):
        continue
    try:
        importlib.import_module(module.name)
    except Exception as error:
        # The data types of Cyphal are compiled when its bridge runs; what needs them is imported then.
        if getattr(error, "name", "") not in ("uavcan", "reg"):
            failed.append(f"{module.name}: {type(error).__name__}: {error}")
print("\\n".join(failed))
"""
OPEN_CAN = """
print()
from msbot_xrce.errors import LinkDown
from msbot_agent.link import open_link

async def main():
    try:
        await open_link("can:can0").run()
    except LinkDown as error:
        print(error)

loop.run_until_complete(main())
"""
ECHO = """
from msbot_agent.link.net import UdpClientLink, UdpServerLink
from msbot_agent.process.end_signals import run_to_end

async def echo():
    server, heard = UdpServerLink("127.0.0.1", 0), asyncio.get_running_loop().create_future()
    server.attach(packet=lambda packet, peer, now: server.send(packet[::-1], peer))
    serving = asyncio.create_task(server.run())
    while not server.port:
        await asyncio.sleep(0)
    client = UdpClientLink("127.0.0.1", server.port)
    client.attach(packet=lambda packet, peer, now: heard.set_result(packet))
    client.attach(signal=lambda signal, peer, words, now: client.send(b"drawer", client.remote))
    asking = asyncio.create_task(client.run())
    done, _ = await asyncio.wait([heard, serving, asking], timeout=60, return_when=asyncio.FIRST_COMPLETED)
    for one in done:
        print(one.result().decode())
    serving.cancel()
    asking.cancel()

run_to_end(echo())
"""
MISSING = {
    "win32": ("fcntl", "termios", "tty", "pty", "resource", "grp", "pwd", "readline"),
    "darwin": (),
}


@cache
def played(platform: str) -> tuple[str, str, str]:
    """What the three scripts print on that system, one after the other in one process."""
    setting = PLAYED.replace("MISSING", repr(MISSING[platform]), 1).replace("PLATFORM", repr(platform))
    run = subprocess.run(
        [sys.executable, "-c", setting + IMPORT_ALL + OPEN_CAN + ECHO], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    failed, said, heard = ("\n" + run.stdout.strip("\n")).rsplit("\n", 2)
    return failed.strip(), said, heard


@pytest.mark.parametrize("platform", MISSING)
def test_every_module_can_be_imported_elsewhere(platform: str) -> None:
    failed, _, _ = played(platform)
    assert failed == ""


@pytest.mark.parametrize("platform", MISSING)
def test_socketcan_elsewhere_is_one_sentence_without_commands_of_linux(platform: str) -> None:
    _, said, _ = played(platform)
    assert said.startswith("can:can0: SocketCAN is a part of Linux"), said
    assert "ip link" not in said
    assert "can:slcan:COM3" in said


@pytest.mark.parametrize("platform", MISSING)
def test_a_datagram_finds_its_way_elsewhere(platform: str) -> None:
    _, _, heard = played(platform)
    assert heard == "reward"
