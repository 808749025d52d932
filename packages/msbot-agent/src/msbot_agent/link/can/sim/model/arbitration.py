"""Arbitration, and the attempt to send that follows: who gets the frame, what goes wrong, and how long it takes.

Theory of operation. An attempt that goes well needs only the length of the frame, which is counted by tables. When
something goes wrong, the bits of the frame are examined: each group of nodes notices the error at some bit and sends
its error flag from the next one on; the flags overlap, and the bus is free again 8 + 3 bits after the last of them. All
times are calculated when the attempt begins; nothing is simulated bit by bit while time passes.

Simplifications: bits change their rate at bit boundaries (not at the sample point, which leaves the length of a frame
as it is), a node's error flag begins at the end of the bit in which it noticed, and a disturbance of the third bit of
the intermission, which would be taken for an SOF, is left out.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import field, replace

from msbot_agent.link.can.protocol.bits import INTERMISSION, FrameBits, WireBit, frame_bits, wire_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.events import (
    ERROR_DELIMITER,
    ERROR_FLAG,
    PASSIVE_LIMIT,
    ErrorCounters,
    noticed_at,
)
from msbot_xrce.lazy import dataclass

Noise = Callable[[int], int | None]
"""Given a number of bits: the index of the first one that is disturbed; None, or one behind them: none is."""

OVERLOAD_FLAG = ERROR_FLAG
"""Bits of an overload flag; always dominant."""

_AFTER_ACK_SLOT = 1 + 7 + INTERMISSION
_ARBITRATION = ("ID", "SRR", "IDE", "RTR", "RRS")


@dataclass(slots=True, eq=False)
class QueuedFrame:
    """A frame in a controller."""

    ready_at: float
    """When it was handed over."""
    rank: int
    """Its `arbitration_rank`."""
    frame: Frame


@dataclass(slots=True, eq=False)
class SimNode:
    """One controller on the simulated bus."""

    name: str
    fd: bool
    """Whether it understands CAN FD frames; a controller that does not destroys them."""
    node_id: int = 0
    """Its number on the bus."""
    mailboxes: list[QueuedFrame] = field(default_factory=list)
    """Frames to be sent, in the order they were handed over."""
    choice: QueuedFrame | None = None
    """The frame that it sends now or next."""
    counters: ErrorCounters = field(default_factory=ErrorCounters)
    plugged: bool = True
    plugged_at: float = float("-inf")
    ready_at: float = float("-inf")
    """Earliest time to begin sending (integration after plugging in, suspended transmission)."""
    recovering_from: float | None = None
    """Since when it has been counting recessive bits to return from bus-off."""
    sequences_left: int = 0
    """Sequences of 11 recessive bits left until it is back from bus-off."""
    deaf_frames: int = 0
    """How many of the next frames it will miss."""
    deafness: float = 0.0
    """Probability of missing a frame."""

    def ready(self) -> float:
        """When it can begin to send, apart from the bus; it must hold a frame."""
        if len(self.mailboxes) == 1:
            return max(self.ready_at, self.mailboxes[0].ready_at)
        return max(self.ready_at, min(mail.ready_at for mail in self.mailboxes))

    def choose(self, by: float) -> QueuedFrame:
        """Choose among the frames ready before `by`: the lowest identifier wins, and of equal ones the oldest frame."""
        if len(self.mailboxes) == 1:
            self.choice = self.mailboxes[0]
            return self.choice
        self.choice = min((mail for mail in self.mailboxes if mail.ready_at < by), key=lambda mail: mail.rank)
        return self.choice

    def outgoing(self) -> Frame:
        """The chosen frame, with ESI as the controller's state demands."""
        assert self.choice is not None
        frame = self.choice.frame
        return frame if not frame.fd or self.counters.active else replace(frame, esi=True)


@dataclass(slots=True)
class Rates:
    """Bit times in seconds."""

    bit_s: float
    fast_bit_s: float

    def end_of(self, wire: Sequence[WireBit], index: int, start: float) -> float:
        """When a bit of a frame that began at `start` ends; index -1 is the start itself."""
        fast = sum(bit.fast for bit in wire[: index + 1])
        return start + (index + 1 - fast) * self.bit_s + fast * self.fast_bit_s


