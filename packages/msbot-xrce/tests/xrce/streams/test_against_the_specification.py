"""Our streams beside `spec_model`, which was written from the specification: the same input, the same outcome."""

from __future__ import annotations

import copy
from functools import cache
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from msbot_xrce import AgentSession
from msbot_xrce.messages.submessage import Envelope
from msbot_xrce.sessions import DataWritten
from msbot_xrce.streams.receiving_in_order import BestEffortInput, ReliableInput
from msbot_xrce.streams.round_trip import RoundTrip
from msbot_xrce.streams.sending_and_resending import ReliableOutput
from msbot_xrce.streams.settings import Memory, SessionCounters
from msbot_xrce.streams.waiting_messages import Outbox
from tests.xrce.streams.spec_model import (
    LOST,
    NUMBERS,
    SpecBestEffortReceiver,
    SpecReceiver,
    SpecSender,
    acknack,
    cut,
    heartbeat,
    message,
    read,
    write_data,
)

STARTS = (0, 40, 32_760, 65_530)
"""Where streams begin here: also just before the numbers wrap, and before half of them."""
WINDOWS = (1, 4, 16)
MTU = 24


@given(st.sampled_from(STARTS), st.lists(st.integers(-40, 40) | st.sampled_from([32_767, 32_768, 32_769, -32_768])))
def test_best_effort_takes_what_the_specification_says(start: int, steps: list[int]) -> None:
    ours, model = BestEffortInput(), SpecBestEffortReceiver()
    for number in range(0, start + 1, 20):
        assert ours.accept(number)
        assert model.take(number)
    for step in steps:
        number = (model.newest + step) % NUMBERS
        assert ours.accept(number) is model.take(number), (model.newest, number)


