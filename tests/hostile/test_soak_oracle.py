"""The oracle of `bench/soak.py` must be able to fail: wrong histories are told to it, and it complains of each."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bench.soaking.flatness import Sample, growth
from bench.soaking.journal import JournalOracle, Row
from bench.soaking.oracle import SampleOracle
from bench.soaking.states import Expected, StateOracle
from bench.soaking.troubles import ALL, Troubles

A, B = "aaaa", "bbbb"


class Pair:
    """S0 (process aaaa) is heard by S1 (process bbbb), both active since 1.0 s; four samples a second."""

    def __init__(self, *, reliable: bool = True) -> None:
        self.troubles = Troubles(0.0)
        self.oracle = SampleOracle(self.troubles.clear_since)
        self.oracle.wire(0.0, "S0", "S1", reliable=reliable)
        for slot, boot in (("S0", A), ("S1", B)):
            self.oracle.boot(slot, boot)
            self.oracle.join(1.0, boot, 1, slot, stopped=False)
        self.count = 0

    def send(self, until: float, *, heard: bool = True, begin: float = 1.0) -> None:
        """Samples until then."""
        while (at := begin + 0.25 * self.count) < until:
            self.oracle.sent(at, A, 1, self.count)
            if heard:
                self.hear(at + 0.01, self.count)
            self.count += 1

    def hear(self, at: float, number: int, *, boot: str = A, epoch: int = 1, slot: str = "S0", ear: int = 1) -> None:
        self.oracle.got(at, B, ear, (slot, boot, epoch, number))

    @property
    def rules(self) -> set[str]:
        """The rules that were broken."""
        return {one.rule for one in self.oracle.violations}


def test_a_right_history_is_right() -> None:
    pair = Pair()
    pair.send(30.0)
    pair.oracle.check(30.0)
    pair.oracle.stop(30.0, B)
    pair.send(40.0, heard=False)
    pair.oracle.go(40.0, B)
    pair.send(50.0)
    pair.oracle.check(50.0)
    pair.oracle.worn(50.0, "S1", "session", 0)
    pair.oracle.lost(50.0, B)
    pair.oracle.join(51.0, B, 2, "S1", stopped=False)
    pair.send(52.0, heard=False)
    pair.hear(52.5, pair.count - 1, ear=2)
    assert pair.oracle.violations == []
    assert (pair.oracle.accepted, pair.oracle.left_out) == (pair.count, 0)


def twice(pair: Pair) -> None:
    pair.send(5.0)
    pair.hear(5.1, pair.count - 1)


def overtaken(pair: Pair) -> None:
    pair.send(5.0)
    pair.hear(5.1, 3)


def forged(pair: Pair) -> None:
    pair.hear(2.0, 0, boot="cccc")


def in_anothers_name(pair: Pair) -> None:
    pair.hear(2.0, 0, slot="S7")


def of_a_life_that_never_was(pair: Pair) -> None:
    pair.hear(2.0, 0, epoch=9)


def never_sent(pair: Pair) -> None:
    pair.send(5.0)
    pair.hear(5.1, 500)
    pair.oracle.check(20.0)


def before_it_has_joined(pair: Pair) -> None:
    pair.oracle.boot("S1", "dddd")
    pair.oracle.got(2.0, "dddd", 1, ("S0", A, 1, 0))


def after_it_was_lost(pair: Pair) -> None:
    pair.send(5.0)
    pair.oracle.lost(5.0, B)
    pair.hear(5.1, pair.count)


def while_stopped(pair: Pair) -> None:
    pair.oracle.stop(2.0, B)
    pair.send(5.0)


def joined_stopped(pair: Pair) -> None:
    pair.oracle.join(2.0, B, 2, "S1", stopped=True)
    pair.oracle.sent(2.0, A, 1, 0)
    pair.hear(2.1, 0, ear=2)


def in_anothers_slot(pair: Pair) -> None:
    pair.oracle.join(2.0, B, 2, "S0", stopped=False)


def nothing_arrives(pair: Pair) -> None:
    pair.send(30.0, heard=False)
    pair.oracle.check(30.0)


def arrives_no_more(pair: Pair) -> None:
    pair.send(20.0)
    pair.send(40.0, heard=False)
    pair.oracle.check(40.0)


def left_out_in_silence(pair: Pair) -> None:
    pair.send(5.0)
    pair.count += 1
    pair.oracle.sent(5.1, A, 1, pair.count - 1)
    pair.send(30.0)
    for at in (6.0, 12.0, 20.0):
        pair.oracle.worn(at, "S1", "session", 0)


def not_wired_any_more(pair: Pair) -> None:
    pair.send(5.0)
    pair.oracle.unwire(5.0, "S0", "S1")
    pair.oracle.unwired(5.5, "S0", "S1")
    pair.send(12.0)


def publishes_before_it_has_joined(pair: Pair) -> None:
    pair.oracle.boot("S2", "eeee")
    pair.oracle.sent(2.0, "eeee", 0, 0)


WRONG: list[tuple[Callable[[Pair], None], str]] = [
    (twice, "doubled"),
    (overtaken, "doubled"),
    (forged, "stranger"),
    (in_anothers_name, "stranger"),
    (of_a_life_that_never_was, "stranger"),
    (never_sent, "stranger"),
    (before_it_has_joined, "hears"),
    (after_it_was_lost, "hears"),
    (while_stopped, "stop"),
    (joined_stopped, "stop"),
    (in_anothers_slot, "slot"),
    (nothing_arrives, "late"),
    (arrives_no_more, "late"),
    (left_out_in_silence, "lost"),
    (not_wired_any_more, "wire"),
    (publishes_before_it_has_joined, "sent"),
]


@pytest.mark.parametrize(("history", "rule"), WRONG, ids=[history.__name__ for history, _ in WRONG])
def test_a_wrong_history_is_complained_of(history: Callable[[Pair], None], rule: str) -> None:
    pair = Pair()
    pair.oracle.worn(1.0, "S1", "session", 0)
    history(pair)
    assert rule in pair.rules


def test_what_was_left_out_and_told_is_counted_and_no_violation() -> None:
    pair = Pair()
    pair.oracle.worn(1.0, "S1", "session", 0)
    pair.send(5.0)
    pair.oracle.sent(5.1, A, 1, pair.count)
    pair.count += 1
    pair.send(30.0)
    pair.oracle.worn(20.0, "S1", "session", 1)
    pair.oracle.worn(30.0, "S1", "session", 1)
    assert (pair.oracle.violations, pair.oracle.left_out) == ([], 1)


def test_what_is_lost_while_somebody_takes_the_wire_away_or_puts_it_back_is_no_violation() -> None:
    pair = Pair()
    pair.send(5.0)
    pair.oracle.unwire(5.0, "S0", "S1")
    pair.send(6.0, heard=False)  # the answers come late: it is back already, and nobody knows
    pair.send(7.0)
    pair.oracle.unwired(7.0, "S0", "S1")
    pair.oracle.binds(7.5, "S0", "S1")
    pair.send(8.0, heard=False)
    pair.send(9.0)
    pair.oracle.wire(12.0, "S0", "S1", reliable=True)
    pair.oracle.worn(30.0, "S1", "session", 0)
    pair.oracle.worn(40.0, "S1", "session", 0)
    assert not pair.rules


def test_what_was_sent_after_somebody_has_asked_for_a_wire_may_be_heard_before_the_answer() -> None:
    pair = Pair()
    pair.send(5.0)
    pair.oracle.unwire(5.0, "S0", "S1")
    pair.oracle.unwired(5.0, "S0", "S1")
    pair.send(10.0, heard=False)
    pair.oracle.binds(10.0, "S0", "S1")
    pair.oracle.wire(16.0, "S0", "S1", reliable=True)  # the answer was long under way
    pair.send(15.0)
    assert not pair.rules


def test_best_effort_may_lose_but_not_double() -> None:
    pair = Pair(reliable=False)
    pair.oracle.worn(1.0, "S1", "session", 0)
    left_out_in_silence(pair)
    assert pair.oracle.violations == []
    twice(pair)
    assert pair.rules == {"doubled"}


def test_nothing_need_arrive_while_something_is_wrong() -> None:
    pair = Pair()
    trouble = pair.troubles.begin(2.0, "network cut", ["S1"])
    pair.send(30.0, heard=False)
    pair.oracle.check(30.0)
    assert pair.oracle.violations == []
    trouble.ended = 30.0
    pair.send(45.0, heard=False)
    pair.oracle.check(45.0)
    assert pair.rules == {"late"}


class Shown:
    """One part whose state the page shows."""

    def __init__(self) -> None:
        self.troubles = Troubles(0.0)
        self.found: list[str] = []
        self.oracle = StateOracle(self.troubles.clear_since, lambda _at, rule, _words: self.found.append(rule))
        self.part = self.oracle.parts["S0"] = Expected("uid", note=("first", 0.0), told_note="first", joined=1.0)

    def show(self, at: float, state: str, uid: str = "uid", *, stopped: bool = False) -> None:
        self.oracle.shown(at, {"S0": (state, uid)}, stopped=stopped, master_since=0.0)


@pytest.mark.parametrize(("state", "uid"), [("lost", "uid"), ("empty", ""), ("active", "another"), ("late", "uid")])
def test_a_part_that_should_be_active(state: str, uid: str) -> None:
    shown = Shown()
    shown.show(11.0, state, uid)
    assert shown.found == []
    shown.show(13.0, state, uid)
    shown.show(14.0, state, uid)
    assert shown.found == ["state"], "once, until it is over"
    shown.show(15.0, "active")
    shown.show(16.0, state, uid)
    assert shown.found == ["state", "state"]


def test_a_dead_part_that_is_shown_as_active() -> None:
    shown = Shown()
    shown.part.absent = 20.0
    shown.show(29.0, "active")
    shown.show(31.0, "lost")
    assert shown.found == []
    shown.show(32.0, "late")
    assert shown.found == ["gone"]


def test_a_stop_that_is_not_obeyed_or_forgotten() -> None:
    shown = Shown()
    shown.oracle.stop = (True, 20.0)
    shown.oracle.check(25.0)
    assert shown.found == []
    shown.oracle.check(27.0)
    assert shown.found == ["stop"]
    shown.show(28.0, "active", stopped=False)
    assert shown.found == ["stop", "stop"]


def test_a_setting_that_does_not_arrive_and_a_page_that_does_not_answer() -> None:
    shown = Shown()
    shown.part.note = ("new", 20.0)
    shown.oracle.check(27.0)
    assert shown.found == ["setting"]
    shown.oracle.page(30.0, "no answer", 27.0)
    assert shown.found == ["setting"]
    shown.oracle.page(34.0, "no answer", 27.0)
    assert shown.found == ["setting", "page"]


RIGHT: Row = (1, 1000, "S0", "u0", "S0", "checking", "active", "slot S0 is free")


@pytest.mark.parametrize(
    "wrong",
    [
        (1, 2000, "S0", "u0", "S0", "active", "late", "no beat"),
        (2, 500, "S0", "u0", "S0", "active", "late", "no beat"),
        (2, 2000, "S0", "u0", "S0", "active", "late", " "),
        (2, 2000, "S0", "u0", "S0", "lost", "active", "by magic"),
        (2, 2000, "S1", "u1", "S0", "checking", "active", "slot S0 is free"),
    ],
    ids=["number", "time", "reason", "change", "two holders"],
)
def test_a_journal_that_contradicts_itself(wrong: Row) -> None:
    found: list[str] = []
    journal = JournalOracle(lambda _at, rule, words: found.append(f"{rule} {words}"))
    journal.follow(0.0, [RIGHT])
    assert found == []
    journal.follow(0.0, [wrong])
    assert len(found) == 1


def test_a_part_of_the_robot_that_is_accused_and_a_change_that_was_lost() -> None:
    found: list[str] = []
    journal = JournalOracle(lambda _at, rule, _words: found.append(rule))
    words = "a sample that says it is from this part was refused: no seal"
    journal.follow(0.0, [RIGHT, (2, 2000, "S0", "u0", "S0", "active", "active", words)])
    assert found == ["journal"]
    journal.edits(10.0, {1, 2}, [(1, 0.0), (3, 8.0)])
    assert found == ["journal"], "it may be on its way"
    journal.edits(20.0, {1, 2}, [(1, 0.0), (3, 8.0)])
    assert found == ["journal", "edits"]


def samples(mb_per_hour: float, tasks_more: int = 0) -> list[Sample]:
    """An hour, every ten seconds."""
    return [
        Sample(at, 100 + mb_per_hour * at / 3600 + (at // 10) % 3, 40 + tasks_more * (at > 3000), 9, 30)
        for at in range(0, 3600, 10)
    ]


def test_memory_and_tasks_that_grow() -> None:
    flat, fat, busy = growth(samples(0)), growth(samples(60)), growth(samples(0, 20))
    assert flat is not None
    assert flat.troubles == []
    assert fat is not None
    assert "memory grows by 60" in fat.troubles[0]
    assert busy is not None
    assert busy.troubles == ["tasks grow from 40 to 60"]
    assert growth(samples(60)[:100]) is None, "too short to say"


def test_troubles_of_all_concern_everybody() -> None:
    troubles = Troubles(0.0)
    one = troubles.begin(5.0, "master killed", [ALL])
    assert troubles.clear_since("S0") is None
    one.ended = 8.0
    assert troubles.clear_since("S0") == 8.0
    troubles.note(9.0, 9.5, "stall", ["S1"])
    assert (troubles.clear_since("S0"), troubles.clear_since("S1"), troubles.of("S1")[0].what) == (8.0, 9.5, "stall")
