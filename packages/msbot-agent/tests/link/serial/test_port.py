from __future__ import annotations

import asyncio
import errno
import importlib.util
import os
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from msbot_agent.link import Signal
from msbot_agent.link.serial import SerialClientLink, SerialServerLink
from msbot_agent.link.serial import serial_port as serial
from msbot_agent.link.serial.serial_port import OTHER_SOURCE, check_baudrate, why_not
from msbot_xrce.errors import ConfigError, LinkDown
from tests.link.ends import End, running
from tests.link.ports import Board

serialx = pytest.importorskip("serialx", reason="needs the extra [serial]")
QUICK_S = 0.005
"""Between two looks for ports, in tests."""


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    board = Board(tmp_path / "ttyTEST")
    board.plug()
    yield board
    board.pull()


@asynccontextmanager
async def serving(*boards: Board) -> AsyncIterator[tuple[SerialServerLink, End]]:
    link = SerialServerLink([board.port for board in boards], rescan_s=QUICK_S)
    async with running(link) as (end,):
        yield link, end


async def opened(link: SerialServerLink, board: Board) -> None:
    """Wait until the port is open; what came before is thrown away, as it may be half a frame."""
    while board.port not in link.open_ports:  # noqa: ASYNC110 - a port that opens makes no sound
        await asyncio.sleep(0)


async def test_a_board_and_the_agent_exchange_packets(board: Board) -> None:
    async with serving(board) as (link, end):
        board.say(b"hello \x7e\x7d")
        peer = (board.port, 1)
        assert await end.told(Signal.PEER_JOINED) == (peer, "heard for the first time")
        assert await end.packets.get() == (b"hello \x7e\x7d", peer)
        assert link.describe(peer) == f"{board.port} address 1"
        assert link.has_room(peer)
        link.send(b"\x7e answer", peer)
        assert await board.hear() == b"\x7e answer"
    assert link.info.bits_per_second == 115200
    assert (link.counters.packets_in, link.counters.packets_out) == (1, 1)


async def test_one_line_carries_clients_of_several_addresses(board: Board) -> None:
    async with serving(board) as (link, end):
        for address in (1, 2, 0x7E, 0):
            board.say(b"I am", source=address)
            _, peer = await end.packets.get()
            assert peer == (board.port, address)
            link.send(b"you are", peer)
            octets = await board.read()
            assert octets[:3] in (bytes((0x7E, 0, address)), b"\x7e\x00\x7d")


async def test_several_ports_at_once(tmp_path: Path) -> None:
    boards = [Board(tmp_path / f"tty{number}") for number in range(3)]
    for board in boards:
        board.plug()
    async with serving(*boards) as (link, end):
        assert link.open_ports == [board.port for board in boards]
        for board in boards:
            board.say(board.port.encode())
            packet, peer = await end.packets.get()
            assert peer == (packet.decode(), 1)
            link.send(b"!", peer)
            assert await board.hear() == b"!"
    for board in boards:
        board.pull()


async def test_case_74_noise_other_addresses_and_wrong_check_sums_are_ignored(board: Board) -> None:
    async with serving(board) as (link, end):
        board.write(b"garbage \x00\x7d before")
        board.say(b"for somebody else", destination=5)
        board.write(bytes.fromhex("7e 00 00 09 00 31 32 33 34 35 36 37 38 39 3d ba"))  # one bit of the check sum
        board.write(bytes.fromhex("7e 00 00 09 00 31 32 33 34 35 36 37 38 79 3d bb"))  # one bit of the contents
        board.write(bytes.fromhex("7e 01 00 40 00 31 32"))  # cut short by the next frame
        board.write(bytes.fromhex("7e 01 00 10 00 80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00 cf 12"))
        assert await end.heard() == bytes.fromhex("80000000020108000 00afffd02000000".replace(" ", ""))
        assert link.counters.dropped == {"for another address": 1, "wrong check sum": 2, "frame cut short": 1}
        assert end.packets.empty()


async def test_frames_may_come_octet_by_octet(board: Board) -> None:
    async with serving(board) as (_, end):
        for octet in bytes.fromhex("7e 00 00 09 00 31 32 33 34 35 36 37 38 39 3d bb"):
            board.write(bytes([octet]))
            await asyncio.sleep(0)
        assert await end.heard() == b"123456789"


