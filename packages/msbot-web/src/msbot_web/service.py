"""What a signed-in person can see and do: the pages and the API both go through here, so rights are checked once.

Every action names the session it is done for. The right is checked at that moment, not when the page was opened: a
role that was taken away, or a session that has ended, counts at once, also for a page that is still open.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Generic, TypeVar

from msbot.metrics import MomentFigures
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.operation import Outcome
from msbot.operations.rights import Principal, Right, role_named
from msbot.registry import EditRecord
from msbot.sim.arena.running_arena import RunningArena
from msbot_agent.text.sentence import counted, said
from msbot_web.access.accounts import Accounts, NotAllowed
from msbot_web.access.class_list import NewAccount
from msbot_web.access.sessions import Session
from msbot_web.access.ticket_codes import TicketCodes
from msbot_web.access.users import User
from msbot_web.arena_view import ArenaView
from msbot_web.class_controller import ClassController
from msbot_web.doctor_service import DoctorService
from msbot_web.gallery import Gallery, RunningDemo
from msbot_web.glances import RobotGlance
from msbot_web.hand_ins import HandInActions
from msbot_web.lessons_view import LessonsView
from msbot_web.live_channel import LiveChannel
from msbot_web.local_masters import LocalMasters
from msbot_web.model_builder import ModelBuilder
from msbot_web.models.robot_models import (
    BlueprintDiff,
    ChangeResult,
    EditLine,
    JournalLine,
    Me,
    RelayTicket,
    Robot,
    Scalar,
    UserLine,
    Value,
)
from msbot_web.programs.programs import NoProgramStore, ProgramActions, ProgramStore
from msbot_web.recorded_past import RecordedPast
from msbot_web.remote_robots import RemoteRobots
from msbot_web.sd_card import CardChange, CardState, SdCard
from msbot_web.simulated.held_controls import HeldControls
from msbot_web.stored_data import BackupDownload, StoredData
from msbot_web.whole_class import WholeClass
from msbot_xrce.errors import ConfigError, NotThere

if TYPE_CHECKING:
    from msbot.doctor import Examination, Finding

SHARED_S = 0.2
"""How long one snapshot of the robot serves every page."""
LONGEST_SHARED_S = 1.0
"""Likewise, while the pages are refreshed one after the other."""
MAX_BLUEPRINT = 256 * 1024
"""Octets of a blueprint."""
BACKUP = "backup"
"""What the doctor mends that is no operation."""


_T = TypeVar("_T")


class _Shared(Generic[_T]):
    """What many pages ask for at the same time, worked out once.

    Args:
        work: works it out.
        clock: the robot's clock, seconds.
        marks: how much was asked for so far, and in which look at all pages this is; 0: in none.
    """

    def __init__(
        self, work: Callable[[], _T], clock: Callable[[], float], marks: Callable[[], tuple[int, int]]
    ) -> None:
        self._work, self._clock, self._marks = work, clock, marks
        self._known: tuple[float, tuple[int, int], _T] | None = None

    def __call__(self) -> _T:
        """As it is now, or was a moment ago."""
        now, marks, known = self._clock(), self._marks(), self._known
        if known is not None and known[1][0] == marks[0]:
            shared_s = LONGEST_SHARED_S if marks[1] and known[1] == marks else SHARED_S
            if now - known[0] < shared_s:
                return known[2]
        found = self._work()
        # From the end of the work on: else what takes longer than this to work out would never be shared.
        self._known = (self._clock(), marks, found)
        return found

    def forget(self) -> None:
        """It changes now."""
        self._known = None


class Service:
    """See the module's docstring.

    Args:
        views: what can be seen.
        operations: what can be done to the robot.
        accounts: who is signed in.
        records: what the database knows.
        robot: the robot's description for `robot()`, without its slots.
        clock: the robot's clock.
        neighbours: the masters of this computer.
        programs: where people's programs are kept; None: nowhere.
        doctor: examines robot and computer; None: nobody does.
        arena: the world that its parts are in; None: none that is here.
        figures: reads the figures for Prometheus; None: there are none.
        learning: the lessons; None: there are none.
        far: the robots on other computers; None: those that this user has an access to.
        demo: the demo whose robot this is; None: none.
        card: the SD card that this computer runs from; None: the one of this computer, if it is one of MsBOT.
    """

    def __init__(
        self,
        *,
        views: ModelBuilder,
        operations: InProcessOperations,
        accounts: Accounts,
        records: StoredData,
        robot: Callable[[], Robot],
        clock: Callable[[], float],
        neighbours: LocalMasters | None = None,
        programs: ProgramStore | None = None,
        doctor: DoctorService | None = None,
        figures: Callable[[], MomentFigures] | None = None,
        arena: RunningArena | None = None,
        learning: LessonsView | None = None,
        far: RemoteRobots | None = None,
        demo: RunningDemo | None = None,
        card: SdCard | None = None,
    ) -> None:
        self.views = views
        self.accounts = accounts
        self.operations = operations
        self._records = records
        self._robot = robot
        self._clock = clock
        self._doctor = doctor
        self._figures = figures
        self.whole_class = WholeClass(
            operations,
            records,
            robot,
            accounts,
            clock=clock,
            neighbours=neighbours or LocalMasters(),
            library=lambda: views.library,
            far=far,
            asker=self.asker,
        )
        """All robots of the class."""
        self._card = card or SdCard()
        self.past = RecordedPast(
            lambda: str(operations.recording.recording().answer.get("folder") or ""),
            lambda: views.library,
            views.endpoints,
        )
        """What the recorder has."""
        self.arena = ArenaView(arena)
        self.learning = learning or LessonsView(None, None, accounts)
        accounts.on_gone(operations.acts.forget)
        accounts.on_gone(self.learning.forget)
        self.gallery = Gallery(demo, operations, self.learning, views, require=accounts.require, asker=self.asker)
        """The robots and worlds that there are to choose from."""
        shelf = programs or NoProgramStore()
        self.pupils = ClassController(
            accounts,
            operations,
            TicketCodes(accounts, accounts.clock, accounts.forward_clock.now),
            shelf,
            self.learning,
        )
        """The class."""
        self.programs = ProgramActions(shelf, accounts, self.pupils.check_writing)
        self.hand_ins = HandInActions(accounts, self.programs, self.learning, operations.lessons, self.past)
        """What is handed in of lessons."""
        self.live = LiveChannel(accounts)
        """What is live on pages."""
        self._seen, self._glanced = self._shared(self._look_at_robot), self._shared(self._glance_at_robot)
        self._held = HeldControls(lambda: views.bench)
        operations.pupils.use_holds(self._held.end_where)
        accounts.sessions.on_end(self._signed_out)
        accounts.on_token_end(self._token_ended)

    @property
    def robot_name(self) -> str:
        """The robot's name and version."""
        robot = self._robot()
        return robot.name

    @property
    def robot_id(self) -> str:
        """What identifies this robot: name and serial number."""
        robot = self._robot()
        return f"{robot.name} {robot.serial_number}"

    @property
    def is_stopped(self) -> bool:
        """Whether STOP holds."""
        return self.operations.stopping.status.stopped

    def now(self) -> float:
        """The robot's clock, seconds."""
        return self._clock()

    # Seeing

    def me(self, session: Session) -> Me:
        """Who is signed in and what they may do."""
        rights = [right.name.lower() for right in Right if session.may(right)]
        return Me(name=session.name, role=session.role.word, rights=rights, csrf=session.csrf)

    def robot(self) -> Robot:
        """The robot with all its slots; worked out once for all pages that ask at the same time."""
        return self._seen()

    def _look_at_robot(self) -> Robot:
        slots, arrivals = self.views.slots_and_waiting()
        return self._robot().model_copy(
            update={"slots": slots, "arrivals": arrivals, "trouble": self._records.trouble()}
        )

    def glance(self) -> RobotGlance:
        """What all pages look at twice a second, shared in the same way."""
        return self._glanced()

    def _glance_at_robot(self) -> RobotGlance:
        slots, arrivals = self.views.glances_and_waiting()
        robot = self._robot()
        return RobotGlance(
            version=robot.version,
            serial_number=robot.serial_number,
            manufacturer=robot.manufacturer,
            links=robot.links,
            beat_s=robot.beat_s,
            stop=robot.stop,
            trouble=self._records.trouble(),
            faults=robot.faults,
            arrivals=arrivals,
            slots=slots,
        )

    def _shared(self, work: Callable[[], _T]) -> _Shared[_T]:
        # The numbers of what was asked for, and of the look at all pages in which this is.
        return _Shared(
            work, self._clock, lambda: (self.operations.asked, self.live.looks if self.live.is_looking else 0)
        )

    async def values(self, slot: str) -> list[Value]:
        """The parameters of a slot with origin, range and unit."""
        self.views.check_slot(slot)
        return [
            Value(
                name=value.name,
                kind=value.kind,
                value=value.value,
                default=value.default,
                origin=value.origin,
                unit=value.unit,
                least=value.least,
                most=value.most,
                description=value.description,
                who=value.who,
            )
            for value in await self.operations.settings.read(slot)
        ]

    async def journal(self, session: Session, limit: int, part: str | None = None) -> list[JournalLine]:
        """The newest lines of the journal, newest first; who may not see UIDs and addresses finds nothing by them."""
        return await self._records.journal(limit, part, not session.may(Right.ARRANGE))

    async def edits(self, limit: int) -> list[EditLine]:
        """What people changed, newest first."""
        return [_edit_line(edit) for edit in await self.operations.undoing.read(limit)]

    async def blueprint(self) -> str:
        """The present blueprint as `robot.toml`."""
        return await self._records.export()

    async def blueprint_diff(self, session: Session, toml: str) -> BlueprintDiff:
        """What applying another blueprint would change; only for those who may apply it.

        Raises:
            ConfigError: it is wrong; the text says where.
        """
        self._need(session, Right.DESIGN)
        _check_size(toml)
        return BlueprintDiff(changes=await self._records.diff(toml))

    def figures(self, session: Session) -> MomentFigures:
        """The figures of this moment, for Prometheus."""
        self.accounts.require(session, Right.SEE)
        if self._figures is None:
            raise NotThere(said("this robot has no figures"))
        return self._figures()

    # Doing

    def asker(self, session: Session) -> Principal:
        """Who asks for an operation: `operations.do` checks the right at that moment."""
        robot = self._robot()
        place = (
            said("a program with an API token") if session.is_program else said("the page of {robot}", robot=robot.name)
        )
        require, since_ns = partial(self.accounts.require, session), self.accounts.since_ns(session)
        return Principal(session.name, require, session.may, place, since_ns)

    # Doing: students

    def operate(
        self, session: Session, slot: str, control: str, value: Scalar, *, on_page: object | None = None
    ) -> ChangeResult:
        """Do something to a simulated part; what is held by a page is let go when that is gone (`let_go`)."""
        self._need(session, Right.OPERATE)
        places = self._check_simulated(session, slot)
        self.views.bench.operate(slot, control, value)
        self.operations.acts.note(session.name, places)
        by = (session.holder,) if on_page is None else (session.holder, on_page)
        if self._held.operated("" if session.may(Right.ARRANGE) else session.name, by, slot, control, value):
            self.operations.pupils.drives(session.name)
        return ChangeResult(words=said("{slot}: {control} is {value}", slot=slot, control=control, value=value))

    def plug(self, session: Session, slot: str, *, plugged: bool) -> ChangeResult:
        """Plug a simulated part in, or pull it out."""
        self._need(session, Right.OPERATE)
        places = self._check_simulated(session, slot)
        is_new = plugged and not self.views.bench.is_plugged(slot)
        if is_new and self.views.is_held_by_another(slot) and not session.may(Right.ARRANGE):
            # It would look for another slot, and that may be another group's.
            raise ConfigError(said("slot {slot} has another part now: pull that out first", slot=slot))
        if not plugged:
            self._held.end_at(slot)
        (self.views.bench.plug if plugged else self.views.bench.unplug)(slot)
        self.operations.acts.note(session.name, places)
        return ChangeResult(words=said("{slot} is plugged in" if plugged else "{slot} is unplugged", slot=slot))

    def end_pilot(self, slot: str) -> None:
        """Take the simulated part out by which people drove by hand: the last page that did so is closed."""
        self._held.end_at(slot)
        self.views.bench.unplug(slot)

    def let_go(self, page: object) -> None:
        """Nobody holds anything with that page any more: it is closed, or its connection is lost."""
        self._held.end_by(page)

    def _token_ended(self, token: str, name: str) -> None:
        """What a program drives by hand is let go of when its token is taken back."""
        self._held.end_by(token)
        self.operations.by_hand.end_those_of([name])

    def _signed_out(self, session: Session) -> None:
        """Nobody holds anything with a session that is over; no pupil does who has none left."""
        self._held.end_by(session.holder)
        if not session.may(Right.ARRANGE) and not self.accounts.sessions.of(session.name):
            self.operations.pupils.end_holds(session.name)

    def _check_simulated(self, session: Session, slot: str) -> set[str]:
        """Check that somebody may play with the simulated part of a slot, wherever it is now: those slots.

        Raises:
            ConfigError: there is none, or that slot or the one that it holds is another group's.
        """
        self.pupils.check_slot(session, slot)
        self.views.simulated(slot)
        held = self.views.slot_held_by_simulated(slot)
        if held:
            self.pupils.check_slot(session, held)
        return {slot, held} - {None, ""}

    def may_undo(self, session: Session, edit: EditLine) -> bool:
        """Whether to offer undo: students undo only their own settings."""
        is_theirs = edit.who == session.name and edit.at_ms * 1_000_000 >= self.accounts.since_ns(session)
        is_own = is_theirs and not session.guest_of and edit.kind == "value" and session.may(Right.SET)
        return edit.undoable and (is_own or session.may(Right.ARRANGE))

    # Doing: teachers

    async def apply_blueprint(self, session: Session, toml: str) -> ChangeResult:
        """Make the robot what another blueprint says."""
        self._need(session, Right.DESIGN)
        _check_size(toml)
        return done_of(await self._records.apply(toml, session.name))

    async def examine(self, session: Session, *, anew: bool) -> Examination:
        """What keeps the robot from working, and what mends it."""
        self._need(session, Right.ARRANGE)
        return await self._the_doctor().examine(anew=anew)

    async def repair(self, session: Session, finding: Finding) -> ChangeResult:
        """Mend what the doctor has found, where that can be taken back or only adds a file."""
        mending = finding.mending
        if mending is None:
            raise ConfigError(said("this cannot be mended from here: {command}", command=finding.mend))
        if mending.name == BACKUP:
            self._need(session, Right.ADMINISTER)
            return ChangeResult(words=await self._the_doctor().back_up())
        self._need(session, Right.ARRANGE)
        return done_of(await self.operations.do(mending.name, who=self.asker(session), **mending.arguments))

    def _the_doctor(self) -> DoctorService:
        if self._doctor is None:
            raise ConfigError(said("nobody examines this robot"))
        return self._doctor

    # Doing: administrators

    def users(self, session: Session) -> list[UserLine]:
        """Everybody who may sign in."""
        self._need(session, Right.ADMINISTER)
        return [_user_line(user) for user in self.accounts.users()]

    async def add_user(self, session: Session, name: str, role: str, password: str) -> ChangeResult:
        """Let a person sign in."""
        self._need(session, Right.ADMINISTER)
        await self.accounts.add_user(name, role_named(role), password, who=session.name)
        return ChangeResult(words=said("{name} can sign in as {role}", name=name, role=said(role)))

    async def add_people(self, session: Session, people: Sequence[NewAccount]) -> ChangeResult:
        """Let a whole class sign in: all of them, or nobody."""
        self._need(session, Right.ADMINISTER)
        await self.accounts.add_people(people, who=session.name)
        return ChangeResult(words=counted(len(people), "{count} person can sign in", "{count} people can sign in"))

    async def people_edits(self, session: Session, limit: int) -> list[EditLine]:
        """What was changed about people and keys, newest first."""
        self._need(session, Right.ADMINISTER)
        return [_edit_line(edit) for edit in await self._records.people_edits(limit)]

    async def change_role(self, session: Session, name: str, role: str) -> ChangeResult:
        """Give a user another role."""
        self._need(session, Right.ADMINISTER)
        await self.accounts.change_role(name, role, who=session.name)
        return ChangeResult(words=said("{name} is {role} now", name=name, role=role_named(role).with_article))

    async def change_password(self, session: Session, name: str, password: str, old: str | None) -> ChangeResult:
        """Give a user another password; everybody may change their own, and has to say the old one.

        Raises:
            NotAllowed: a program asks, or the role does not allow it.
        """
        is_own = name == session.name and not session.guest_of
        self._need(session, Right.SEE if is_own else Right.ADMINISTER)
        if session.is_program:
            raise NotAllowed(said("a program with an API token may not change passwords: sign in on the page"))
        await self.accounts.change_password(
            name, password, who=session.name, old=(old or "") if is_own else None, browser=session.key
        )
        return ChangeResult(
            words=said("{name} has a new password; sessions and API tokens of {name} have ended", name=name)
        )

    async def remove_user(self, session: Session, name: str) -> ChangeResult:
        """Remove a person, who can no longer sign in."""
        self._need(session, Right.ADMINISTER)
        await self.accounts.remove_user(name, who=session.name)
        return ChangeResult(words=said("{name} is removed", name=name))

    async def new_token(self, session: Session, name: str, purpose: str) -> str:
        """Make an API token for oneself; an administrator makes them for others, too."""
        is_own = name == session.name and not session.guest_of
        self._need(session, Right.SEE if is_own else Right.ADMINISTER)
        return await self.accounts.new_token(name, purpose, who=session.name)

    def tickets(self, session: Session) -> list[RelayTicket]:
        """The tickets for relays and agents: one's own, and all for an administrator."""
        self._need(session, Right.ARRANGE)
        sees_all = session.may(Right.ADMINISTER)
        users = [user for user in self.accounts.users() if sees_all or user.name == session.name]
        return [RelayTicket(name=user.name, purpose=purpose) for user in users for purpose in user.tickets]

    async def new_ticket(self, session: Session, name: str, purpose: str) -> str:
        """Make a ticket for a relay or an agent: teachers for themselves, an administrator for others, too."""
        is_own = name == session.name and not session.guest_of
        self._need(session, Right.ARRANGE if is_own else Right.ADMINISTER)
        return await self.accounts.new_ticket(name, purpose, who=session.name)

    async def remove_token(self, session: Session, name: str, purpose: str) -> ChangeResult:
        """Make an API token worthless."""
        is_own = name == session.name and not session.guest_of
        self._need(session, Right.SEE if is_own else Right.ADMINISTER)
        await self.accounts.remove_token(name, purpose, who=session.name)
        return ChangeResult(words=said("the token for {purpose} is removed", purpose=purpose))

    async def backup(self, session: Session) -> BackupDownload:
        """The whole database in one file, which goes out in pieces."""
        self._need(session, Right.ADMINISTER)
        return await self._records.backup()

    async def restore(self, session: Session, backup: AsyncIterator[bytes]) -> ChangeResult:
        """Go back to a backup, which is stored as it comes in."""
        self._need(session, Right.ADMINISTER)
        return ChangeResult(words=await self._records.restore(backup, session.name))

    # The card that the computer runs from

    @property
    def is_on_card(self) -> bool:
        """Whether the computer runs from a card of MsBOT."""
        return self._card.is_there

    def has_card(self, session: Session) -> bool:
        """Whether there is something to set about the computer, for this person."""
        return session.may(Right.ADMINISTER) and self.is_on_card

    async def card(self, session: Session) -> CardState:
        """The card as it is."""
        self.accounts.require(session, Right.ADMINISTER)
        return await self._card.state()

    async def change_card(self, session: Session, wanted: CardChange) -> ChangeResult:
        """Set name, Wi-Fi, hats."""
        self._need(session, Right.ADMINISTER)
        await self._card.change(wanted)
        return ChangeResult(words=said("The card keeps it."))

    async def update_card(self, session: Session, package: AsyncIterator[bytes]) -> ChangeResult:
        """Take a version of MsBOT in."""
        self._need(session, Right.ADMINISTER)
        state = await self._card.update(package, version("msbot"))
        words = said("MsBOT {version} is on the card: it runs from the next start on.", version=state.versions.current)
        return ChangeResult(words=words)

    async def card_back(self, session: Session) -> ChangeResult:
        """Go back to the former version with the next start."""
        self._need(session, Right.ADMINISTER)
        await self._card.go_back()
        return ChangeResult(words=said("The next start goes back to the former version."))

    async def restart_computer(self, session: Session) -> ChangeResult:
        """Start the computer again."""
        self._need(session, Right.ADMINISTER)
        await self._card.restart()
        return ChangeResult(words=said("The computer starts again: about a minute."))

    # Helpers

    def _need(self, session: Session, right: Right) -> None:
        self.accounts.require(session, right)
        self._seen.forget()  # what follows changes it
        self._glanced.forget()


def _edit_line(edit: EditRecord) -> EditLine:
    return EditLine(
        number=edit.id,
        at_ms=edit.at_ns // 1_000_000,
        who=edit.who,
        kind=edit.kind,
        slot=edit.slot,
        words=edit.words,
        undone=edit.undone,
        undoable=edit.can_be_undone,
    )


def _check_size(toml: str) -> None:
    size = len(toml.encode("utf-8", "surrogatepass"))
    if size > MAX_BLUEPRINT:
        raise ConfigError(
            said(
                "a blueprint has at most {max_blueprint} kB; this one has {size} kB",
                max_blueprint=MAX_BLUEPRINT // 1024,
                size=size // 1024 + 1,
            )
        )


def done_of(outcome: Outcome) -> ChangeResult:
    """The outcome of an operation, for page and API."""
    return ChangeResult.model_validate(
        {
            "words": outcome.words,
            "edit": outcome.edit_id,
            **{name: outcome.answer.get(name, []) for name in ("offers", "for_people", "by_hand")},
            "reply": outcome.answer.get("reply", {}),
        }
    )


def _user_line(user: User) -> UserLine:
    return UserLine(name=user.name, role=user.role.word, tokens=user.api_tokens, tickets=user.tickets)