class ReceiverMachine(RuleBasedStateMachine):
    """Messages and HEARTBEATs of a sender that is right, of one that is confused, and old ones."""

    @initialize(window=st.sampled_from(WINDOWS), start=st.sampled_from(STARTS))
    def begin(self, window: int, start: int) -> None:
        self.ours = ReliableInput(window, Memory(100_000), SessionCounters())
        self.model = SpecReceiver(window)
        self.handed_on: list[bytes | None] = []
        for first in (start // 3, start // 3 * 2, start):
            self.hear(first, first - 1)

    @rule(ahead=st.integers(-20, 40) | st.sampled_from([32_766, 32_767, 32_768, -32_767]))
    def a_message_comes(self, ahead: int) -> None:
        position = self.model.next + ahead
        octets = b"%d" % position
        if self.ours.accept(position % NUMBERS, octets):
            self.handed_on.append(octets)
            self.take_held()
        self.model.take(position % NUMBERS, octets)

    @rule(ahead=st.integers(-20, 20), count=st.integers(0, 20))
    def a_heartbeat_comes(self, ahead: int, count: int) -> None:
        self.hear(self.model.next + ahead, self.model.next + ahead + count - 1)

    @rule(count=st.integers(1, 16))
    def what_is_missing_comes(self, count: int) -> None:
        first, bitmap = self.ours.missing()
        for bit in [bit for bit in range(16) if bitmap >> bit & 1][:count]:
            self.a_message_comes(bit - (self.model.next - first) % NUMBERS)

    @rule()
    def the_streams_begin_anew(self) -> None:
        self.ours.reset()
        self.model = SpecReceiver(self.model.window)
        self.handed_on.clear()

    def hear(self, first: int, last: int) -> None:
        self.handed_on += self.ours.announce(first % NUMBERS, last % NUMBERS)
        self.take_held()
        self.model.hear(first % NUMBERS, last % NUMBERS)

    def take_held(self) -> None:
        while (octets := self.ours.next_held()) is not None:
            self.handed_on.append(octets)

    @invariant()
    def the_same_has_been_handed_on(self) -> None:
        assert without_repeated_losses(self.handed_on) == without_repeated_losses(self.model.done)

    @invariant()
    def the_same_is_kept_and_reported(self) -> None:
        first, bitmap = self.ours.missing()
        assert self.ours.held == len(self.model.early)
        assert self.model.may_report(first, bitmap), (first, f"{bitmap:b}", self.model)


def without_repeated_losses(done: list[bytes | None]) -> list[bytes | None]:
    """A loss is a loss, however many messages it was."""
    return [one for at, one in enumerate(done) if one is not LOST or at == 0 or done[at - 1] is not LOST]


@cache
def prepared(window: int, start: int) -> tuple[ReliableOutput, Outbox]:
    """A stream that has sent so many messages, all of them acknowledged."""
    counters = SessionCounters()
    outbox = Outbox(8, counters)
    stream = ReliableOutput(
        0x80,
        Envelope(0x81, 1, MTU, pads=False),
        outbox,
        counters,
        window=window,
        round_trip=RoundTrip(),
        pool=Memory(10_000_000),
    )
    for position in range(start):
        stream.send(b"\x07\x01\x00\x00")
        outbox.pull()
        stream.acknowledge((position + 1) % NUMBERS, 0, 0.0)
    return stream, outbox


class SenderMachine(RuleBasedStateMachine):
    """ACKNACKs of a receiver that is right, of one that is confused, and old ones."""

    @initialize(window=st.sampled_from(WINDOWS), start=st.sampled_from((0, 65_530)))
    def begin(self, window: int, start: int) -> None:
        self.ours, self.outbox = copy.deepcopy(prepared(window, start))
        self.model = SpecSender(window, start)
        self.now = 1.0
        self.sent: list[bytes] = []
        self.asked: set[int] = set()
        """Positions that an ACKNACK has asked for and that are not acknowledged."""
        self.asked_for_sure: set[int] = set()
        """Those asked for after a HEARTBEAT that came long after everything else."""
        self.given = 0

    @rule(sizes=st.lists(st.sampled_from([0, 8, 11, 12, 13, 40, 200]), min_size=1, max_size=6))
    def something_is_sent(self, sizes: list[int]) -> None:
        for size in sizes:
            self.given += 1
            body = write_data(self.given, 0x15, bytes(size))
            self.ours.send(body)
            self.model.messages += cut(body, MTU)

    @rule(ahead=st.integers(-20, 20) | st.sampled_from([32_768, -32_768]), bitmap=st.integers(0, 0xFFFF))
    def an_acknack_comes(self, ahead: int, bitmap: int) -> None:
        self.hear((self.model.acked + ahead) % NUMBERS, bitmap)

    @rule(taken=st.integers(0, 16), bitmap=st.integers(0, 0xFFFF))
    def a_right_acknack_comes(self, taken: int, bitmap: int) -> None:
        self.hear(min(self.model.acked + taken, self.model.end) % NUMBERS, bitmap)

    @rule(bitmap=st.integers(1, 0xFFFF))
    def a_heartbeat_is_answered_after_a_silence(self, bitmap: int) -> None:
        self.everything_is_pulled()
        if self.model.end == self.model.acked:
            return
        self.now += 100.0
        told = self.ours.heartbeat(self.now)
        assert (told.first, told.last) == (
            self.model.acked % NUMBERS,
            (self.model.end - 1) % NUMBERS,
        )
        self.asked_for_sure = set(self.hear(self.model.acked % NUMBERS, bitmap))
        self.everything_is_pulled()

    @rule(seconds=st.sampled_from([0.0, 0.0005, 0.01, 1.0]))
    def everything_is_pulled(self, seconds: float = 0.0) -> None:
        self.now += seconds
        again = self.ours.pull_missed(self.now)
        self.sent += self.outbox.pull()
        self.ours.link_drained(self.now, 0.2, 0.005)
        known = {message(0x80, at, self.model.at(at)): at for at in range(self.model.acked, self.model.end)}
        positions = [known[packet] for packet in again]  # octet by octet what was sent at first
        assert len(set(positions)) == len(positions)
        assert set(positions) <= self.asked, (positions, self.asked)
        assert self.asked_for_sure <= set(positions)
        self.asked_for_sure = set()

    def hear(self, first: int, bitmap: int) -> list[int]:
        before = self.model.acked
        asked = self.model.hear(first, bitmap)
        progress = self.ours.acknowledge(first, bitmap, self.now)
        assert bool(progress) == (self.model.acked > before)
        self.asked = {at for at in self.asked | set(asked or ()) if at >= self.model.acked}
        return asked or []

    @invariant()
    def the_window_is_used_to_its_end_and_not_beyond(self) -> None:
        if not hasattr(self, "model"):
            return
        assert self.ours.first_nr == self.model.acked % NUMBERS
        assert self.ours.next_nr == self.model.end % NUMBERS
        assert self.ours.unacked == self.model.end - self.model.acked

    def teardown(self) -> None:
        """Everything is acknowledged in the end, and everything has been sent once and in order."""
        if not hasattr(self, "model"):
            return
        while self.model.end > self.model.acked:
            self.everything_is_pulled()
            self.hear(self.model.end % NUMBERS, 0)
        self.everything_is_pulled()
        start = self.model.start
        assert self.sent == [message(0x80, start + at, one) for at, one in enumerate(self.model.messages)]


class AgentBesideModelMachine(RuleBasedStateMachine):
    """A whole session of our agent, and a client that is nothing but the model; the network does its worst."""

    WRITER, READER = 0x15, 0x16

    @initialize(seed=st.integers(0, 1 << 30), window=st.sampled_from(WINDOWS))
    def begin(self, seed: int, window: int) -> None:
        self.random = Random(seed)
        self.window = window
        self.agent = AgentSession(0xAABBCCDD, 0x81, 60, epoch_ns=lambda: 0)
        self.now = 0.0
        self.loss = self.late = 0.0
        self.start_over()

    def start_over(self) -> None:
        self.sender, self.receiver = SpecSender(self.window), SpecReceiver(64)
        self.written: list[bytes] = []
        self.arrived: list[bytes] = []
        self.given: list[bytes] = []
        self.to_agent: list[bytes] = []
        self.to_client: list[bytes] = []

    @rule(size=st.sampled_from([0, 5, 30, 60, 300]), count=st.integers(1, 6))
    def the_client_writes(self, size: int, count: int) -> None:
        for _ in range(count):
            payload = len(self.written).to_bytes(4, "big") + bytes(size)
            self.written.append(payload)
            before = self.sender.end
            self.sender.messages += cut(write_data(7, self.WRITER, payload), 60)
            self.number(before)

    @rule(size=st.sampled_from([0, 5, 30, 60, 300]), count=st.integers(1, 20))
    def the_agent_sends(self, size: int, count: int) -> None:
        for _ in range(count):
            payload = len(self.given).to_bytes(4, "big") + bytes(size)
            if self.agent.send_data(0x1D, self.READER, payload, 0x80):
                self.given.append(payload)

    @rule(loss=st.sampled_from([0.0, 0.2, 0.6]), late=st.sampled_from([0.0, 0.4]))
    def the_network_changes(self, loss: float, late: float) -> None:
        self.loss, self.late = loss, late

    @rule(seconds=st.sampled_from([0.001, 0.02, 0.3]))
    def time_passes(self, seconds: float) -> None:
        self.now += seconds
        if (at := self.agent.timer()) is not None and at <= self.now:
            self.agent.handle_timer(self.now)
        if self.sender.end > self.sender.acked:
            self.post(self.to_agent, heartbeat(self.sender.acked, self.sender.end - 1, 0x80))
        self.deliver()

    @rule()
    def the_client_resets(self) -> None:
        self.agent.receive_packet(bytes.fromhex("810000000c010000"), self.now)
        self.take_events()
        self.agent.packets_to_send(self.now)
        self.start_over()

    def number(self, before: int) -> None:
        for position in range(before, self.sender.end):
            self.post(self.to_agent, message(0x80, position, self.sender.at(position)))

    def post(self, way: list[bytes], packet: bytes) -> None:
        if self.random.random() >= self.loss:
            way.append(packet)
            if self.random.random() < self.late:
                way.append(packet)

    def deliver(self) -> None:
        """One round trip: what is late stays for the next one."""
        for packet in self.agent.packets_to_send(self.now):
            self.post(self.to_client, packet)
        for packet in self.taken(self.to_client):
            self.client_hears(packet)
        for packet in self.taken(self.to_agent):
            self.agent.receive_packet(packet, self.now)
            self.take_events()
        for packet in self.agent.packets_to_send(self.now):
            self.post(self.to_client, packet)

    def taken(self, way: list[bytes]) -> list[bytes]:
        now: list[bytes] = []
        later: list[bytes] = []
        for packet in way:
            (later if self.random.random() < self.late / 2 else now).append(packet)
        if self.late:
            self.random.shuffle(now)
        way[:] = later
        return now

    def client_hears(self, packet: bytes) -> None:
        for one in read(packet):
            if one.kind == 0x0A and one.body[4] == 0x80:
                before = self.sender.end
                first, bitmap = int.from_bytes(one.body[:2], "little"), int.from_bytes(one.body[2:4], "big")
                for position in self.sender.hear(first, bitmap) or ():
                    self.post(self.to_agent, message(0x80, position, self.sender.at(position)))
                self.number(before)
            elif one.kind == 0x0B and one.body[4] == 0x80:
                first, last = int.from_bytes(one.body[:2], "little"), int.from_bytes(one.body[2:4], "little")
                self.receiver.hear(first, last)
                self.post(self.to_agent, acknack(*self.receiver.report(), 0x80))
        stream, number = packet[1], int.from_bytes(packet[2:4], "little")
        if stream == 0x80:
            self.receiver.take(number, packet[4:])
            self.post(self.to_agent, acknack(*self.receiver.report(), 0x80))

    def take_events(self) -> None:
        while (event := self.agent.next_event()) is not None:
            if isinstance(event, DataWritten):
                self.arrived.append(event.payload)

    def received(self) -> list[bytes]:
        """The samples in what the model was handed: FRAGMENTs are put together, several samples taken apart."""
        whole, pieces = [], b""
        for body in self.receiver.done:
            assert body is not LOST
            for one in read(b"\x81\x80\0\0" + body):
                if one.kind == 0x0D:
                    pieces += one.body
                    if not one.flags & 0x02:
                        continue
                    whole += [inner.body[4:] for inner in read(b"\x81\x80\0\0" + pieces) if inner.kind == 0x09]
                    pieces = b""
                elif one.kind == 0x09:
                    whole.append(one.body[4:])
        return whole

    @invariant()
    def what_has_come_is_a_beginning_of_what_was_sent(self) -> None:
        if hasattr(self, "agent"):
            assert self.arrived == self.written[: len(self.arrived)]
            received = self.received()
            assert received == self.given[: len(received)]

    def teardown(self) -> None:
        """Once the network is well, everything arrives."""
        if not hasattr(self, "agent"):
            return
        self.loss = self.late = 0.0
        for _ in range(400):
            if self.arrived == self.written and self.received() == self.given and not self.to_agent:
                break
            self.time_passes(0.3)
        assert self.arrived == self.written
        assert self.received() == self.given


for _machine in (ReceiverMachine, SenderMachine, AgentBesideModelMachine):
    _machine.TestCase.settings = settings(deadline=None, stateful_step_count=30)
TestReceiver = ReceiverMachine.TestCase
TestSender = SenderMachine.TestCase
TestAgentBesideModel = AgentBesideModelMachine.TestCase
