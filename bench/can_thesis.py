"""The thesis' figures about CAN, and ours beside them, each measured here (headline figures H1 to H10 and H14)."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from random import Random

from bench.buses import BUSES, Rates, bits, table
from bench.can_costs import (
    BEAT,
    CREATE_CLIENT,
    HEARTBEAT,
    LARGE,
    STATUS_AGENT,
    THESIS_BEAT,
    THESIS_BYTES,
    Packets,
    frames_of,
)
from bench.can_setup import CLASSIC, COMPRESSED, THESIS, XML, component, set_up
from bench.crowd import Outcome
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Peer
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.adapters.can_driver import RING_FRAMES
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.sim import SimBusDriver
from msbot_xrce.messages import Heartbeat, ObjectKind, decode_header, iter_submessages

AT = BUSES[2]
"""500 kbit/s, the thesis' bit rate."""
FAST = BUSES[4]
"""CAN FD, 500 kbit/s and 2 Mbit/s."""
SIZES = (1, 1791, 1792, 1793, 4096)
"""Messages across the thesis' limit and up to ours."""
LARGE_SAMPLE = 60_000


async def one_message(rates: Rates, size: int) -> tuple[float, int]:
    """Milliseconds and frames of one message from a part to its master."""
    loop = asyncio.get_running_loop()
    driver = SimBusDriver(rates.bus())
    master = CanMasterLink(driver.attach("master"), profile_hash=1, random=Random(1), fd=rates.fd)
    part = CanPartLink(driver.attach("part"), uid=bytes(range(1, 9)), random=Random(2))
    joined, arrived = asyncio.Event(), loop.create_future()
    part.attach(signal=lambda *_: joined.set())
    frames: list[Frame] = []
    message = Random(size).randbytes(size)

    def received(packet: bytes, _peer: Peer, now: float) -> None:
        assert packet == message
        arrived.set_result(now)

    master.attach(packet=received)
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(link.run()) for link in (master, part)]
        await joined.wait()
        await asyncio.sleep(0.5)
        driver.tap = lambda _at, name, frame: frames.append(frame) if name == "part" else None
        start = loop.time()
        part.send(message, 0)
        took = await arrived - start
        for task in running:
            task.cancel()
    return took * 1000, len(frames)


@dataclass(frozen=True)
class Echo:
    """A reliable sample that a component writes and reads back."""

    seconds: float
    heartbeats: int
    """XRCE HEARTBEATs on the bus meanwhile."""
    wrong: int
    """Samples that arrived other than they were sent, twice, or not at all."""


async def echo(size: int, *, lose: int = 0) -> Echo:
    """Send one sample to the agent and back; `lose` frames in a row do not reach the master."""
    loop = asyncio.get_running_loop()
    sample = Random(size).randbytes(size)
    came: list[bytes] = []
    back = asyncio.Event()
    heartbeats = 0

    def taken(_object_id: int, _request_id: int, payload: bytes) -> None:
        came.append(payload)
        back.set()

    async with component(AT, CLASSIC, on_topic=taken) as room:

        def seen(_now: float, _way: str, _peer: object, packet: bytes) -> None:
            nonlocal heartbeats
            header = decode_header(packet)
            heartbeats += sum(isinstance(one, Heartbeat) for one in iter_submessages(packet, header.size))

        made = room.create()
        room.client.read(made[ObjectKind.DATAREADER])
        await room.client.connect()
        await room.client.until_all_statuses(timeout_s=10.0)
        await asyncio.sleep(0.5)
        room.link.tap = seen
        if lose:
            room.driver.bus.deafen(room.master.node, frames=lose)
        start = loop.time()
        room.client.write(made[ObjectKind.DATAWRITER], sample)
        async with asyncio.timeout(60.0):
            await back.wait()
        took = loop.time() - start
        await asyncio.sleep(2.0)
    return Echo(took, heartbeats, int(came != [sample]))


def thesis_table(full: Outcome) -> list[str]:
    """The thesis' figures beside ours; `full` is the run with 120 parts at 500 kbit/s."""
    head = ["", "what", "thesis", "here", "how measured"]
    return table(
        head,
        [
            _large(),
            *_set_up(),
            _frames(),
            _efficiency(),
            _largest(),
            _heartbeats(),
            _ring(),
            _loss(),
            _clients(full),
            _beats(),
        ],
    )


def _large() -> list[str]:
    took_ms, frames = run_virtual(one_message(AT, THESIS_BYTES))
    return [
        "H1",
        f"{THESIS_BYTES} bytes over classic CAN",
        "over a minute; its published code waits 30.0 s",
        f"{took_ms:.1f} ms, {frames} frames",
        "one message from a part to its master, from `send` to the packet handler",
    ]


