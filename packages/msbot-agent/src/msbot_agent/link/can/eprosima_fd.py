"""CAN FD as eProsima's agent and clients use it (their transport `canfd`): one frame is one packet.

A client chooses a 29-bit identifier, sends with it and listens to it; the agent hears every frame, identifies the
client by the identifier, and answers with the same one. Byte 0 of a frame is the length of the packet, 1 to 63; padding
follows the packet. There are no segments: DDS-XRCE itself fragments longer messages.

Agent and client may both send with the same identifier, which CAN does not allow: when they start in the same bit, the
frames destroy each other, and both are repeated at once. This may end in bus-off, from which the port returns. Two
nodes with something to send start together whenever a frame ends, so this end answers only after the other has been
silent for the time of a frame. The native mode (`native_link.py`) has no such weakness; this one is for boards whose
firmware cannot be changed.
"""

from __future__ import annotations

from typing import Final

from msbot_agent.link.can.can_link_base import CanEnd
from msbot_agent.link.can.controller import CanBus
from msbot_agent.link.can.protocol.frame_queue import QUEUE_FRAMES
from msbot_agent.link.can.protocol.frames import Frame, pad_fd
from msbot_agent.link.contract import Peer
from msbot_xrce.errors import ConfigError, LinkFull, LocalProtocolError

MTU: Final = 63
IDENTIFIERS: Final = 1 << 29

MAX_PEERS: Final = 1024
"""Identifiers with a queue of their own; beyond, the one first used is dropped, and its waiting frames are counted."""

SILENCE_BITS: Final = 750
"""Silence after a frame of the other side, in nominal bits: the longest FD frame without a bit-rate switch has 704."""

SILENCE_S: Final = 0.0015
"""The same where the bit rate is not known: the time at 500 kbit/s."""

WRONG_LENGTH: Final = "length byte does not fit the frame"
GAVE_WAY: Final = "too many identifiers: the oldest one's packets gave way"


class CanFdEprosimaLink(CanEnd):
    """The agent's end, or with `can_id` a client's. A peer is the 29-bit identifier. Satisfies `Link`."""

    def __init__(self, bus: CanBus, *, can_id: int | None = None, queue_frames: int = QUEUE_FRAMES) -> None:
        """Make the link; `run` opens it.

        Args:
            bus: a controller that can send CAN FD frames.
            can_id: the client's identifier; None = the agent, which hears all of them.
            queue_frames: how many packets may wait for one client.

        Raises:
            ConfigError: the controller is a classic one, or there is no such identifier.
        """
        if not bus.info.fd:
            raise ConfigError(f"link {bus.info.name}: eProsima's mode needs a CAN FD controller, this one is classic")
        if can_id is not None and not 0 <= can_id < IDENTIFIERS:
            raise ConfigError(f"CAN identifier {can_id:#x} is not from 0 to {IDENTIFIERS - 1:#x}")
        super().__init__(bus, mtu=MTU, remote=can_id, queue_frames=queue_frames)
        self._queue_frames = queue_frames
        rate = bus.info.bits_per_second
        self._silence_s = SILENCE_BITS / rate if rate else SILENCE_S
        self._peers: dict[int, None] = {}
        self._speaking: dict[int, float] = {}
        """Identifiers just heard -> until when nothing is sent with them."""
        self._held: dict[int, list[Frame]] = {}
        """Frames that wait for this silence."""

    def has_room(self, peer: Peer) -> bool:
        """See `Link`."""
        return isinstance(peer, int) and self._port.is_up and self._may_queue(peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: the peer's queue is full.
            LinkDown: the link is not on the bus.
            LocalProtocolError: the packet does not fit a frame, or the peer is not an identifier.
        """
        self._port.check_up()
        if not isinstance(peer, int):
            raise LocalProtocolError(f"{peer!r} is no CAN identifier")
        if not 0 < len(packet) <= MTU:
            raise LocalProtocolError(f"a CAN FD frame carries a packet of 1 to {MTU} bytes, not {len(packet)}")
        if not self._may_queue(peer):
            raise LinkFull(f"the queue to {self.describe(peer)} is full: wait for on_room")
        self._note(peer)
        frame = Frame(peer, pad_fd(bytes((len(packet),)) + packet), extended=True, fd=True)
        now = self._port.now()
        self._sent(packet, peer, now)
        if self._speaking.get(peer, now) > now:
            self._held.setdefault(peer, []).append(frame)
            self._port.arm()
        else:
            self._port.queue.put(peer, [frame])
            self._port.pump(now)

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return f"CAN identifier {peer:#x}" if isinstance(peer, int) else str(peer)

    # What the port calls (`PortOwner`).

    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""
        if not frame.extended or not frame.fd or frame.error or self.remote not in (None, frame.can_id):
            self.foreign += 1
            return
        data = frame.data
        if not data or not 0 < data[0] <= min(MTU, len(data) - 1):
            self.counters.dropped.count(WRONG_LENGTH)
            return
        packet = data[1 : 1 + data[0]]
        self._speaking[frame.can_id] = now + self._silence_s
        self._port.arm()
        self._received(packet, frame.can_id, now)

    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        """See `PortOwner`."""
        lost_frames += sum(map(len, self._held.values()))
        for waiting in (self._peers, self._speaking, self._held):
            waiting.clear()
        super().bus_down(reason, lost_frames, now)

    def timer(self) -> float | None:
        """See `PortOwner`."""
        return min(self._speaking.values(), default=None)

    def handle_timer(self, now: float) -> None:
        """See `PortOwner`."""
        for peer in [peer for peer, until in self._speaking.items() if until <= now]:
            del self._speaking[peer]
            frames = self._held.pop(peer, None)
            if frames:
                self._port.queue.put(peer, frames)
        self._port.pump(now)

    def _may_queue(self, peer: int) -> bool:
        return self._port.queue.has_room(peer) and len(self._held.get(peer, ())) < self._queue_frames

    def _note(self, peer: int) -> None:
        """Bound the queues: on a bus full of noise there may be any number of identifiers."""
        if peer in self._peers:
            return
        if len(self._peers) >= MAX_PEERS:
            oldest = next(iter(self._peers))
            del self._peers[oldest]
            self._count_frames(GAVE_WAY, self._port.queue.clear(oldest) + len(self._held.pop(oldest, ())))
        self._peers[peer] = None