@dataclass(slots=True)
class Failure:
    """A node that noticed an error, and what that does to its counters."""

    node: SimNode
    as_sender: bool
    times: int = 1
    """0: the counter does not change (exceptions of rule c)."""
    first: bool = False
    """A receiver that was the first to send an error flag (rule b)."""

    def apply(self) -> None:
        """Apply it to the counters."""
        for _ in range(self.times):
            if self.as_sender:
                self.node.counters.transmit_failed()
            else:
                self.node.counters.receive_failed(first=self.first)


@dataclass(slots=True)
class Attempt:
    """One try to send a frame, calculated to its end."""

    starts_at: float
    frame: Frame
    senders: list[SimNode]
    """All nodes that send this frame (more than one only with equal identifiers)."""
    listeners: list[SimNode]
    sent: list[SimNode] = field(default_factory=list)
    """The senders whose frame has been sent."""
    received: list[SimNode] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    error: str = ""
    """What went wrong, in words; empty if all went well."""
    overload: bool = False
    """An overload frame followed, because the intermission was disturbed."""
    bits: int = 0
    """Bits on the bus, intermission included."""
    ends_at: float = 0.0
    """When its effects become visible: end of frame, or end of the error delimiter."""
    free_at: float = 0.0
    """When the next frame may begin."""
    recessive_from: float = 0.0
    """Since when the bus has been recessive, as seen at `free_at`."""


@dataclass(slots=True)
class _Group:
    """Nodes that notice an error at the same bit."""

    nodes: list[SimNode]
    index: int
    as_sender: bool
    times: int = 1


def arbitrate(rivals: Sequence[SimNode], closed_at: float) -> list[SimNode]:
    """Who goes on sending of the nodes that begin before `closed_at`: the lowest identifier wins (ISO 11898-1).

    More than one node wins when they send the same identifier; they meet again in the bits that follow.
    """
    if len(rivals) == 1:
        rivals[0].choose(closed_at)
        return list(rivals)
    ranks = [node.choose(closed_at).rank for node in rivals]
    best = min(ranks)
    return [node for node, rank in zip(rivals, ranks, strict=True) if rank == best]


def plan_attempt(start: float, senders: list[SimNode], listeners: list[SimNode], rates: Rates, noise: Noise) -> Attempt:
    """Calculate what happens to the frame that these nodes, all with the same identifier, begin to send.

    Args:
        start: time of the first bit.
        senders: at least one.
        listeners: all other nodes that have followed the bus since before the start.
        rates: bit times.
        noise: where the bus is disturbed.
    """
    frame = senders[0].outgoing()
    if len(senders) > 1 and any(node.outgoing() != frame for node in senders):
        return _plan_conflict(start, senders, listeners, rates, noise)
    refusing = [node for node in listeners if not node.fd] if frame.fd else []
    attempt = Attempt(
        start, frame, senders, [node for node in listeners if node not in refusing] if refusing else listeners
    )
    length = frame_bits(frame)
    total = sum(length)
    disturbed = noise(total)
    if disturbed is None and not refusing and listeners:
        _succeed(attempt, length, rates)
        return attempt
    destroying = [node for node in refusing if node.counters.active]
    if destroying:
        wire = wire_bits(frame)
        fdf = next(index for index, bit in enumerate(wire) if bit.field == "FDF")
        if disturbed is None or disturbed > fdf:
            return _destroy(attempt, wire, fdf, destroying, rates)
        attempt.listeners = listeners  # up to here, and if FDF itself is inverted, these see what the others see
    acknowledged = bool(attempt.listeners) or disturbed == total - _AFTER_ACK_SLOT - 1
    if disturbed is not None and disturbed < total - INTERMISSION and (attempt.listeners or not acknowledged):
        return _disturb(attempt, disturbed, rates)
    if not acknowledged:
        return _not_acknowledged(attempt, length.nominal_bits, length.data_bits, rates)
    _succeed(attempt, length, rates)
    attempt.failures = [Failure(node, as_sender=False) for node in refusing]
    if disturbed is not None and total - INTERMISSION <= disturbed < total - 1:
        _overload(attempt, disturbed, rates)
    return attempt


