"""Pupils of a class at one robot: which groups have which slots, and whose programs are held. Pure.

A pupil's part is one that came in by the page, for somebody who may not arrange parts. It gets a slot of the pupil's
group, or one of nobody, and while it is held it neither writes nor reads any topic of the robot. STOP is independent of
all this: a held part hears it, and confirms it, like any other.
"""

from __future__ import annotations

from collections.abc import Iterable

from msbot_agent.text.sentence import said
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Group:
    """Pupils, and the slots that only they may use."""

    name: str
    pupils: tuple[str, ...] = ()
    slots: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Freeze:
    """All pupils' programs are held."""

    by: str
    reason: str
    at: float
    """On the robot's clock, seconds."""


@dataclass(frozen=True, slots=True)
class TakeOverByTeacher:
    """A teacher has a pupil's program."""

    by: str
    at: float
    """On the robot's clock, seconds."""
    runs: bool = False
    """Whether it works under the teacher's hands; else it is held."""


class Pupils:
    """See the module's docstring."""

    def __init__(self) -> None:
        self.freeze: Freeze | None = None
        """None: nobody has frozen the class."""
        self.taken: dict[str, TakeOverByTeacher] = {}
        """Pupil -> who has the pupil's program."""
        self._groups: dict[str, Group] = {}
        self._group_of_pupil: dict[str, str] = {}
        self._group_of_slot: dict[str, str] = {}

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups, by name."""
        return tuple(self._groups[name] for name in sorted(self._groups))

    def use_groups(self, groups: Iterable[Group]) -> None:
        """From now on these are the groups; a pupil or slot that is in several belongs to the last."""
        self._groups = {group.name: group for group in groups}
        self._group_of_pupil = {pupil: group.name for group in self._groups.values() for pupil in group.pupils}
        self._group_of_slot = {slot: group.name for group in self._groups.values() for slot in group.slots}

    def group_of(self, pupil: str) -> str:
        """The group of a pupil; empty: none."""
        return self._group_of_pupil.get(pupil, "")

    def group_of_slot(self, slot: str) -> str:
        """The group that a slot belongs to; empty: everybody's."""
        return self._group_of_slot.get(slot, "")

    def is_own(self, pupil: str, slot: str) -> bool:
        """Whether a slot belongs to the pupil's group."""
        group = self.group_of(pupil)
        return bool(group) and self.group_of_slot(slot) == group

    def may_use(self, pupil: str, slot: str) -> bool:
        """Whether a pupil may use a slot; whoever is no pupil (an empty name) may use all."""
        return not pupil or self.group_of_slot(slot) in ("", self.group_of(pupil))

    def why_not(self, pupil: str, slot: str) -> str:
        """Why a pupil may not do anything with a slot now, in a sentence; empty: nothing is in the way."""
        if not self.may_use(pupil, slot):
            return said("slot {slot} belongs to group {group}", slot=slot, group=self.group_of_slot(slot))
        return self.held(pupil)

    @property
    def freeze_words(self) -> str:
        """Who has frozen the class and why, in a sentence; empty: nobody."""
        if self.freeze is None:
            return ""
        words = said("the class is frozen by {by}", by=self.freeze.by)
        return said("{words}: {reason}", words=words, reason=self.freeze.reason) if self.freeze.reason else words

    def held(self, pupil: str) -> str:
        """Why the pupil's programs are held, in a sentence; empty: they are not."""
        if not pupil:
            return ""
        taken = self.taken.get(pupil)
        if taken is not None:
            return "" if taken.runs else said("{by} has taken over the program of {pupil}", by=taken.by, pupil=pupil)
        return self.freeze_words
