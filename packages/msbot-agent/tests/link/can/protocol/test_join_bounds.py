"""The moments of docs/reference/can.md, "Joining" and "Two masters": just before, at, and just after each."""

from __future__ import annotations

from random import Random

import pytest

from msbot_agent.link.can.protocol.ids import (
    NODES,
    STARTING,
    Beacon,
    MemoryNodeIds,
    beacon_frame,
    join_frame,
    question_frame,
    read_assign,
    read_beacon,
)
from msbot_agent.link.can.protocol.join_master import MasterJoin, NodeEvicted, NodeJoined, NodeRefused, OtherMaster
from msbot_agent.link.can.protocol.join_part import ComponentJoin, ComponentState
from tests.link.joining import HASH, IDS, UID, assign, beacon, uid

BASE = 64.0
"""When all begins: a power of two, so that sums of quarters are exact."""


def beacons(join: MasterJoin) -> list[Beacon]:
    read = [read_beacon(frame, IDS) for frame in join.take_frames()]
    return [one for one in read if one is not None]


def master(node_ids: MemoryNodeIds | None = None, *, sent_at: float = BASE) -> MasterJoin:
    """It is alone, and its first beacon left the controller then."""
    join = MasterJoin(node_ids or MemoryNodeIds(), profile_hash=HASH, random=Random(1))
    join.start(sent_at - 0.25)
    assert join.sent(sent_at - 0.25)
    due = join.timer()
    assert due is not None
    join.handle_timer(due)
    assert [one.flags for one in beacons(join)] == [STARTING]
    assert not join.sent(sent_at)
    return join


def test_what_leaves_the_controller_moves_the_timer_once() -> None:
    join = MasterJoin(MemoryNodeIds(), profile_hash=HASH, random=Random(1))
    join.start(0.0)
    assert join.take_frames() == [question_frame(HASH, IDS)]
    assert join.sent(0.5) is True
    assert (join.timer(), join.is_listening) == (0.7, True)
    assert join.sent(0.6) is False, "the question had left before"
    assert (join.timer(), join.is_listening) == (0.7, True)
    join.handle_timer(0.7)
    assert [one.flags for one in beacons(join)] == [STARTING]
    assert join.sent(1.0) is False
    assert join.sent(2.0) is False
    assert join.timer() == 1.7
    for now, flags in ((1.7, STARTING), (2.7, 0)):  # for 1.5 s after its first beacon has left
        join.handle_timer(now)
        assert [one.flags for one in beacons(join)] == [flags]


@pytest.mark.parametrize(("after_s", "flags"), [(1.25, STARTING), (1.5, 0)])
def test_a_master_is_starting_for_a_second_and_a_half(after_s: float, flags: int) -> None:
    join = master()
    join.resume(BASE + after_s)
    assert [one.flags for one in beacons(join)] == [flags]


@pytest.mark.parametrize("after_s", [0.0, 0.25, 0.375])
@pytest.mark.parametrize(("epoch", "robot"), [(-1, 1), (0, -1), (0, 0), (0, 1), (1, -1)])
def test_of_two_that_start_the_one_that_was_heard_stays_or_else_the_smaller_one(
    after_s: float, epoch: int, robot: int
) -> None:
    join = master()
    join.epoch = 7
    other = beacon_frame(Beacon(STARTING, join.epoch + epoch, HASH + robot), IDS)
    (event,) = join.receive(other, BASE + after_s)
    stays = after_s > 0.3 or (epoch, robot) > (0, 0)
    assert event == OtherMaster(HASH + robot, fatal=not stays, at_once=not stays)
    answers = beacons(join)
    assert [one.flags for one in answers] == ([] if not stays else [0] if after_s > 0.3 else [STARTING])


def test_three_tenths_of_a_second_are_enough_to_have_been_heard() -> None:
    join = master(sent_at=0.0)
    other = beacon_frame(Beacon(STARTING, 0, 0), IDS)
    assert join.receive(other, 0.3) == [OtherMaster(0, fatal=False)]


@pytest.mark.parametrize(("after_s", "count"), [(0.0625, 0), (0.1, 1), (0.125, 1)])
def test_questions_are_answered_and_strangers_sent_away_ten_times_a_second_at_most(after_s: float, count: int) -> None:
    join = master(sent_at=-10.0)
    for now, expected in ((0.0, 1), (after_s, count)):
        join.receive(question_frame(1, IDS), now)
        assert len(beacons(join)) == expected
        join.stranger(7, now)
        assert len(join.take_frames()) == expected
        join.stranger(8, now)
        assert len(join.take_frames()) == expected, "each address by itself"


