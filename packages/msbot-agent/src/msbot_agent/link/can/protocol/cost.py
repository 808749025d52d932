"""The average cost of messages on a CAN bus: encodes the same message many times and counts every frame. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import COUNTER, Frame, split
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION, EPOCHS, Beacon, CanIds, beacon_frame
from msbot_agent.link.can.protocol.join_master import BEACON_PERIOD_S
from msbot_xrce.lazy import dataclass

BEACONS_HZ: Final = 1 / BEACON_PERIOD_S
_EPOCHS_TRIED: Final = 64


@dataclass(frozen=True, slots=True)
class Framing:
    """How messages become frames on a bus."""

    fd: bool = False
    """CAN FD data frames."""
    bit_rate_switch: bool = False
    """They switch to the data bit rate."""
    compress: Callable[[bytes], bytes] | None = None
    """Header compression; None = messages as they are."""

    @property
    def caps(self) -> int:
        """The capability bits of a master with this framing."""
        return (CAN_FD if self.fd else 0) | (COMPRESSION if self.compress is not None else 0)


@dataclass(frozen=True, slots=True)
class Cost:
    """Mean cost of one message."""

    frames: float
    nominal_bits: float
    """See `FrameBits`."""
    data_bits: float

    @property
    def bits(self) -> float:
        """All bits."""
        return self.nominal_bits + self.data_bits

    def seconds(self, bitrate: float, data_bitrate: float | None = None) -> float:
        """Time on the bus at these bit rates (bit/s)."""
        return self.nominal_bits / bitrate + self.data_bits / (data_bitrate or bitrate)


def message_cost(packets: Sequence[bytes], node: int, framing: Framing, *, up: bool, ids: CanIds | None = None) -> Cost:
    """Mean cost of one of these packets.

    Args:
        packets: what is sent; at least one.
        node: address of the part.
        framing: how packets become frames.
        up: from the part to the master; else the other way.
        ids: identifier bases.
    """
    ids = ids or CanIds()
    can_id = (ids.up if up else ids.down) + node
    frames: list[Frame] = []
    for number, packet in enumerate(packets):
        message = packet if framing.compress is None else framing.compress(packet)
        # The counter of the first frame can be anything; these are spread over all values.
        counter = number * (COUNTER + 1) // len(packets)
        parts = split(message, counter, framing.fd)
        frames += [Frame(can_id, part, False, framing.fd, framing.bit_rate_switch) for part in parts]
    return _mean(frames, len(packets))


def beacon_cost(profile_hash: int, framing: Framing, *, ids: CanIds | None = None) -> Cost:
    """Mean cost of a BEACON, whatever the epoch is."""
    epochs = range(0, EPOCHS, EPOCHS // _EPOCHS_TRIED)
    beacons = [beacon_frame(Beacon(framing.caps, epoch, profile_hash), ids or CanIds()) for epoch in epochs]
    return _mean(beacons, len(beacons))


def _mean(frames: Iterable[Frame], messages: int) -> Cost:
    costs = [frame_bits(frame) for frame in frames]
    nominal, data = sum(cost.nominal_bits for cost in costs), sum(cost.data_bits for cost in costs)
    return Cost(len(costs) / messages, nominal / messages, data / messages)
