"""What a sample on a CAN bus costs, from the frames as Linux hands them over to the frames that deliver it.

Two parts, a writer and a reader, are on the bus of an agent: the agent's end is the real one (SocketCAN's reader, the
driver, the port, the CAN link with header compression, the agent), only the socket is a local one, because it keeps
packets apart as CAN_RAW sockets do and every machine has it. The parts' frames are made beforehand; what is measured
is the processor time of the agent's side until the reader's frames are sent.

    python -m bench.can_path [--quick] [--profile]
"""

from __future__ import annotations

import argparse
import asyncio
import cProfile
import io
import pstats
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random

from bench.machine import describe_machine
from bench.path import Client
from bench.path_wires import Wire
from msbot_agent.agent import Agent
from msbot_agent.link import LinkCounters, Peer
from msbot_agent.link.can import CanBusInfo, CanMasterLink, Codec
from msbot_agent.link.can.adapters import CanDriver
from msbot_agent.link.can.adapters.error_frames import FD_SIZE, pack_frame, unpack_frame
from msbot_agent.link.can.adapters.interface import CanInterface
from msbot_agent.link.can.adapters.remedies import Wanted
from msbot_agent.link.can.adapters.socketcan import SocketCanAdapter
from msbot_agent.link.can.filters import IdFilter
from msbot_agent.link.can.legacy_link import PeerFraming
from msbot_agent.link.can.protocol import CanIds, Frame
from msbot_agent.link.can.protocol.ids import COMPRESSION, join_frame, read_assign
from msbot_agent.space import MemorySpace
from msbot_xrce import ClientSession, ClientSessionSettings, ClientState, compress, decompress
from msbot_xrce.messages import (
    STREAM_BEST_EFFORT,
    STREAM_RELIABLE,
    DeliveryControl,
    ObjectKind,
    ObjectVariant,
    make_object_id,
)
from msbot_xrce.objects import (
    RELIABLE_QOS,
    participant_variant,
    publisher_variant,
    reader_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from msbot_xrce.sessions import DataReceived

IDS = CanIds()
CODEC = Codec(compress, decompress)
INFO = CanBusInfo("can:bench", None)
INTERFACE = CanInterface("bench", 1, is_can=True, is_up=True, mtu=16, kind="can")
SETTINGS = ClientSessionSettings(ids_by_rule=True)
"""As those of a part on a link that compresses."""
BUS_FRAMES = 8_500
"""Frames of 8 bytes that a 1 Mbit/s bus carries in a second at most (111 bits and few stuff bits, bench/can.py)."""


class Bus:
    """The other side of the agent's socket: all other controllers."""

    def __init__(self) -> None:
        self.wire: socket.socket
        self.seconds = 0.0
        """Processor time of the agent's side."""
        self.frames_in = 0
        self.frames_out = 0

    def connect(self, _: Wanted, __: Sequence[IdFilter] | None) -> socket.socket:
        """The socket of the agent's adapter."""
        ours, self.wire = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self.wire.setblocking(False)
        self.wire.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        return ours

    async def exchange(self, raw: Sequence[bytes]) -> list[Frame]:
        """Frames come in; what goes out because of them."""
        send = self.wire.send
        for one in raw:
            send(one)
        start = time.thread_time()
        for _ in range(3):  # the reader, then the flush of the agent, each behind this task
            await asyncio.sleep(0)
        self.seconds += time.thread_time() - start
        self.frames_in += len(raw)
        frames = []
        try:
            while True:
                frame = unpack_frame(self.wire.recv(FD_SIZE))
                assert frame is not None
                frames.append(frame)
        except BlockingIOError:
            self.frames_out += len(frames)
            return frames


class Part:
    """A part's session on the bus, without an event loop of its own."""

    def __init__(self, bus: Bus, key: int) -> None:
        self.bus = bus
        self.key = key
        self.session = ClientSession(key, settings=SETTINGS, epoch_ns=lambda: 0)
        self.samples = 0
        self.wire: PeerFraming
        self.node_id = 0

    async def join(self) -> None:
        """Get an address, log in."""
        uid = self.key.to_bytes(8)
        for frame in await self.bus.exchange([pack_frame(join_frame(uid, COMPRESSION, IDS))]):
            assign = read_assign(frame, IDS)
            if assign is not None and assign.uid == uid:
                self.node_id = assign.node_id
        assert self.node_id
        counters = LinkCounters()
        self.wire = PeerFraming(
            IDS.up + self.node_id, use=COMPRESSION, info=INFO, mtu=512, counters=counters, codec=CODEC
        )
        self.session.connect(0.0)
        await self.settle()
        assert self.session.state is ClientState.CONNECTED
        self.participant = await self.make(ObjectKind.PARTICIPANT, participant_variant("bench", 0))
        self.topic = await self.make(ObjectKind.TOPIC, topic_variant("bench", "bench", self.participant))

    def frames(self) -> list[bytes]:
        """What the session has to say."""
        packets = self.session.packets_to_send(0.0)
        return [pack_frame(frame) for packet in packets for frame in self.wire.split(packet)]

    def hear(self, frames: Sequence[Frame]) -> None:
        """Frames on the bus."""
        for frame in frames:
            if frame.can_id == IDS.down + self.node_id:
                message = self.wire.joiner.receive(frame.data, 0.0)
                packet = None if message is None else self.wire.unpack(message)
                if packet is not None:
                    self.session.receive_packet(packet, 0.0)
        while (event := self.session.next_event()) is not None:
            self.samples += isinstance(event, DataReceived)

    async def settle(self) -> None:
        """Exchange frames until nobody has any."""
        while raw := self.frames():
            self.hear(await self.bus.exchange(raw))

    async def make(self, kind: ObjectKind, variant: ObjectVariant) -> int:
        """Create object number 1 of that kind."""
        object_id = make_object_id(1, kind)
        self.session.create(object_id, variant)
        await self.settle()
        return object_id

    async def leave(self) -> None:
        """Log out."""
        self.session.close(0.0)
        await self.settle()

    async def writer(self) -> int:
        """A writer of the topic."""
        publisher = await self.make(ObjectKind.PUBLISHER, publisher_variant(self.participant))
        return await self.make(ObjectKind.DATAWRITER, writer_variant(self.topic, publisher, RELIABLE_QOS))

    async def reader(self, stream_id: int) -> None:
        """A reader of the topic that reads."""
        subscriber = await self.make(ObjectKind.SUBSCRIBER, subscriber_variant(self.participant))
        reader = await self.make(ObjectKind.DATAREADER, reader_variant(self.topic, subscriber, RELIABLE_QOS))
        self.session.read(reader, stream_id, DeliveryControl())
        await self.settle()


@dataclass(frozen=True)
class Load:
    """One row of the table."""

    name: str
    payload: int
    stream_id: int
    burst: int


LOADS = tuple(
    Load(f"{size} bytes, {name}", size, stream_id, burst)
    for size in (4, 64)
    for name, stream_id in (("best effort", STREAM_BEST_EFFORT), ("reliable", STREAM_RELIABLE))
    for burst in (1, 8)
)


@dataclass(frozen=True)
class Figures:
    """Of one run."""

    microseconds: float
    """Processor time for a sample."""
    frames_in: float
    frames_out: float
    """Frames for a sample."""

    @property
    def frames_per_s(self) -> float:
        """Received frames a second, besides those that are sent."""
        return self.frames_in / self.microseconds * 1e6


OTHERS = """
import socket, sys, threading
bus = socket.socket(fileno=int(sys.argv[1]))
bus.setblocking(True)
def drain():
    while bus.recv(72): pass
threading.Thread(target=drain, daemon=True).start()
frames = open(sys.argv[2], "rb").read()
for at in range(0, len(frames), 16): bus.send(frames[at:at + 16])
"""
"""A program that is all other controllers: says its frames as fast as they are taken, and hears the agent's."""


class Stand:
    """An agent on the bus, a writer and a reader."""

    def __init__(self) -> None:
        self.bus = Bus()
        adapter = SocketCanAdapter(Wanted("bench"), INFO, find=lambda _: INTERFACE, connect=self.bus.connect)
        self.link = CanMasterLink(CanDriver(adapter), profile_hash=1, random=Random(1), codec=CODEC)
        self.agent = Agent(MemorySpace())
        self.agent.add_link(self.link)
        self.writing, self.reading = Part(self.bus, 1), Part(self.bus, 2)
        self.writer = 0

    async def open(self, stream_id: int) -> asyncio.Task[None]:
        """Start everything; the agent's task."""
        serving = asyncio.ensure_future(self.agent.run())
        await asyncio.sleep(0.01)
        await self.writing.join()
        await self.reading.join()
        self.writer = await self.writing.writer()
        await self.reading.reader(stream_id)
        return serving


class Listener(Wire):
    """A link in memory to a reader in the agent's own process; counts what it is sent."""

    def __init__(self) -> None:
        super().__init__()
        self.samples = 0
        self.count = 0
        self.first, self.last = asyncio.Event(), asyncio.Event()

    def send(self, packet: bytes, peer: Peer) -> None:
        """Count it, once `samples` is set."""
        if not self.samples:
            super().send(packet, peer)
            return
        self.count += 1
        if self.count == 1:
            self.first.set()
        elif self.count == self.samples:
            self.last.set()


async def flood(samples: int) -> tuple[float, float]:
    """Samples of 4 octets, one frame each, as fast as another program can say them, for a reader in this process.

    Returns:
        Samples a second of processor time, and of the clock; all are delivered.
    """
    stand, listener = Stand(), Listener()
    stand.agent.add_link(listener)
    serving = await stand.open(STREAM_BEST_EFFORT)
    reading = Client(listener, 3)
    reading.read(reading.reader(), STREAM_BEST_EFFORT)
    reading.session.ping(0.0)
    # Alive now, not only at the beginning of time.
    listener.hand_in(reading.session.packets_to_send(0.0), reading.key)
    listener.work(asyncio.get_running_loop().time())
    await stand.reading.leave()
    frames: list[bytes] = []
    for number in range(samples):
        stand.writing.session.write(stand.writer, number.to_bytes(4), STREAM_BEST_EFFORT)
        frames += stand.writing.frames()
    listener.samples = samples
    with tempfile.NamedTemporaryFile() as file:
        file.write(b"".join(frames))
        file.flush()
        wire = stand.bus.wire.fileno()
        others = await asyncio.create_subprocess_exec(
            sys.executable, "-c", OTHERS, str(wire), file.name, pass_fds=[wire]
        )
        await listener.first.wait()
        cpu, wall = time.thread_time(), time.perf_counter()
        await listener.last.wait()
        cpu, wall = time.thread_time() - cpu, time.perf_counter() - wall
        await others.wait()
    serving.cancel()
    await asyncio.wait([serving])
    stand.bus.wire.close()
    return samples / cpu, samples / wall


async def measure(load: Load, samples: int, repeats: int, profile: cProfile.Profile | None) -> list[Figures]:
    """The figures, once for each repeat."""
    stand = Stand()
    bus, writing, reading = stand.bus, stand.writing, stand.reading
    serving = await stand.open(load.stream_id)
    payload = bytes(range(load.payload))

    async def run(count: int) -> Figures:
        bus.seconds, bus.frames_in, bus.frames_out, reading.samples = 0.0, 0, 0, 0
        for _ in range(0, count, load.burst):
            for _ in range(load.burst):
                writing.session.write(stand.writer, payload, load.stream_id)
            raw = writing.frames()
            while raw:
                out = await bus.exchange(raw)
                writing.hear(out)
                reading.hear(out)
                raw = writing.frames() + reading.frames()
        assert reading.samples == count, (reading.samples, count, stand.link.counters.dropped)
        return Figures(bus.seconds / count * 1e6, bus.frames_in / count, bus.frames_out / count)

    await run(samples // 4)
    if profile is not None:
        profile.enable()
    figures = [await run(samples) for _ in range(repeats)]
    if profile is not None:
        profile.disable()
    serving.cancel()
    await asyncio.wait([serving])
    return figures


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--quick", action="store_true", help="fewer samples")
    options.add_argument("--profile", action="store_true", help="print where the time goes instead")
    chosen = options.parse_args()
    samples, repeats = (800, 3) if chosen.quick else (8_000, 7)
    for line in table(samples, repeats) if not chosen.profile else profile(samples):
        print(line)


def table(samples: int, repeats: int) -> Iterator[str]:
    """The table, line by line."""
    yield "The way of a sample over a CAN bus through the agent: processor time from the frames as Linux gives them"
    yield f"to those that deliver it ({describe_machine()}; median of {repeats} runs of {samples:,} samples)\n"
    yield "| samples | burst | frames in | frames out | µs a sample | from | to | frames in, 1/s | times a full bus |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for load in LOADS:
        runs = sorted(asyncio.run(measure(load, samples, repeats, None)), key=lambda run: run.microseconds)
        middle = runs[len(runs) // 2]
        yield (
            f"| {load.name} | {load.burst} | {middle.frames_in:.0f} | {middle.frames_out:.0f} "
            f"| {middle.microseconds:.1f} | {runs[0].microseconds:.1f} | {runs[-1].microseconds:.1f} "
            f"| {middle.frames_per_s:,.0f} | {middle.frames_per_s / BUS_FRAMES:.1f} |"
        )
    cpu, wall = sorted(asyncio.run(flood(5 * samples)) for _ in range(repeats))[repeats // 2]
    yield "\nAs fast as another program says them (4 bytes, best effort, a frame each), to a reader in the agent's"
    yield f"own process: {cpu:,.0f} frames in a second of processor time, {cpu / BUS_FRAMES:.1f} times a full bus;"
    yield f"{wall:,.0f} in a second of the clock."
    yield f"\nA full bus: {BUS_FRAMES:,} frames of 8 bytes in a second, the most that 1 Mbit/s carries."


def profile(samples: int) -> Iterator[str]:
    """The functions that take most of the time, for each load."""
    for load in LOADS:
        watch = cProfile.Profile()
        asyncio.run(measure(load, samples, 1, watch))
        text = io.StringIO()
        pstats.Stats(watch, stream=text).sort_stats("tottime").print_stats(30)
        yield f"{load.name}, {load.burst} in a burst\n{text.getvalue()}"


if __name__ == "__main__":
    main()
