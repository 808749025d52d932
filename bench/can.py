"""What plug-and-play costs on a CAN bus, in virtual time: exact, the same on every machine.

Prints three tables: from plugging a part in to `active` with the bus time of the same frames beside it, without and
with header compression; the bits of the commonest messages in each mode; and the thesis' 418-byte message, which took
it "over a minute" (thesis 4.2.5).

    python bench/can.py
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library, write_sample
from msbot.demo import DemoRobot, Wire
from msbot.link import CanMasterLink, CanPartLink, Frame, Peer, SimBus, SimBusDriver, frame_bits, run_virtual
from msbot.link.can_frames import split
from msbot.registry import open_registry
from msbot.xrce import (
    STREAM_BEST_EFFORT,
    STREAM_RELIABLE,
    Acknack,
    Data,
    Header,
    Submessage,
    WriteData,
    compress,
    encode_message,
    read_request_id,
    write_request_id,
)


@dataclass(frozen=True)
class Rates:
    """One kind of bus."""

    nominal: int
    data: int | None = None

    @property
    def name(self) -> str:
        """In a table's words."""
        if self.data is None:
            return f"classic {self.nominal // 1000}k"
        return f"FD {self.nominal // 1000}k/{self.data // 1_000_000}M"

    def seconds(self, frame: Frame) -> float:
        """Time the frame occupies the bus."""
        return frame_bits(frame).seconds(self.nominal, self.data)

    def bus(self) -> SimBus:
        """A simulated bus."""
        return SimBus(self.nominal, data_bitrate=self.data, fd=self.data is not None)


BUSES = (
    *(Rates(bitrate) for bitrate in (125_000, 250_000, 500_000, 1_000_000)),
    Rates(500_000, 2_000_000),
    Rates(1_000_000, 5_000_000),
)

THESIS_BYTES = 418


@dataclass(frozen=True)
class PlugIn:
    """One part's way from the plug to `active`."""

    active_ms: float
    bus_ms: float
    frames: int
    bits: int


async def plug_in(rates: Rates, folder: Path, *, compression: bool) -> PlugIn:
    """Plug one part into a running robot."""
    library = load_library()
    blueprint = load_blueprint(folder / "robot.toml", library)
    registry = open_registry(folder / f"{rates.name.replace('/', '-')}-{compression}.db")
    robot = DemoRobot(
        blueprint,
        registry.store_for(registry.apply_blueprint(blueprint, library)),
        wire=Wire.CAN if rates.data is None else Wire.FD,
        bitrate=rates.nominal,
        data_bitrate=rates.data or 0,
        compression=compression,
        names=("AA",),
        random=Random(1),
        epoch_ns=lambda: 0,
    )
    loop = asyncio.get_running_loop()
    frames: list[tuple[float, Frame]] = []
    active = loop.create_future()
    robot.on_event = lambda event: (
        active.set_result(loop.time()) if event.to_state == "active" and not active.done() else None
    )
    async with asyncio.TaskGroup() as tasks:
        running = tasks.create_task(robot.run())
        await robot.master.ready.wait()
        robot.on_frame(lambda at, _name, frame: frames.append((at, frame)))
        until = await active
        snapshot = robot.snapshot()
        robot.finish()
        await running
    registry.close()
    sent = [frame for at, frame in frames if at <= until]
    milliseconds = snapshot.parts[0].plug_in_to_active_ms
    assert milliseconds is not None
    bits = sum(frame_bits(frame).nominal_bits + frame_bits(frame).data_bits for frame in sent)
    return PlugIn(milliseconds, sum(map(rates.seconds, sent)) * 1000, len(sent), bits)


async def one_message(rates: Rates, size: int) -> tuple[float, int]:
    """Milliseconds and frames of one message from a part to its master."""
    loop = asyncio.get_running_loop()
    driver = SimBusDriver(rates.bus())
    fd = rates.data is not None
    master = CanMasterLink(driver.attach("master"), profile_hash=1, random=Random(1), fd=fd)
    part = CanPartLink(driver.attach("part"), uid=bytes(range(1, 9)), random=Random(2))
    joined, arrived = asyncio.Event(), loop.create_future()
    part.on_signal(lambda *_: joined.set())
    frames: list[Frame] = []

    def received(packet: bytes, _peer: Peer, now: float) -> None:
        assert len(packet) == size
        arrived.set_result(now)

    master.on_packet(received)
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(link.run()) for link in (master, part)]
        await joined.wait()
        await asyncio.sleep(0.5)
        driver.tap = lambda _at, name, frame: frames.append(frame) if name == "part" else None
        start = loop.time()
        part.send(Random(3).randbytes(size), 0)
        took = await arrived - start
        for task in running:
            task.cancel()
    return took * 1000, len(frames)


NUMBER = 1000
"""Sequence number of the messages below."""
IN_SESSION = 0x81


def written(stream_id: int, object_id: int, payload: bytes) -> tuple[bool, bytes]:
    """A message of our client, from part to master."""
    write = WriteData(write_request_id(stream_id, NUMBER), object_id, payload)
    return True, _message(stream_id, NUMBER, write, pad_end=True)


def read(stream_id: int, object_id: int, payload: bytes) -> tuple[bool, bytes]:
    """A message of the agent, from master to part."""
    return False, _message(stream_id, NUMBER, Data(read_request_id(object_id), object_id, payload), pad_end=False)


