"""A CAN bus in memory, exact to the bit: arbitration, frame times, acknowledgement, errors, and faults on demand.

Theory of operation. The bus knows no clock. `submit` puts a frame into a node's controller at a given time. When it is
asked for, the next attempt is calculated to its end (`arbitration.py`), and `next_event_at` says when its effects
become visible. `advance` makes them happen. Nodes that become ready within the first bit of an attempt still take part
in its arbitration: the attempt is calculated anew. A failed attempt leaves the frame in the controller, so it is
repeated, as every CAN controller does. Of the frames in a controller, the one with the lowest identifier is tried
first, and of equal ones the oldest (as in bxCAN and M_CAN), so STOP need not wait for frames handed over before it.
"""

from __future__ import annotations

import math
from collections import deque
from random import Random
from typing import Final

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import arbitration_rank
from msbot_agent.link.can.protocol.frames import Frame, check_frame
from msbot_agent.link.can.protocol.load_meter import LoadMeter
from msbot_agent.link.can.sim.model.arbitration import (
    Attempt,
    QueuedFrame,
    Rates,
    SimNode,
    arbitrate,
    fall_silent,
    plan_attempt,
    plan_shorted,
)
from msbot_agent.link.can.sim.model.events import (
    RECOVERY_BITS,
    RECOVERY_SEQUENCES,
    SUSPEND,
    BusCounters,
    BusEvent,
    Delivered,
    ErrorCounters,
    Sent,
    StateChanged,
)
from msbot_xrce.errors import LinkDown, LinkFull, LocalProtocolError

MAILBOXES: Final = 3
"""Frames that a controller holds, as common ones do."""


