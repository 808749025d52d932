"""A mission that runs: what people say and do becomes notes, and it is over when it should be. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from msbot_agent.text.sentence import said
from msbot_school.faults.fault_kinds import kind_named
from msbot_school.missions.grading import VERDICTS, Grade, grade, judged, place_words
from msbot_school.missions.mission import DrawnFault, Mission, MissionEvent, MissionEventKind, repair_named
from msbot_xrce.errors import ConfigError

MOST_FACTS: Final = 2000
"""Notes of acts and states that are kept; answers, repairs and hints have limits of their own."""
MOST_ANSWERS: Final = 50
MOST_REPAIRS: Final = 50


class MissionRun:
    """See the module's docstring.

    Args:
        mission: what is to be done.
        faults: its faults as chance has decided them.
        who: who has started it.
        now: seconds.
        on_fact: called with every note.
    """

    def __init__(
        self,
        mission: Mission,
        faults: Sequence[DrawnFault],
        who: str,
        now: float,
        *,
        on_fact: Callable[[MissionEvent], object] = lambda _: None,
    ) -> None:
        self.mission = mission
        self.faults = tuple(faults)
        self.who = who
        self.facts: list[MissionEvent] = []
        self.left_out = 0
        """Notes of acts and states that were too many."""
        self._began_at = now
        self._on_fact = on_fact
        self._there: set[int] = set()
        self._counts = dict.fromkeys(MissionEventKind, 0)
        self._holds: dict[int, bool] = {}
        self._grade: tuple[int, Grade] | None = None
        self.ended = False
        self._note(now, MissionEventKind.BEGAN, who, word=mission.name)

    # What happens.

    def fault_began(self, number: int, now: float) -> None:
        """A fault of the mission is there."""
        self._there.add(number)
        self._note(now, MissionEventKind.FAULT_BEGAN, number=number)

    def fault_over(self, number: int, now: float, reason: str, *, is_mended: bool, by: str = "") -> None:
        """A fault of the mission is no longer there; `is_mended`: somebody has mended it at the part itself, the person
        `by` if that is known."""
        self._there.discard(number)
        who = (by or said("somebody")) if is_mended else ""
        self._note(
            now, MissionEventKind.FAULT_OVER, who, number=number, word="mended" if is_mended else "", text=reason
        )

    def state(self, slot: str, word: str, reason: str, now: float) -> None:
        """The part in a slot has another state."""
        self._note_if_room(now, MissionEventKind.STATE, slot=slot, word=word, text=reason)

    def act(self, operation: str, arguments: Mapping[str, object], who: str, words: str, now: float) -> None:
        """A person has done something to the robot."""
        given = {name: str(value) for name, value in arguments.items() if value is not None}
        self._note_if_room(now, MissionEventKind.ACT, who, word=operation, text=words, arguments=given)

    def looked(self, who: str, now: float) -> None:
        """Somebody has looked the answers up."""
        self._note_if_room(now, MissionEventKind.LOOKED, who)

    def holds(self, number: int, now: float, *, holds: bool) -> None:
        """Whether the condition of a task holds now."""
        if self._holds.get(number) != holds:
            self._holds[number] = holds
            self._note_if_room(now, MissionEventKind.HOLDS, number=number, word="yes" if holds else "no")

    # What people say.

    def name(self, who: str, kind: str, slot: str, now: float) -> str:
        """Somebody says what is wrong and where; what is to be said to that.

        Raises:
            ConfigError: there is no such kind, or it has been guessed too often.
        """
        known = kind_named(kind)
        if known.at_part and not slot:
            raise ConfigError(said("{kind} is at a part: name its slot", kind=kind))
        if not known.at_part:
            slot = ""
        self._count(
            MissionEventKind.NAMED, MOST_ANSWERS, said("{most} answers were given: that is the most", most=MOST_ANSWERS)
        )
        verdict, _ = judged(self.grade().faults, kind, slot)
        words = said("{what}: {verdict}", what=place_words(known.words, slot), verdict=VERDICTS[verdict])
        self._note(now, MissionEventKind.NAMED, who, slot=slot, word=kind, text=words)
        return words

    def repair(self, who: str, name: str, slot: str, now: float) -> tuple[str, int]:
        """Somebody has something repaired; what is to be said to that, and the fault that it mends (0: none).

        Raises:
            ConfigError: there is no such repair, or it was tried too often.
        """
        repair = repair_named(name)
        if repair.at_part and not slot:
            raise ConfigError(said("{repair} is done at a part: name its slot", repair=name))
        if not repair.at_part:
            slot = ""
        self._count(
            MissionEventKind.REPAIRED,
            MOST_REPAIRS,
            said("{most} repairs were tried: that is the most", most=MOST_REPAIRS),
        )
        mended = next(
            (
                one.number
                for one in self.faults
                if one.number in self._there and one.kind in repair.mends and one.at == slot
            ),
            0,
        )
        what = place_words(repair.words, slot)
        words = (
            said("{what}: that has mended it", what=what)
            if mended
            else said("{what}: done, and nothing has changed", what=what)
        )
        self._note(now, MissionEventKind.REPAIRED, who, number=mended, slot=slot, word=name, text=words)
        return words, mended

    def hint(self, who: str, now: float) -> str:
        """The next hint.

        Raises:
            ConfigError: there is none left.
        """
        given = self.hints_given
        if given >= len(self.mission.hints):
            raise ConfigError(said("there is no hint left"))
        self._note(now, MissionEventKind.HINT, who, number=given + 1)
        return self.mission.hints[given]

    def end(self, reason: str, now: float) -> None:
        """It is over."""
        if not self.ended:
            self.ended = True
            self._note(now, MissionEventKind.ENDED, text=reason)

    # What is asked.

    @property
    def hints_given(self) -> int:
        """How many hints were given."""
        return self._counts[MissionEventKind.HINT]

    @property
    def ends_at(self) -> float:
        """When its time is over."""
        return self._began_at + self.mission.time_s

    def grade(self) -> Grade:
        """The marks so far."""
        if self._grade is None or self._grade[0] != len(self.facts):
            self._grade = len(self.facts), grade(self.mission, self.faults, self.facts)
        return self._grade[1]

    def why_over(self, now: float) -> str:
        """Why it should end now; empty: it should not."""
        if now >= self.ends_at:
            return said("its time is over")
        return said("everything is found and done") if self.grade().is_complete else ""

    # Notes.

    def _count(self, what: MissionEventKind, most: int, refusal: str) -> None:
        if self._counts[what] >= most:
            raise ConfigError(refusal)

    def _note_if_room(self, now: float, what: MissionEventKind, who: str = "", **more: object) -> None:
        if len(self.facts) >= MOST_FACTS:
            self.left_out += 1
        else:
            self._note(now, what, who, **more)

    def _note(self, now: float, what: MissionEventKind, who: str = "", **more: object) -> None:
        self._counts[what] += 1
        fact = MissionEvent(round(now - self._began_at, 3), what, who, **more)  # type: ignore[arg-type]
        self.facts.append(fact)
        self._on_fact(fact)