def full(*, known: bool) -> tuple[MasterJoin, MemoryNodeIds]:
    """Every address was given at `BASE`."""
    node_ids = MemoryNodeIds()
    join = master(node_ids, sent_at=BASE - 8)
    for number in range(1, NODES + 1):
        join.receive(join_frame(uid(number), 0, IDS), BASE)
        if known:
            join.claim_address(number)
    join.take_frames()
    return join, node_ids


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("more_s", [-0.25, 0.0, 0.25])
def test_a_newcomer_loses_its_address_after_1_s_without_data_and_a_known_part_after_10(
    known: bool, more_s: float
) -> None:
    join, _ = full(known=known)
    now = BASE + (10.0 if known else 1.0) + more_s
    for number, member in join.members.items():  # all but one have just been heard
        member.heard_at = BASE if number == 77 else now
    events = join.receive(join_frame(UID, 0, IDS), now)
    (answer,) = (read_assign(frame, IDS) for frame in join.take_frames())
    assert answer is not None
    if more_s > 0:
        assert (answer.node_id, events) == (77, [NodeEvicted(77, uid(77)), NodeJoined(77, UID, 0)])
    else:
        assert (answer.node_id, events) == (0, [NodeRefused(UID)])


def test_who_comes_back_has_confirmed_its_address() -> None:
    join, node_ids = full(known=True)
    assert node_ids.oldest_first()[:2] == (1, 2)
    join.receive(join_frame(uid(1), 0, IDS), BASE + 5)
    assert (node_ids.oldest_first()[0], node_ids.oldest_first()[-1]) == (2, 1)


def test_what_a_part_is_before_it_asks_and_after_it_was_silenced() -> None:
    part = ComponentJoin(UID, random=Random(1))
    assert (part.node_id, part.state, part.timer(), part.take_frames()) == (0, ComponentState.OFF, None, [])
    assert part.receive(beacon(), 0.0) is None
    assert part.sent(0.0) is False
    part.start(0.0)
    assert part.sent(0.0) is False, "the JOIN has not been taken yet"
    assert len(part.take_frames()) == 1
    part.stop()
    assert (part.sent(1.0), part.timer(), part.take_frames()) == (False, None, [])
    part.start(2.0)
    part.stop()
    assert part.take_frames() == [], "the JOIN that waited is not sent any more"


class NoJitter(Random):
    """Every pause is as long as it is meant to be."""

    def random(self) -> float:
        return 0.5


@pytest.mark.parametrize(("before_s", "joins"), [(0.5, True), (0.015, True), (0.012, False), (0.0, False)])
def test_a_beacon_of_a_new_epoch_is_answered_unless_a_join_is_due_about_as_soon(before_s: float, joins: bool) -> None:
    """As soon as the answer to the last one may take: 10 ms, and a quarter of it for jitter."""
    part = ComponentJoin(UID, random=NoJitter())
    part.start(BASE)
    part.take_frames()
    lost = part.receive(assign(0), BASE)
    assert lost is not None
    assert part.sent(BASE), "refused: the next JOIN is due after the longest pause"
    due = part.timer()
    assert due == BASE + 0.8
    part.receive(beacon(epoch=5), due - before_s)
    assert bool(part.take_frames()) == joins
    if joins:
        assert part.sent(due - before_s)
        assert part.timer() == pytest.approx(due - before_s + 0.010)


def test_a_beacon_of_the_same_epoch_is_no_news() -> None:
    part = ComponentJoin(UID, random=NoJitter())
    part.start(0.0)
    joined = []
    for now, epoch in enumerate((5, 5, 6, 6, 5)):
        part.take_frames()
        part.receive(assign(0), float(now))
        part.sent(float(now))
        part.receive(beacon(epoch=epoch), now + 0.125)
        joined.append(len(part.take_frames()))
        part.handle_timer(now + 0.875)
    assert joined == [1, 0, 1, 0, 1]


def test_a_refusal_is_told_once_until_there_was_an_address() -> None:
    part = ComponentJoin(UID, random=NoJitter())
    part.start(0.0)
    told = []
    for answer in (assign(0), assign(0), assign(7), beacon(epoch=6), assign(0), assign(0)):
        told.append(part.receive(answer, 0.0) is not None)
        part.take_frames()
    assert told == [True, False, True, True, True, False]
