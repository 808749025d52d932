"""What a message costs inside the agent, without sockets: from the packet of a link to the packets for it.

One writer, one reader (or a requester and a replier) log in over a link in memory; then recorded packets run through
the agent, 1 or 8 in a burst, and the processor time is divided by the messages. Acknowledgements are part of reliable
messages. A session is one login, four objects, each acknowledged, and the end of the session; 8 in a burst are those
of 8 clients.

    python -m bench.path [--quick] [--profile] [--sockets | --recorded]

With `--sockets` packets come and go through UDP sockets of this computer, and what the kernel does counts as well.

With `--recorded` each load runs without and with the flight recorder, in short turns, and processor time is counted, so
that other programs hardly matter: what the recorder does in the robot's process, not what its own process does. Once
without sockets, and once through UDP sockets of this computer, each burst with one question to the kernel which socket
has something: what a robot's agent does, but for asyncio's own part of a turn.
"""

from __future__ import annotations

import argparse
import asyncio
import cProfile
import io
import pstats
import statistics
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from bench.machine import describe_machine
from bench.path_wires import SocketWire, Wire
from msbot.recording.recorder.recorder import Recorder
from msbot_agent.agent import Agent
from msbot_agent.space import MemorySpace
from msbot_xrce import ClientSession, ClientState
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
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)

PAYLOAD = bytes(64)
SEQUENCE_NR = struct.Struct("<H")
ACKNACK = struct.Struct("<8sHHB")
ACKNACK_HEAD = bytes.fromhex("81000000 0a010500")
DATA = 9
SERVICE = ("bench", "bench_request", "bench_reply", "bench_Request", "bench_Reply")
IDENTITY = bytes(24)
WARM_UP = 4_000
"""Messages before the first that count."""
A_TURN = 1_600
"""Messages in a turn of `--recorded`, after which the recorder empties its buffer."""
Run = Callable[[int], float]
"""Runs that many messages; gives the seconds that the agent took."""


class Client:
    """A client session on the wire."""

    def __init__(self, wire: Wire | SocketWire, key: int) -> None:
        self.wire = wire
        self.key = key
        self.sent: list[bytes] = []
        """All its packets."""
        self.session = ClientSession(key, epoch_ns=lambda: 0)
        self.session.connect(0.0)
        self.settle()
        assert self.session.state is ClientState.CONNECTED
        self.participant = self.make(ObjectKind.PARTICIPANT, participant_variant("bench", 0))

    def make(self, kind: ObjectKind, variant: ObjectVariant) -> int:
        """Create object number 1 of that kind."""
        object_id = make_object_id(1, kind)
        self.session.create(object_id, variant)
        self.settle()
        return object_id

    def writer(self) -> int:
        """A writer of the topic."""
        topic = self.make(ObjectKind.TOPIC, topic_variant("bench", "bench", self.participant))
        publisher = self.make(ObjectKind.PUBLISHER, publisher_variant(self.participant))
        return self.make(ObjectKind.DATAWRITER, writer_variant(topic, publisher, RELIABLE_QOS))

    def read(self, object_id: int, stream_id: int) -> None:
        """Read all samples."""
        self.session.read(object_id, stream_id, DeliveryControl())
        self.settle()

    def reader(self) -> int:
        """A reader of the topic."""
        topic = self.make(ObjectKind.TOPIC, topic_variant("bench", "bench", self.participant))
        subscriber = self.make(ObjectKind.SUBSCRIBER, subscriber_variant(self.participant))
        return self.make(ObjectKind.DATAREADER, reader_variant(topic, subscriber, RELIABLE_QOS))

    def settle(self) -> None:
        """Exchange packets until nobody has any."""
        while packets := self.session.packets_to_send(0.0):
            self.sent += packets
            self.wire.hand_in(packets, self.key)
            self.wire.work(0.0)
            for packet, peer in self.wire.take():
                if peer == self.key:
                    self.session.receive_packet(packet, 0.0)
            while self.session.next_event() is not None:
                pass

    def write(self, object_id: int, payload: bytes, stream_id: int) -> bytes:
        """The packet of a sample; it is the pattern for all that follow, the session is not used any more."""
        self.session.write(object_id, payload, stream_id)
        (packet,) = self.session.packets_to_send(0.0)
        return packet


class Packets:
    """Messages like the first, one number higher each time."""

    def __init__(self, first: bytes) -> None:
        self._head = first[:2]
        self._number = number_of(first)
        self._tail = first[4:]

    def take(self, payload: bytes | None = None) -> bytes:
        """The next one, with another payload if one is given."""
        packet = (
            self._head + SEQUENCE_NR.pack(self._number) + (self._tail if payload is None else self._tail[:8] + payload)
        )
        self._number = (self._number + 1) & 0xFFFF
        return packet


def number_of(packet: bytes) -> int:
    """The sequence number of a message."""
    number: int = SEQUENCE_NR.unpack_from(packet, 2)[0]
    return number


