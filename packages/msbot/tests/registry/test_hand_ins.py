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


def test_a_recording_stays_with_the_work_and_goes_with_it(registry: Registry) -> None:
    kept = registry.hand_ins
    number = kept.store(HandIn("Ada", "ring", 20, 10, recorded_from_ns=12, recorded_to_ns=19), b"\0MCAP" * 100)
    bare = kept.store(HandIn("Ben", "ring", 21, 10))
    assert kept.recording(number) == b"\0MCAP" * 100
    assert [(one.number, one.recording_octets) for one in kept.of()] == [(bare, 0), (number, 500)]
    found = kept.get(number)
    assert (found.recording_octets, found.recorded_from_ns, found.recorded_to_ns) == (500, 12, 19)
    kept.give_back(number, "Ms Novak", "good", 30)
    assert kept.recording(number) == b"\0MCAP" * 100
    for at in range(hand_ins.MOST_OF_LESSON):
        kept.store(HandIn("Ada", "ring", 30 + at, 0))
    for gone in (number, bare, 999):
        with pytest.raises(NotThere, match=f"hand-in {gone}"):
            kept.recording(gone)


def test_recordings_of_a_person_have_a_bound_and_the_oldest_gives_way(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = registry.hand_ins
    monkeypatch.setattr(hand_ins, "MOST_RECORDED_OF_ONE", 1000)
    numbers = [kept.store(HandIn("Ada", lesson, 1, 0), bytes(400)) for lesson in ("ring", "spare", "first_part")]
    other = kept.store(HandIn("Ben", "ring", 1, 0), bytes(1000))
    sizes = {one.number: one.recording_octets for one in kept.of()}
    assert sizes == {numbers[0]: 0, numbers[1]: 400, numbers[2]: 400, other: 1000}
    late = kept.store(HandIn("Ada", "own_message", 1, 0), bytes(1001))
    assert kept.get(late).recording_octets == 0, "larger than all a person may have"
    assert kept.get(numbers[2]).recording_octets == 400, "and nothing else was lost for it"


def test_recordings_of_a_class_have_a_bound_and_what_waits_for_the_teacher_keeps_its_own(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = registry.hand_ins
    monkeypatch.setattr(hand_ins, "MOST_RECORDED", 1000)
    first, second = (kept.store(HandIn(name, "ring", 1, 0), bytes(500)) for name in ("Ada", "Ben"))
    third = kept.store(HandIn("Cleo", "ring", 1, 0), bytes(500))
    assert [kept.get(one).recording_octets for one in (first, second, third)] == [500, 500, 0]
    kept.give_back(second, "Ms Novak", "", 5)
    fourth = kept.store(HandIn("Dan", "ring", 1, 0), bytes(500))
    assert [kept.get(one).recording_octets for one in (first, second, fourth)] == [500, 0, 500]
