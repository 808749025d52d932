"""The CAN link of the thesis' firmware (R29): one component on a bus, identifiers 0x123 up and 0x120 down.

For boards whose firmware cannot be changed. It cannot do the following, which is why there is a native mode
(`native_link.py`): more than one component, addresses, messages beyond 1792 bytes, and the certainty that a message
arrives as it was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from msbot_agent.link.can.can_link_base import CanEnd
from msbot_agent.link.can.controller import CanBus
from msbot_agent.link.can.protocol.frames import REPEAT_S, Frame
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_agent.link.can.protocol.legacy_frames import DOWN, MTU, UP, LegacyJoiner, split_legacy
from msbot_agent.link.can.protocol.queue import QUEUE_FRAMES
from msbot_agent.link.contract import Peer
from msbot_xrce.errors import ConfigError, LinkDown

MASTER: Final = 0
"""The peer that a component sees."""
COMPONENT: Final = 1
"""The peer that a master sees."""

_WORDS: Final = {MASTER: "the master", COMPONENT: "the CAN component"}


class CanLegacyLink(CanEnd):
    """The master's end, or with `component` the component's. Satisfies `Link`."""

    def __init__(
        self,
        bus: CanBus,
        *,
        is_whole: Callable[[bytes], bool],
        component: bool = False,
        up: int = UP,
        down: int = DOWN,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        """Make the link; `run` opens it.

        Args:
            bus: the controller; only classic frames are used.
            is_whole: whether octets are one message from its beginning to its end, which this format cannot tell.
            component: the component's end.
            up: identifier from the component to the master, 11 bits.
            down: identifier from the master to the component; the published agent of the thesis answers with `up`.
            queue_frames: frames that may wait before there is no room.

        Raises:
            ConfigError: an identifier has more than 11 bits, or is that of STOP.
        """
        for can_id in (up, down):
            if not 0 <= can_id <= 0x7FF or can_id == CanIds().stop:
                raise ConfigError(f"CAN identifier {can_id:#x} cannot be used: choose another one from 0 to 0x7ff")
        super().__init__(bus, mtu=MTU, remote=MASTER if component else None, queue_frames=queue_frames)
        self._peer = MASTER if component else COMPONENT
        self._send_id, self._receive_id = (up, down) if component else (down, up)
        self._joiner = LegacyJoiner(
            is_whole, dropped=self.counters.dropped, repeat_s=_repeat_s(bus.info.bits_per_second)
        )

    def has_room(self, peer: Peer) -> bool:
        """See `Link`."""
        return peer == self._peer and self._port.is_up and self._port.queue.has_room(self._peer)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: the queue is full.
            LinkDown: the link is not on the bus, or there is no such peer.
            LocalProtocolError: the packet is empty or longer than 1792 bytes.
        """
        self._port.check_up()
        if peer != self._peer:
            raise LinkDown(f"there is only {_WORDS[self._peer]} at the other end ({self._peer}), not {peer}")
        parts = split_legacy(packet)
        self._port.check_room(self._peer, self.describe(peer))
        now = self._port.now()
        self._sent(packet, peer, now)
        self._port.queue.put(self._peer, [Frame(self._send_id, part) for part in parts])
        self._port.pump(now)

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        return _WORDS[self._peer] if peer == self._peer else f"nobody ({peer})"

    # What the port calls (`PortOwner`).

    def frame_received(self, frame: Frame, now: float) -> None:
        """See `PortOwner`."""
        if frame.can_id != self._receive_id or frame.extended or frame.remote or frame.error or frame.fd:
            self.foreign += 1
            return
        packet = self._joiner.receive(frame.data, now)
        if packet is not None:
            self._received(packet, self._peer, now)


def _repeat_s(bits_per_second: int | None) -> float:
    # The longest frame has 135 bits; its repetition follows at once, behind an error frame at most.
    return REPEAT_S if bits_per_second is None else 400 / bits_per_second