def payloads_of(packets: list[bytes]) -> list[bytes]:
    """The payloads of all samples in these messages."""
    found = []
    for packet in packets:
        at = 4
        while at < len(packet):
            length = SEQUENCE_NR.unpack_from(packet, at + 2)[0]
            if packet[at] == DATA:
                found.append(packet[at + 8 : at + 4 + length])
            at = (at + 4 + length + 3) & ~3
    return found


def acknack(packet: bytes) -> bytes:
    """The message that acknowledges that message and all before it."""
    return ACKNACK.pack(ACKNACK_HEAD, (number_of(packet) + 1) & 0xFFFF, 0, STREAM_RELIABLE)


class Course:
    """Runs bursts of packets through the agent and keeps the time that the agent took."""

    def __init__(self, wire: Wire | SocketWire, stream_id: int, timer: Callable[[], float]) -> None:
        self.wire = wire
        self.reliable = stream_id == STREAM_RELIABLE
        self.seconds = 0.0
        self._clock = asyncio.get_running_loop().time
        self._timer = timer

    def pass_burst(self, packets: list[bytes], sender: int, receiver: int) -> list[bytes]:
        """A burst of one client comes in; the samples for the other that go out because of it."""
        self.wire.hand_in(packets, sender)
        work, now = self.wire.work, self._clock()
        start = self._timer()
        work(now)
        self.seconds += self._timer() - start
        return [packet for packet, peer in self.wire.take() if peer == receiver and packet[4] == DATA]

    def pass_all(self, packets: list[tuple[bytes, int]]) -> int:
        """A packet each of several clients comes in; how many packets go out because of it."""
        self.wire.hand_in_all(packets)
        work, now = self.wire.work, self._clock()
        start = self._timer()
        work(now)
        self.seconds += self._timer() - start
        return len(self.wire.take())

    def acknowledge(self, samples: list[bytes]) -> list[bytes]:
        """What the client says to those samples."""
        return [acknack(packet) for packet in samples] if self.reliable else []


def samples(wire: Wire | SocketWire, load: Load) -> Run:
    """A writer and a reader."""
    writing, reading = Client(wire, 1), Client(wire, 2)
    writer = writing.writer()
    reading.read(reading.reader(), load.stream_id)
    packets = Packets(writing.write(writer, PAYLOAD, load.stream_id))

    def run(messages: int) -> float:
        course = Course(wire, load.stream_id, load.timer)
        for _ in range(0, messages, load.burst):
            went = course.pass_burst([packets.take() for _ in range(load.burst)], 1, 2)
            assert len(payloads_of(went)) == load.burst
            course.pass_burst(course.acknowledge(went), 2, 1)
        return course.seconds

    return run


def requests(wire: Wire | SocketWire, load: Load) -> Run:
    """A requester and a replier."""
    asking, replying = Client(wire, 1), Client(wire, 2)
    requester = asking.make(ObjectKind.REQUESTER, requester_variant(*SERVICE, asking.participant))
    replier = replying.make(ObjectKind.REPLIER, replier_variant(*SERVICE, replying.participant))
    asking.read(requester, load.stream_id)
    replying.read(replier, load.stream_id)
    questions = Packets(asking.write(requester, PAYLOAD, load.stream_id))
    answers = Packets(replying.write(replier, IDENTITY + PAYLOAD, load.stream_id))

    def run(messages: int) -> float:
        course = Course(wire, load.stream_id, load.timer)
        for _ in range(0, messages, load.burst):
            asked = course.pass_burst([questions.take() for _ in range(load.burst)], 1, 2)
            replies = [answers.take(payload) for payload in payloads_of(asked)]
            answered = course.pass_burst(replies + course.acknowledge(asked), 2, 1)
            assert len(payloads_of(answered)) == load.burst
            course.pass_burst(course.acknowledge(answered), 1, 2)
        return course.seconds

    return run


def sessions(wire: Wire | SocketWire, load: Load) -> Run:
    """Clients that come, make a writer, and leave; each comes again with the same packets."""
    recorded: list[list[bytes]] = []
    for key in range(1, load.burst + 1):
        client = Client(wire, key)
        client.writer()
        client.session.close(0.0)
        client.settle()
        recorded.append(client.sent)
    assert len({len(packets) for packets in recorded}) == 1

    def run(messages: int) -> float:
        course = Course(wire, load.stream_id, load.timer)
        for _ in range(0, messages, load.burst):
            for number in range(len(recorded[0])):
                went = course.pass_all([(packets[number], key) for key, packets in enumerate(recorded, 1)])
            assert went == load.burst, "each has the answer to its end"
        return course.seconds

    return run


@dataclass(frozen=True)
class Load:
    """One row of the table."""

    name: str
    prepare: Callable[[Wire | SocketWire, Load], Run]
    stream_id: int
    burst: int
    wire: Callable[[], Wire | SocketWire] = Wire
    timer: Callable[[], float] = time.thread_time
    """What the agent's time is kept with; each burst is timed twice."""


