"""A class on the page: accounts and tickets of pupils, how everybody is, and the programs that they have open."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from msbot.config import groups_by_slots
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.rights import Principal, Right, Role
from msbot.registry import ProgramSource
from msbot.registry.reserved_names import check_name
from msbot_agent.text.sentence import counted, said
from msbot_school.lessons.progress import LessonProgress
from msbot_web.access.accounts import Accounts
from msbot_web.access.class_list import NewAccount, new_password, read_list
from msbot_web.access.joining import PICTURES
from msbot_web.access.sessions import Session
from msbot_web.access.ticket_codes import TicketCodes
from msbot_web.lessons_view import LessonsView
from msbot_web.models.robot_models import ChangeResult
from msbot_web.programs.programs import ProgramStore, check_program
from msbot_web.programs.robot_words import PYTHON, with_view
from msbot_xrce.errors import ConfigError, NotThere
from msbot_xrce.lazy import dataclass

MOST_SCREENS = 500
"""Open pages Program that are known; of more, the oldest cannot be looked at."""


class ProgramScreen(Protocol):
    """A page Program that a pupil has open."""

    def program(self) -> tuple[str, ProgramSource]:
        """Name and source of the program, as it is being typed."""

    def show(self, text: str) -> None:
        """Put another text in its place."""

    def run(self) -> None:
        """Run what is shown."""

    def stop(self) -> None:
        """End the program."""


@dataclass(frozen=True, slots=True)
class PupilTicket:
    """What is printed for one pupil."""

    name: str
    group: str
    password: str
    """Empty: nobody knows it any more."""
    path: str
    """What the ticket's code leads to, a path of this server."""
    pictures: tuple[tuple[str, str], ...]
    """The pictures by which the pupil comes in, and their words."""


@dataclass(frozen=True, slots=True)
class PupilStatus:
    """How one pupil is."""

    name: str
    group: str
    slots: tuple[str, ...]
    """Those that the pupil's programs hold."""
    runs: bool
    """Whether a program of the pupil is connected."""
    is_open: bool
    """Whether the pupil has the page Program open."""
    held: str
    """Why the pupil's programs are held; empty: they are not."""
    taken_by: str
    hand_s: float | None
    """For how long the hand is up; None: it is not."""
    lesson: str
    """The lesson that the pupil began last, and how far it is; empty: none."""


@dataclass(frozen=True, slots=True)
class GroupStatus:
    """How one group is: without names, for the wall."""

    group: str
    """Empty: those without a group."""
    pupils: tuple[str, ...]
    active: int
    """Slots of the group with an active part."""
    slots: int
    running: int
    """Pupils whose program is connected."""
    hands: int
    done: float
    """How far the group is in the lessons that its pupils began last, 0 to 1."""