def _set_up() -> list[list[str]]:
    ours, legacy = (run_virtual(set_up(AT, framing)) for framing in (COMPRESSED, THESIS))
    tries = str(max(ours.logins, legacy.logins))
    return [
        [
            "H2",
            "tries until the session is open",
            "8 to 10; 2 to 3 with its symbols",
            tries,
            "CREATE_CLIENT messages that the agent gets; the same at every bit rate (table above)",
        ],
        [
            "H3",
            "all statuses OK within 1000 ms",
            "4 of 5 or 6, then given up",
            f"{legacy.statuses} of {len(XML)} after {legacy.seconds * 1000:.1f} ms in its own framing, "
            f"{ours.seconds * 1000:.1f} ms in ours",
            "`until_all_statuses` of the client, the same six objects by XML",
        ],
    ]


def _frames() -> list[str]:
    def counts(packets: Packets) -> str:
        modes = ("classic", "classic, compressed", "FD")
        return " / ".join(str(len(frames_of(packets, mode))) for mode in modes)

    messages = (CREATE_CLIENT, STATUS_AGENT, HEARTBEAT, LARGE)
    return [
        "H4",
        f"frames of CREATE_CLIENT, STATUS_AGENT, HEARTBEAT, {THESIS_BYTES} bytes",
        "4, 3, 2, 60",
        ", ".join(map(counts, messages)),
        "classic / with header compression / CAN FD",
    ]


def _efficiency() -> list[str]:
    payload = 8 * THESIS_BYTES
    on_classic = payload / bits(frames_of(LARGE, "classic")).nominal_bits
    on_fd = payload / (FAST.seconds(frames_of(LARGE, "FD")) * FAST.nominal)
    return [
        "H5",
        "payload bits for each bit time",
        "0.59 ideal; 0.52 with its index byte",
        f"{56 / 108:.2f} counted as the thesis does; {on_classic:.2f} with stuff bits and pauses; "
        f"{on_fd:.2f} on {FAST.name}",
        f"the frames of {THESIS_BYTES} bytes of noise",
    ]


def _largest() -> list[str]:
    for size in SIZES:
        run_virtual(one_message(AT, size))  # stops with an error unless the message arrives as it was sent
    large = run_virtual(echo(LARGE_SAMPLE))
    return [
        "H6",
        "largest message",
        "1792 bytes; longer ones arrive as garbage",
        f"{SIZES[-1]} bytes; samples of any size in pieces, {LARGE_SAMPLE:,} bytes tried; {large.wrong} wrong",
        f"messages of {', '.join(map(str, SIZES))} bytes, byte by byte; a sample there and back",
    ]


def _heartbeats() -> list[str]:
    sent = run_virtual(echo(THESIS_BYTES))
    return [
        "H7",
        f"XRCE HEARTBEATs while {THESIS_BYTES} bytes are sent",
        "300 or more",
        str(sent.heartbeats),
        "a reliable sample to the agent and back, all packets looked at",
    ]


def _ring() -> list[str]:
    return [
        "H8",
        "receive ring",
        "4096 bytes, full after 132 HEARTBEATs, then out of step for good",
        f"{RING_FRAMES} frames; overflow is counted, and the next whole message is received",
        "`packages/msbot-agent/tests/link/test_can_driver.py`; on the simulated bus there is no ring",
    ]


def _loss() -> list[str]:
    sent = run_virtual(echo(24, lose=1))
    return [
        "H9",
        "one frame lost",
        "a wrong message is delivered (17 of 24 bytes)",
        f"{sent.wrong} wrong; noticed and sent again, there after {sent.seconds:.1f} s",
        "the master is deaf for one frame of a reliable sample",
    ]


def _clients(full: Outcome) -> list[str]:
    return [
        "H10",
        "clients on one bus",
        "2 by its table, 1 by its fixed identifier",
        str(len(full.active_s)),
        f"switched on together, all active after {full.last_s:.2f} s, {full.lost} lost (table above)",
    ]


def _beats() -> list[str]:
    ours, theirs = (
        sum(bits(frames_of(packets, mode)))
        for packets, mode in ((BEAT, "classic, compressed"), (THESIS_BEAT, "thesis"))
    )
    return [
        "H14",
        "a component's request and reply each second",
        f"96 + 96 bytes (27 + 9 used), {theirs} bits: {theirs / AT.nominal:.2%} of the bus",
        f"4 + 4 bytes, {ours} bits: {ours / AT.nominal:.3%} of the bus",
        "a beat and its answer; the thesis' with the acknowledgements of its reliable streams",
    ]