LOADS = tuple(
    Load(name, prepare, stream_id, burst)
    for name, prepare, stream_id in (
        ("best effort", samples, STREAM_BEST_EFFORT),
        ("reliable", samples, STREAM_RELIABLE),
        ("request and reply, reliable", requests, STREAM_RELIABLE),
        ("sessions", sessions, STREAM_RELIABLE),
    )
    for burst in (1, 8)
)


async def prepare(load: Load, recorder: Recorder | None = None) -> tuple[Run, asyncio.Task[None]]:
    """An agent with its clients, warm; and what must be cancelled at the end."""
    wire = load.wire()
    space = MemorySpace()
    agent = Agent(space if recorder is None else recorder.space(space))
    agent.add_link(wire)
    serving = asyncio.ensure_future(agent.run())
    await wire.opened()
    run = load.prepare(wire, load)
    run(WARM_UP)
    return run, serving


async def measure(load: Load, messages: int, repeats: int, profile: cProfile.Profile | None) -> list[float]:
    """Microseconds a message, once for each repeat."""
    run, serving = await prepare(load)
    if profile is not None:
        profile.enable()
    costs = [run(messages) / messages * 1e6 for _ in range(repeats)]
    if profile is not None:
        profile.disable()
    serving.cancel()
    await asyncio.wait([serving])
    return costs


async def compare(load: Load, turns: int) -> tuple[list[float], list[float]]:
    """Microseconds of processor time a message, without and with the recorder, in turn."""
    load = replace(load, timer=time.thread_time)
    recorder = Recorder(time.monotonic, time.time_ns)
    (plain, serving), (recorded, serving_too) = await prepare(load), await prepare(load, recorder)
    without, with_it = [], []

    def run_recorded() -> float:
        recorder.drain()
        seconds = recorded(A_TURN)
        start = time.thread_time()
        recorder.drain()
        return seconds + time.thread_time() - start

    for turn in range(turns):
        for is_recorded in (False, True) if turn % 2 else (True, False):
            if is_recorded:
                with_it.append(run_recorded() / A_TURN * 1e6)
            else:
                without.append(plain(A_TURN) / A_TURN * 1e6)
    for task in (serving, serving_too):
        task.cancel()
        await asyncio.wait([task])
    return without, with_it


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--quick", action="store_true", help="fewer messages")
    options.add_argument("--profile", action="store_true", help="print where the time goes instead")
    options.add_argument("--sockets", action="store_true", help="through UDP sockets")
    options.add_argument("--recorded", action="store_true", help="with the flight recorder, and without")
    chosen = options.parse_args()
    messages, repeats = (2_000, 3) if chosen.quick else (20_000, 7)
    if chosen.recorded:
        for line in recorded_table(20 if chosen.quick else 150):
            print(line)
        return
    loads = [replace(load, wire=SocketWire) for load in LOADS] if chosen.sockets else LOADS
    for line in table(loads, messages, repeats) if not chosen.profile else profile(loads, messages):
        print(line)


def table(loads: Sequence[Load], messages: int, repeats: int) -> Iterator[str]:
    """The table, line by line."""
    sockets = "from UDP socket to UDP socket" if loads[0].wire is SocketWire else "without sockets"
    yield f"The way of a message of {len(PAYLOAD)} bytes through the agent, {sockets} ({describe_machine()};"
    yield f"processor time, median of {repeats} runs of {messages:,} messages, and the range)\n"
    yield "| messages | in a burst | µs a message | from | to |"
    yield "|---|---|---|---|---|"
    for load in loads:
        costs = asyncio.run(measure(load, messages, repeats, None))
        yield f"| {load.name} | {load.burst} | {statistics.median(costs):.2f} | {min(costs):.2f} | {max(costs):.2f} |"


def recorded_table(turns: int) -> Iterator[str]:
    """The table with and without the flight recorder, line by line."""
    yield f"What the flight recorder costs the agent a message, in processor time ({describe_machine()};"
    yield f"medians of {turns} pairs of {A_TURN:,} messages each)\n"
    yield "| messages | in a burst | sockets | µs without | µs with | difference | of the agent's time |"
    yield "|---|---|---|---|---|---|---|"
    for wire, name in ((Wire, "none"), (SocketWire, "UDP")):
        for load in LOADS:
            without, with_it = asyncio.run(compare(replace(load, wire=wire), turns))
            before, after = statistics.median(without), statistics.median(with_it)
            more = statistics.median(b - a for a, b in zip(without, with_it, strict=True))
            yield (
                f"| {load.name} | {load.burst} | {name} | {before:.2f} | {after:.2f} | {more:.2f} "
                f"| {more / before:.1%} |"
            )


def profile(loads: Sequence[Load], messages: int) -> Iterator[str]:
    """The functions that take most of the time, for each load."""
    for load in loads:
        watch = cProfile.Profile()
        asyncio.run(measure(load, messages, 1, watch))
        text = io.StringIO()
        pstats.Stats(watch, stream=text).sort_stats("tottime").print_stats(25)
        yield f"{load.name}, {load.burst} in a burst\n{text.getvalue()}"


if __name__ == "__main__":
    main()
