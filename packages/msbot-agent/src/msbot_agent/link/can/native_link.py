"""The two ends of the CAN link: `CanMasterLink` serves up to 120 parts, `CanPartLink` is one part.

Both carry whole, opaque packets. A packet is cut into frames when it is sent and put together in the call-back of its
last frame (`protocol/frames.py`); there is no queue between the controller and the packet handler. Addresses come from
joining (`protocol/join_part.py`, `protocol/join_master.py`). A master's peer is the node id, 1 to 120; a part's only
peer, the master, is 0.
"""

from __future__ import annotations

import logging
from abc import abstractmethod
from random import Random
from typing import Final

from msbot_agent.link.can.can_link_base import CanEnd
from msbot_agent.link.can.controller import CanBus
from msbot_agent.link.can.legacy_link import Codec, PeerFraming
from msbot_agent.link.can.protocol.frame_queue import QUEUE_FRAMES
from msbot_agent.link.can.protocol.frames import MTU, Frame
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION, NODES, CanIds, MemoryNodeIds, NodeIds, is_joining
from msbot_agent.link.can.protocol.join_master import (
    JoinedPart,
    MasterEvent,
    MasterJoin,
    NodeEvicted,
    NodeJoined,
    NodeRefused,
)
from msbot_agent.link.can.protocol.join_part import AddressLost, ComponentEvent, ComponentJoin
from msbot_agent.link.contract import Peer, Signal
from msbot_xrce.errors import BusTaken, ConfigError, LinkDown, LocalProtocolError

# What the two ends of the native CAN link have in common: sending packets through the `PeerFraming` of each peer, and
# STOP.


NOT_SENT: Final = "still waiting when the peer's address ended"