async def test_a_port_that_vanishes_takes_its_peers_along_and_brings_them_back(board: Board) -> None:
    async with serving(board) as (link, end):
        for address in (1, 2):
            board.say(b"x", source=address)
        peers = [(await end.told(Signal.PEER_JOINED))[0] for _ in range(2)]
        board.pull()
        gone = [await end.told(Signal.PEER_GONE) for _ in range(2)]
        assert [peer for peer, _ in gone] == peers
        assert all(words.startswith("port broken: ") for _, words in gone)
        assert not link.has_room(peers[0])
        with pytest.raises(LinkDown, match=r"there is no connection with .* address 1"):
            link.send(b"x", peers[0])
        board.plug()
        assert [await end.told(Signal.PEER_BACK) for _ in range(2)] == [
            (peer, "its port is there again") for peer in peers
        ]
        link.send(b"still there?", peers[0])
        assert await board.hear() == b"still there?"


async def test_a_port_that_is_not_there_yet_is_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    board = Board(tmp_path / "ttyLATE")
    async with serving(board) as (link, end):
        assert link.open_ports == []
        assert [
            record.message for record in caplog.records if record.name == "msbot_agent.link.serial.serial_port"
        ] == [f"serial port {board.port} is not there: it will be used as soon as it is plugged in"]
        board.plug()
        await opened(link, board)
        board.say(b"here I am")
        assert await end.heard() == b"here I am"
    board.pull()


async def test_every_usb_port_is_used_unless_ports_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boards = [Board(tmp_path / "ttyUSB0"), Board(tmp_path / "ttyUSB1")]
    plugged: list[Board] = [boards[0]]

    async def listed() -> list[SimpleNamespace]:
        on_board = SimpleNamespace(device="/dev/ttyS0", vid=None)
        return [on_board, *(SimpleNamespace(device=board.port, vid=0x10C4) for board in plugged)]

    monkeypatch.setattr(serialx, "async_list_serial_ports", listed)
    boards[0].plug()
    link = SerialServerLink(rescan_s=QUICK_S)
    assert link.info.name == "serial:auto"
    async with running(link) as (end,):
        assert link.open_ports == [boards[0].port]
        boards[1].plug()
        plugged.append(boards[1])
        await opened(link, boards[1])
        boards[1].say(b"new here")
        assert await end.packets.get() == (b"new here", (boards[1].port, 1))
    for board in boards:
        board.pull()


async def test_a_usb_port_that_cannot_be_used_does_not_disturb_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    looks: asyncio.Queue[None] = asyncio.Queue()

    async def listed() -> list[SimpleNamespace]:
        looks.put_nowait(None)
        return [SimpleNamespace(device="/dev/null", vid=1)]

    monkeypatch.setattr(serialx, "async_list_serial_ports", listed)
    async with running(SerialServerLink(rescan_s=QUICK_S)):
        for _ in range(3):
            await looks.get()
    said = [record.message for record in caplog.records if record.name == "msbot_agent.link.serial.serial_port"]
    assert len(said) == 1
    assert "cannot use serial port /dev/null: it is not a serial port" in said[0]


@pytest.mark.parametrize("port", ["/dev/null", "/", __file__])
async def test_a_port_that_is_none_is_explained(port: str) -> None:
    for link in (SerialServerLink([port]), SerialClientLink(port)):
        with pytest.raises(LinkDown, match="it is not a serial port: `ls /dev/serial/by-id`"):
            await link.run()


async def test_a_port_in_use_is_explained(board: Board) -> None:
    async with serving(board):
        with pytest.raises(LinkDown, match="another program uses it: end that one"):
            await SerialClientLink(board.port).run()


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EACCES, "cannot use serial port p: no permission: join the group"),
        (errno.EINVAL, "cannot use serial port p: it does not take the baud rate: try 115200"),
        (errno.EIO, "cannot use serial port p: Input/output error"),
        (errno.ENXIO, "serial port p is not there"),
    ],
)
def test_other_troubles_are_explained(number: int, words: str) -> None:
    assert why_not("p", OSError(number, os.strerror(number))).startswith(words)


@pytest.mark.parametrize("baudrate", [50, 115_200, 20_000_000])
def test_a_baud_rate_within_the_limits_is_taken(baudrate: int) -> None:
    assert check_baudrate(baudrate) == baudrate