def fall_silent(attempt: Attempt, now: float, rates: Rates, *, stuck: bool) -> Attempt:
    """Recalculate an attempt whose bus turns recessive at `now`.

    Args:
        attempt: as planned.
        now: between its start and its end.
        rates: bit times.
        stuck: True when the bus itself is stuck (short circuit): the senders are still there and notice; False
            when the senders have gone.
    """
    changed = Attempt(attempt.starts_at, attempt.frame, [], attempt.listeners)
    wire = wire_bits(attempt.frame, acknowledged=bool(attempt.listeners))
    over = bisect_right(range(len(wire)), now, key=lambda index: rates.end_of(wire, index, attempt.starts_at))
    last = over - 1
    groups: list[_Group] = []
    noticed = noticed_at(wire, last, wire[last].level if last >= 0 else 1, 1)
    if stuck:
        changed.senders = attempt.senders
        missing = next((i for i in range(over, len(wire)) if wire[i].level == 0), None)
        if missing is None:
            return attempt
        groups.append(_Group(attempt.senders, missing, as_sender=True))
        if wire[missing].field == "ACK":
            noticed = missing  # the receivers miss the dominant bit that they send there
    if noticed is None:
        changed.received = attempt.listeners
    else:
        groups.append(_Group(attempt.listeners, noticed, as_sender=False))
    if not groups:
        for name in ("bits", "ends_at", "free_at", "recessive_from"):
            setattr(changed, name, getattr(attempt, name))
        return changed
    return _fail(changed, wire, groups, rates, "the bus was short-circuited" if stuck else "the sender was unplugged")


