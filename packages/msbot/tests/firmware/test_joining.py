"""Joining: the firmware's link and MsBOT's own `ComponentJoin` get the same frames at the same times."""

from __future__ import annotations

from random import Random

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from tests.effort import tries
from tests.firmware.msbot_side import (
    CAN_FD,
    COMPRESSION,
    AddressLost,
    Assign,
    Beacon,
    CanIds,
    ComponentEvent,
    ComponentJoin,
    ComponentState,
    Frame,
    Joined,
    assign_frame,
    beacon_frame,
    crc32,
    stop_frame,
)
from tests.firmware.pipe import Firmware, frame_octets

IDS = CanIds()
UID = bytes(range(1, 9))
OTHER = bytes(range(11, 19))
SEED = 12345
ROBOT = 0xCAFE
CLOSE_US = 20
"""The two round their pauses differently."""

STATES = (ComponentState.OFF, ComponentState.JOINING, ComponentState.JOINED, ComponentState.FOREIGN)
DOWN, UP, STOP = 1, 2, 4
REASONS = {
    "no beacon of the master for 3.5 s": 2,
    "the master has restarted": 3,
    "the robot's profile has changed": 4,
    "the master has given the address to another part": 5,
    "the master has no free address: all 120 are held by live parts": 6,
    "this bus belongs to another robot": 7,
}


class FirmwaresRandom(Random):
    """Draws what the firmware draws (xorshift32)."""

    def __init__(self) -> None:
        super().__init__()
        self._state = crc32(UID) ^ SEED

    def random(self) -> float:
        x = self._state
        x ^= x << 13 & 0xFFFFFFFF
        x ^= x >> 17
        x ^= x << 5 & 0xFFFFFFFF
        self._state = x
        return (x >> 16) / 65536


