"""STOP is counted truly: only a beat with its number confirms it, and whoever is silent is named."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.pnp import StopRecord
from msbot.pnp.emergency_stop import MOST_NAMES, EmergencyStop, StopConfirmation, StopStatus

AA, BB, CC = ((name.encode(), name) for name in ("AA", "BB", "CC"))


def said(*parts: tuple[bytes, str]) -> EmergencyStop:
    stop = EmergencyStop()
    stop.say("ann", "hand in the gear", parts, 10.0, 1_000)
    return stop


def test_before_anybody_says_stop_there_is_nothing() -> None:
    status = EmergencyStop().status()
    assert (status.stopped, status.number, status.told_count, status.since_ns, status.latency_ms) == (
        False,
        0,
        0,
        None,
        None,
    )


def test_who_confirmed_and_in_how_many_ms_and_who_did_not() -> None:
    stop = said(AA, BB, CC)
    assert stop.confirm(b"AA", 1, 10.004)
    assert stop.confirm(b"CC", 1, 10.25)
    status = stop.status()
    assert [(one.part, round(one.ms, 3)) for one in status.confirmed] == [("AA", 4.0), ("CC", 250.0)]
    assert status.silent == ("BB",)
    assert status.told_count == 3
    assert status.latency_ms is None, "one has not confirmed"
    assert stop.confirm(b"BB", 1, 10.5)
    assert stop.status().latency_ms == 500.0


def test_the_number_of_another_stop_confirms_nothing() -> None:
    stop = said(AA)
    stop.go("ann")
    stop.say("bob", "", [AA], 20.0, 2_000)
    assert not stop.confirm(b"AA", 1, 20.1)
    assert stop.status().silent == ("AA",)
    assert stop.confirm(b"AA", 2, 20.2)
    assert not EmergencyStop().confirm(b"AA", 0, 0.0), "no STOP holds"


def test_a_number_counts_by_its_lowest_16_bits() -> None:
    stop = EmergencyStop(StopRecord(0x1_FFFF, False))
    stop.say("ann", "", [AA], 0.0, 0)
    assert stop.stop_number == 0x2_0001, "those bits are never all 0"
    assert not stop.confirm(b"AA", 0, 0.1)
    assert stop.confirm(b"AA", 1, 0.1)


def test_a_part_says_stop_with_0_or_with_a_number_that_was_never_counted_to() -> None:
    stop = EmergencyStop(StopRecord(5, False))
    assert stop.handle_beat(*AA, 0)
    assert stop.handle_beat(*AA, 6)
    assert not stop.handle_beat(*AA, 5), "it has not heard of GO"
    assert not stop.handle_beat(*AA, 1)
    assert not stop.handle_beat(*AA, None)
    wrapped = EmergencyStop(StopRecord(0x1_0003, False))
    assert not wrapped.handle_beat(*AA, 0xFFFE)
    assert wrapped.handle_beat(*AA, 4)
    assert EmergencyStop().handle_beat(*AA, 57), "a new database"
    assert not said(AA).handle_beat(*AA, 0), "one holds already"


def test_who_still_says_stop_is_known_until_another_beat_or_none() -> None:
    stop = said(AA, BB)
    for identity, name in (AA, BB, CC):
        stop.handle_beat(identity, name, 0)
    assert stop.sayers == ("AA", "BB", "CC")
    stop.handle_beat(*AA, 1)
    stop.handle_beat(*BB, None)
    stop.fall_silent(b"CC")
    assert not stop.sayers
    stop.handle_beat(*AA, 0)
    stop.part_left(b"AA")
    assert not stop.sayers


def test_a_part_that_begins_anew_must_confirm_again() -> None:
    stop = said(AA, BB)
    stop.confirm(b"AA", 1, 10.1)
    stop.begin_anew(b"AA", "AA", 12.0)
    assert stop.status().silent == ("BB", "AA")
    stop.confirm(b"AA", 1, 12.3)
    assert stop.status().confirmed[0].ms == pytest.approx(300)


def test_a_part_that_comes_in_later_is_counted_from_then() -> None:
    stop = said(AA)
    stop.tell(b"CC", "CC", 30.0)
    stop.confirm(b"CC", 1, 30.02)
    assert [(one.part, round(one.ms)) for one in stop.status().confirmed] == [("CC", 20)]


def test_a_part_that_says_goodbye_is_not_waited_for() -> None:
    stop = said(AA, BB)
    stop.part_left(b"BB")
    assert stop.status().silent == ("AA",)


def test_a_part_whose_slot_somebody_takes_away_may_still_move_unless_it_has_confirmed() -> None:
    stop = said(AA, BB)
    stop.confirm(b"AA", 1, 10.1)
    stop.lose_slot(b"AA")
    stop.lose_slot(b"BB")
    assert (stop.status().confirmed, stop.status().silent) == ((), ("BB",))
    stop.begin_anew(b"BB", "BB", 12.0)  # it has a slot again
    stop.confirm(b"BB", 1, 12.1)
    assert not stop.status().silent


def test_stop_said_twice_is_one_stop_by_the_first_who_said_it() -> None:
    stop = said(AA)
    stop.confirm(b"AA", 1, 10.1)
    stop.say("bob", "again", [AA, BB], 11.0, 2_000)
    status = stop.status()
    assert (status.by, status.since_ns, status.number, status.first, status.silent) == ("ann", 1_000, 2, 1, ("BB",))
    assert len(status.confirmed) == 1


def test_whoever_says_stop_again_says_nothing_new_and_the_stop_has_a_number_of_its_own() -> None:
    stop = EmergencyStop()
    assert stop.say("ann", "", [AA], 1.0, 1)
    assert not stop.say("ann", "", [AA], 1.1, 2)
    assert stop.say("bob", "", [AA], 1.2, 3)
    assert not stop.say("bob", "", [AA], 1.3, 4)
    assert (stop.latest, stop.stop_number) == (4, 1)
    stop.go("ann")
    stop.say("ann", "", [AA], 2.0, 5)
    assert (stop.latest, stop.stop_number) == (5, 5)


def test_go_ends_it_and_the_next_one_has_another_number() -> None:
    stop = said(AA)
    assert stop.go("bob") == 1
    assert not stop.status().stopped
    assert stop.status().told_count == 0
    stop.say("ann", "", [AA], 1.0, 1)
    assert stop.stop_number == 2


def test_a_stop_from_before_goes_on() -> None:
    stop = EmergencyStop(StopRecord(7, True, "ann", "fire", 5))
    stop.tell(b"AA", "AA", 1.0)
    status = stop.status()
    assert (status.stopped, status.by, status.reason, status.since_ns, status.silent) == (
        True,
        "ann",
        "fire",
        5,
        ("AA",),
    )
    assert not stop.confirm(b"AA", 7, 1.1), "its GO may have been said without being stored; the part knows it as over"
    assert stop.confirm(b"AA", 8, 1.2)


def test_a_number_that_was_said_while_stop_held_is_not_used_again_after_a_restart() -> None:
    stop = said(AA)
    stop.say("bob", "", [AA], 1.0, 1)
    after = EmergencyStop(stop.record)
    assert after.latest == after.stop_number == 3
    stop.go("ann")
    after = EmergencyStop(stop.record)
    after.say("ann", "", [AA], 1.0, 1)
    assert after.latest == 3


@given(st.lists(st.tuples(st.integers(0, 9), st.booleans()), min_size=2, max_size=2))
def test_of_two_records_the_later_one_holds_and_go_comes_after_its_stop(both: list[tuple[int, bool]]) -> None:
    one, other = (StopRecord(number, holds) for number, holds in both)
    assert not (one.is_newer_than(other) and other.is_newer_than(one))
    if one.number == other.number and one.holds != other.holds:
        assert (other if one.holds else one).is_newer_than(one if one.holds else other)


class Plain:
    """The same by a list of all that has happened since STOP was said, read from its beginning each time."""

    def __init__(self) -> None:
        self.number = self.latest = 0
        self.holds = False
        self.by, self.reason, self.at_ns = "", "", 0
        self.happened: list[tuple[str, str, float]] = []
        """What (`asked`, `confirmed`, `gone`, `also`), whom it concerns, when."""

    def status(self) -> StopStatus:
        waiting: list[tuple[str, float]] = []
        confirmed: list[StopConfirmation] = []
        also: list[str] = []
        for what, who, at in self.happened:
            if what == "also" and who != self.by and who not in also:
                also = [*also, who][:MOST_NAMES]
            if what == "asked" and who not in [name for name, _ in waiting] + [one.part for one in confirmed]:
                waiting.append((who, at))
            if what == "confirmed":
                confirmed += [StopConfirmation(who, (at - since) * 1000) for name, since in waiting if name == who]
            if what == "gone":
                confirmed = [one for one in confirmed if one.part != who]
            if what in ("confirmed", "gone"):
                waiting = [one for one in waiting if one[0] != who]
        return StopStatus(
            stopped=self.holds,
            number=self.latest,
            first=self.number,
            by=self.by,
            reason=self.reason,
            since_ns=self.at_ns if self.holds else None,
            confirmed=tuple(confirmed),
            silent=tuple(name for name, _ in waiting),
            also_by=tuple(also),
            trouble="",
            is_stored=True,
        )


@pytest.mark.parametrize("seed", range(8))
def test_whatever_is_said_the_status_is_what_its_history_says(seed: int) -> None:
    random = Random(seed)
    stop, plain = EmergencyStop(), Plain()
    names = [f"p{number}" for number in range(4)]
    people = [f"person {number}" for number in range(MOST_NAMES + 4)]
    for step in range(200):
        now, name = float(step), random.choice(names)
        act = random.choice(
            ("say", "say", "tell", "confirm", "confirm", "wrong", "anew", "leave", "go" if step % 3 == 0 else "say")
        )
        if act == "say":
            by, asked = random.choice(people), random.sample(names, 2)
            stop.say(by, f"because {step}", [(one.encode(), one) for one in asked], now, step)
            plain.latest += 1
            if not plain.holds:
                plain.number, plain.holds, plain.happened = plain.latest, True, []
                plain.by, plain.reason, plain.at_ns = by, f"because {step}", step
            plain.happened += [("also", by, now), *(("asked", one, now) for one in asked)]
        elif act == "tell":
            stop.tell(name.encode(), name, now)
            plain.happened += [("asked", name, now)] * plain.holds
        elif act == "confirm":
            assert stop.confirm(name.encode(), plain.number, now) is plain.holds
            plain.happened += [("confirmed", name, now)] * plain.holds
        elif act == "wrong":
            assert not stop.confirm(name.encode(), plain.number + 1, now)
        elif act == "anew":
            stop.begin_anew(name.encode(), name, now)
            plain.happened += [("gone", name, now), ("asked", name, now)] * plain.holds
        elif act == "leave":
            stop.part_left(name.encode())
            plain.happened += [("gone", name, now)] * plain.holds
        elif random.random() < 0.2:
            assert stop.go("zoe") == plain.number
            plain.holds, plain.happened, plain.by, plain.reason = False, [], "zoe", ""
        assert stop.status() == plain.status()