def acknowledged() -> bytes:
    """The ACKNACK of a reliable message; the same both ways."""
    return _message(0, 0, Acknack(NUMBER + 1, 0, STREAM_RELIABLE), pad_end=False)


def _message(stream_id: int, sequence_nr: int, content: Submessage, *, pad_end: bool) -> bytes:
    return encode_message(Header(IN_SESSION, stream_id, sequence_nr), [content], pad_end=pad_end)


LEASE = bytes.fromhex("a3d81173")
ONE = bytes.fromhex("0000803f")
RELATED = write_request_id(STREAM_BEST_EFFORT, NUMBER).to_bytes(2, "big") + bytes.fromhex("0017")
NOISE = Random(3).randbytes(THESIS_BYTES - 12)
MESSAGES: tuple[tuple[str, list[tuple[bool, bytes]]], ...] = (
    (
        "heartbeat round trip",
        [
            written(STREAM_BEST_EFFORT, 0x0017, LEASE),
            read(STREAM_BEST_EFFORT, 0x0017, RELATED + (1).to_bytes(4, "little")),
        ],
    ),
    ("4-byte sample from a part, best effort", [written(STREAM_BEST_EFFORT, 0x0015, ONE)]),
    ("4-byte sample to a part, best effort", [read(STREAM_BEST_EFFORT, 0x0026, ONE)]),
    (
        "4-byte sample from a part, reliable, with its ACKNACK",
        [written(STREAM_RELIABLE, 0x0015, ONE), (False, acknowledged())],
    ),
    (
        "4-byte sample to a part, reliable, with its ACKNACK",
        [read(STREAM_RELIABLE, 0x0026, ONE), (True, acknowledged())],
    ),
    (f"{THESIS_BYTES}-byte message, noise", [read(STREAM_BEST_EFFORT, 0x0026, NOISE)]),
)


def classic(packet: bytes, can_id: int) -> list[Frame]:
    """Our frames on classic CAN."""
    return [Frame(can_id, data) for data in split(packet, 0, False)]


def fast(packet: bytes, can_id: int) -> list[Frame]:
    """Our frames on CAN FD with bit-rate switch."""
    return [Frame(can_id, data, fd=True, brs=True) for data in split(packet, 0, True)]


def thesis(packet: bytes, can_id: int) -> list[Frame]:
    """The frames of the thesis' firmware: 7 bytes behind an index that counts down to 0."""
    chunks = [packet[start : start + 7] for start in range(0, len(packet), 7)]
    return [Frame(can_id, bytes((len(chunks) - 1 - n,)) + chunk) for n, chunk in enumerate(chunks)]


MODES: tuple[tuple[str, Callable[[bytes, int], list[Frame]], Callable[[bytes], bytes], tuple[int, int]], ...] = (
    ("thesis", thesis, bytes, (0x123, 0x120)),
    ("classic", classic, bytes, (0x101, 0x181)),
    ("classic, compressed", classic, compress, (0x101, 0x181)),
    ("FD", fast, bytes, (0x101, 0x181)),
    ("FD, compressed", fast, compress, (0x101, 0x181)),
)
"""Name, frames of a packet, what is done to the packet before, identifiers up and down."""


def costs() -> None:
    """Print what the commonest messages cost in each mode."""
    print("\nFrames and bits on the wire, stuff bits and intermission included; FD: nominal + data bits\n")
    print(f"| message | {' | '.join(name for name, *_ in MODES)} |")
    print("|---" * (len(MODES) + 1) + "|")
    for name, packets in MESSAGES:
        cells = []
        for _, cut, prepare, (up_id, down_id) in MODES:
            frames = [frame for up, packet in packets for frame in cut(prepare(packet), up_id if up else down_id)]
            nominal, data = (sum(part) for part in zip(*map(frame_bits, frames), strict=True))
            cells.append(f"{len(frames)}: {nominal}" + (f" + {data}" if data else ""))
        print(f"| {name} | {' | '.join(cells)} |")


def main() -> None:
    """Print all tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_sample(folder / "robot.toml")
        print("From plug to active, one part, both steps, in virtual time; without / with header compression\n")
        print("| bus | plug-in to active ms | bus time of its frames ms | ratio | frames | bits |")
        print("|---|---|---|---|---|---|")
        for rates in BUSES:
            plain, short = (run_virtual(plug_in(rates, folder, compression=wanted)) for wanted in (False, True))
            print(
                f"| {rates.name} | {plain.active_ms:.1f} / {short.active_ms:.1f} "
                f"| {plain.bus_ms:.1f} / {short.bus_ms:.1f} "
                f"| {plain.active_ms / plain.bus_ms:.2f} / {short.active_ms / short.bus_ms:.2f} "
                f"| {plain.frames} / {short.frames} | {plain.bits} / {short.bits} |"
            )
    costs()
    print(f"\nOne message of {THESIS_BYTES} bytes (thesis: over a minute; its published code: 30,000 ms of delays)\n")
    print("| bus | ms | frames | times quicker than a minute |")
    print("|---|---|---|---|")
    for rates in BUSES:
        took_ms, frames = run_virtual(one_message(rates, THESIS_BYTES))
        print(f"| {rates.name} | {took_ms:.2f} | {frames} | {60_000 / took_ms:,.0f} |")


if __name__ == "__main__":
    main()
