from __future__ import annotations

import asyncio
import os
import sys
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from msbot_agent.link import Signal
from msbot_agent.link.byte_frames import SerialReceiver, encode_serial
from msbot_agent.link.serial import PtyServerLink, SerialClientLink
from msbot_xrce.errors import LinkDown
from tests.link.ends import End, running
from tests.link.ports import readable


class Program:
    """A client that opens a terminal by its path, as a C program does: without touching its modes."""

    def __init__(self, path: str) -> None:
        self.descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._receiver = SerialReceiver(1)

    def say(self, packet: bytes) -> None:
        os.write(self.descriptor, encode_serial(packet, 1, 0))

    async def hear(self) -> bytes:
        while True:
            for _, packet in self._receiver.receive(await readable(self.descriptor)):
                return packet

    def close(self) -> None:
        os.close(self.descriptor)


@pytest.fixture
def programs() -> Iterator[list[Program]]:
    programs: list[Program] = []
    yield programs
    for program in programs:
        program.close()


async def test_a_program_speaks_with_the_agent_through_the_path_it_was_told(programs: list[Program]) -> None:
    link = PtyServerLink()
    end = End(link)
    task = asyncio.create_task(link.run())
    path = (await end.told(Signal.LINK_UP))[1].removeprefix("opened ")
    assert path == link.path
    program = Program(path)
    programs.append(program)
    all_octets = bytes(range(256))
    program.say(all_octets)
    packet, peer = await end.packets.get()
    assert (packet, peer) == (all_octets, (path, 1))
    assert not termios.tcgetattr(program.descriptor)[3] & termios.ECHO
    link.send(all_octets[::-1], peer)
    assert await program.hear() == all_octets[::-1]
    assert link.describe(peer) == f"{path} address 1"
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert link.path is None
    assert end.signals.get_nowait()[0] is Signal.PEER_JOINED
    assert end.signals.get_nowait() == (Signal.LINK_DOWN, None, "closed")
    assert not link._lines, "nothing listens at a descriptor that is another file's soon"


async def test_programs_come_and_go(programs: list[Program]) -> None:
    link = PtyServerLink()
    async with running(link) as (end,):
        assert link.path is not None
        for number in range(3):
            program = Program(link.path)
            program.say(bytes([number]))
            packet, peer = await end.packets.get()
            link.send(packet, peer)
            assert await program.hear() == bytes([number])
            program.close()


async def test_our_client_takes_it_for_a_serial_port(tmp_path: Path) -> None:
    pytest.importorskip("serialx", reason="needs the extra [serial]")
    path = str(tmp_path / "robot.tty")
    link = PtyServerLink(path)
    async with running(link) as (end,):
        client = SerialClientLink(path)
        async with running(client) as (at_client,):
            client.send(b"question", client.remote)
            packet, peer = await end.packets.get()
            assert (packet, peer) == (b"question", (path, 1))
            link.send(b"answer", peer)
            assert await at_client.heard() == b"answer"


async def test_a_name_of_its_own_lasts_as_long_as_the_link(tmp_path: Path) -> None:
    name = tmp_path / "robot.tty"
    link = PtyServerLink(str(name))
    for _ in range(2):
        async with running(link):
            assert name.is_char_device()
        assert not name.is_symlink()


async def test_a_name_left_over_from_a_killed_process_is_taken_over(tmp_path: Path) -> None:
    name = tmp_path / "robot.tty"
    name.symlink_to(tmp_path / "gone")
    async with running(PtyServerLink(str(name))):
        assert name.is_char_device()


async def test_a_name_that_is_taken_is_explained(tmp_path: Path) -> None:
    name = tmp_path / "robot.tty"
    name.write_text("precious")
    with pytest.raises(LinkDown, match=r"robot.tty: File exists: choose another name, or remove it"):
        await PtyServerLink(str(name)).run()
    assert name.read_text() == "precious"
    with pytest.raises(LinkDown, match="No such file or directory"):
        await PtyServerLink(str(tmp_path / "no" / "folder")).run()


async def test_a_terminal_that_breaks_ends_the_link() -> None:
    link = PtyServerLink()
    end = End(link)
    task = asyncio.create_task(link.run())
    await end.told(Signal.LINK_UP)
    (line,) = link._lines.values()
    line.abort()
    with pytest.raises(LinkDown, match="pty:: the pseudo terminal has closed: start it again"):
        await task


async def test_windows_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(LinkDown, match="no pseudo terminals on Windows: use UDP or TCP"):
        await PtyServerLink().run()
