"""Marks from notes: each rule, and the mission files that they come from."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.text.sentence import Sentence, said
from msbot_school.faults.fault_kinds import KINDS
from msbot_school.missions.grading import Grade, grade
from msbot_school.missions.mission import (
    REPAIRS,
    DrawnFault,
    Mission,
    MissionEvent,
    MissionEventKind,
    contradiction_of,
    drawn,
    events_from_json,
)
from msbot_school.missions.mission_file import load_mission, parse_mission, ready_mission, ready_missions
from msbot_school.missions.mission_run import MOST_ANSWERS, MOST_FACTS, MissionRun
from msbot_school.missions.recorded_missions import PlayedMission, grade_json, played_from_json
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from tests import ROOT

TWO = """
[mission]
title = "T"
story = "S"
time_s = 90
hints = ["look", "look again"]
avoid = ["swap"]

[[fault]]
kind = "loss"
at = "fan"

[[fault]]
kind = "stuck"
at = "knob"

[[do]]
words = "show it"
operation = "identify"
with = { part = "fan" }
within_s = 10

[[do]]
words = "well at the end"
until = "fan is active"
"""


def run_of(toml: str = TWO) -> MissionRun:
    mission = parse_mission(toml, "two.toml")
    return MissionRun(mission, drawn(mission, 1), "Ada", 100.0)


def begun() -> MissionRun:
    run = run_of()
    run.fault_began(1, 105.0)
    run.fault_began(2, 105.0)
    run.holds(2, 105.0, holds=True)
    return run


def test_everything_right_and_quick_brings_all_marks() -> None:
    run = begun()
    assert run.why_over(106.0) == ""
    assert run.name("Bo", "loss", "fan", 110.0) == "packets are lost (at fan): right"
    assert run.name("Cy", "stuck", "knob", 134.0).endswith("right")
    run.act("identify", {"part": "fan"}, "Bo", "", 112.0)
    words, mended = run.repair("Bo", "new-cable", "fan", 120.0)
    assert (words, mended) == ("lay another cable to the part (at fan): that has mended it", 1)
    run.fault_over(1, 120.0, "mended", is_mended=False)
    assert run.repair("Bo", "exchange-part", "knob", 125.0)[1] == 2
    run.fault_over(2, 125.0, "mended", is_mended=False)
    assert run.why_over(126.0) == "everything is found and done"
    found = run.grade()
    assert (found.marks, found.of, found.percent) == (24.0, 24.0, 100.0)
    assert [(one.found_by, one.found_s, one.mended_by, one.mended_s) for one in found.faults] == [
        ("Bo", 5.0, "Bo", 15.0),
        ("Cy", 29.0, "Bo", 20.0),
    ]
    assert [(task.by, task.after_s) for task in found.tasks] == [("Bo", 7.0), ("", 5.0)]


@pytest.mark.parametrize(
    ("kind", "slot", "verdict"),
    [
        ("loss", "fan", "right"),
        ("delay", "fan", "only the place is right"),
        ("loss", "knob", "only the place is right"),
        ("loss", "ear", "nothing of that kind is wrong there"),
        ("babbling", "fan", "nothing of that kind is wrong there"),
    ],
)
def test_an_answer_is_judged(kind: str, slot: str, verdict: str) -> None:
    assert run_words(begun(), kind, slot) == verdict


def run_words(run: MissionRun, kind: str, slot: str) -> str:
    return run.name("Bo", kind, slot, 110.0).rpartition(": ")[2]


def marks_of(run: MissionRun) -> float:
    return sum(one.marks for one in run.grade().faults) - sum(one.cost for one in run.grade().wrong)


def test_only_the_place_brings_part_of_the_marks_and_costs_one() -> None:
    run = begun()
    run.name("Bo", "delay", "fan", 110.0)
    assert [one.place_by for one in run.grade().faults] == ["Bo", ""]
    assert marks_of(run) == 2 - 1


def test_who_is_slow_gets_no_marks_for_that() -> None:
    run = begun()
    run.name("Bo", "loss", "fan", 136.0)  # a third of 90 s, and one more
    assert marks_of(run) == 5
    assert run_words(run, "loss", "fan") == "that was found already"
    assert marks_of(run) == 5, "what is said again costs nothing"


def test_nothing_to_find_yet() -> None:
    run = run_of()
    assert run_words(run, "loss", "fan") == "nothing has gone wrong yet"
    assert [one.words for one in run.grade().wrong] == [
        "wrong answer: loss: packets are lost (at fan) (nothing has gone wrong yet)"
    ]


def test_wrong_repairs_acts_to_be_avoided_and_hints_cost() -> None:
    run = begun()
    assert run.repair("Bo", "new-cable", "knob", 110.0) == (
        "lay another cable to the part (at knob): done, and nothing has changed",
        0,
    )
    run.act("swap", {"slot": "fan"}, "Bo", "", 111.0)
    run.act("set", {"slot": "fan"}, "Bo", "", 111.0)
    assert run.hint("Bo", 112.0) == "look"
    assert run.hint("Cy", 113.0) == "look again"
    with pytest.raises(ConfigError, match="no hint left"):
        run.hint("Cy", 114.0)
    found = run.grade()
    assert [(one.who, one.words, one.cost) for one in found.wrong] == [
        ("Bo", "repaired in vain: lay another cable to the part (at knob)", 1.0),
        ("Bo", "swap was to be avoided", 1.0),
        ("Bo", "hint 1", 1.0),
        ("Cy", "hint 2", 1.0),
    ]
    assert found.marks == 0, "never less than nothing"


def test_what_is_looked_up_brings_nothing_but_what_was_found_before_stays() -> None:
    run = begun()
    run.name("Bo", "loss", "fan", 106.0)
    run.looked("Bo", 107.0)
    run.name("Bo", "stuck", "knob", 108.0)
    found = run.grade()
    assert found.looked_by == "Bo"
    assert [one.marks for one in found.faults] == [7.0, 0.0]
    run = begun()
    run.name("Bo", "delay", "fan", 106.0)
    run.looked("Bo", 107.0)
    run.name("Bo", "loss", "fan", 108.0)
    run.name("Bo", "drift", "knob", 108.0)
    assert [one.marks for one in run.grade().faults] == [2.0, 0.0]


def test_who_plugs_in_at_the_card_has_mended_it() -> None:
    run = begun()
    run.fault_over(1, 115.0, "somebody has plugged it in again", is_mended=True)
    assert run.grade().faults[0].mended_s == 10.0
    run.fault_over(2, 116.0, "Ada has ended it", is_mended=False)
    assert run.grade().faults[1].mended_s is None


def test_a_fault_that_never_began_does_not_count() -> None:
    run = run_of()
    run.fault_began(1, 105.0)
    assert run.grade().of == 10 + 4, "one fault and two tasks"
    assert run.why_over(190.0) == "its time is over"


def test_a_task_has_its_time_and_its_arguments() -> None:
    for at, part, is_done in ((103.0, "fan", True), (114.0, "fan", True), (116.0, "fan", False), (110.0, "ear", False)):
        run = begun()
        run.act("identify", {"part": part}, "Bo", "", at)
        assert run.grade().tasks[0].is_done is is_done, (at, part)
    run = begun()
    run.holds(2, 120.0, holds=False)
    assert run.grade().tasks[1].is_done is False


def test_guessing_and_noise_have_an_end() -> None:
    run = begun()
    for _ in range(MOST_ANSWERS):
        run.name("Bo", "delay", "ear", 110.0)
    with pytest.raises(ConfigError, match="50 answers were given"):
        run.name("Bo", "delay", "ear", 110.0)
    for number in range(MOST_FACTS):
        run.state("fan", "late" if number % 2 else "active", "", 111.0)
    assert len(run.facts) == MOST_FACTS
    assert run.left_out > 50
    run.end("its time is over", 190.0)
    assert run.facts[-1].what is MissionEventKind.ENDED, "the end is always noted"


FACTS = st.builds(
    MissionEvent,
    st.floats(0, 300),
    st.sampled_from(MissionEventKind),
    st.sampled_from(["", "Bo"]),
    st.sampled_from([1, 2]),
    st.sampled_from(["fan", "knob", ""]),
    st.sampled_from([*KINDS]),
)


@given(st.lists(FACTS, max_size=30))
def test_marks_are_within_bounds_and_the_same_for_the_same_notes(facts: list[MissionEvent]) -> None:
    mission = parse_mission(TWO, "two.toml")
    facts = [fact for fact in facts if fact.what is not MissionEventKind.REPAIRED]
    found = grade(mission, drawn(mission, 1), facts)
    assert 0 <= found.marks <= found.of <= 24
    assert grade(mission, drawn(mission, 1), facts) == found


def test_a_played_mission_survives_json_with_its_sentences() -> None:
    run = begun()
    run.name("Bo", "loss", "fan", 110.0)
    run.end(said("{who} has stopped it", who="Ada"), 115.0)
    played = PlayedMission(3, run.mission, 1, 1_700_000_000_000, tuple(run.facts))
    again = played_from_json(json.loads(json.dumps(played.as_json())))
    assert again.grade() == played.grade()
    assert grade_json(again) == grade_json(played)
    assert isinstance(again.facts[-1].text, Sentence)
    for bad in ({}, {"at_s": "x"}, {**run.facts[0].as_json(), "what": "explode"}):
        with pytest.raises(RemoteProtocolError):
            events_from_json([bad])
    with pytest.raises(RemoteProtocolError):
        played_from_json({"number": "one"})


def test_chance_draws_the_same_for_the_same_seed_and_all_of_it() -> None:
    mission = ready_mission("a-bad-day")
    assert drawn(mission, 5) == drawn(mission, 5)
    seen = {(one.kind, one.at) for seed in range(60) for one in drawn(mission, seed)}
    assert {kind for kind, _ in seen} == {"stuck", "drift", "loss", "duplicates", "slow-consumer"}
    assert {at for _, at in seen} == {"knob", "ear", "fan", "hand"}


def test_contradictions_are_drawn_away() -> None:
    mission = parse_mission(
        '[mission]\ntitle = "T"\nstory = "S"\n' + '[[fault]]\nkind = ["unplug", "loss"]\nat = ["fan", "knob"]\n' * 2,
        "x.toml",
    )
    for seed in range(30):
        one, other = drawn(mission, seed)
        assert not contradiction_of(one, other), seed


# Files.


def test_every_kind_has_a_ready_mission_of_its_own_and_a_repair() -> None:
    missions = ready_missions()
    alone = [one.faults[0].kinds for one in missions.values() if len(one.faults) == 1]
    assert sorted(alone) == sorted((kind,) for kind in KINDS)
    mended = {kind for repair in REPAIRS.values() for kind in repair.mends}
    assert mended == set(KINDS)
    for repair in REPAIRS.values():
        assert {KINDS[kind].at_part for kind in repair.mends} == {repair.at_part}, repair.name
    for name, one in missions.items():
        told = " ".join((one.title, one.story, *one.hints, name)).casefold()
        for fault in one.faults:
            assert not any(kind in told for kind in fault.kinds if "-" in kind), "the answer is not told"
        assert one.hints, name
        assert one.explanation, name


def played_with(mission: Mission, answers: Callable[[DrawnFault], list[tuple[str, str]]]) -> PlayedMission:
    """A mission in which each fault is mended, and before that people have said something of it."""
    notes: list[MissionEvent] = []
    run = MissionRun(mission, drawn(mission, 7), "Ada", 0.0, on_fact=notes.append)
    for task, number in zip(mission.tasks, range(1, 99), strict=False):
        if task.until:
            run.holds(number, 0.0, holds=True)
    for fault in run.faults:
        run.fault_began(fault.number, 5.0)
    for task in mission.tasks:
        if task.operation:
            run.act(task.operation, task.arguments, "Bo", "", 6.0)
    for fault in run.faults:
        for kind, at in answers(fault):
            run.name("Bo", kind, at, 10.0)
    for fault in run.faults:
        repair = next(one.name for one in REPAIRS.values() if fault.kind in one.mends)
        assert run.repair("Bo", repair, fault.at, 15.0)[1] == fault.number
        run.fault_over(fault.number, 15.0, "mended", is_mended=False)
    run.end(run.why_over(16.0) or said("its time is over"), 16.0)
    written = json.loads(json.dumps([fact.as_json() for fact in notes]))  # as the recorder has them
    return PlayedMission(1, mission, 7, 1, tuple(events_from_json(written)))


@pytest.mark.parametrize("name", ready_missions())
def test_each_ready_mission_is_graded_from_its_notes(name: str) -> None:
    mission = ready_mission(name)
    right = played_with(mission, lambda fault: [(fault.kind, fault.at)]).grade()
    assert (right.percent, right.reason) == (100.0, "everything is found and done")
    assert all(one.found_by == "Bo" and one.is_quick for one in right.faults)
    kinds_there = {fault.kind for fault in drawn(mission, 7)}
    for kind in sorted(set(KINDS) - kinds_there):
        wrong = played_with(mission, lambda fault, kind=kind: [(kind, fault.at or "fan")]).grade()  # type: ignore[misc]
        assert not any(one.found_by for one in wrong.faults), kind
        assert wrong.reason == "its time is over", kind
        assert wrong.marks < right.marks - len(wrong.faults) * mission.marks.kind, kind
    if all(fault.at for fault in mission.faults):
        elsewhere = played_with(mission, lambda fault: [(fault.kind, "nowhere")]).grade()
        assert not any(one.found_by or one.place_by for one in elsewhere.faults)
        assert len(elsewhere.wrong) == len(mission.faults)
    nothing = played_with(mission, lambda _: []).grade()
    assert not any(one.found_by for one in nothing.faults)
    assert nothing.marks < right.marks


@pytest.mark.parametrize(
    ("wrong", "right", "words"),
    [
        (
            'kind = "loss"',
            'kind = "los"',
            "x.toml, line 10, fault[0].kind: there is no fault 'los'; did you mean loss?",
        ),
        ('at = "fan"', "", 'x.toml, line 10, fault[0].kind: loss is planted at a part: add at = "SLOT"'),
        ('kind = "loss"', 'kind = "babbling"', "line 11, fault[0].at: babbling concerns the whole robot: remove it"),
        ('at = "fan"', 'at = "fan"\namount = 200', "line 12, fault[0].amount: is 200; it must be 0.1 to 100 %"),
        ('at = "knob"', 'at = "knob"\namount = 2', "fault[1].amount: stuck has no amount: remove it"),
        ('at = "fan"', 'at = "fan"\njitter_ms = 2', "fault[0].jitter_ms: loss knows no jitter_ms: remove it"),
        ('at = "fan"', 'at = "fan"\nwhen = "fan flies"', "fault[0].when: the condition 'fan flies' cannot be read"),
        ('at = "fan"', 'at = "fan"\nafter_s = 99', "fault[0].after_s: is 99; it must be 0 to 90 s"),
        ("time_s = 90", "time_s = 9000", "line 5, mission.time_s: is 9000; it must be more than 0 to 3600 s"),
        ('title = "T"', "", "line 2, mission.title: is missing; add a line such as title ="),
        ('title = "T"', f'title = "{"x" * 101}"', "mission.title: is 101 characters long; shorten it to 100"),
        ('["look", "look again"]', '"look"', "mission.hints: must be a list of texts, for example hints ="),
        ('avoid = ["swap"]', 'avoid = ["fly"]', "mission.avoid[0]: there is no operation 'fly'; there are adopt"),
        ('operation = "identify"', 'operation = "why"', "why only asks: nobody notes who did"),
        ('{ part = "fan" }', '{ slot = "fan" }', "do[0].with.slot: identify knows no slot; it takes part"),
        ('until = "fan is active"', "", "do[1]: either operation or until must be there"),
        ("[mission]", "[missoin]", "there is no such key here; did you mean mission?"),
        ('story = "S"', 'story = "S"\nstroy = "S"', "mission.stroy: there is no such key here"),
        (
            'kind = "stuck"\nat = "knob"',
            'kind = "unplug"\nat = "fan"',
            "fault[1]: contradicts fault[0]: while fan is cut off there is nothing of it that could be disturbed",
        ),
    ],
)
def test_mistakes_name_line_and_remedy(wrong: str, right: str, words: str) -> None:
    assert wrong in TWO
    with pytest.raises(ConfigError) as caught:
        parse_mission(TWO.replace(wrong, right, 1), "x.toml")
    assert words in str(caught.value).replace('"mission"', "mission")


def test_a_mission_without_faults_and_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"in a mission something goes wrong: add a \[\[fault\]\]"):
        parse_mission('[mission]\ntitle = "T"\nstory = "S"\n', "x.toml")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_mission(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_bytes(b"\xff")
    with pytest.raises(ConfigError, match=r"bad\.toml: is no text in UTF-8; save it as UTF-8"):
        load_mission(tmp_path / "bad.toml")
    with pytest.raises(ConfigError, match=r"there is no mission 'x'; .*; there are a-bad-day"):
        ready_mission("x")


def test_the_mission_of_the_guide_is_right() -> None:
    guide = (ROOT / "docs/howto/missions.md").read_text()
    mission = parse_mission(guide.split("```toml\n")[1].split("```")[0], "guide.toml")
    assert mission.faults[0].kinds == ("loss", "delay")
    assert mission.marks.quick_s == 60
    assert isinstance(grade(mission, drawn(mission, 1), []), Grade)
