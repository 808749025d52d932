"""What waits for the bus."""

from __future__ import annotations

from msbot_agent.link.can.protocol.frame_queue import URGENT_FRAMES, FrameQueue
from msbot_agent.link.can.protocol.frames import Frame


def frames(peer: int, count: int) -> list[Frame]:
    return [Frame(peer, bytes([number])) for number in range(count)]


def drain(queue: FrameQueue) -> list[tuple[int, int]]:
    taken = []
    while (frame := queue.next()) is not None:
        taken.append((frame.can_id, frame.data[0]))
    return taken


def test_peers_take_turns_frame_by_frame() -> None:
    queue = FrameQueue()
    queue.put(1, frames(1, 4))
    queue.put(2, frames(2, 2))
    queue.put(1, frames(1, 1))
    assert drain(queue) == [(1, 0), (2, 0), (1, 1), (2, 1), (1, 2), (1, 3), (1, 0)]


def test_a_peer_has_no_room_from_the_limit_on_and_is_named_when_it_has_again() -> None:
    queue = FrameQueue(limit=3)
    queue.put(1, frames(1, 2))
    assert queue.has_room(1)
    queue.put(1, frames(1, 10))
    assert not queue.has_room(1)
    assert queue.has_room(2)
    for _ in range(9):
        queue.next()
    assert not queue.has_room(1)
    assert queue.roomy == []
    queue.next()
    assert queue.has_room(1)
    assert queue.roomy == [1]
    drain(queue)
    assert queue.roomy == [1]


def test_urgent_frames_go_first_and_an_equal_one_waits_only_once() -> None:
    queue = FrameQueue()
    queue.put(1, frames(1, 1))
    assert queue.put_urgent(Frame(9, b"\1"))
    assert queue.put_urgent(Frame(9, b"\1"))
    assert queue.put_urgent(Frame(9, b"\2"))
    assert FrameQueue().next(urgent_only=True) is None
    queue.put_stop(Frame(8, b"\0"), 3)
    queue.put_stop(Frame(8, b"\0"), 3)
    assert drain(queue) == [(8, 0), (8, 0), (8, 0), (9, 1), (9, 2), (1, 0)]


def test_urgent_frames_are_bounded() -> None:
    queue = FrameQueue()
    accepted = [queue.put_urgent(Frame(number)) for number in range(URGENT_FRAMES + 1)]
    assert accepted == [True] * URGENT_FRAMES + [False]


def test_forgetting_a_peer_or_everything() -> None:
    queue = FrameQueue()
    queue.put(1, frames(1, 3))
    queue.put(2, frames(2, 2))
    queue.put_urgent(Frame(9, b"\1"))
    assert len(queue) == 6
    assert queue.clear(1) == 3
    assert queue.clear(1) == queue.clear(7) == 0
    assert queue.clear_all() == 3
    assert drain(queue) == []
    queue.put(1, frames(1, 1))
    assert drain(queue) == [(1, 0)]
