"""Recorded clients over TCP and serial lines, octet for octet as they were on the wire, against our agent's own links.

The client's half is sent as it was recorded; where the genuine agent answered, ours must have answered before the
client goes on. So no clock is needed, and what must be equal is the same as in `test_replay`.
"""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Protocol

import pytest

from msbot_agent.agent import Agent
from msbot_agent.link import Link, Signal
from msbot_agent.link.byte_frames import TcpReceiver
from msbot_agent.link.net import TcpServerLink
from msbot_agent.link.serial import SerialServerLink
from msbot_agent.space import MemorySpace
from msbot_xrce.messages import Acknack, Heartbeat, decode_header, iter_submessages
from tests.agent.replay import VECTORS, Answers, Place, differences, load, recorded
from tests.agent.test_replay import EQUAL
from tests.link.ports import Board

AHEAD = "tcp_big_10k_pub"
"""Here the genuine agent sends more pieces than a window before the client acknowledges any; ours waits for it, so the
recorded order cannot be kept step by step. `test_replay` compares the answers."""

GROUPS = [names for names in EQUAL if names[0].startswith(("tcp_", "serial_")) and names[0] != AHEAD]


class FarEnd(Protocol):
    """A recorded client."""

    async def say(self, octets: bytes) -> None:
        """Put octets on the wire."""

    async def hear(self) -> list[bytes]:
        """The next packets of the agent, at least one."""


class TcpEnd:
    """A client's connection. It sends single octets where that is affordable, and the rest at once."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._receiver = TcpReceiver()

    async def say(self, octets: bytes) -> None:
        for octet in octets[:30]:
            self._writer.write(bytes([octet]))
            await asyncio.sleep(0)
        self._writer.write(octets[30:])

    async def hear(self) -> list[bytes]:
        while True:
            packets = self._receiver.receive(await self._reader.read(7))
            if packets:
                return packets


class SerialEnd:
    """A board at the far end of a line."""

    def __init__(self, board: Board) -> None:
        self._board = board

    async def say(self, octets: bytes) -> None:
        for start in range(0, len(octets), 42):  # as eProsima's client writes
            self._board.write(octets[start : start + 42])
            await asyncio.sleep(0)

    async def hear(self) -> list[bytes]:
        return [await self._board.hear()]


@asynccontextmanager
async def serving(link: Link) -> AsyncIterator[None]:
    """Our agent on that link."""
    up = asyncio.Event()
    agent = Agent(MemorySpace(), signal=lambda _link, signal, *_: up.set() if signal is Signal.LINK_UP else None)
    agent.add_link(link)
    task = asyncio.create_task(agent.run())
    await up.wait()
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@asynccontextmanager
async def over_tcp(places: set[Place]) -> AsyncIterator[dict[Place, FarEnd]]:
    """The agent over TCP, and a connection for each client."""
    link = TcpServerLink("127.0.0.1", 0)
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(serving(link))
        ends: dict[Place, FarEnd] = {}
        for place in places:
            reader, writer = await asyncio.open_connection("127.0.0.1", link.port)
            stack.callback(writer.close)
            ends[place] = TcpEnd(reader, writer)
        yield ends


@asynccontextmanager
async def over_serial(places: set[Place], folder: Path) -> AsyncIterator[dict[Place, FarEnd]]:
    """The agent on a port for each client."""
    boards = {place: Board(folder / f"tty{number}") for number, place in enumerate(sorted(places))}
    async with AsyncExitStack() as stack:
        for board in boards.values():
            board.plug()
            stack.callback(board.pull)
        await stack.enter_async_context(serving(SerialServerLink([board.port for board in boards.values()])))
        yield {place: SerialEnd(board) for place, board in boards.items()}


def octets_of(names: list[str]) -> list[tuple[float, Place, bool, bytes]]:
    """The lines of recordings with their framing: `(time, client, from it, octets)`."""
    lines = []
    for name in names:
        for text in (VECTORS / f"{name}.jsonl").read_text().splitlines():
            entry = json.loads(text)
            place = (name, entry.get("client", 0))
            lines.append((entry["t"], place, entry["dir"] == "client>agent", bytes.fromhex(entry["hex"])))
    return sorted(lines, key=lambda line: line[0])


def is_only(kind: type[Acknack | Heartbeat], packet: bytes) -> bool:
    """Whether the packet consists of those."""
    header = decode_header(packet)
    return all(isinstance(submessage, kind) for submessage in iter_submessages(packet, header.size))


async def replay(names: list[str], ends: dict[Place, FarEnd]) -> dict[Place, Answers]:
    """What our agent answers when the clients say the same, without ACKNACKs: one speaks for all that came at once."""
    answers: dict[Place, Answers] = defaultdict(Answers)
    waiting: dict[Place, list[bytes]] = defaultdict(list)
    acknowledged: dict[Place, int] = defaultdict(int)
    packets = iter(load(*names))
    for _, place, from_client, octets in octets_of(names):
        packet = next(packets).packet
        if is_only(Heartbeat, packet) and not from_client:
            continue
        if from_client:
            await ends[place].say(octets)
            continue
        is_acknack = is_only(Acknack, packet)
        while acknowledged[place] < first_unacknowledged(packet) if is_acknack else not waiting[place]:
            for heard in await ends[place].hear():
                if is_only(Acknack, heard):
                    acknowledged[place] = max(acknowledged[place], first_unacknowledged(heard))
                elif not is_only(Heartbeat, heard):
                    waiting[place].append(heard)
        if not is_acknack:
            answers[place].add(waiting[place].pop(0))
    return answers


def first_unacknowledged(packet: bytes) -> int:
    """What an ACKNACK says has not come yet; these clients use one stream and few numbers."""
    return int.from_bytes(packet[-5:-3], "little")


@pytest.mark.parametrize("names", GROUPS, ids=lambda names: names[0])
async def test_answers_over_the_wire_are_those_of_the_genuine_agent(names: list[str], tmp_path: Path) -> None:
    lines = load(*names)
    places = {line.place for line in lines}
    if names[0].startswith("serial_"):
        pytest.importorskip("serialx", reason="needs the extra [serial]")
        network = over_serial(places, tmp_path)
    else:
        network = over_tcp(places)
    async with asyncio.timeout(30), network as ends:
        answers = await replay(names, ends)
    assert not differences(recorded(line for line in lines if not is_only(Acknack, line.packet)), answers)
