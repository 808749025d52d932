"""The master's side of joining, with literal times."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import (
    CAN_FD,
    NOBODY,
    NODES,
    STARTING,
    Assign,
    Beacon,
    MemoryNodeIds,
    beacon_frame,
    join_frame,
    question_frame,
    read_assign,
    read_beacon,
)
from msbot_agent.link.can.protocol.join_master import (
    LISTEN_S,
    REPEAT_S,
    UNPROVEN_S,
    MasterJoin,
    NodeEvicted,
    NodeJoined,
    NodeRefused,
    OtherMaster,
)
from tests.effort import tries
from tests.link.joining import HASH, IDS, UID, any_frame, beacon, uid


def master(node_ids: MemoryNodeIds | None = None, *, seed: int = 1, caps: int = 0) -> MasterJoin:
    join = MasterJoin(node_ids or MemoryNodeIds(), profile_hash=HASH, random=Random(seed), caps=caps)
    join.start(-LISTEN_S)
    listen(join, -LISTEN_S)
    join.take_frames()
    join.sent(0.0)
    return join


def listen(join: MasterJoin, now: float) -> None:
    """It asks whether it is alone, and nobody answers: its first beacon is ready."""
    assert join.take_frames() == [question_frame(HASH, IDS)]
    assert join.is_listening
    join.sent(now)
    due = join.timer()
    assert due == now + LISTEN_S
    join.handle_timer(due)
    assert not join.is_listening


def answer(join: MasterJoin) -> Assign:
    (frame,) = join.take_frames()
    read = read_assign(frame, IDS)
    assert read is not None
    return read


def test_a_master_says_beacon_at_once_and_each_second() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1), caps=CAN_FD)
    join.start(10.0 - LISTEN_S)
    listen(join, 10.0 - LISTEN_S)
    (frame,) = join.take_frames()
    assert read_beacon(frame, IDS) == Beacon(CAN_FD | STARTING, join.epoch, HASH)
    join.sent(10.0)
    assert join.timer() == 11.0
    join.handle_timer(10.9)
    assert join.take_frames() == []
    join.handle_timer(11.0)
    assert join.take_frames() == [frame]
    assert join.timer() == 12.0
    join.handle_timer(12.0)
    assert read_beacon(join.take_frames()[0], IDS) == Beacon(CAN_FD, join.epoch, HASH)


def test_a_master_that_starts_says_nothing_to_parts_before_it_knows_that_it_is_alone() -> None:
    running, second = master(seed=2), MasterJoin(MemoryNodeIds(), profile_hash=HASH + 1, random=Random(3))
    second.start(10.0)
    (question,) = second.take_frames()
    second.sent(10.0)
    assert second.receive(join_frame(UID, 0, IDS), 10.0) == []
    second.stranger(7, 10.0)
    assert second.take_frames() == []
    assert running.receive(question, 10.0) == [OtherMaster(HASH + 1, fatal=False)]
    (answer,) = running.take_frames()
    assert second.receive(answer, 10.01) == [OtherMaster(HASH, fatal=True)]
    assert second.take_frames() == []
    running.receive(question, 10.0 + REPEAT_S / 2)
    assert running.take_frames() == [], "questions without end get no answers without end"


def test_a_master_that_has_just_said_its_first_beacon_answers_as_one_that_was_there() -> None:
    join = master()
    assert join.receive(question_frame(HASH + 1, IDS), 0.1) == [OtherMaster(HASH + 1, fatal=False)]
    (frame,) = join.take_frames()
    assert read_beacon(frame, IDS) == Beacon(0, join.epoch, HASH)


def test_a_question_that_nobody_acknowledges_says_that_nobody_is_there() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1))
    join.start(0.0)
    join.take_frames()
    assert join.timer() == LISTEN_S
    join.handle_timer(LISTEN_S)
    assert not join.is_listening
    assert join.take_frames() == [beacon_frame(Beacon(STARTING, join.epoch, HASH), IDS)]


def test_of_two_that_listen_at_once_none_answers() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1))
    join.start(0.0)
    join.take_frames()
    assert join.receive(question_frame(HASH + 1, IDS), 0.1) == []
    assert join.take_frames() == []


def test_a_master_that_comes_back_on_the_bus_before_it_has_an_answer_asks_again() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1))
    join.start(0.0)
    join.take_frames()
    join.resume(3.0)
    listen(join, 3.1)


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
    assert read_beacon(frame, IDS) == Beacon(STARTING, epoch, HASH)
    assert list(join.members) == [1]


def test_a_part_gets_the_same_address_again_also_from_the_next_master() -> None:
    node_ids = MemoryNodeIds()
    join = master(node_ids, caps=CAN_FD)
    assert join.receive(join_frame(uid(1), 3, IDS), 0.1) == [NodeJoined(1, uid(1), CAN_FD)]
    assert answer(join) == Assign(uid(1), 1, join.epoch, CAN_FD)
    assert join.receive(join_frame(uid(2), 0, IDS), 0.2) == [NodeJoined(2, uid(2), 0)]
    join.take_frames()
    join.claim_address(1)
    join.claim_address(2)
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
    join.claim_address(1)
    assert join.receive(frame, 5.0) == [NodeJoined(1, UID, 0)]


def full_house(join: MasterJoin, now: float) -> None:
    for number in range(1, NODES + 1):
        join.receive(join_frame(uid(number), 0, IDS), now)
        join.claim_address(number)
    join.take_frames()


def test_a_flood_of_joins_never_keeps_a_known_part_without_its_address() -> None:
    node_ids = MemoryNodeIds()
    full_house(master(node_ids), 1.0)
    join = master(node_ids, seed=2)
    known = range(1, NODES + 1)
    for number in range(5000):
        now = 20.0 + number / 1000
        join.receive(join_frame(uid(1_000_000 + number), 0, IDS), now)
        if number % 40 == 0:
            part = known[number // 40 % NODES]
            events = join.receive(join_frame(uid(part), 0, IDS), now)
            assert events[-1] == NodeJoined(part, uid(part), 0)
            join.claim_address(part)
        join.take_frames()
    assert [node_ids.find(uid(part)) for part in known] == list(known)


def test_newcomers_that_say_nothing_make_room_for_each_other_and_one_that_speaks_stays() -> None:
    join = master()
    assert join.receive(join_frame(UID, 0, IDS), 0.0) == [NodeJoined(1, UID, 0)]
    join.claim_address(1)
    for number in range(2, NODES + 1):
        join.receive(join_frame(uid(number), 0, IDS), 0.0)
    assert join.receive(join_frame(uid(200), 0, IDS), 0.5) == [NodeRefused(uid(200))]
    assert join.receive(join_frame(uid(200), 0, IDS), 1.5) == [NodeEvicted(2, uid(2)), NodeJoined(2, uid(200), 0)]
    assert join.members[1].uid == UID


def test_a_newcomer_that_only_asks_again_and_again_makes_room_as_well() -> None:
    join = master(caps=CAN_FD)
    for number in range(1, NODES + 1):
        join.receive(join_frame(uid(number), 0, IDS), 0.0)
    for number in range(1, NODES + 1):  # some ask as they did, some offer something else
        join.receive(join_frame(uid(number), number & CAN_FD, IDS), 0.9)
    assert join.receive(join_frame(UID, 0, IDS), 0.95) == [NodeRefused(UID)]
    assert join.receive(join_frame(UID, 0, IDS), 1.1) == [NodeEvicted(1, uid(1)), NodeJoined(1, UID, 0)]


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
    join.claim_address(40)
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


def test_a_master_that_nobody_has_heard_yet_gives_way_however_long_it_waits() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1))
    join.start(0.0)
    assert join.receive(beacon(profile_hash=0x1234), 60.0) == [OtherMaster(0x1234, fatal=True)]


def starting(epoch: int, profile_hash: int = HASH) -> Frame:
    return beacon_frame(Beacon(STARTING, epoch, profile_hash), IDS)


@pytest.mark.parametrize("smaller", [False, True])
def test_of_two_that_start_at_once_the_one_with_the_smaller_number_stays_and_says_so(smaller: bool) -> None:
    join = master()
    other = join.epoch - 1 if smaller else join.epoch + 1
    assert join.receive(starting(other), 0.05) == [OtherMaster(HASH, fatal=smaller, at_once=smaller)]
    assert len(join.take_frames()) == (0 if smaller else 1)


def test_who_was_there_before_stays_whatever_the_numbers_say() -> None:
    join = master()
    assert join.receive(starting(0), 0.5) == [OtherMaster(HASH, fatal=False)]
    (frame,) = join.take_frames()
    assert read_beacon(frame, IDS) == Beacon(0, join.epoch, HASH), "no longer one that starts: the other one ends"


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


@settings(max_examples=tries(50, 2000))
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
                assert now - before[event.node_id][1] > UNPROVEN_S
            elif isinstance(event, NodeJoined):
                assert 1 <= event.node_id <= NODES
                assert join.members[event.node_id].uid == event.uid
        uids = [member.uid for member in join.members.values()]
        assert len(set(uids)) == len(uids)
        join.take_frames()
