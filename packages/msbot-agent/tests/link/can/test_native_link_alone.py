"""Each end of the native CAN link by itself, on a controller that keeps what it is given: frame by frame."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from itertools import pairwise
from random import Random

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Peer, Signal
from msbot_agent.link.can.controller import BusState, CanBusInfo
from msbot_agent.link.can.legacy_link import Codec
from msbot_agent.link.can.native_link import MASTER, NOT_SENT, CanMasterLink, CanPartLink, NativeEnd
from msbot_agent.link.can.protocol.frames import Frame, split
from msbot_agent.link.can.protocol.ids import (
    CAN_FD,
    COMPRESSION,
    NODES,
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    join_frame,
    read_assign,
    read_beacon,
    read_join,
    read_question,
)
from msbot_agent.link.can.protocol.join_master import LISTEN_S
from msbot_agent.link.can.protocol.join_part import FIRST_PAUSE_S, JITTER, LONGEST_PAUSE_S
from msbot_xrce.errors import LinkDown

IDS = CanIds()
HASH = 0x00C0FFEE
UID, OTHER = b"uid.0001", b"uid.0002"
OCTETS = 70
FRAMES = len(split(bytes(OCTETS), 0, False))
CODEC = Codec(lambda packet: packet, lambda message: message)


class Controller:
    """A controller with a bus that nobody else is on; frames leave it when the test says so."""

    def __init__(self, *, fd: bool = False) -> None:
        self.info = CanBusInfo("bus", 500_000, 2_000_000 if fd else None, fd=fd)
        self.sent: list[tuple[float, Frame]] = []
        self.held = 0
        """Frames that have not left."""
        self.leaves_at_once = True
        self.next_frame = asyncio.Event()
        self.takes = True

    def attach(
        self,
        *,
        frame: Callable[[Frame, float], None] | None = None,
        room: Callable[[float], None] | None = None,
        state: Callable[[BusState, str, float], None] | None = None,
    ) -> None:
        assert frame is not None
        assert room is not None
        assert state is not None
        self.arrive, self.room, self.state = frame, room, state

    def has_room(self) -> bool:
        return self.takes

    def pending(self) -> int:
        return self.held

    def send(self, frame: Frame) -> None:
        self.sent.append((asyncio.get_running_loop().time(), frame))
        self.held += not self.leaves_at_once
        self.next_frame.set()

    def all_left(self) -> None:
        self.held = 0
        self.room(asyncio.get_running_loop().time())

    def restart(self) -> None: ...

    async def run(self) -> None:
        await asyncio.get_running_loop().create_future()


class Desk:
    """One end on its controller, and all that it told."""

    def __init__(self, link: NativeEnd, bus: Controller) -> None:
        self.link, self.bus = link, bus
        self.signals: list[tuple[Signal, Peer | None, str]] = []
        self.rooms: list[Peer | None] = []
        self.packets: list[tuple[bytes, Peer]] = []
        link.attach(
            packet=lambda packet, peer, _now: self.packets.append((packet, peer)),
            signal=lambda signal, peer, words, _now: self.signals.append((signal, peer, words)),
            room=self.rooms.append,
        )

    def hear(self, *frames: Frame) -> None:
        for frame in frames:
            self.bus.arrive(frame, asyncio.get_running_loop().time())

    def told(self) -> list[tuple[Signal, Peer | None, str]]:
        told, self.signals = self.signals, []
        return told

    def sent(self) -> list[Frame]:
        sent, self.bus.sent = self.bus.sent, []
        return [frame for _, frame in sent]


def play(
    make: Callable[[Controller], NativeEnd], scene: Callable[[Desk], Awaitable[None]], *, fd: bool = False
) -> None:
    """Run a scene with one end, in virtual time."""

    async def main() -> None:
        bus = Controller(fd=fd)
        desk = Desk(make(bus), bus)
        running = asyncio.create_task(desk.link.run())
        try:
            await scene(desk)
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())


def master(bus: Controller, **more: object) -> CanMasterLink:
    return CanMasterLink(bus, profile_hash=HASH, random=Random(1), **more)  # type: ignore[arg-type]


def part(bus: Controller, **more: object) -> CanPartLink:
    return CanPartLink(bus, uid=UID, random=Random(1), **more)  # type: ignore[arg-type]


def big(desk: Desk, peer: Peer, octets: int = OCTETS) -> None:
    """Hand over a packet of `FRAMES` frames while the controller takes none."""
    desk.bus.takes = False
    desk.link.send(bytes(octets), peer)
    desk.bus.takes = True


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("codec", [None, CODEC])
def test_each_end_offers_what_it_can_and_nothing_else(fd: bool, codec: Codec | None) -> None:
    offered = CAN_FD * fd | COMPRESSION * (codec is not None)

    async def of_master(desk: Desk) -> None:
        await asyncio.sleep(LISTEN_S + 1.5)
        beacons = [beacon for frame in desk.sent() if (beacon := read_beacon(frame, IDS)) is not None]
        assert beacons
        assert {beacon.flags & (CAN_FD | COMPRESSION) for beacon in beacons} == {offered}
        assert isinstance(desk.link, CanMasterLink)
        assert {beacon.epoch for beacon in beacons} == {desk.link.epoch}
        assert desk.told() == [(Signal.LINK_UP, None, f"epoch {desk.link.epoch}")]

    async def of_part(desk: Desk) -> None:
        desk.hear(beacon_frame(Beacon(0, 5, HASH), IDS))
        await asyncio.sleep(0.5)
        joins = {join for frame in desk.sent() if (join := read_join(frame, IDS)) is not None}
        assert joins == {(UID, offered)}

    play(lambda bus: master(bus, fd=fd, codec=codec), of_master, fd=fd)
    play(lambda bus: part(bus, codec=codec), of_part, fd=fd)


def test_a_part_asks_again_as_long_as_nobody_answers_with_longer_and_longer_pauses() -> None:
    async def scene(desk: Desk) -> None:
        desk.bus.leaves_at_once = False
        asked: list[float] = []
        for _ in range(12):
            await desk.bus.next_frame.wait()
            desk.bus.next_frame.clear()
            asked += [at for at, frame in desk.bus.sent if read_join(frame, IDS) is not None]
            desk.bus.sent.clear()
            await asyncio.sleep(0.05)
            assert not desk.bus.sent, "one that has not left is not said again"
            desk.bus.all_left()
        pauses = [later - at - 0.05 for at, later in pairwise(asked)]
        expected = [min(FIRST_PAUSE_S * 2**number, LONGEST_PAUSE_S) for number in range(len(pauses))]
        assert len(pauses) == 11
        for pause, middle in zip(pauses, expected, strict=True):
            assert (1 - JITTER) * middle - 0.001 <= pause <= (1 + JITTER) * middle + 0.001

    play(part, scene)


def test_a_master_waits_for_an_answer_from_when_its_question_has_left() -> None:
    async def scene(desk: Desk) -> None:
        desk.bus.leaves_at_once = False
        await asyncio.sleep(0.02)
        (question,) = desk.sent()
        assert read_question(question, IDS) == HASH
        desk.bus.all_left()
        left_at = asyncio.get_running_loop().time()
        desk.bus.next_frame.clear()
        await desk.bus.next_frame.wait()
        assert asyncio.get_running_loop().time() - left_at == pytest.approx(LISTEN_S)
        assert [read_beacon(frame, IDS) is not None for frame in desk.sent()] == [True]

    play(master, scene)


def test_which_frames_are_of_other_equipment() -> None:
    def frames(base: int) -> list[Frame]:
        return [Frame(base + node_id, b"\xc0x") for node_id in (0, 1, NODES, NODES + 1)]

    async def of_part(desk: Desk) -> None:
        await asyncio.sleep(0.01)
        counts: list[int] = []
        for frame in (*frames(IDS.up), *frames(IDS.down)):
            before = desk.link.foreign
            desk.hear(frame)
            counts.append(desk.link.foreign - before)
        assert counts == [1, 0, 0, 1, 1, 0, 0, 1]
        desk.hear(Frame(IDS.down + 1, b"x", extended=True))
        assert (desk.link.foreign, desk.packets) == (5, [])

    async def of_master(desk: Desk) -> None:
        await asyncio.sleep(LISTEN_S + 0.1)
        counts: list[int] = []
        for frame in frames(IDS.up):
            before = desk.link.foreign
            desk.hear(frame)
            counts.append(desk.link.foreign - before)
        assert counts == [1, 0, 0, 1]
        taken_back = [assign.node_id for frame in desk.sent() if (assign := read_assign(frame, IDS)) is not None]
        assert taken_back == [1, NODES], "whoever uses an address that it was not given has to join"

    play(part, of_part)
    play(master, of_master)


def test_what_waits_for_a_part_is_counted_when_it_joins_anew() -> None:
    async def scene(desk: Desk) -> None:
        await asyncio.sleep(LISTEN_S + 0.1)
        desk.hear(join_frame(UID, 0, IDS))
        (joined,) = [assign for frame in desk.sent() if (assign := read_assign(frame, IDS)) is not None]
        node_id = joined.node_id
        assert joined.uid == UID
        assert desk.told()[1:] == [(Signal.PEER_JOINED, node_id, f"UID {UID.hex()}")]
        assert isinstance(desk.link, CanMasterLink)
        assert (desk.link.uid_of(node_id), desk.link.uid_of(node_id + 1), desk.link.uid_of("x")) == (UID, None, None)
        assert [desk.link.has_room(peer) for peer in (node_id, node_id + 1, 0, NODES + 1, "x")] == [True] + [False] * 4
        desk.hear(Frame(IDS.up + node_id, split(b"hi", 0, False)[0]))
        assert desk.packets == [(b"hi", node_id)]
        big(desk, node_id)
        desk.hear(join_frame(UID, 0, IDS))
        assert desk.link.counters.dropped == {NOT_SENT: FRAMES}
        assert not [frame for frame in desk.sent() if frame.can_id == IDS.down + node_id]
        desk.link.send(b"new", node_id)
        assert [frame.can_id for frame in desk.sent()] == [IDS.down + node_id]

    play(master, scene)


def test_who_waited_for_room_is_told_when_a_part_joins_anew() -> None:
    async def scene(desk: Desk) -> None:
        await asyncio.sleep(LISTEN_S + 0.1)
        desk.hear(join_frame(UID, 0, IDS))
        node_id = next(assign.node_id for frame in desk.sent() if (assign := read_assign(frame, IDS)) is not None)
        desk.hear(Frame(IDS.up + node_id, split(b"hi", 0, False)[0]))
        desk.rooms.clear()
        while desk.link.has_room(node_id):
            big(desk, node_id)
        desk.bus.takes = False
        desk.hear(join_frame(UID, 0, IDS))
        assert desk.rooms == [node_id]
        assert desk.link.has_room(node_id)

    play(master, scene)


@pytest.mark.parametrize("how", ["taken back", "off the bus"])
def test_a_part_that_loses_its_address_has_nothing_left(how: str) -> None:
    async def scene(desk: Desk) -> None:
        link = desk.link
        assert isinstance(link, CanPartLink)
        await asyncio.sleep(0.05)
        with pytest.raises(LinkDown, match="no address yet"):
            link.send(b"x", MASTER)
        desk.hear(beacon_frame(Beacon(0, 5, HASH), IDS), assign_frame(Assign(UID, 7, 5, 0), IDS))
        assert desk.told() == [(Signal.LINK_UP, MASTER, "CAN node 7")]
        assert (link.node_id, link.has_room(MASTER), link.has_room(7), desk.rooms) == (7, True, False, [None])
        big(desk, MASTER)
        if how == "taken back":
            desk.hear(assign_frame(Assign(bytes(8), 7, 5, 0), IDS))
            assert link.counters.dropped == {NOT_SENT: FRAMES}
        else:
            desk.bus.state(BusState.OFF, "too many errors", asyncio.get_running_loop().time())
            assert link.counters.dropped == {"still waiting when the controller left the bus": FRAMES}
            assert link.timer() is None
        ((signal, peer, _),) = desk.told()
        assert (signal, peer, link.has_room(MASTER)) == (Signal.LINK_DOWN, MASTER, False)
        desk.hear(Frame(IDS.down + 7, b"\xc0late"))
        assert desk.packets == []
        desk.sent()
        if how == "taken back":
            await asyncio.sleep(2.0)
            assert {frame.can_id & ~0xFFFFFF for frame in desk.sent()} == {IDS.join}, "it asks again, and says no more"

    play(part, scene)


@pytest.mark.parametrize("is_full", [False, True])
def test_who_sends_as_soon_as_there_is_room_speaks_to_the_new_program_after_its_answer(is_full: bool) -> None:
    async def scene(desk: Desk) -> None:
        await asyncio.sleep(LISTEN_S + 0.1)
        desk.hear(join_frame(UID, 0, IDS))
        node_id = next(assign.node_id for frame in desk.sent() if (assign := read_assign(frame, IDS)) is not None)
        desk.hear(Frame(IDS.up + node_id, split(b"hi", 0, False)[0]))
        while desk.link.has_room(node_id):
            big(desk, node_id)
        told: list[str] = []

        def room(peer: Peer | None) -> None:
            told.append("room")
            if peer == node_id and desk.link.has_room(node_id):
                desk.link.send(b"new", node_id)

        desk.link.attach(room=room, signal=lambda signal, peer, words, now: told.append(signal.name))
        desk.bus.takes = not is_full
        desk.hear(join_frame(UID, 0, IDS))
        desk.bus.takes = True
        desk.bus.room(asyncio.get_running_loop().time())
        assert told == ["PEER_JOINED", "room"]
        answer, *rest = desk.sent()
        assert read_assign(answer, IDS) is not None
        assert [frame.data for frame in rest] == split(b"new", 0, False), "as the first packet of a new wire"

    play(master, scene)
