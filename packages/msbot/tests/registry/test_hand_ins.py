"""Work that was handed in: kept with its program, bounded, returned with a comment."""

from __future__ import annotations

import pytest

from msbot.registry import Registry, hand_ins
from msbot.registry.hand_ins import HandIn
from msbot_xrce.errors import ConfigError, NotThere


def test_it_is_kept_as_it_was_and_returned(registry: Registry) -> None:
    kept = registry.hand_ins
    work = HandIn("Ada", "ring", 20, 10, "lamp.py", "übung = 1\n", "ready", {"1.3": "ten"})
    number = kept.store(work)
    found = kept.get(number)
    assert (found.text, found.answers, found.note) == ("übung = 1\n", {"1.3": "ten"}, "ready")
    assert (found.from_ns, found.returned_ns) == (10, 0)
    assert [(one.number, one.text) for one in kept.of("Ada")] == [(number, "")]
    assert kept.of("Ben") == []
    back = kept.give_back(number, "Ms Novak", "good", 30)
    assert (back.returned_by, back.comment, back.returned_ns, back.text) == ("Ms Novak", "good", 30, "übung = 1\n")
    with pytest.raises(NotThere, match="number 99"):
        kept.get(99)
    with pytest.raises(NotThere, match="number 99"):
        kept.give_back(99, "Ms Novak", "", 1)


def test_the_newest_of_each_person_and_lesson_are_kept(registry: Registry) -> None:
    kept = registry.hand_ins
    for at in range(8):
        kept.store(HandIn("Ada", "ring", at, 0))
    kept.store(HandIn("Ada", "spare", 1, 0))
    kept.store(HandIn("Ben", "ring", 0, 0))
    assert [one.at_ns for one in kept.of("Ada") if one.lesson == "ring"] == [7, 6, 5, 4, 3]
    assert len(kept.of()) == 7


def test_what_waits_for_an_answer_is_listed_first_and_the_list_has_an_end(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = registry.hand_ins
    numbers = [kept.store(HandIn("Ada", "ring", at, 0)) for at in range(4)]
    kept.give_back(numbers[3], "Ms Novak", "", 5)
    assert [one.number for one in kept.of()] == [numbers[2], numbers[1], numbers[0], numbers[3]]
    monkeypatch.setattr(hand_ins, "MOST_LISTED", 2)
    assert [one.number for one in kept.of("Ada")] == [numbers[2], numbers[1]]


def test_what_was_returned_gives_way_and_what_was_not_does_not(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = registry.hand_ins
    monkeypatch.setattr(hand_ins, "MOST_OF_ALL", 25)
    first, second = (kept.store(HandIn(name, "ring", 1, 0, "a.py", "ü" * 5)) for name in ("Ada", "Ben"))
    with pytest.raises(ConfigError, match="a teacher returns some of it first"):
        kept.store(HandIn("Cleo", "ring", 1, 0, "a.py", "ü" * 5))
    assert {one.number for one in kept.of()} == {first, second}
    kept.give_back(second, "Ms Novak", "", 5)
    third = kept.store(HandIn("Cleo", "ring", 1, 0, "a.py", "ü" * 5))
    assert {one.number for one in kept.of()} == {first, third}