def plan_shorted(start: float, senders: list[SimNode], rates: Rates) -> Attempt:
    """Calculate an attempt on a bus that is stuck recessive: the first dominant bit cannot be seen.

    Each bit of an active error flag fails as well (rule d), until the node is error-passive.
    """
    frame = senders[0].outgoing()
    attempt = Attempt(start, frame, senders, [], error="the bus is short-circuited")
    flag = ERROR_FLAG
    for node in senders:
        passive_after = -(-(PASSIVE_LIMIT + 1 - node.counters.transmit) // 8)
        times = max(1, passive_after) if node.counters.active else 1
        attempt.failures.append(Failure(node, as_sender=True, times=times))
        flag = max(flag, times - 1 + ERROR_FLAG)
    return _close(attempt, start + rates.bit_s * (1 + flag), 1 + flag, rates)


def _plan_conflict(
    start: float, senders: list[SimNode], listeners: list[SimNode], rates: Rates, noise: Noise
) -> Attempt:
    """Equal identifiers, different frames: the node that sends recessive at the first difference finds a bit error."""
    wires = {node: wire_bits(node.outgoing()) for node in senders}
    length = min(map(len, wires.values()))
    broken = next(i for i in range(length) if len({wire[i].level for wire in wires.values()}) > 1)
    losers = [node for node in senders if wires[node][broken].level == 1]
    winners = [node for node in senders if wires[node][broken].level == 0]
    if not any(node.counters.active for node in losers):
        attempt = plan_attempt(start, winners, listeners, rates, noise)
        attempt.failures += [Failure(node, as_sender=True) for node in losers]
        return attempt
    wire = wires[winners[0]]
    attempt = Attempt(start, winners[0].outgoing(), senders, listeners)
    groups = [_Group(losers, broken, as_sender=True)]
    groups += [_Group([node], _next_recessive(wires[node], broken), as_sender=True) for node in winners]
    noticed = noticed_at(wire, broken, 0, 0)
    if noticed is not None:
        groups.append(_Group(listeners, noticed, as_sender=False))
    return _fail(attempt, wire, groups, rates, "two nodes sent different frames with one identifier")


def _destroy(attempt: Attempt, wire: list[WireBit], fdf: int, destroying: list[SimNode], rates: Rates) -> Attempt:
    """Classic-only controllers find a form error at the FDF bit of a CAN FD frame."""
    groups = [_Group(destroying, fdf, as_sender=False)]
    groups.append(_Group(attempt.senders, _next_recessive(wire, fdf), as_sender=True))
    noticed = noticed_at(wire, fdf, 1, 0)
    if noticed is not None:
        groups.append(_Group(attempt.listeners, noticed, as_sender=False))
    return _fail(attempt, wire, groups, rates, "a classic-only controller does not support CAN FD")


def _disturb(attempt: Attempt, broken: int, rates: Rates) -> Attempt:
    """One bit is inverted for all nodes."""
    wire = wire_bits(attempt.frame, acknowledged=bool(attempt.listeners))
    bit = wire[broken]
    level = 1 - bit.level
    in_arbitration = bit.field in _ARBITRATION and bit.level == 1
    if in_arbitration and not bit.stuff:
        # The senders believe they lost arbitration and fall silent, so every node is a receiver.
        noticed = noticed_at(wire, broken, level, 1)
        everybody = _Group(attempt.senders + attempt.listeners, broken if noticed is None else noticed, as_sender=False)
        return _fail(attempt, wire, [everybody], rates, "a bit was disturbed")
    # Exception of rule c: a stuff error during arbitration does not count.
    groups = [_Group(attempt.senders, broken, as_sender=True, times=0 if in_arbitration else 1)]
    if broken == len(wire) - INTERMISSION - 1:
        # The last bit of the end of frame: the receivers have accepted the frame by then and answer with an overload
        # flag, while the sender repeats it. This is how CAN delivers a frame twice.
        attempt.received = attempt.listeners
        return _fail(attempt, wire, groups, rates, "a bit was disturbed")
    active = any(node.counters.active for node in attempt.senders)
    noticed = broken if bit.field == "ACK" else noticed_at(wire, broken, level, 0 if active else 1)
    if noticed is None:
        attempt.received = attempt.listeners
    else:
        groups.append(_Group(attempt.listeners, noticed, as_sender=False))
    return _fail(attempt, wire, groups, rates, "a bit was disturbed")


def _succeed(attempt: Attempt, length: FrameBits, rates: Rates) -> None:
    attempt.sent, attempt.received = attempt.senders, attempt.listeners
    attempt.bits = sum(length)
    attempt.free_at = attempt.starts_at + length.nominal_bits * rates.bit_s + length.data_bits * rates.fast_bit_s
    attempt.ends_at = attempt.free_at - INTERMISSION * rates.bit_s
    attempt.recessive_from = attempt.free_at - _AFTER_ACK_SLOT * rates.bit_s


def _overload(attempt: Attempt, disturbed: int, rates: Rates) -> None:
    """A dominant bit in the first two of the intermission: every node sends an overload frame (ISO 11898-1:2015
    10.4.5).

    It looks like an error frame, but the frame before it was transmitted, and no counter changes.
    """
    attempt.overload = True
    seen = disturbed + 1 - (attempt.bits - INTERMISSION)
    more = OVERLOAD_FLAG + ERROR_DELIMITER
    attempt.recessive_from = attempt.ends_at + (seen + OVERLOAD_FLAG) * rates.bit_s
    attempt.free_at = attempt.ends_at + (seen + more + INTERMISSION) * rates.bit_s
    attempt.bits += seen + more


def _not_acknowledged(attempt: Attempt, nominal: int, fast: int, rates: Rates) -> Attempt:
    """No node is there to acknowledge: the sender finds the ACK slot recessive."""
    attempt.error = "nobody acknowledged"
    for node in attempt.senders:
        # Exception of rule c: an error-passive node that sees no dominant bit in its flag does not count this error,
        # so a lone node never goes bus-off.
        attempt.failures.append(Failure(node, as_sender=True, times=1 if node.counters.active else 0))
    slow = nominal - _AFTER_ACK_SLOT + ERROR_FLAG
    return _close(attempt, attempt.starts_at + slow * rates.bit_s + fast * rates.fast_bit_s, slow + fast, rates)


def _fail(attempt: Attempt, wire: Sequence[WireBit], groups: list[_Group], rates: Rates, error: str) -> Attempt:
    """Overlap the error flags of all groups, and end the attempt after the last."""
    attempt.error = error
    groups = [group for group in groups if group.nodes]
    first = min(group.index for group in groups)
    active = [group.index for group in groups if any(node.counters.active for node in group.nodes)]
    last = max(active, default=first)
    for group in groups:
        overtaken = not group.as_sender and group.index == first < last
        for node in group.nodes:
            attempt.failures.append(Failure(node, group.as_sender, group.times, overtaken and node.counters.active))
    flags_end = rates.end_of(wire, last, attempt.starts_at) + ERROR_FLAG * rates.bit_s
    return _close(attempt, flags_end, last + 1 + ERROR_FLAG, rates)


def _close(attempt: Attempt, flags_end: float, bits: int, rates: Rates) -> Attempt:
    attempt.recessive_from = flags_end
    attempt.ends_at = flags_end + ERROR_DELIMITER * rates.bit_s
    attempt.free_at = attempt.ends_at + INTERMISSION * rates.bit_s
    attempt.bits = bits + ERROR_DELIMITER + INTERMISSION
    return attempt


def _next_recessive(wire: Sequence[WireBit], after: int) -> int:
    """The bit in which a sender meets the dominant flag of another node."""
    return next(i for i in range(after + 1, len(wire)) if wire[i].level == 1)
