"""Whose password is hashed next."""

from __future__ import annotations

from msbot_web.access.passwords import MOST_ALL, MOST_OF_ONE, HashQueue


def test_everybody_has_a_turn_however_many_another_sends() -> None:
    queue: HashQueue[str] = HashQueue()
    for number in range(5):
        assert queue.add("eve", f"eve {number}")
    assert queue.add("ada", "ada")
    assert queue.add("bob", "bob")
    assert [queue.next() for _ in range(4)] == ["eve 0", "ada", "bob", "eve 1"]
    assert queue.add("ada", "ada again")
    assert [queue.next() for _ in range(5)] == ["eve 2", "ada again", "eve 3", "eve 4", None]
    assert len(queue) == 0


def test_it_is_bounded_for_one_and_for_all() -> None:
    queue: HashQueue[int] = HashQueue()
    assert [queue.add("eve", number) for number in range(MOST_OF_ONE + 3)].count(True) == MOST_OF_ONE
    assert queue.add("ada", 0)
    for number in range(2 * MOST_ALL):
        queue.add(f"asker {number}", number)
    assert len(queue) == MOST_ALL
    assert queue.next() == 0