class NativeEnd(CanEnd):
    """Base of `CanMasterLink` and `CanPartLink`."""

    def __init__(
        self, bus: CanBus, *, ids: CanIds, mtu: int, codec: Codec | None, queue_frames: int, remote: Peer | None = None
    ) -> None:
        """Connect with the controller."""
        super().__init__(bus, mtu=mtu, remote=remote, ids=ids, compresses=codec is not None, queue_frames=queue_frames)
        self._codec = codec

    def has_room(self, peer: Peer) -> bool:
        """See `Link`; also False while the peer has no address."""
        return isinstance(peer, int) and self._wire(peer) is not None and self._port.queue.has_room(peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: the link is not on the bus, or the peer has no address.
            LocalProtocolError: the packet is empty or longer than `info.mtu`.
        """
        self._port.check_up()
        wire = self._wire(peer) if isinstance(peer, int) else None
        if wire is None or not isinstance(peer, int):
            raise self._no_address(peer)
        if len(packet) > self.info.mtu:
            raise LocalProtocolError(f"a packet of {len(packet)} bytes is longer than the link's {self.info.mtu}")
        self._port.check_room(peer, self.describe(peer))
        frames = wire.split(packet)
        now = self._port.now()
        self._sent(packet, peer, now)
        self._port.queue.put(peer, frames)
        self._port.pump(now)

    def send_stop(self, reason: int = 0) -> None:
        """Send STOP to every node on the bus, before all other frames; the reason is a byte (`STOP_REASONS`).

        Raises:
            LinkDown: the link is not on the bus.
        """
        self._port.send_stop(reason)

    @abstractmethod
    def _wire(self, peer: int) -> PeerFraming | None:
        """The wire to a peer that has an address."""

    def _new_wire(self, send_id: int, use: int) -> PeerFraming:
        info, counters = self._port.bus.info, self.counters
        return PeerFraming(send_id, use=use, info=info, mtu=self.info.mtu, counters=counters, codec=self._codec)

    @abstractmethod
    def _no_address(self, peer: Peer) -> Exception:
        """Why there is no wire to that peer."""

    def _deliver(self, message: bytes, peer: int, wire: PeerFraming, now: float) -> None:
        packet = wire.unpack(message)
        if packet is not None:
            self._received(packet, peer, now)

    def _forget_waiting(self, peer: int) -> None:
        self._count_frames(NOT_SENT, self._port.queue.clear(peer))


MASTER: Final = 0
"""A part's only peer."""
NO_ADDRESS: Final = "data from a node without an address"
TOO_MANY: Final = "no room for another joining frame"
MASTERS_TOLD: Final = 8
"""Other masters that are warned about; any beyond are assumed to be invented."""

_log = logging.getLogger(__name__)


class CanMasterLink(NativeEnd):
    """The master's end: gives addresses to parts and carries packets from and to each."""

    def __init__(
        self,
        bus: CanBus,
        *,
        profile_hash: int,
        random: Random,
        node_ids: NodeIds | None = None,
        fd: bool = False,
        codec: Codec | None = None,
        mtu: int = MTU,
        ids: CanIds | None = None,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        """Make the link; `run` opens it.

        Args:
            bus: the controller.
            profile_hash: CRC-32 of the robot's name, version and serial number, for the beacon.
            random: source of the epoch.
            node_ids: where addresses are remembered; None = in memory.
            fd: send CAN FD frames to parts that support them. Every node on the bus must tolerate them.
            codec: header compression, for parts that support it.
            mtu: largest packet in bytes.
            ids: identifier bases, when the bus is shared with other equipment.
            queue_frames: frames that may wait for one part.

        Raises:
            ConfigError: `fd`, but the controller is a classic one.
        """
        ids = ids or CanIds()
        super().__init__(bus, ids=ids, mtu=mtu, codec=codec, queue_frames=queue_frames)
        if fd and not bus.info.fd:
            raise ConfigError(f"link {bus.info.name}: fd=1 needs a CAN FD controller, and this one is classic")
        caps = (CAN_FD if fd else 0) | (COMPRESSION if codec is not None else 0)
        self._join = MasterJoin(
            MemoryNodeIds() if node_ids is None else node_ids,
            profile_hash=profile_hash,
            random=random,
            caps=caps,
            ids=ids,
        )
        self._wires: list[PeerFraming | None] = [None] * (NODES + 1)
        self._members: list[JoinedPart | None] = [None] * (NODES + 1)
        self._up = ids.up
        self._started = self._is_up = False
        self._other_masters: set[int] = set()

    @property
    def epoch(self) -> int:
        """The number of this start, as announced in the beacon."""
        return self._join.epoch

    def uid_of(self, peer: Peer) -> bytes | None:
        """The UID of the part at that address, or None when no part has it."""
        member = self._join.members.get(peer) if isinstance(peer, int) else None
        return None if member is None else member.uid

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return f"CAN node {peer}"

    async def run(self) -> None:
        """See `Link`.

        Raises:
            BusTaken: another master is on the bus.
            LinkDown: the controller cannot be opened or has gone.
        """
        self._started = self._is_up = False
        await super().run()

    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""
        node_id = frame.can_id - self._up
        if 0 < node_id <= NODES and not (frame.extended or frame.remote or frame.error):
            wire = self._wires[node_id]
            member = self._members[node_id]
            if wire is None or member is None:
                self.counters.dropped.count(NO_ADDRESS)
                self._join.stranger(node_id, now)
                self._flush(now)
                return
            member.heard_at = now
            if not member.spoke:
                self._join.claim_address(node_id)
            message = wire.joiner.receive(frame.data, now)
            if message is not None:
                self._deliver(message, node_id, wire, now)
        elif is_joining(frame, self._ids):
            events = self._join.receive(frame, now)
            # The answer is the first of all that is sent from now on, but nothing is sent before what waited for the
            # address is forgotten and its new holder has a wire: whoever is told of room may send at once.
            refused = sum(not self._port.queue.put_urgent(answer) for answer in self._join.take_frames())
            self._count_frames(TOO_MANY, refused)
            for event in events:
                self._handle(event, now)
            self._port.send_urgent([], now)
            self._up_if_alone(now)
        else:
            self.foreign += 1

    def drained(self, now: float) -> None:
        """See `PortOwner`."""
        if self._join.sent(now):
            self._port.arm()

    def bus_up(self, now: float) -> None:
        """See `PortOwner`."""
        if self._started:
            self._join.resume(now)
        else:
            self._started = True
            self._wires = [None] * (NODES + 1)
            self._members = [None] * (NODES + 1)
            self._join.start(now)
        self._is_up = False
        self._flush(now)
        self._up_if_alone(now)

    def timer(self) -> float | None:
        """See `PortOwner`."""
        return self._join.timer()

    def handle_timer(self, now: float) -> None:
        """See `PortOwner`."""
        self._join.handle_timer(now)
        self._flush(now)
        self._up_if_alone(now)

    def _up_if_alone(self, now: float) -> None:
        """Say that the link is up, once it is known that this bus has no other master."""
        if not self._is_up and not self._join.is_listening and self._port.is_up:
            self._is_up = True
            self._signal_handler(Signal.LINK_UP, None, f"epoch {self.epoch}", now)

    def _wire(self, peer: int) -> PeerFraming | None:
        return self._wires[peer] if 0 < peer <= NODES else None

    def _no_address(self, peer: Peer) -> Exception:
        return LinkDown(f"CAN node {peer} has no address on {self.info.name}: the part is not on the bus")

    def _flush(self, now: float) -> None:
        frames = self._join.take_frames()
        if frames:
            self._count_frames(TOO_MANY, self._port.send_urgent(frames, now))

    def _handle(self, event: MasterEvent, now: float) -> None:
        if isinstance(event, NodeJoined):
            self._welcome(event, now)
        elif isinstance(event, NodeEvicted):
            self._wires[event.node_id] = self._members[event.node_id] = None
            self._forget_waiting(event.node_id)
            self._signal_handler(Signal.PEER_GONE, event.node_id, "its address was given to another part", now)
        elif isinstance(event, NodeRefused):
            _log.warning("part %s is refused on %s: all %d addresses are held", event.uid.hex(), self.info.name, NODES)
        elif event.fatal:
            self._port.fail(
                BusTaken(
                    f"link {self.info.name}: another master {'starts' if event.at_once else 'is'} on this bus, its "
                    f"robot has the profile hash {event.profile_hash:08x}. A bus has one master: stop the other one "
                    "or take another bus"
                )
            )
        elif event.profile_hash not in self._other_masters and len(self._other_masters) < MASTERS_TOLD:
            self._other_masters.add(event.profile_hash)
            _log.warning("a second master (profile hash %08x) is on %s", event.profile_hash, self.info.name)

    def _welcome(self, event: NodeJoined, now: float) -> None:
        node_id = event.node_id
        self._forget_waiting(node_id)
        self._wires[node_id] = self._new_wire(self._ids.down + node_id, event.use)
        self._members[node_id] = self._join.members[node_id]
        self._signal_handler(Signal.PEER_JOINED, node_id, f"UID {event.uid.hex()}", now)
        self._port.tell_room()


class CanPartLink(NativeEnd):
    """A part's end: gets an address by its UID and carries packets from and to the master."""

    def __init__(
        self,
        bus: CanBus,
        *,
        uid: bytes,
        random: Random,
        profile_hash: int | None = None,
        codec: Codec | None = None,
        mtu: int = MTU,
        ids: CanIds | None = None,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        """Make the link; `run` opens it.

        Args:
            bus: the controller.
            uid: 8 bytes, constant for the life of the part, different from those of all others.
            random: source of the jitter between attempts to join.
            profile_hash: the robot the part is made for; None = any.
            codec: header compression, offered to the master.
            mtu: largest packet in bytes.
            ids: identifier bases, when the bus is shared with other equipment.
            queue_frames: frames that may wait for the bus.

        Raises:
            LocalProtocolError: the UID is not 8 bytes, or all zero.
        """
        ids = ids or CanIds()
        super().__init__(bus, ids=ids, mtu=mtu, codec=codec, queue_frames=queue_frames, remote=MASTER)
        caps = (CAN_FD if bus.info.fd else 0) | (COMPRESSION if codec is not None else 0)
        self._join = ComponentJoin(uid, random=random, caps=caps, profile_hash=profile_hash, ids=ids)
        self._to_master: PeerFraming | None = None
        self._own_id = -1
        self._other_ids = frozenset(base + n for base in (ids.up, ids.down) for n in range(1, NODES + 1))
        self._port.ignore(self._other_ids)

    @property
    def node_id(self) -> int:
        """The address, 1 to 120; 0 = none."""
        return self._join.node_id

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return "the master" if peer == MASTER else f"nobody ({peer})"

    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""
        if not (frame.extended or frame.remote or frame.error):
            wire = self._to_master
            if frame.can_id == self._own_id and wire is not None:
                message = wire.joiner.receive(frame.data, now)
                if message is not None:
                    self._deliver(message, MASTER, wire, now)
                return
            if frame.can_id in self._other_ids:
                return  # between the master and another part
        if is_joining(frame, self._ids):
            self._handle(self._join.receive(frame, now), now)
        else:
            self.foreign += 1

    def drained(self, now: float) -> None:
        """See `PortOwner`."""
        if self._join.sent(now):
            self._port.arm()

    def bus_up(self, now: float) -> None:
        """See `PortOwner`."""
        self._join.start(now)
        self._handle(None, now)

    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        """See `PortOwner`."""
        self._join.stop()
        self._forget_master()
        super().bus_down(reason, lost_frames, now)

    def timer(self) -> float | None:
        """See `PortOwner`."""
        return self._join.timer()

    def handle_timer(self, now: float) -> None:
        """See `PortOwner`."""
        self._handle(self._join.handle_timer(now), now)

    def _wire(self, peer: int) -> PeerFraming | None:
        return self._to_master if peer == MASTER else None

    def _no_address(self, peer: Peer) -> Exception:
        if peer != MASTER:
            return LinkDown(f"a part talks to the master ({MASTER}) only, not to {peer}")
        return LinkDown(f"link {self.info.name}: no address yet; the part is still waiting for its master")

    def _handle(self, event: ComponentEvent | None, now: float) -> None:
        if isinstance(event, AddressLost):
            self._forget_master()
            self._signal_handler(Signal.LINK_DOWN, MASTER, event.reason, now)
        elif event is not None:
            node_id = event.node_id
            self._own_id = self._ids.down + node_id
            self._port.ignore(self._other_ids - {self._own_id})
            self._to_master = self._new_wire(self._ids.up + node_id, event.use)
            self._signal_handler(Signal.LINK_UP, MASTER, f"CAN node {node_id}", now)
            self._room_handler(None)
        self._port.send_urgent(self._join.take_frames(), now)

    def _forget_master(self) -> None:
        self._to_master = None
        self._own_id = -1
        self._port.ignore(self._other_ids)
        self._forget_waiting(MASTER)