class ClassController:
    """See the module's docstring.

    Args:
        accounts: who can sign in.
        operations: what is done to the robot.
        passes: the tickets.
        shelf: where programs are kept.
        learning: how far people are in lessons.
    """

    def __init__(
        self,
        accounts: Accounts,
        operations: InProcessOperations,
        passes: TicketCodes,
        shelf: ProgramStore,
        learning: LessonsView,
    ) -> None:
        self._accounts = accounts
        self._operations = operations
        self._control = operations.pupils
        self._shelf = shelf
        self._learning = learning
        self._screens: dict[str, list[ProgramScreen]] = {}
        self.passes = passes
        """Tickets of pupils and of classes."""
        self._control.use_people(self.pupils)
        accounts.on_gone(self._control.forget)
        accounts.on_role(self._control.end_holds)
        accounts.on_gone(passes.class_tickets.forget_those_of)
        accounts.on_gone(passes.codes.forget_those_of)

    def pupils(self) -> list[str]:
        """Who can sign in as a pupil, by name."""
        return [user.name for user in self._accounts.users() if user.role is Role.STUDENT]

    # What a pupil may do

    def check_slot(self, session: Session, slot: str) -> None:
        """Check that whoever is signed in may do something with a slot now.

        Raises:
            ConfigError: it is another group's, or a teacher holds the person's programs.
        """
        if not session.may(Right.ARRANGE):
            self._control.check_slot(session.name, slot)

    def check_writing(self, session: Session) -> None:
        """Check that whoever is signed in may change the own programs now.

        Raises:
            ConfigError: a teacher has them.
        """
        taken = None if session.may(Right.ARRANGE) else self._control.taken_by(session.name)
        if taken is not None:
            raise ConfigError(said("{by} has taken over the program of {pupil}", by=taken.by, pupil=session.name))

    # Accounts and tickets

    async def add(self, session: Session, text: str, days: int, who: Principal) -> list[PupilTicket]:
        """Make accounts from a list, a name on each line, after a semicolon the group: all of them, or none.

        Raises:
            ConfigError: nobody is in it, somebody is there already, or not so many days.
        """
        self._accounts.require(session, Right.ARRANGE)
        listed = read_list(text)
        known = {one.name: one for one in self._control.groups}
        spelt = {one.casefold(): one for one in known}
        for _, group, _ in listed:  # before anybody is let in
            if group and group.casefold() not in spelt:
                check_name(group, known)
        people = [NewAccount(name, Role.STUDENT, new_password(), line) for name, _, line in listed]
        await self._accounts.add_people(people, who=session.name)
        groups: dict[str, list[str]] = {}
        for name, group, _ in listed:
            if group:
                groups.setdefault(spelt.setdefault(group.casefold(), group), []).append(name)
        for group, names in groups.items():
            old = known.get(group)
            pupils, slots = ((), ()) if old is None else (old.pupils, old.slots)
            await self._operations.do("group", who=who, group=group, pupils=[*pupils, *names], slots=list(slots))
        passwords = {one.name: one.password for one in people}
        return [self._ticket(name, days, passwords[name]) for name, _, _ in listed]

    def tickets(self, session: Session, days: int) -> list[PupilTicket]:
        """A new ticket for every pupil; those that were printed before stay valid until their time is over.

        Raises:
            ConfigError: there is no pupil, or not so many days.
        """
        self._accounts.require(session, Right.ARRANGE)
        if not (names := self.pupils()):
            raise ConfigError(said("there are no pupils yet: paste a list first"))
        return [self._ticket(name, days, "") for name in names]

    def class_ticket(self, session: Session, places: int) -> tuple[str, str]:
        """A ticket by which pupils of the list come in, and so many others ask to; the path of its link, and its code.

        Raises:
            ConfigError: not so many places.
        """
        self._accounts.require(session, Right.ARRANGE)
        word, _ = self.passes.class_tickets.make(session.name, "/program", places)
        return f"/come?ticket={word}", self.passes.codes.make(session.name, word)

    def waiting(self, session: Session) -> Sequence[str]:
        """Who is not in the list and wants to come in."""
        self._accounts.require(session, Right.ARRANGE)
        return self.passes.waiting.names()

    async def let_in(self, session: Session, names: Sequence[str]) -> ChangeResult:
        """Let them in who wait.

        Raises:
            ConfigError: somebody does not wait, or the name is taken.
        """
        self._accounts.require(session, Right.ARRANGE)
        for name in names:
            await self.passes.let_in(name, session.name)
        return ChangeResult(words=counted(len(names), "{count} pupil is let in", "{count} pupils are let in"))

    def turn_away(self, session: Session, name: str) -> ChangeResult:
        """Do not let somebody in.

        Raises:
            ConfigError: nobody of that name waits.
        """
        self._accounts.require(session, Right.ARRANGE)
        self.passes.turn_away(name)
        return ChangeResult(words=said("{name} is not let in", name=name))

    async def make_groups(self, session: Session, who: Principal) -> ChangeResult:
        """Make the groups that the names of the slots tell; pupils stay where they are.

        Raises:
            ConfigError: the names tell none.
        """
        self._accounts.require(session, Right.ARRANGE)
        found = groups_by_slots([slot.name for slot in self._operations.blueprint.slots])
        if not found:
            raise ConfigError(
                said("the slots tell no groups: `msbot pupils robot` makes a robot with eyes_Red, eyes_Blue and so on")
            )
        pupils = {one.name: one.pupils for one in self._control.groups}
        for group, slots in found.items():
            await self._operations.do("group", who=who, group=group, pupils=list(pupils.get(group, ())), slots=slots)
        return ChangeResult(words=counted(len(found), "{count} group is made", "{count} groups are made"))

    def _ticket(self, name: str, days: int, password: str) -> PupilTicket:
        word = self.passes.make(name, days)
        pictures = tuple(PICTURES[number] for number in self.passes.pictures(name))
        return PupilTicket(name, self._control.group_of(name), password, f"/pass?word={word}", pictures)

    # How everybody is

    async def now(self, session: Session, language: str, here: Mapping[str, tuple[str, ...]]) -> list[PupilStatus]:
        """How every pupil is: those who ask for help first, the longest waiting at the top.

        Args:
            session: who looks.
            language: of the lessons' titles.
            here: pupils who run programs, and the slots of these.
        """
        self._accounts.require(session, Right.ARRANGE)
        lessons = _latest(await self._learning.progress(session, language))
        hands, control = self._control.hands, self._control
        names = {*self.pupils(), *here, *hands, *(name for group in control.groups for name in group.pupils)}
        found = [
            PupilStatus(
                name=name,
                group=control.group_of(name),
                slots=here.get(name, ()),
                runs=name in here,
                is_open=bool(self._screens.get(name)),
                held=control.held(name),
                taken_by=taken.by if (taken := control.taken_by(name)) else "",
                hand_s=hands.get(name),
                lesson=lessons[name].words if name in lessons else "",
            )
            for name in names
        ]
        return sorted(found, key=lambda one: (one.hand_s is None, -(one.hand_s or 0.0), one.group, one.name.casefold()))

    async def groups_now(
        self, session: Session, here: Mapping[str, tuple[str, ...]], active: frozenset[str]
    ) -> list[GroupStatus]:
        """How every group is; those without a group are one, if there are any."""
        self._accounts.require(session, Right.ARRANGE)
        lessons = _latest(await self._learning.progress(session))
        hands = self._control.hands
        groups = [(one.name, one.pupils, one.slots) for one in self._control.groups]
        grouped = {name for _, pupils, _ in groups for name in pupils}
        owned = {slot for _, _, slots in groups for slot in slots}
        rest = tuple(sorted({*here, *hands, *self.pupils()} - grouped))
        free = tuple(slot.name for slot in self._operations.blueprint.slots if slot.name not in owned)
        if rest or (free and not groups):
            groups.append(("", rest, free))
        return [
            GroupStatus(
                group=name,
                pupils=pupils,
                active=len(active.intersection(slots)),
                slots=len(slots),
                running=sum(pupil in here for pupil in pupils),
                hands=sum(pupil in hands for pupil in pupils),
                done=_mean(lessons[pupil].share for pupil in pupils if pupil in lessons),
            )
            for name, pupils, slots in groups
        ]

    # Programs

    def opened(self, pupil: str, screen: ProgramScreen) -> Callable[[], None]:
        """A pupil has opened the page Program; returns what to call when it is closed."""
        screens = self._screens.setdefault(pupil, [])
        screens.append(screen)
        if sum(map(len, self._screens.values())) > MOST_SCREENS:
            self._closed(pupil, screens[0])

        def closed() -> None:
            self._closed(pupil, screen)

        return closed

    def _closed(self, pupil: str, screen: ProgramScreen) -> None:
        screens = self._screens.get(pupil, [])
        if screen in screens:
            screens.remove(screen)
        if not screens:
            self._screens.pop(pupil, None)

    async def program(self, session: Session, pupil: str) -> tuple[str, ProgramSource, bool]:
        """Name and source of a pupil's program, and whether the pupil has it open: else it is the one kept last.

        Raises:
            NotThere: the pupil has none.
        """
        self._accounts.require(session, Right.ARRANGE)
        if screens := self._screens.get(pupil):
            return (*screens[-1].program(), True)
        kept = await self._shelf.of(pupil)
        if not kept:
            raise NotThere(said("{pupil} has no program yet", pupil=pupil))
        return kept[0].name, await self._shelf.source(pupil, kept[0].name), False

    async def keep_as_it_is(self, session: Session, pupil: str) -> ChangeResult:
        """Keep what a pupil has written, before the teacher who has taken over writes: it is an earlier version then.

        Raises:
            ConfigError: it was not taken over by this teacher, or cannot be kept.
        """
        self._accounts.require(session, Right.ARRANGE)
        self._need_taken(session, pupil)
        name, source, is_open = await self.program(session, pupil)
        if is_open:
            check_program(name, source)
            await self._shelf.store(pupil, name, source)
        return ChangeResult(words="")

    def show(self, session: Session, pupil: str, name: str, text: str) -> None:
        """Show a pupil what the teacher writes who has taken over; `write` keeps it, too.

        Raises:
            ConfigError: it was not taken over by this teacher, is too long, or the pupil has another program open.
        """
        self._accounts.require(session, Right.ARRANGE)
        self._need_taken(session, pupil)
        check_program(name, ProgramSource(text))
        if (screen := self._screen_with(pupil, name)) is not None:
            screen.show(text)

    async def write(self, session: Session, pupil: str, name: str, text: str) -> ChangeResult:
        """Put another text in place of a pupil's program that was taken over, and keep it for the pupil.

        A program of blocks is shown as text from then on; the blocks are kept as they were.

        Raises:
            ConfigError: as `show`.
        """
        self.show(session, pupil, name, text)
        screen = self._screen_with(pupil, name)
        blocks = await self._blocks_of(pupil, name) if screen is None else screen.program()[1].blocks
        source = ProgramSource(text, with_view(blocks, PYTHON))
        check_program(name, source)
        number = await self._shelf.store(pupil, name, source)
        return ChangeResult(
            words=said("{name} of {pupil} is saved, version {number}", name=name, pupil=pupil, number=number)
        )

    async def _blocks_of(self, pupil: str, name: str) -> str:
        """The blocks that are kept with a program."""
        try:
            return (await self._shelf.source(pupil, name)).blocks
        except NotThere:
            return ""

    def _screen_with(self, pupil: str, name: str) -> ProgramScreen | None:
        """Where a pupil has this program open; None: the pupil has none open."""
        screens = self._screens.get(pupil)
        if not screens:
            return None
        if (other := screens[-1].program()[0]) != name:
            raise ConfigError(said("{pupil} has {other} open now, not {name}", pupil=pupil, other=other, name=name))
        return screens[-1]

    def steer(self, session: Session, pupil: str, *, run: bool) -> None:
        """Run a pupil's program in the pupil's browser, or end it.

        Raises:
            ConfigError: it was not taken over by this teacher, or the pupil's page is not open.
        """
        self._accounts.require(session, Right.ARRANGE)
        self._need_taken(session, pupil)
        screens = self._screens.get(pupil)
        if not screens:
            raise ConfigError(said("{pupil} has no page Program open: it runs in the pupil's browser", pupil=pupil))
        (screens[-1].run if run else screens[-1].stop)()

    def _need_taken(self, session: Session, pupil: str) -> None:
        taken = self._control.taken_by(pupil)
        if taken is None or taken.by != session.name:
            raise ConfigError(said("take over the program of {pupil} first", pupil=pupil))


@dataclass(frozen=True, slots=True)
class _InLesson:
    words: str
    share: float


def _latest(rows: Iterable[LessonProgress]) -> dict[str, _InLesson]:
    """Person -> the lesson where something happened last."""
    newest: dict[str, LessonProgress] = {}
    for row in rows:
        known = newest.get(row.person)
        if known is None or row.last_ms >= known.last_ms:
            newest[row.person] = row
    return {
        person: _InLesson(f"{row.title}: {row.ticked}/{row.checks}", row.ticked / row.checks if row.checks else 0.0)
        for person, row in newest.items()
    }


def _mean(shares: Iterable[float]) -> float:
    found = list(shares)
    return sum(found) / len(found) if found else 0.0