class JoiningMachine(RuleBasedStateMachine):
    """Both hear and see the same."""

    firmware: Firmware

    @initialize(robot=st.sampled_from((None, ROBOT)), codec=st.booleans(), fd=st.booleans(), clock=st.integers(0, 2))
    def power_up(self, robot: int | None, codec: bool, fd: bool, clock: int) -> None:
        caps = CAN_FD * fd | COMPRESSION * codec
        self.clock_us = (0, 2**31 - 5_000_000, 2**32 - 5_000_000)[clock]
        self.now_us = 0
        self.join = ComponentJoin(UID, random=FirmwaresRandom(), caps=caps, profile_hash=robot, ids=IDS)
        self.firmware.make_link(UID, codec=codec, fd=fd, robot=robot, seed=SEED)
        self.start()

    @property
    def stamp(self) -> bytes:
        return (self.clock_us + self.now_us & 0xFFFFFFFF).to_bytes(4, "little")

    def compare(self, *request: bytes, event: ComponentEvent | None = None) -> None:
        if request:
            self.firmware.ask(*request)
        state = self.firmware.state()
        assert STATES[state.state] is self.join.state
        assert state.node_id == self.join.node_id
        match event:
            case Joined():
                assert state.events & UP
                assert state.use == event.use
            case AddressLost():
                assert state.events == DOWN
                assert state.reason == REASONS[event.reason.partition(" (")[0]]
            case None:
                assert not state.events & (UP | DOWN)
        sent = self.join.take_frames()
        frames = []
        while (frame := self.firmware.next_frame()) is not None:
            frames.append(frame)
        assert frames == sent
        due = self.join.timer()
        assert (state.due_us is None) == (due is None)
        if due is not None and state.due_us is not None:
            mine = (state.due_us - self.clock_us - self.now_us + 2**31) % 2**32 - 2**31 + self.now_us
            assert abs(mine - due * 1e6) < CLOSE_US

    @rule()
    def start(self) -> None:
        self.join.start(self.now_us / 1e6)
        self.compare(b"s")

    @rule()
    def leave_the_bus(self) -> None:
        self.join.stop()
        self.firmware.ask(b"o")
        assert self.firmware.state().events == DOWN
        self.compare()

    @rule(pause_us=st.sampled_from((100, 5_000, 9_000, 12_000, 25_000, 300_000, 999_000, 2_500_000, 3_499_000)))
    def wait(self, pause_us: int) -> None:
        self.now_us += pause_us
        due = self.join.timer()
        if due is not None and abs(due * 1e6 - self.now_us) < 2 * CLOSE_US:
            self.now_us += 4 * CLOSE_US
        event = self.join.handle_timer(self.now_us / 1e6)
        self.compare(b"t" + self.stamp, event=event)

    @rule()
    def wait_until_due(self) -> None:
        due = self.join.timer()
        if due is not None:
            self.now_us = max(self.now_us, round(due * 1e6) + CLOSE_US)
            self.compare(b"t" + self.stamp, event=self.join.handle_timer(self.now_us / 1e6))

    @rule(before_us=st.sampled_from((12_600, 12_400, 5_000, 1_000)), epoch=st.integers(20, 30))
    def hear_a_new_master_shortly_before_due(self, before_us: int, epoch: int) -> None:
        due = self.join.timer()
        if due is not None:
            self.now_us = max(self.now_us, round(due * 1e6) - before_us)
            self.hear(beacon_frame(Beacon(3, epoch, ROBOT), IDS))

    @rule()
    def frames_have_left(self) -> None:
        self.join.sent(self.now_us / 1e6)
        self.compare(b"r" + self.stamp)

    def hear(self, frame: Frame) -> None:
        event = self.join.receive(frame, self.now_us / 1e6)
        self.compare(b"f" + self.stamp + frame_octets(frame), event=event)

    @rule(epoch=st.sampled_from((0, 7, 16383)), robot=st.sampled_from((ROBOT, ROBOT, ROBOT + 1)))
    def hear_beacon(self, epoch: int, robot: int) -> None:
        self.hear(beacon_frame(Beacon(3, epoch, robot), IDS))

    @rule(
        uid=st.sampled_from((UID, UID, OTHER, bytes(8))),
        node_id=st.sampled_from((0, 1, 120, 121)),
        epoch=st.sampled_from((0, 7, 16383)),
        use=st.integers(0, 3),
    )
    def hear_assign(self, uid: bytes, node_id: int, epoch: int, use: int) -> None:
        self.hear(assign_frame(Assign(uid, node_id, epoch, use), IDS))

    @rule(
        can_id=st.sampled_from((0x700, 0x101, 0x1E000001, 0x02000001, 0x03000001)),
        data=st.binary(max_size=8) | st.just(UID),
        extended=st.booleans(),
        remote=st.booleans(),
        fd=st.booleans(),
    )
    def hear_something(self, can_id: int, data: bytes, extended: bool, remote: bool, fd: bool) -> None:
        if can_id < 0x800 or extended:
            self.hear(Frame(can_id, b"" if remote else data, extended, fd and not remote, remote=remote))

    @rule(reason=st.integers(0, 2))
    def hear_stop(self, reason: int) -> None:
        self.firmware.ask(*3 * (b"f" + self.stamp + frame_octets(stop_frame(reason, IDS)),))
        assert self.firmware.state().events in (STOP, 0), "three frames are one STOP"

    @invariant()
    def nothing_was_dropped(self) -> None:
        if hasattr(self, "join"):
            assert self.firmware.link_drops() == {}


def test_the_firmware_joins_as_msbot_does(firmware: Firmware) -> None:
    machine = type("Machine", (JoiningMachine,), {"firmware": firmware})
    run_state_machine_as_test(
        machine, settings=settings(max_examples=tries(60, 2000), stateful_step_count=40, deadline=None)
    )


def test_stop_goes_before_all_other_frames_three_times(firmware: Firmware) -> None:
    firmware.make_link(UID)
    firmware.ask(b"s", b"p" + bytes((2,)))
    for _ in range(3):
        assert firmware.next_frame(pending=2) == stop_frame(2, IDS)
    join = firmware.next_frame(pending=2)
    assert join is not None
    assert join.extended
    assert firmware.next_frame() is None


def test_at_most_two_frames_of_packets_are_in_the_controller(firmware: Firmware) -> None:
    firmware.make_link(UID)
    joined = assign_frame(Assign(UID, 5, 1, 0), IDS)
    firmware.ask(b"s", b"n\0", b"f" + bytes(4) + frame_octets(joined))
    (taken,) = firmware.ask(b"w" + b"a message of more than one frame")
    assert taken == b"\1"
    assert firmware.ask(b"w" + b"another") == [b"\0"], "one packet at a time"
    assert firmware.next_frame(pending=2) is None
    first = firmware.next_frame(pending=1)
    assert first == Frame(0x105, b"\x80a messa")
