"""Joining: both state machines, with literal times."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.errors import LocalProtocolError
from msbot.link.can_frames import Frame
from msbot.link.can_ids import (
    CAN_FD,
    COMPRESSION,
    NOBODY,
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
)
from msbot.link.can_join import (
    AddressLost,
    ComponentJoin,
    ComponentState,
    Joined,
    MasterJoin,
    NodeEvicted,
    NodeJoined,
    NodeRefused,
    OtherMaster,
)
from msbot.link.can_nodes import MemoryNodeIds

IDS = CanIds()
HASH = 0xCAFE
UID = bytes(range(1, 9))


def uid(number: int) -> bytes:
    return b"part" + number.to_bytes(4, "big")


def part(profile_hash: int | None = None, caps: int = 0) -> ComponentJoin:
    return ComponentJoin(UID, random=Random(1), caps=caps, profile_hash=profile_hash)


def assign(node_id: int, *, epoch: int = 5, to: bytes = UID, use: int = 0) -> Frame:
    return assign_frame(Assign(to, node_id, epoch, use), IDS)


def beacon(epoch: int = 5, profile_hash: int = HASH) -> Frame:
    return beacon_frame(Beacon(0, epoch, profile_hash), IDS)


def joined_part(profile_hash: int | None = None) -> ComponentJoin:
    join = part(profile_hash)
    join.start(0.0)
    join.take_frames()
    join.sent(0.001)
    assert join.receive(assign(7), 0.002) == Joined(7, 0)
    return join


def test_power_up_says_join_at_once() -> None:
    join = part(caps=CAN_FD)
    assert join.timer() is None
    join.start(0.0)
    assert join.take_frames() == [join_frame(UID, CAN_FD, IDS)]
    assert join.take_frames() == []


def test_join_is_repeated_with_doubling_pauses_and_jitter_at_most_1_s() -> None:
    join = part()
    join.start(0.0)
    now, pauses = 0.0, []
    for _ in range(12):
        assert len(join.take_frames()) == 1
        assert join.timer() is None, "the pause begins when the JOIN has left"
        assert join.sent(now)
        assert not join.sent(now)
        due = join.timer()
        assert due is not None
        pauses.append(due - now)
        join.handle_timer(due - 0.0001)
        assert join.take_frames() == []
        now = due
        join.handle_timer(now)
    for pause, plain in zip(pauses, [0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 0.8, 0.8, 0.8, 0.8, 0.8], strict=True):
        assert 0.75 * plain <= pause <= 1.25 * plain
    assert max(pauses) <= 1.0
    assert len(set(pauses)) == len(pauses), "jitter"


def test_an_address_ends_the_asking_and_what_both_can_is_used() -> None:
    join = part(caps=CAN_FD | COMPRESSION)
    join.start(0.0)
    join.take_frames()
    join.sent(0.001)
    assert join.receive(assign(9, to=uid(1)), 0.002) is None
    assert join.receive(assign(9, use=CAN_FD), 0.002) == Joined(9, CAN_FD)
    assert (join.state, join.node_id, join.take_frames()) == (ComponentState.JOINED, 9, [])
    assert join.timer() == pytest.approx(3.502)
    assert join.receive(assign(9, use=CAN_FD), 0.003) is None, "the answer to a repeated JOIN"


def test_no_beacon_for_3_5_s_loses_the_master_and_joining_begins_anew() -> None:
    join = joined_part()
    for second in range(5):
        assert join.receive(beacon(), float(second)) is None
    assert join.timer() == pytest.approx(7.5)
    assert join.handle_timer(7.4) is None
    lost = join.handle_timer(7.5)
    assert isinstance(lost, AddressLost)
    assert "no beacon" in lost.reason
    assert (join.state, join.node_id) == (ComponentState.JOINING, 0)
    assert join.take_frames() == [join_frame(UID, 0, IDS)]


def test_another_epoch_means_joining_again_at_once() -> None:
    join = joined_part()
    assert join.receive(beacon(epoch=5), 1.0) is None
    assert join.receive(beacon(epoch=6), 2.0) == AddressLost("the master has started anew")
    assert join.take_frames() == [join_frame(UID, 0, IDS)]
    assert join.receive(assign(7, epoch=6), 2.001) == Joined(7, 0)
    assert join.receive(beacon(epoch=6), 3.0) is None


def test_the_first_beacon_of_a_master_ends_a_long_pause() -> None:
    join = part()
    join.start(0.0)
    for now in (0.0, 0.02, 0.05):
        join.take_frames()
        join.sent(now)
        join.handle_timer(now + 0.02)
    join.take_frames()
    join.receive(beacon(), 0.06)
    assert len(join.take_frames()) == 1
    join.sent(0.061)
    join.receive(beacon(), 1.06)
    assert join.take_frames() == [], "the next beacon of the same epoch changes nothing"


def test_a_part_of_one_robot_is_silent_on_the_bus_of_another() -> None:
    join = part(HASH)
    join.start(0.0)
    join.take_frames()
    lost = join.receive(beacon(profile_hash=1), 0.1)
    assert isinstance(lost, AddressLost)
    assert "another robot (profile hash 00000001)" in lost.reason
    assert join.receive(beacon(profile_hash=1), 1.1) is None
    assert join.receive(assign(3), 1.2) is None
    assert join.take_frames() == []
    assert not join.sent(1.2)
    assert join.timer() == pytest.approx(4.6)
    assert join.state is ComponentState.FOREIGN
    join.receive(beacon(epoch=9), 1.3)
    assert len(join.take_frames()) == 1


def test_when_the_other_robots_master_is_gone_the_part_asks_again() -> None:
    join = part(HASH)
    join.start(0.0)
    join.receive(beacon(profile_hash=1), 0.1)
    assert join.handle_timer(3.6) is None
    assert join.state is ComponentState.JOINING
    assert len(join.take_frames()) == 1


def test_an_address_of_the_wrong_robot_is_given_up_but_not_for_a_second_master() -> None:
    join = joined_part(HASH)
    assert join.receive(beacon(epoch=6, profile_hash=1), 0.1) is None, "another master beside our own"
    assert join.state is ComponentState.JOINED
    assert isinstance(join.receive(beacon(epoch=5, profile_hash=1), 0.2), AddressLost)
    assert (join.state, join.node_id) == (ComponentState.FOREIGN, 0)


def test_a_part_made_for_any_robot_takes_every_beacon() -> None:
    join = joined_part(None)
    assert join.receive(beacon(profile_hash=1), 1.0) is None
    assert join.timer() == pytest.approx(4.5)


@pytest.mark.parametrize("to", [uid(3), NOBODY])
def test_an_address_given_to_another_part_or_taken_back_is_lost(to: bytes) -> None:
    join = joined_part()
    assert join.receive(assign(8, to=to), 0.5) is None
    lost = join.receive(assign(7, to=to), 0.6)
    assert isinstance(lost, AddressLost)
    assert len(join.take_frames()) == 1


def test_a_refusal_is_told_once_and_the_part_asks_once_a_second() -> None:
    join = part()
    join.start(0.0)
    join.take_frames()
    join.sent(0.0)
    lost = join.receive(assign(0), 0.001)
    assert isinstance(lost, AddressLost)
    assert "no free address" in lost.reason
    due = join.timer()
    assert due is not None
    join.handle_timer(due)
    join.take_frames()
    join.sent(due)
    assert join.receive(assign(0), due) is None
    later = join.timer()
    assert later is not None
    assert 0.6 <= later - due <= 1.0
    assert join.receive(assign(4), due + 0.1) == Joined(4, 0)


def test_a_stopped_part_is_silent() -> None:
    join = joined_part()
    join.stop()
    assert (join.node_id, join.timer(), join.take_frames()) == (0, None, [])
    assert join.receive(beacon(epoch=9), 1.0) is None
    assert join.receive(assign(3), 1.0) is None
    assert join.handle_timer(9.0) is None
    join.start(2.0)
    assert len(join.take_frames()) == 1


def test_a_part_needs_a_uid() -> None:
    with pytest.raises(LocalProtocolError):
        ComponentJoin(b"short", random=Random(1))


# The master


def master(node_ids: MemoryNodeIds | None = None, *, seed: int = 1, caps: int = 0) -> MasterJoin:
    join = MasterJoin(node_ids or MemoryNodeIds(), profile_hash=HASH, random=Random(seed), caps=caps)
    join.start(0.0)
    join.take_frames()
    return join


def answer(join: MasterJoin) -> Assign:
    (frame,) = join.take_frames()
    read = read_assign(frame, IDS)
    assert read is not None
    return read


def test_a_master_says_beacon_at_once_and_each_second() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1), caps=CAN_FD)
    join.start(10.0)
    (frame,) = join.take_frames()
    assert read_beacon(frame, IDS) == Beacon(CAN_FD, join.epoch, HASH)
    assert join.timer() == 11.0
    join.handle_timer(10.9)
    assert join.take_frames() == []
    join.handle_timer(11.0)
    assert join.take_frames() == [frame]
    assert join.timer() == 12.0


def test_epochs_differ_between_starts() -> None:
    join = master()
    first = join.epoch
    join.receive(join_frame(UID, 0, IDS), 0.1)
    join.start(5.0)
    assert join.epoch != first
    assert join.members == {}


def test_going_on_after_a_time_off_the_bus_keeps_the_epoch() -> None:
    join = master()
    join.receive(join_frame(UID, 0, IDS), 0.1)
    epoch = join.epoch
    join.take_frames()
    join.resume(0.7)
    (frame,) = join.take_frames()
    assert read_beacon(frame, IDS) == Beacon(0, epoch, HASH)
    assert list(join.members) == [1]


def test_a_part_gets_the_same_address_again_also_from_the_next_master() -> None:
    node_ids = MemoryNodeIds()
    join = master(node_ids, caps=CAN_FD)
    assert join.receive(join_frame(uid(1), 3, IDS), 0.1) == [NodeJoined(1, uid(1), CAN_FD)]
    assert answer(join) == Assign(uid(1), 1, join.epoch, CAN_FD)
    assert join.receive(join_frame(uid(2), 0, IDS), 0.2) == [NodeJoined(2, uid(2), 0)]
    join.take_frames()
    following = master(node_ids, seed=2)
    assert following.receive(join_frame(uid(2), 0, IDS), 0.1) == [NodeJoined(2, uid(2), 0)]
    assert following.receive(join_frame(uid(1), 0, IDS), 0.1) == [NodeJoined(1, uid(1), 0)]
    assert following.receive(join_frame(uid(3), 0, IDS), 0.1) == [NodeJoined(3, uid(3), 0)]


def test_a_repeated_join_is_answered_again_but_only_a_restart_is_an_event() -> None:
    join = master()
    frame = join_frame(UID, 0, IDS)
    assert join.receive(frame, 0.1) == [NodeJoined(1, UID, 0)]
    assert join.receive(frame, 0.11) == []
    assert len(join.take_frames()) == 2
    join.members[1].spoke = True
    assert join.receive(frame, 5.0) == [NodeJoined(1, UID, 0)]


def full_house(join: MasterJoin, now: float) -> None:
    for number in range(1, NODES + 1):
        join.receive(join_frame(uid(number), 0, IDS), now)
    join.take_frames()


def test_when_120_live_parts_hold_all_addresses_the_next_is_refused() -> None:
    join = master()
    full_house(join, 1.0)
    assert sorted(join.members) == list(range(1, 121))
    assert join.receive(join_frame(UID, 3, IDS), 2.0) == [NodeRefused(UID)]
    assert answer(join) == Assign(UID, 0, join.epoch, 0)


def test_the_part_silent_for_longest_loses_its_address_to_a_newcomer() -> None:
    join = master()
    full_house(join, 1.0)
    for node_id, member in join.members.items():
        member.heard_at = 30.0
        if node_id in (40, 50, 60):
            member.heard_at = node_id / 10.0
    assert join.receive(join_frame(UID, 0, IDS), 30.0) == [NodeEvicted(40, uid(40)), NodeJoined(40, UID, 0)]
    assert answer(join).node_id == 40
    assert join.receive(join_frame(uid(40), 0, IDS), 30.1) == [NodeEvicted(50, uid(50)), NodeJoined(50, uid(40), 0)]


def test_addresses_of_parts_not_seen_since_the_start_go_first_the_oldest_first() -> None:
    node_ids = MemoryNodeIds()
    full_house(master(node_ids), 1.0)
    join = master(node_ids, seed=2)
    for number in (1, 2, 4):
        join.receive(join_frame(uid(number), 0, IDS), 0.1)
    assert join.receive(join_frame(UID, 0, IDS), 0.2) == [NodeJoined(3, UID, 0)]


def test_another_master_stops_a_starting_one_and_is_answered_by_a_running_one() -> None:
    join = master()
    assert join.receive(beacon(profile_hash=0x1234), 1.4) == [OtherMaster(0x1234, fatal=True)]
    assert join.receive(beacon(profile_hash=0x1234), 1.6) == [OtherMaster(0x1234, fatal=False)]
    assert len(join.take_frames()) == 1
    assert join.receive(beacon(profile_hash=0x1234), 1.65) == [OtherMaster(0x1234, fatal=False)]
    assert join.take_frames() == [], "two masters do not answer each other without end"


def test_a_stranger_is_told_to_join_again_but_not_for_each_frame() -> None:
    join = master()
    join.stranger(9, 1.0)
    join.stranger(9, 1.05)
    join.stranger(8, 1.05)
    assert [read_assign(frame, IDS) for frame in join.take_frames()] == [
        Assign(NOBODY, 9, join.epoch, 0),
        Assign(NOBODY, 8, join.epoch, 0),
    ]
    join.stranger(9, 1.2)
    assert len(join.take_frames()) == 1


any_frame = st.one_of(
    st.builds(Frame, st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.booleans(), st.booleans()),
    st.builds(lambda n, caps: join_frame(uid(n), caps, IDS), st.integers(1, 200), st.integers(0, 3)),
    st.builds(
        lambda n, e, to: assign(n, epoch=e, to=to),
        st.integers(0, 120),
        st.integers(0, 9),
        st.sampled_from([UID, uid(1)]),
    ),
    st.builds(beacon, st.integers(0, 9), st.sampled_from([HASH, 1])),
)


@given(st.lists(st.tuples(st.floats(0, 3), any_frame), max_size=40), st.sampled_from([None, HASH]))
def test_a_part_bears_any_frames_in_any_order(story: list[tuple[float, Frame]], profile_hash: int | None) -> None:
    join = part(profile_hash, caps=3)
    join.start(0.0)
    now = 0.0
    for pause, frame in story:
        now += pause
        join.receive(frame, now)
        join.handle_timer(now)
        assert all(read_join(sent, IDS) == (UID, 3) for sent in join.take_frames())
        join.sent(now)
        assert (join.node_id > 0) == (join.state is ComponentState.JOINED)
        assert join.state is ComponentState.JOINED or join.timer() is not None, "it never gives up"


@settings(max_examples=50)
@given(st.lists(st.tuples(st.floats(0, 5), any_frame), max_size=300))
def test_a_master_never_gives_one_address_to_two_live_parts(story: list[tuple[float, Frame]]) -> None:
    node_ids = MemoryNodeIds()
    join = master(node_ids)
    now = 0.0
    for pause, frame in story:
        now += pause / 20
        before = {node_id: (member.uid, member.heard_at) for node_id, member in join.members.items()}
        for event in join.receive(frame, now):
            if isinstance(event, NodeEvicted):
                assert now - before[event.node_id][1] > 10.0
            elif isinstance(event, NodeJoined):
                assert 1 <= event.node_id <= NODES
                assert node_ids.find(event.uid) == event.node_id
        uids = [member.uid for member in join.members.values()]
        assert len(set(uids)) == len(uids)
        join.take_frames()