@pytest.mark.parametrize("baudrate", [0, 49, 20_000_001])
def test_a_baud_rate_that_cannot_be_is_refused(baudrate: int) -> None:
    with pytest.raises(ConfigError, match=f"baud rate {baudrate} is not from 50 to 20000000"):
        SerialServerLink(baudrate=baudrate)
    with pytest.raises(ConfigError, match="115200 is usual"):
        SerialClientLink("p", baudrate=baudrate)


def test_an_address_that_cannot_be_is_refused() -> None:
    with pytest.raises(ConfigError, match="serial address 256 is not from 0 to 255"):
        SerialClientLink("p", address=256)


@pytest.mark.parametrize("link", [SerialServerLink(["p"]), SerialClientLink("p")], ids=["server", "client"])
async def test_without_the_library_the_extra_is_named(
    link: SerialServerLink | SerialClientLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LinkDown, match=r"serial:p: serial ports need .* `pip install 'msbot-agent\[serial\]'`"):
        await link.run()


async def test_our_client_speaks_with_the_agent_at_the_far_end(board: Board) -> None:
    board.address = 0
    link = SerialClientLink(board.port, address=7, rescan_s=QUICK_S)
    async with running(link) as (end,):
        link.send(b"question", link.remote)
        assert (await board.read())[:3] == b"\x7e\x07\x00"
        board.say(b"for another", destination=8)
        board.say(b"of another", source=3, destination=7)
        board.say(b"answer", destination=7)
        assert await end.packets.get() == (b"answer", link.remote)
        assert link.counters.dropped == {"for another address": 1, OTHER_SOURCE: 1}
    assert end.signals.get_nowait() == (Signal.LINK_DOWN, link.remote, "closed")


async def test_our_client_survives_that_the_cable_is_pulled(board: Board) -> None:
    link = SerialClientLink(board.port, rescan_s=QUICK_S)
    async with running(link) as (end,):
        board.pull()
        peer, words = await end.told(Signal.LINK_DOWN)
        assert (peer, words[:12]) == (link.remote, "port broken:")
        assert not link.has_room(link.remote)
        board.plug()
        assert await end.told(Signal.LINK_UP) == (link.remote, "opened")
        link.send(b"again", link.remote)
        assert (await board.read())[:3] == b"\x7e\x01\x00"


async def test_a_line_that_nobody_reads_fills_up_and_has_room_again(board: Board) -> None:
    async with serving(board) as (link, end):
        board.say(b"x")
        _, peer = await end.packets.get()
        while link.has_room(peer):
            link.send(bytes(500), peer)
        while not end.room.qsize():
            await board.read()
        assert end.room.get_nowait() == peer
        assert link.has_room(peer)


async def test_a_link_can_run_again(board: Board) -> None:
    link = SerialServerLink([board.port], rescan_s=QUICK_S)
    for _ in range(2):
        async with running(link) as (end,):
            board.say(b"x")
            assert await end.heard() == b"x"
        assert link.open_ports == []
        assert [end.signals.get_nowait()[0] for _ in range(2)] == [Signal.PEER_JOINED, Signal.LINK_DOWN]


async def test_ending_while_a_port_is_being_opened_leaves_nothing_behind(board: Board) -> None:
    for turns in range(12):
        task = asyncio.create_task(SerialServerLink([board.port]).run())
        for _ in range(turns):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    async with serving(board) as (_, end):
        board.say(b"x")
        assert await end.heard() == b"x"


async def test_usb_ports_are_listed_by_their_lasting_names() -> None:
    assert all(isinstance(port, str) for port in await serial.usb_ports())


@pytest.mark.parametrize("chosen", [{}, {"flow_control": False}, {"flow_control": True}])
@pytest.mark.parametrize("kind", [SerialClientLink, SerialServerLink])
async def test_a_port_uses_rts_and_cts_only_when_it_is_asked_to(
    kind: type[SerialClientLink | SerialServerLink], chosen: dict[str, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = asyncio.get_running_loop().create_future()

    async def create(_loop: object, _make: object, port: str, **settings: object) -> None:
        if not opened.done():
            opened.set_result((port, settings))
        raise FileNotFoundError(errno.ENOENT, "not there")

    monkeypatch.setattr(serialx, "create_serial_connection", create)
    ports = "/dev/ttyTEST" if kind is SerialClientLink else ["/dev/ttyTEST"]
    serving = asyncio.create_task(kind(ports, baudrate=9600, **chosen).run())  # type: ignore[arg-type]
    assert await opened == ("/dev/ttyTEST", {"baudrate": 9600, "rtscts": chosen.get("flow_control", False)})
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
