"""The report of a mission as HTML: marks, times, wrong acts and what happened when; alone on a page, to be printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

from msbot_agent.text.sentence import said
from msbot_school.faults.fault_kinds import KINDS
from msbot_school.missions.grading import FaultGrade, Grade, place_words
from msbot_school.missions.mission import REPAIRS, MissionEvent, MissionEventKind
from msbot_school.missions.recorded_missions import PlayedMission
from msbot_web.html import Markup, render
from msbot_web.language import Language, languages
from msbot_web.svg.wiring_graph import STATE_COLOURS, shortened
from msbot_xrce.errors import ConfigError

_WIDTH, _LEFT, _RIGHT, _ROW = 1000, 150, 20, 26
_TICKS = 8
_STEPS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600)
"""Seconds between the lines of the time scale."""
_LIGHT = {STATE_COLOURS[state] for state in ("late", "new", "empty")}
_MARKS = {
    MissionEventKind.NAMED: ("#0b6e99", "?"),
    MissionEventKind.REPAIRED: ("#5a4bb0", "R"),
    MissionEventKind.HINT: ("#8a5a00", "!"),
    MissionEventKind.ACT: ("#5b6b78", "A"),
    MissionEventKind.LOOKED: ("#b3261e", "L"),
}
"""Colour and letter of what people did; the list below says it in words."""


def page_in(played: PlayedMission, code: str) -> str:
    """The page of `msbot mission report --html`.

    Raises:
        ConfigError: there is no language of that code.
    """
    if code not in languages():
        raise ConfigError(f"--language: there is no language {code!r}; there are {', '.join(languages())}")
    return report_page(played, languages()[code])


def report_page(played: PlayedMission, language: Language) -> str:
    """A whole HTML page that needs nothing else."""
    body = report_body(played, language, heading="h1")
    return render("mission_page", code=language.code, title=language.translate(played.mission.title), body=body)


def report_body(played: PlayedMission, language: Language, *, heading: str = "h2") -> Markup:
    """The report for a page that is there already; `heading` is the element of its title."""
    found, say = played.grade(), language.translate
    return render(
        "mission_report",
        heading=heading,
        say=say,
        number=language.number,
        mission=played.mission,
        found=found,
        seed=played.seed,
        who=played.who,
        began=datetime.fromtimestamp(played.began_ms / 1000).strftime("%Y-%m-%d %H:%M"),
        reason=say(found.reason) if found.reason else say("it was broken off"),
        faults=[_fault(one, language) for one in found.faults],
        people=_people(played.facts),
        steps=_steps(played.facts, language),
        picture=_picture(played, found, language),
    )


def _fault(one: FaultGrade, language: Language) -> Mapping[str, object]:
    say = language.translate
    kind = said("{kind}: {words}", kind=one.fault.kind, words=KINDS[one.fault.kind].words)
    what = say(place_words(kind, one.fault.at))
    if one.began_s is None:
        return {"what": what, "found": say("never began"), "mended": "", "marks": one.marks, "of": one.of}
    found = say("not to be named") if not one.fault.find else say("nobody")
    if one.found_s is not None:
        found = say("{who}, after {seconds:.0f} s", who=one.found_by, seconds=one.found_s)
        if one.is_quick:
            found = say("{found} (quick)", found=found)
        if one.is_looked_up:
            found = say("{found} (after the answers were looked up)", found=found)
    elif one.place_by:
        found = say("only the place, by {who}", who=one.place_by)
    mended = say("not to be mended") if not one.fault.mend else say("nobody")
    if one.mended_s is not None:
        how = REPAIRS[one.mended_how].words if one.mended_how else said("at the part itself")
        mended = say("{who}, after {seconds:.0f} s: {how}", who=say(one.mended_by), seconds=one.mended_s, how=how)
    return {"what": what, "found": found, "mended": mended, "marks": one.marks, "of": one.of}


def _people(facts: Sequence[MissionEvent]) -> list[str]:
    """Who took part, in the order in which they first did something."""
    doing = (MissionEventKind.NAMED, MissionEventKind.REPAIRED, MissionEventKind.HINT, MissionEventKind.ACT)
    return list(dict.fromkeys(fact.who for fact in facts if fact.what in doing and fact.who))


def _steps(facts: Sequence[MissionEvent], language: Language) -> list[tuple[str, str, str]]:
    """(time, who, what) of what people did and of the faults, in their order."""
    found = []
    for fact in facts:
        words = _step(fact)
        if words:
            found.append((language.number(fact.at_s, ".0f"), language.translate(fact.who), language.translate(words)))
    return found


def _step(fact: MissionEvent) -> str:
    match fact.what:
        case MissionEventKind.BEGAN:
            return said("the mission begins")
        case MissionEventKind.FAULT_BEGAN:
            return said("fault {number} begins", number=fact.number)
        case MissionEventKind.FAULT_OVER:
            return said("fault {number} is over ({reason})", number=fact.number, reason=fact.text)
        case MissionEventKind.NAMED | MissionEventKind.REPAIRED | MissionEventKind.ACT:
            return fact.text
        case MissionEventKind.HINT:
            return said("hint {number}", number=fact.number)
        case MissionEventKind.LOOKED:
            return said("has looked the answers up")
        case MissionEventKind.ENDED:
            return said("the mission is over ({reason})", reason=fact.text)
        case _:
            return ""


def _picture(played: PlayedMission, found: Grade, language: Language) -> Markup:
    """Faults, states of the slots and what people did, over time."""
    span_s = max(found.seconds, 1.0)
    room = _WIDTH - _LEFT - _RIGHT

    def x(at_s: float) -> float:
        return round(_LEFT + room * min(at_s, span_s) / span_s, 1)

    def bar(begin_s: float, end_s: float, colour: str, words: str) -> Mapping[str, object]:
        ink = "#10202c" if colour in _LIGHT else "#fff"
        return {
            "ink": ink,
            "x": x(begin_s),
            "width": max(x(end_s) - x(begin_s), 2),
            "colour": colour,
            "words": language.translate(words),
        }

    lanes: list[Mapping[str, object]] = [
        {
            "name": language.translate("fault {number}", number=one.fault.number),
            "marks": [],
            "bars": []
            if one.began_s is None
            else [
                bar(one.began_s, span_s if one.over_s is None else one.over_s, "#b92f26", KINDS[one.fault.kind].words)
            ],
        }
        for one in found.faults
    ]
    slots = dict.fromkeys(
        [*played.mission.needs, *(one.slot for one in played.facts if one.what is MissionEventKind.NAMED)]
    )
    for slot in slots:
        if slot:
            lanes.append({"name": shortened(slot, 18), "marks": [], "bars": _states(played.facts, slot, span_s, bar)})
    marks = [
        {
            "x": x(fact.at_s),
            "colour": _MARKS[fact.what][0],
            "letter": _MARKS[fact.what][1],
            "words": language.translate(_step(fact)),
        }
        for fact in played.facts
        if fact.what in _MARKS
    ]
    lanes.append({"name": language.translate("people"), "bars": [], "marks": marks})
    step_s = next((one for one in _STEPS_S if span_s / one <= _TICKS), _STEPS_S[-1])
    ticks = [
        (x(step_s * number), language.number(step_s * number, ".0f")) for number in range(int(span_s / step_s) + 1)
    ]
    return render(
        "mission_picture",
        say=language.translate,
        width=_WIDTH,
        left=_LEFT,
        height=34 + _ROW * len(lanes),
        row=_ROW,
        lanes=lanes,
        ticks=ticks,
    )


def _states(facts: Sequence[MissionEvent], slot: str, span_s: float, bar: object) -> list[Mapping[str, object]]:
    assert callable(bar)
    states = [fact for fact in facts if fact.what is MissionEventKind.STATE and fact.slot == slot]
    ends = [*(fact.at_s for fact in states[1:]), span_s]
    return [
        bar(fact.at_s, end, STATE_COLOURS.get(fact.word, "#666"), said(fact.word))
        for fact, end in zip(states, ends, strict=False)
    ]
