"""The CAN links against any frames of any node: the master's end, a part's end, eProsima's FD mode, and the joiner."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from functools import partial
from random import Random

from fuzz.bounds import REASONS, hold
from fuzz.case import Case, Step, Violation, plain
from fuzz.corpus import packets
from fuzz.mutate import mutate_octets
from fuzz.virtual import play, read_logs, the_loop
from msbot_agent.link import Link, Peer
from msbot_agent.link.can.controller import BusState, CanBusInfo, FrameHandler, StateHandler
from msbot_agent.link.can.eprosima_fd import MAX_PEERS, CanFdEprosimaLink
from msbot_agent.link.can.legacy_link import Codec
from msbot_agent.link.can.native_link import MASTER, CanMasterLink, CanPartLink, NativeEnd
from msbot_agent.link.can.protocol.frames import FD_LENGTHS, FIRST, LAST, Frame, FrameJoiner, check_frame, split
from msbot_agent.link.can.protocol.ids import (
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    join_frame,
    read_assign,
    read_join,
    stop_frame,
)
from msbot_agent.link.can.protocol.join_master import LISTEN_S
from msbot_xrce.compression import compress, decompress
from msbot_xrce.errors import LinkDown, LinkFull, LocalProtocolError

MTU = 300
"""Small, so that it is met."""
IDS = CanIds()
ROBOT = 0xC0FFEE
UID = b"part-uid"
HONEST = 4
"""Seconds after which the honest part must be on the bus; a beacon comes each second."""


class FakeBus:
    """A controller whose frames leave when the case says so, and that hears what the case says."""

    def __init__(self, name: str) -> None:
        self.info = CanBusInfo(name, 500_000, 2_000_000, fd=True)
        self.out: list[Frame] = []
        """What left the controller."""
        self._mailboxes: list[Frame] = []
        self._state = BusState.ACTIVE
        self.hear: FrameHandler = lambda *_: None
        self._room: Callable[[float], None] = lambda _: None
        self._tell: StateHandler = lambda *_: None

    def attach(
        self,
        *,
        frame: FrameHandler | None = None,
        room: Callable[[float], None] | None = None,
        state: StateHandler | None = None,
    ) -> None:
        """See `CanBus`."""
        assert frame is not None
        assert room is not None
        assert state is not None
        self.hear, self._room, self._tell = frame, room, state

    def has_room(self) -> bool:
        """See `CanBus`."""
        return len(self._mailboxes) < 3

    def pending(self) -> int:
        """See `CanBus`."""
        return len(self._mailboxes)

    def send(self, frame: Frame) -> None:
        """See `CanBus`; a real controller would refuse a frame that cannot be."""
        check_frame(frame)
        if not self.has_room():
            raise LinkFull("three mailboxes")
        self._mailboxes.append(frame)

    def restart(self) -> None:
        """See `CanBus`."""
        self.change(BusState.ACTIVE)

    async def run(self) -> None:
        """See `CanBus`."""
        await asyncio.Event().wait()

    def leave(self, count: int) -> None:
        """So many frames leave the controller."""
        for _ in range(count):
            if not self._mailboxes:
                return
            self.out.append(self._mailboxes.pop(0))
            self._room(the_loop().time())

    def change(self, state: BusState) -> None:
        """The controller enters a state."""
        if state is BusState.OFF:
            self._mailboxes.clear()
        self._state = state
        self._tell(state, "fuzz", the_loop().time())


class CanWorld:
    """Three ends on three controllers that hear the same frames, and a joiner."""

    def __init__(self, *, codec: bool) -> None:
        coder = Codec(compress, decompress) if codec else None
        self.buses = [FakeBus("master"), FakeBus("part"), FakeBus("fd")]
        self.master = CanMasterLink(self.buses[0], profile_hash=ROBOT, random=Random(1), fd=True, codec=coder, mtu=MTU)
        self.part = CanPartLink(self.buses[1], uid=UID, random=Random(2), profile_hash=ROBOT, codec=coder, mtu=MTU)
        self.eprosima = CanFdEprosimaLink(self.buses[2])
        self.links: tuple[NativeEnd | CanFdEprosimaLink, ...] = (self.master, self.part, self.eprosima)
        self.joiner = FrameJoiner(MTU)
        self.packets: list[list[bytes]] = [[] for _ in self.links]
        self.seen: set[str] = set()
        ends: tuple[Link, ...] = self.links
        for link, received in zip(ends, self.packets, strict=True):
            link.attach(packet=partial(_keep, received))
            link.attach(signal=lambda signal, _peer, words, _now: self.seen.add(f"{signal.value}: {plain(words)}"))

    def do(self, step: Step) -> None:
        """One step."""
        now = the_loop().time()
        match step.verb:
            case "frame":
                frame = _frame(step)
                if self._is_forged(frame):
                    return
                for bus in self.buses:
                    bus.hear(frame, now)
                self._join(frame.data, now)
            case "out":
                for bus in self.buses:
                    bus.leave(abs(step.whole(0)) % 40)
            case "state":
                self.buses[abs(step.whole(0)) % 3].change(tuple(BusState)[abs(step.whole(1)) % 3])
            case "send":
                self._send(step.data, step.whole(0), step.whole(1))
            case "stop":
                try:
                    self.master.send_stop(step.whole(0))
                except LinkDown:
                    self.seen.add("no STOP")

    def _is_forged(self, frame: Frame) -> bool:
        """Whether the frame pretends to be the honest master or part, with all their secrets.

        Who has a controller on the bus can do that, and CAN has nothing against it.
        """
        assign, join = read_assign(frame, IDS), read_join(frame, IDS)
        by_master = assign is not None and assign.uid == UID and assign.epoch == self.master.epoch
        return by_master or (join is not None and join[0] == UID and join[1] != self.part._join._caps)

    def _join(self, data: bytes, now: float) -> None:
        packet = self.joiner.receive(data, now)
        if packet is not None:
            hold("a joined packet", len(packet), MTU)
        size = sum(map(len, self.joiner._parts or ()))
        hold("octets of a joiner", size, MTU + 64)
        if self.joiner._parts is not None and size != self.joiner._size:
            raise Violation(f"the joiner has {size} octets and counts {self.joiner._size}")

    def _send(self, packet: bytes, which: int, peer: int) -> None:
        link = self.links[abs(which) % 3]
        to: Peer = (abs(peer) % 130, MASTER, peer & 0x1FFFFFFF)[abs(which) % 3]
        try:
            link.send(packet, to)
        except (LinkFull, LinkDown, LocalProtocolError) as error:
            self.seen.add(f"{type(error).__name__} {plain(str(error))[:40]}")

    def check(self) -> None:
        """Nothing was raised, nothing grows."""
        the_loop().check()
        for link, received in zip(self.links, self.packets, strict=True):
            hold("reasons", len(link.counters.dropped), REASONS)
            hold("urgent frames", len(link._port.queue._urgent), 259)
            for lane in link._port.queue._lanes.values():
                hold("frames for one peer", len(lane), 32 + MTU)
            for packet in received:
                hold("a packet", len(packet), max(MTU, 4096, 63) if link is not self.eprosima else 63)
            received.clear()
        hold("lanes", len(self.eprosima._port.queue._lanes), MAX_PEERS)
        hold("members", len(self.master._join.members), 120)
        hold("masters", len(self.master._other_masters), 8)
        hold("addresses", len(self.master._join.node_ids.oldest_first()), 120)
        if any(member is not None for member in self.master._members[:1]):
            raise Violation("somebody has address 0")

    async def heal(self) -> None:
        """The noise ends, and the honest part and its master are alone on one bus.

        Raises:
            Violation: they do not find each other.
        """
        for bus in self.buses[:2]:
            bus.change(BusState.ACTIVE)
            bus.leave(10_000)
            bus.out.clear()
        for _ in range(8):
            # As every client does until somebody answers; silence alone would not tell the master of a stranger.
            if self.part.has_room(MASTER):
                self.part.send(b"login", MASTER)
            await self._exchange(5)
        if self.part.node_id == 0 or self.master.uid_of(self.part.node_id) != UID:
            raise Violation(f"the part has address {self.part.node_id}, the master knows {self.master._join.members}")
        for received in self.packets:
            received.clear()
        for size in (1, 7, 8, 200):
            self.part.send(bytes([size]) * size, MASTER)
            self.master.send(bytes([size]) * size, self.part.node_id)
            await self._exchange(1)
        expected = [bytes([size]) * size for size in (1, 7, 8, 200)]
        if self.packets[:2] != [expected, expected]:
            raise Violation(f"after the noise these packets came: {[[len(p) for p in got] for got in self.packets]}")

    async def _exchange(self, rounds: int) -> None:
        """Frames go from the master to the part and back, for `HONEST` seconds in 40 rounds."""
        master, part = self.buses[:2]
        for _ in range(rounds):
            for _ in range(200):
                for bus in (master, part):
                    bus.leave(1)
                if not master.out and not part.out:
                    break
                now = the_loop().time()
                for bus, other in ((master, part), (part, master)):
                    frames, bus.out = bus.out, []
                    for frame in frames:
                        other.hear(frame, now)
            await asyncio.sleep(HONEST / 40)


class CanTarget:
    """See the module's docstring."""

    name = "can"
    about = "the CAN links: nothing raises, memory is bounded, a part finds its master after the noise"

    def make(self, random: Random) -> Case:
        """Frames, mostly right ones."""
        steps: list[Step] = []
        for _ in range(random.randrange(1, 20)):
            steps += _steps(random)
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Hear them."""
        reader = read_logs()
        reader.take()

        async def main() -> set[str]:
            world = CanWorld(codec=len(case) % 2 == 0)
            tasks = [asyncio.create_task(_serve(link)) for link in world.links]
            await asyncio.sleep(0.1)
            world.buses[0].leave(40)  # the question whether it is alone
            await asyncio.sleep(2 * LISTEN_S)
            world.buses[0].leave(40)  # only after its first beacon has left is the master no longer starting
            await asyncio.sleep(2.0)  # else another master on the bus ends ours, as it should
            for step in case:
                if step.verb == "wait":
                    await asyncio.sleep(min(abs(step.number(0)), 12.0))
                else:
                    world.do(step)
                    await asyncio.sleep(0)
                world.check()
            for link in world.links:
                world.seen.update(plain(reason) for reason in link.counters.dropped)
            world.seen.update(world.joiner._dropped)
            await world.heal()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            return world.seen

        return play(main()) | {plain(line) for line in reader.take()} | _round_trip(case)


def _keep(received: list[bytes], packet: bytes, _peer: Peer, _now: float) -> None:
    received.append(packet)


async def _serve(link: NativeEnd | CanFdEprosimaLink) -> None:
    await link.run()


def _round_trip(case: Case) -> set[str]:
    """Any packet that is cut and joined is what it was."""
    for step in case:
        if step.data:
            for fd in (False, True):
                joiner = FrameJoiner(max(len(step.data), 1))
                joined = [joiner.receive(part, 0.0) for part in split(step.data, len(case) & 0x3F, fd)]
                if joined[-1] != step.data or any(part is not None for part in joined[:-1]):
                    raise Violation(f"{step.data.hex()} was cut and joined to {joined[-1]!r}")
    return set()


def _frame(step: Step) -> Frame:
    can_id, flags = step.whole(0) & 0x1FFFFFFF, step.whole(1)
    extended, fd = bool(flags & 1), bool(flags & 2)
    remote, error = bool(flags & 4) and not fd, bool(flags & 8)
    length = max(size for size in FD_LENGTHS if size <= min(len(step.data), 64 if fd else 8))
    data = b"" if remote else step.data[:length]
    return Frame(can_id if extended else can_id & 0x7FF, data, extended, fd, bool(flags & 16) and fd, remote, error)


def _as_step(frame: Frame) -> Step:
    flags = frame.extended | frame.fd << 1 | frame.remote << 2 | frame.error << 3 | frame.brs << 4
    return Step("frame", frame.data, (frame.can_id, flags))


def _steps(random: Random) -> list[Step]:
    node_id = random.choice((1, 1, 1, 2, 3, 119, 120))
    epoch = random.choice((0, 1, 5, Random(1).randrange(1 << 14)))
    match random.randrange(14):
        case 0 | 1:
            uid = random.choice((UID, b"other-id", b"third-id", random.randbytes(8)))
            return [_as_step(join_frame(uid, random.randrange(4), IDS))]
        case 2:
            uid = random.choice((UID, b"other-id", bytes(8)))
            return [_as_step(assign_frame(Assign(uid, random.choice((0, node_id)), epoch, random.randrange(4)), IDS))]
        case 3:
            robot = random.choice((ROBOT, ROBOT, 0xBAD, random.getrandbits(32)))
            return [_as_step(beacon_frame(Beacon(random.randrange(8), epoch, robot), IDS))]
        case 4:
            return [_as_step(stop_frame(random.randrange(256), IDS))]
        case 5 | 6 | 7:
            return _packet(random, random.choice((IDS.up, IDS.down)) + node_id)
        case 8:
            return [Step("wait", b"", (random.choice((0.0, 0.01, 0.1, 0.3, 1.0, 4.0, 11.0)),))]
        case 9:
            return [Step("out", b"", (random.choice((1, 3, 30)),))]
        case 10:
            return [Step("state", b"", (random.randrange(3), random.randrange(3)))]
        case 11:
            packet = random.randbytes(random.choice((0, 1, 7, 8, 63, 64, 200, MTU, MTU + 1)))
            return [Step("send", packet, (random.randrange(3), random.choice((1, 2, 120, 121, 0x1FFFFFFF))))]
        case 12:
            packet = random.choice(packets(of_clients=True))[:63]
            octets = bytes((random.choice((len(packet), 0, 64)),)) + packet
            return [Step("frame", octets + bytes(64 - len(octets)), (random.getrandbits(29), 3))]
    base = random.choice((IDS.up, IDS.down, IDS.join, IDS.assign, IDS.beacon, IDS.stop, 0))
    can_id = base + random.choice((0, node_id, random.getrandbits(24)))
    return [Step("frame", random.randbytes(random.randrange(65)), (can_id, random.randrange(32)))]


def _packet(random: Random, can_id: int) -> list[Step]:
    fd = random.random() < 0.4
    packet = random.choice(packets(of_clients=random.random() < 0.5))
    if random.random() < 0.3:
        packet *= random.choice((2, 5))
    if random.random() < 0.4:
        packet = compress(packet)
    frames = split(packet[:900] or b"x", random.randrange(64), fd)
    steps = [Step("frame", data, (can_id, 2 if fd else 0)) for data in frames]
    for _ in range(random.choice((0, 0, 1, 2))):
        at = random.randrange(len(steps))
        match random.randrange(4):
            case 0 if len(steps) > 1:
                del steps[at]
            case 1:
                steps.insert(at, steps[random.randrange(len(steps))])
            case 2:
                steps[at] = Step("frame", mutate_octets(random, steps[at].data), steps[at].numbers)
            case _:
                data = steps[at].data
                first = bytes((data[0] ^ random.choice((FIRST, LAST, 1)),)) if data else b""
                steps[at] = Step("frame", first + data[1:], steps[at].numbers)
    return steps
