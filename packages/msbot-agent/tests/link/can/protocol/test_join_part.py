"""The part's side of joining, with literal times."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION, NOBODY, join_frame, read_join
from msbot_agent.link.can.protocol.join_part import AddressLost, ComponentJoin, ComponentState, Joined
from msbot_xrce.errors import LocalProtocolError
from tests.link.joining import HASH, IDS, UID, any_frame, assign, beacon, uid


def part(profile_hash: int | None = None, caps: int = 0) -> ComponentJoin:
    return ComponentJoin(UID, random=Random(1), caps=caps, profile_hash=profile_hash)


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
    assert join.receive(beacon(epoch=6), 2.0) == AddressLost("the master has restarted")
    assert join.take_frames() == [join_frame(UID, 0, IDS)]
    assert join.receive(assign(7, epoch=6), 2.001) == Joined(7, 0)
    assert join.receive(beacon(epoch=6), 3.0) is None


def test_the_first_beacon_of_a_master_ends_a_long_pause() -> None:
    join = part()
    join.start(0.0)
    for now in (0.0, 0.02, 0.05, 0.1):
        join.take_frames()
        join.sent(now)
        join.handle_timer(now + 0.02)
    assert join.take_frames() == [], "the pause is 40 ms or more"
    join.receive(beacon(), 0.13)
    assert len(join.take_frames()) == 1
    join.sent(0.131)
    join.receive(beacon(), 1.13)
    assert join.take_frames() == [], "the next beacon of the same epoch changes nothing"


def test_a_join_that_still_waits_for_the_bus_is_enough_for_a_new_master() -> None:
    join = part()
    join.start(0.0)
    assert len(join.take_frames()) == 1
    join.receive(beacon(), 0.3)
    assert join.take_frames() == [], "two would be answered twice"
    join.sent(0.4)
    assert isinstance(join.receive(assign(7), 0.401), Joined)


def test_a_join_that_has_just_left_is_enough_for_a_new_master() -> None:
    join = part()
    join.start(0.0)
    join.take_frames()
    join.sent(0.001)
    join.receive(beacon(), 0.002)
    assert join.take_frames() == [], "the answer is on its way, or the next JOIN goes within 12.5 ms"
    join.handle_timer(0.015)
    assert len(join.take_frames()) == 1


def test_another_robot_in_the_beacon_of_the_same_epoch_makes_a_part_join_again() -> None:
    join = part()
    join.start(0.0)
    join.take_frames()
    join.receive(assign(7), 0.1)
    for now in (0.5, 1.5):
        assert join.receive(beacon(), now) is None
    lost = join.receive(beacon(profile_hash=HASH + 1), 2.5)
    assert lost == AddressLost("the robot's profile has changed")
    assert (join.state, join.node_id, len(join.take_frames())) == (ComponentState.JOINING, 0, 1)
    assert isinstance(join.receive(assign(7), 2.6), Joined)
    assert join.receive(beacon(profile_hash=HASH + 1), 3.5) is None, "that is its robot now"


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
