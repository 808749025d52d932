"""A class at a running robot: groups with slots of their own, freeze all, take over, hand back, raised hands.

Which part is a pupil's, and what it may do while it is held, is decided in `msbot.pnp.pupils` and at the agent's gate;
here people say so, and what pupils do by operations is checked against the same rules.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from msbot.operations.manual_control import ManualControl
from msbot.operations.operation import Operation, Outcome
from msbot.operations.rights import Principal, Right
from msbot.operations.running_robot import RunningRobot, slot_of
from msbot.operations.teaching_operations import Lessons
from msbot.pnp import Freeze, Group, TakeOverByTeacher
from msbot.registry import EditKind, Registry, RobotRecord
from msbot.registry.reserved_names import check_name
from msbot_agent.text.sentence import counted, said
from msbot_xrce.errors import ConfigError, NotThere

MOST_GROUPS = 100
MOST_PUPILS = 1000
"""In all groups; as many as a class list has."""
MOST_HANDS = 200
MOST_TAKEN = 200
_OF_A_SLOT = ("slot", "port", "part", "at")
"""Arguments that say at which slot something is done; an empty one: at the robot as a whole."""
_WITHOUT_SLOT = frozenset(
    {
        "undo",
        "pause_world",
        "step_world",
        "reset_world",
        "world_speed",
        "put_robot",
        "repair",
        "answer_mission",
        "mission_hint",
        "publish_topic",
    }
)
"""What a pupil who is held cannot do either."""
EndWhere = Callable[[Callable[[str, str], bool]], object]
"""Lets go of what people hold by hand, of which `(slot, who holds it)` is true."""


class ClassControl:
    """The operations of a class.

    Args:
        running: the robot.
        lessons: who takes part in which.
        by_hand: what people hold.
        slots_that_hear: the slots that a topic's messages go to.
    """

    def __init__(
        self,
        running: RunningRobot,
        lessons: Lessons,
        by_hand: ManualControl,
        slots_that_hear: Callable[[str], Iterable[str]],
    ) -> None:
        self._running = running
        self._slots_that_hear = slots_that_hear
        self._lessons = lessons
        self._by_hand = by_hand
        self._pupils = running.inventory.pupil_parts.pupils
        self._hands: dict[str, float] = {}
        """Who asks for help -> since when, on the robot's clock."""
        self._drivers: dict[str, None] = {}
        """Pupils who have driven ports, or simulated parts, by hand since the last freeze, the latest last."""
        self._ends: list[EndWhere] = [by_hand.end_where]
        self._people: Callable[[], Iterable[str]] = tuple
        if running.registry is not None and running.robot is not None:
            self._pupils.use_groups(running.registry.runs.store(running.robot).groups)

    def forget(self, pupil: str) -> None:
        """A person is removed: whoever has that name later is in no group, and nobody holds them."""
        self._hands.pop(pupil, None)
        self.end_holds(pupil)
        self._drivers.pop(pupil, None)
        self._pupils.taken.pop(pupil, None)
        if self._pupils.group_of(pupil):
            groups = (replace(one, pupils=tuple(name for name in one.pupils if name != pupil)) for one in self.groups)
            self._pupils.use_groups([one for one in groups if one.pupils or one.slots])
        self._follow()

    def end_holds(self, person: str) -> None:
        """End what somebody drives by hand: they are removed, or may do less from now on."""
        self._end_where(lambda _slot, who: who == person)

    def use_holds(self, end_where: EndWhere) -> None:
        """Say what else people hold by hand: it is let go of whenever a pupil's hold on a port is."""
        self._ends.append(end_where)

    def drives(self, pupil: str) -> None:
        """A pupil drives something by hand."""
        self._drivers.pop(pupil, None)
        self._drivers[pupil] = None
        if len(self._drivers) > MOST_PUPILS:
            self._forget_a_driver()

    def use_people(self, people: Callable[[], Iterable[str]]) -> None:
        """Say who can sign in besides those who are here."""
        self._people = people

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups, by name."""
        return self._pupils.groups

    @property
    def hands(self) -> Mapping[str, float]:
        """Who asks for help -> for how many seconds, the longest first."""
        now = self._running.now()
        return {who: now - since for who, since in self._hands.items()}

    def held(self, pupil: str) -> str:
        """Why a pupil's programs are held, in a sentence; empty: they are not."""
        return self._pupils.held(pupil)

    def taken_by(self, pupil: str) -> TakeOverByTeacher | None:
        """The teacher who has a pupil's program; None: nobody."""
        return self._pupils.taken.get(pupil)

    @property
    def frozen(self) -> Freeze | None:
        """Who has frozen the class; None: nobody."""
        return self._pupils.freeze

    @property
    def freeze_words(self) -> str:
        """Who has frozen the class and why, in a sentence; empty: nobody."""
        return self._pupils.freeze_words

    def group_of(self, pupil: str) -> str:
        """The group of a pupil; empty: none."""
        return self._pupils.group_of(pupil)

    # Checks

    def check(self, asker: Principal, row: Operation, given: Mapping[str, object]) -> None:
        """Check that a pupil may do this now, at this slot.

        Raises:
            ConfigError: the slot is another group's, or a teacher holds the pupil's programs.
        """
        if asker.may(Right.ARRANGE) or row.right not in (Right.OPERATE, Right.SET):
            return
        word = next((str(given[name]) for name in _OF_A_SLOT if given.get(name)), None)
        if word is not None:
            self.check_slot(asker.name, self._slot_meant(word, is_port="port" in given))
        elif row.name in _WITHOUT_SLOT and (held := self._pupils.held(asker.name)):
            raise ConfigError(held)
        if row.name == "publish_topic":
            for slot in self._slots_that_hear(str(given["topic"])):
                self.check_slot(asker.name, slot)
        if given.get("part"):
            self._running.check_named(str(given["part"]))
        if row.name == "publish":
            self.drives(asker.name)

    def check_slot(self, pupil: str, slot: str) -> None:
        """Check that a pupil may do something with a slot now.

        Raises:
            ConfigError: the slot is another group's, or a teacher holds the pupil's programs.
        """
        if words := self._pupils.why_not(pupil, slot):
            raise ConfigError(words)

    def _slot_meant(self, word: str, *, is_port: bool) -> str:
        """The slot of an argument; what is none is refused by the operation itself."""
        name = word.rpartition(".")[0] if is_port else word
        try:
            return slot_of(self._running, name)
        except NotThere:
            parts = self._running.inventory.find(word, self._running.now(), by_name=True)
            return next((info.slot for info in parts if info.slot), name)

    # Freezing

    def freeze(self, reason: str, who: str) -> Outcome:
        """Hold the programs of all pupils, those that come later too, until `thaw`."""
        self._pupils.freeze = Freeze(who, reason, self._running.now())
        self._follow()
        self._end_where(lambda _slot, who: who in self._drivers)
        self._drivers.clear()
        here = sum(bool(slots) for slots in self._running.inventory.pupil_parts.here().values())
        words = counted(
            here,
            "the class is frozen: {count} pupil's program is held",
            "the class is frozen: {count} pupils' programs are held",
        )
        self._note(said("{words}: {reason}", words=words, reason=reason) if reason else words, who)
        return Outcome(words)

    def thaw(self, who: str) -> Outcome:
        """Let the pupils' programs go on.

        Raises:
            ConfigError: the class is not frozen.
        """
        if self._pupils.freeze is None:
            raise ConfigError(said("the class is not frozen"))
        self._pupils.freeze = None
        self._follow()
        words = said("the class goes on")
        self._note(words, who)
        return Outcome(words)

    # One pupil

    def take_over(self, pupil: str, run: bool, who: str) -> Outcome:
        """Take a pupil's program: it is held, or runs under the teacher's hands.

        Raises:
            ConfigError: there is no such person.
        """
        known = {*self._people(), *self._running.inventory.pupil_parts.here(), *self._hands}
        known |= {one for group in self.groups for one in group.pupils}
        if pupil not in known:
            raise NotThere(said("there is no pupil {pupil!r} here", pupil=pupil))
        taken = self._pupils.taken
        before = taken.get(pupil)
        if before is None and len(taken) >= MOST_TAKEN:
            raise ConfigError(said("{most} programs are taken over already: hand some back", most=MOST_TAKEN))
        since = before.at if before is not None and before.by == who else self._running.now()
        taken[pupil] = TakeOverByTeacher(who, since, run)
        self._hands.pop(pupil, None)
        self._follow()
        if not run:
            self.end_holds(pupil)
        words = (
            said("the program of {pupil} runs under the hands of {who}", pupil=pupil, who=who)
            if run
            else said("the program of {pupil} is held by {who}", pupil=pupil, who=who)
        )
        self._note(words, who)
        return Outcome(words)

    def hand_back(self, pupil: str, who: str) -> Outcome:
        """Give a pupil the program back.

        Raises:
            ConfigError: nobody has it.
        """
        if self._pupils.taken.pop(pupil, None) is None:
            raise ConfigError(said("nobody has taken over the program of {pupil}", pupil=pupil))
        self._follow()
        words = said("{pupil} has the program back", pupil=pupil)
        self._note(words, who)
        return Outcome(words)

    def hand(self, down: bool, who: str) -> Outcome:
        """Put one's hand up, or down; in a lesson, the lesson knows it, too.

        Raises:
            ConfigError: too many are up.
        """
        words = self._lessons.raise_hand(who, up=not down)
        if down:
            self._hands.pop(who, None)
            return Outcome(words or said("{who} asks for nothing", who=who))
        if who not in self._hands and len(self._hands) >= MOST_HANDS:
            raise ConfigError(said("more than {most} hands are up", most=MOST_HANDS))
        self._hands.setdefault(who, self._running.now())
        return Outcome(words or said("{who} asks for help", who=who))

    def answer_hand(self, pupil: str) -> None:
        """Take a pupil's hand down: the teacher has seen it."""
        self._hands.pop(pupil, None)
        self._lessons.raise_hand(pupil, up=False)

    # Groups

    async def group(self, group: str, pupils: list[str], slots: list[str], who: str) -> Outcome:
        """Make a group of these pupils and slots, or change it; they leave the groups that they were in.

        Raises:
            ConfigError: a name will not do, it would have nothing, or there are too many.
            RegistryError: it cannot be stored; nothing has changed.
        """
        groups_now = [one.name for one in self.groups]
        if group not in groups_now:
            check_name(group, groups_now)
        people = {*self._people(), *(name for one in self.groups for name in one.pupils)}
        for name in pupils:
            if name not in people:
                check_name(name)
        if not pupils and not slots:
            raise ConfigError(said("group {group} needs a pupil or a slot", group=group))
        mine = Group(
            group, tuple(dict.fromkeys(pupils)), tuple(dict.fromkeys(slot_of(self._running, slot) for slot in slots))
        )
        others = [
            replace(
                one,
                pupils=tuple(name for name in one.pupils if name not in mine.pupils),
                slots=tuple(name for name in one.slots if name not in mine.slots),
            )
            for one in self.groups
            if one.name != group
        ]
        groups = [one for one in (*others, mine) if one.pupils or one.slots]
        if len(groups) > MOST_GROUPS or sum(len(one.pupils) for one in groups) > MOST_PUPILS:
            raise ConfigError(
                said("a robot has at most {groups} groups with {pupils} pupils", groups=MOST_GROUPS, pupils=MOST_PUPILS)
            )
        await self._use(groups)
        nobody = said("nobody")
        words = said(
            "group {group}: {pupils}; its slots: {slots}",
            group=group,
            pupils=", ".join(mine.pupils) or nobody,
            slots=", ".join(mine.slots) or said("none"),
        )
        self._note(words, who)
        return Outcome(words)

    async def remove_group(self, group: str, who: str) -> Outcome:
        """Take a group away: its slots are everybody's.

        Raises:
            NotThere: there is no such group.
            RegistryError: it cannot be stored; nothing has changed.
        """
        if all(one.name != group for one in self.groups):
            raise NotThere(said("there is no group {group!r}", group=group))
        await self._use([one for one in self.groups if one.name != group])
        words = said("group {group} is gone: its slots are everybody's", group=group)
        self._note(words, who)
        return Outcome(words)

    def classroom(self, who: str) -> Outcome:  # noqa: ARG002 - as every operation that is no question for everybody
        """Groups, pupils, who is held and why, whose hand is up."""
        here, hands = self._running.inventory.pupil_parts.here(), self.hands
        names = sorted({*here, *hands, *self._pupils.taken, *(one for group in self.groups for one in group.pupils)})
        freeze = self._pupils.freeze
        return Outcome(
            answer={
                "frozen": None if freeze is None else {"by": freeze.by, "reason": freeze.reason},
                "groups": [
                    {"group": one.name, "pupils": list(one.pupils), "slots": list(one.slots)} for one in self.groups
                ],
                "pupils": [
                    {
                        "pupil": name,
                        "group": self._pupils.group_of(name),
                        "slots": list(here.get(name, ())),
                        "runs": name in here,
                        "held": self._pupils.held(name),
                        "hand_s": hands.get(name),
                        "taken_by": taken.by if (taken := self._pupils.taken.get(name)) else "",
                    }
                    for name in names
                ],
            }
        )

    # Helpers

    def _follow(self) -> None:
        self._running.inventory.pupil_parts.follow(self._running.now())

    async def _use(self, groups: list[Group]) -> None:
        if self._running.registry is not None and self._running.robot is not None:

            def keep(registry: Registry, robot: RobotRecord) -> None:
                registry.class_groups.replace(robot, groups)

            await self._running.read(keep)
        self._pupils.use_groups(groups)
        self._running.inventory.pupil_parts.regroup(self._running.now())
        self._end_where(lambda slot, who: who in self._drivers and not self._pupils.may_use(who, slot))

    def _forget_a_driver(self) -> None:
        """Forget the one who has driven nothing for longest, and holds nothing now: nothing of theirs could go on."""
        holders: set[str] = set()

        def note(_slot: str, who: str) -> bool:
            holders.add(who)
            return False

        self._end_where(note)
        latest = next(reversed(self._drivers))
        idle = next((who for who in self._drivers if who not in holders and who != latest), None)
        if idle is not None:
            del self._drivers[idle]

    def _end_where(self, is_over: Callable[[str, str], bool]) -> None:
        for end_where in self._ends:
            end_where(is_over)

    def _note(self, words: str, who: str) -> None:
        self._running.note(EditKind.CLASS, words, who)