class SimBus:
    """The bus (see the module docstring). Nodes are numbers that `attach` gives."""

    def __init__(
        self,
        bitrate: int,
        data_bitrate: int | None = None,
        *,
        fd: bool = False,
        random: Random | None = None,
        bit_error_rate: float = 0.0,
    ) -> None:
        """Make a bus without nodes.

        Args:
            bitrate: nominal bit rate in bit/s.
            data_bitrate: bit rate of the FD data phase; None = no bit-rate switch.
            fd: nodes may send CAN FD frames.
            random: source of bit errors and of random deafness; needed only for these.
            bit_error_rate: probability that a bit is inverted for all nodes.

        Raises:
            LocalProtocolError: an impossible rate or probability.
        """
        if bitrate <= 0 or (data_bitrate is not None and data_bitrate < bitrate):
            raise LocalProtocolError(f"bit rates {bitrate} and {data_bitrate}: the data rate is the higher one")
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        self.fd = fd
        self.counters = BusCounters()
        self._random = random
        self._nodes: dict[int, SimNode] = {}
        self._waiting: dict[int, SimNode] = {}
        self._recovering: list[SimNode] = []
        self._hearing: list[SimNode] | None = None
        """Nodes that are plugged in and not bus-off; None = to be determined again."""
        self._plugged_at = float("-inf")
        """When the last of them was plugged in."""
        self._audience: dict[int, list[SimNode]] = {}
        """Who hears a node, by its number, if all of those have followed the bus for long enough."""
        self._next_id = 0
        self._rates = Rates(1 / bitrate, 1 / (data_bitrate or bitrate))
        self._bit_error_rate = 0.0
        self._flips: deque[int] = deque()
        self._broken: set[int] = set()
        """Nodes whose frames are broken."""
        self._flipped = False
        self._shorted = False
        self._is_sound = True
        """No node counts errors or misses frames: what goes well changes no counter, and no state."""
        self._time = float("-inf")
        self._free_at = float("-inf")
        self._recessive_from = float("-inf")
        self._attempt: Attempt | None = None
        self._is_unplanned = False
        """The next attempt is still to be calculated, from the frames that wait then: those that come too late for its
        first bit change nothing in it."""
        self._meter = LoadMeter()
        self.set_bit_error_rate(bit_error_rate)

    # Nodes

    def attach(self, name: str, *, fd: bool | None = None) -> int:
        """Add a controller, plugged in and integrated; `fd` says whether it supports CAN FD (None = as the bus)."""
        self._settle()
        self._next_id += 1
        self._nodes[self._next_id] = SimNode(name, self.fd if fd is None else fd, self._next_id)
        self._hearing = None
        return self._next_id

    def detach(self, node: int, now: float) -> None:
        """Remove a controller and its unsent frames."""
        self.unplug(node, now)
        it = self._nodes.pop(node)
        self._broken.discard(node)
        if it in self._recovering:
            self._recovering.remove(it)

    def unplug(self, node: int, now: float) -> None:
        """Cut a node off, even while it sends: it neither hears nor sends; its frames stay in its controller."""
        it = self._nodes[node]
        if not it.plugged:
            return
        self._settle()
        it.plugged = False
        self._hearing = None
        self._waiting.pop(node, None)
        attempt = self._attempt
        if attempt is None or self._is_open(now):
            self._plan()
        elif it in attempt.senders:
            attempt.senders = [sender for sender in attempt.senders if sender is not it]
            attempt.sent = [sender for sender in attempt.sent if sender is not it]
            attempt.failures = [failure for failure in attempt.failures if failure.node is not it]
            if not attempt.senders and not attempt.error:
                self._attempt = fall_silent(attempt, now, self._rates, stuck=False)
        elif it in attempt.listeners:
            self._stop_listening(attempt, it, now)

    def plug(self, node: int, now: float) -> None:
        """Connect a node again; it takes part after 11 recessive bits."""
        it = self._nodes[node]
        if not it.plugged:
            self._settle()
            it.plugged = True
            self._hearing = None
            it.plugged_at = now
            it.ready_at = max(it.ready_at, now + RECOVERY_BITS * self._rates.bit_s)
            self._enlist(node, it, now)

    def is_plugged(self, node: int) -> bool:
        """Whether the node is connected."""
        return self._nodes[node].plugged

    def restart(self, node: int, now: float) -> None:
        """Let a node that is bus-off count its 128 times 11 recessive bits and come back."""
        it = self._nodes[node]
        if it.counters.off and it.recovering_from is None:
            it.recovering_from = now
            it.sequences_left = RECOVERY_SEQUENCES
            self._recovering.append(it)

    def pending(self, node: int) -> int:
        """Frames that wait in a node's controller, the one being sent included."""
        return len(self._nodes[node].mailboxes)

    def state(self, node: int) -> BusState:
        """The fault confinement state of a node."""
        return self._nodes[node].counters.state

    def error_counters(self, node: int) -> tuple[int, int]:
        """Transmit and receive error counter of a node."""
        counters = self._nodes[node].counters
        return counters.transmit, counters.receive

    # Traffic

    def submit(self, node: int, frame: Frame, now: float) -> None:
        """Put a frame into a node's controller.

        Raises:
            LocalProtocolError: the frame is impossible, or CAN FD on a classic bus or from a classic controller.
            LinkFull: the controller holds `MAILBOXES` frames already.
            LinkDown: the controller is bus-off.
        """
        it = self._nodes[node]
        check_frame(frame)
        if frame.fd and not (self.fd and it.fd):
            raise LocalProtocolError(f"{it.name} cannot send CAN FD frames on this bus")
        if it.counters.off:
            raise LinkDown(f"{it.name} is bus-off: restart it")
        if len(it.mailboxes) >= MAILBOXES:
            raise LinkFull(f"{it.name} holds {MAILBOXES} frames already")
        rank = arbitration_rank(frame)
        # While the bus catches up with the clock, its events are earlier than a frame submitted from outside.
        ready_at = max((mail.ready_at for mail in it.mailboxes if mail.rank == rank), default=now)
        it.mailboxes.append(QueuedFrame(max(now, self._time, ready_at), rank, frame))
        if it.plugged:
            self._enlist(node, it, now)

    def next_event_at(self) -> float | None:
        """When `advance` has something to do; None while nothing is in progress."""
        if self._is_unplanned:
            self._plan()
        attempt = self._attempt
        if not self._recovering:
            return None if attempt is None else attempt.ends_at
        moments = [self._recovery_at(it) for it in self._recovering]
        if attempt is None:
            return min(moments, default=None)
        return min((moment for moment in moments if moment <= attempt.starts_at), default=attempt.ends_at)

    def advance(self, now: float) -> list[BusEvent]:
        """Let everything happen that is due by `now`, in order of its own time."""
        events: list[BusEvent] = []
        while (at := self.next_event_at()) is not None and at <= now:
            self._time = max(self._time, at)
            attempt = self._attempt
            if attempt is not None and at == attempt.ends_at:
                self._finish(attempt, events)
            else:
                self._recover(at, events)
            self._attempt, self._is_unplanned = None, True
            if at == now and not self._recovering:
                break  # another frame takes its time, and whoever hears this one may have one to send
        return events

    def load(self, now: float) -> float:
        """Part of the last second in which the bus was busy, 0 to 1."""
        self._settle()
        return self._meter.load(now, self._attempt.starts_at if self._attempt is not None else None)

    # Faults

    def set_bit_error_rate(self, probability: float, random: Random | None = None) -> None:
        """From the next frame on, invert each bit with this probability, for all nodes.

        Args:
            probability: from 0 to below 1.
            random: the source of bit errors from now on; None: the one that the bus has.

        Raises:
            LocalProtocolError: another probability, or no `random` was given.
        """
        self._settle()
        self._random = random or self._random
        if not 0 <= probability < 1 or (probability and self._random is None):
            raise LocalProtocolError(f"bit error rate {probability}: it is from 0 to below 1 and needs a `random`")
        self._bit_error_rate = probability

    def flip_bit(self, index: int, now: float) -> None:
        """Invert one bit (0 = SOF) of the next frame, for all nodes; a second call applies to the frame after it."""
        self._settle()
        self._flips.append(index)
        if self._is_open(now):
            self._plan()

    def break_sender(self, node: int, *, broken: bool) -> None:
        """From the next frame on, invert a bit of each frame that the node sends, as a broken transmitter does."""
        self._settle()
        (self._broken.add if broken else self._broken.discard)(node)

    def deafen(self, node: int, *, frames: int = 0, probability: float = 0.0) -> None:
        """Let a node miss the next frames, or each with a probability, as a full receive buffer does.

        Raises:
            LocalProtocolError: a probability, but no `random` was given.
        """
        if probability and self._random is None:
            raise LocalProtocolError("a probability needs a `random`")
        self._is_sound = False
        self._nodes[node].deaf_frames = frames
        self._nodes[node].deafness = probability

    def short_circuit(self, now: float) -> None:
        """CAN-H touches CAN-L: from now on no node sees a dominant bit."""
        self._settle()
        attempt = self._attempt
        self._shorted = True
        if self._is_open(now):
            self._plan()
        elif attempt is not None and not attempt.error:
            self._attempt = fall_silent(attempt, now, self._rates, stuck=True)

    def repair(self, now: float) -> None:
        """End the short circuit."""
        self._settle()
        self._shorted = False
        if self._is_open(now):
            self._plan()

    # How it works

    def _is_open(self, now: float) -> bool:
        """Whether nodes can still join the planned attempt: its first bit is not over."""
        return self._attempt is not None and now < self._attempt.starts_at + self._rates.bit_s

    def _enlist(self, node: int, it: SimNode, now: float) -> None:
        if it.mailboxes and not it.counters.off:
            self._waiting[node] = it
            self._is_unplanned = self._is_unplanned or self._attempt is None or self._is_open(now)

    def _settle(self) -> None:
        """Calculate the next attempt, if that is still to be done, before something changes on which it depends."""
        if self._is_unplanned:
            self._plan()

    def _plan(self) -> None:
        """Calculate the next attempt from the waiting frames."""
        self._attempt, self._is_unplanned = None, False
        self._flipped = bool(self._flips)
        if not self._waiting:
            return
        if len(self._waiting) == 1:
            rivals = list(self._waiting.values())
            start = max(rivals[0].ready(), self._free_at)
            closed_at = start + self._rates.bit_s
        else:
            ready = [(max(it.ready(), self._free_at), it) for it in self._waiting.values()]
            start = min(at for at, _ in ready)
            closed_at = start + self._rates.bit_s
            rivals = [it for at, it in ready if at < closed_at]
        winners = arbitrate(rivals, closed_at)
        if self._shorted:  # nobody sees a dominant bit, so that everybody goes on
            self._attempt = plan_shorted(start, rivals, self._rates)
            return
        broken = self._broken and any(it.node_id in self._broken for it in winners)
        noise = _behind_arbitration if broken else self._noise
        self._attempt = plan_attempt(start, winners, self._listeners(start, winners), self._rates, noise)

    def _listeners(self, start: float, senders: list[SimNode]) -> list[SimNode]:
        if self._hearing is None:
            self._hearing = [it for it in self._nodes.values() if it.plugged and not it.counters.off]
            self._plugged_at = max((it.plugged_at for it in self._hearing), default=float("-inf"))
            self._audience.clear()
        # A controller hears nothing before it has seen 11 recessive bits in a row (ISO 11898-1:2015 10.9.3); the bus
        # has had them by `start`, so it depends on when the controller was plugged in.
        since = start - (RECOVERY_BITS - 0.01) * self._rates.bit_s
        if len(senders) == 1:
            sender = senders[0]
            if self._plugged_at > since:
                return [it for it in self._hearing if it is not sender and it.plugged_at <= since]
            audience = self._audience.get(sender.node_id)
            if audience is None:
                audience = self._audience[sender.node_id] = [it for it in self._hearing if it is not sender]
            return audience
        return [it for it in self._hearing if it not in senders and it.plugged_at <= since]

    def _noise(self, bits: int) -> int | None:
        if self._flips:
            return self._flips[0]
        if not self._bit_error_rate or self._random is None:
            return None
        survived = math.log(1 - self._random.random()) / math.log1p(-self._bit_error_rate)
        return int(survived) if survived < bits else None

    def _stop_listening(self, attempt: Attempt, it: SimNode, now: float) -> None:
        attempt.listeners = [node for node in attempt.listeners if node is not it]
        attempt.received = [node for node in attempt.received if node is not it]
        attempt.failures = [failure for failure in attempt.failures if failure.node is not it]
        acknowledged_at = attempt.free_at - (RECOVERY_BITS + 1) * self._rates.bit_s
        if not attempt.listeners and not attempt.error and attempt.senders and now < acknowledged_at:
            self._attempt = plan_attempt(attempt.starts_at, attempt.senders, [], self._rates, lambda _: None)

    def _finish(self, attempt: Attempt, events: list[BusEvent]) -> None:
        self._account(attempt)
        if self._flipped:
            self._flips.popleft()
        if self._is_sound and not attempt.failures and not attempt.error:
            if attempt.received:
                events.append(Delivered(attempt.ends_at, [it.node_id for it in attempt.received], attempt.frame))
            for it in attempt.sent:
                self._take_out(it)
                events.append(Sent(attempt.ends_at, it.node_id, attempt.frame))
            return
        before = {it: it.counters.state for it in attempt.received if it.counters.receive}
        before |= {it: it.counters.state for it in attempt.sent}
        before |= {failure.node: failure.node.counters.state for failure in attempt.failures}
        for failure in attempt.failures:
            failure.apply()
        hearing = [it for it in attempt.received if not (it.deaf_frames or it.deafness) or not self._misses(it)]
        if hearing:
            events.append(Delivered(attempt.ends_at, [it.node_id for it in hearing], attempt.frame))
        for it in attempt.received:
            if it.counters.receive:
                it.counters.receive_succeeded()
        for it in attempt.sent:
            it.counters.transmit_succeeded()
            self._take_out(it)
            events.append(Sent(attempt.ends_at, it.node_id, attempt.frame))
        for it in {*attempt.senders, *(failure.node for failure in attempt.failures if failure.as_sender)}:
            if not it.counters.active:
                it.ready_at = attempt.free_at + SUSPEND * self._rates.bit_s
        self._tell_states(before, attempt.ends_at, events)
        self._is_sound = all(map(_is_sound, self._nodes.values()))

    def _take_out(self, it: SimNode) -> None:
        """Take a frame that has been sent out of its controller."""
        mail, it.choice = it.choice, None
        if mail is not None:
            it.mailboxes.remove(mail)
        if not it.mailboxes:
            self._waiting.pop(it.node_id, None)

    def _tell_states(self, before: dict[SimNode, BusState], at: float, events: list[BusEvent]) -> None:
        for it, state in before.items():
            if it.counters.state is not state:
                events.append(StateChanged(at, it.node_id, it.counters.state))
                if it.counters.off:
                    self._hearing = None
                    it.mailboxes.clear()
                    self._waiting.pop(it.node_id, None)

    def _account(self, attempt: Attempt) -> None:
        self.counters.bits += attempt.bits
        self.counters.busy_s += attempt.free_at - attempt.starts_at
        if attempt.sent or (attempt.received and not attempt.error):
            self.counters.frames += 1
        self.counters.overloads += attempt.overload
        if attempt.error:
            self.counters.errors += 1
            self.counters.by_error.count(attempt.error)
        for it in self._recovering:
            idle = attempt.starts_at - self._recessive_since(it)
            if idle > 0:
                it.sequences_left -= int(idle / (RECOVERY_BITS * self._rates.bit_s) + 1e-6)
        self._free_at = attempt.free_at
        self._recessive_from = attempt.recessive_from
        self._meter.add(attempt.starts_at, attempt.free_at)

    def _misses(self, it: SimNode) -> bool:
        if it.deaf_frames:
            it.deaf_frames -= 1
            return True
        return bool(it.deafness and self._random is not None and self._random.random() < it.deafness)

    def _recessive_since(self, it: SimNode) -> float:
        return self._recessive_from if it.recovering_from is None else max(self._recessive_from, it.recovering_from)

    def _recovery_at(self, it: SimNode) -> float:
        return self._recessive_since(it) + it.sequences_left * RECOVERY_BITS * self._rates.bit_s

    def _recover(self, at: float, events: list[BusEvent]) -> None:
        for it in [it for it in self._recovering if self._recovery_at(it) <= at]:
            self._recovering.remove(it)
            it.recovering_from = None
            it.counters = ErrorCounters()
            self._hearing = None
            events.append(StateChanged(at, it.node_id, BusState.ACTIVE))


def _is_sound(it: SimNode) -> bool:
    """Whether a node counts no errors and misses no frames."""
    counters = it.counters
    return not (counters.transmit or counters.receive or counters.off or it.deaf_frames or it.deafness)


def _behind_arbitration(bits: int) -> int:
    """Where a broken sender's frame goes wrong: arbitration is fair, also of a short frame with a long identifier."""
    return bits * 2 // 3
