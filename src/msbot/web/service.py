"""What a signed-in person can see and do: the pages and the API both go through here, so rights are checked once.

Every deed names the session it is done for. The right is checked at that moment, not when the page was opened: a
role that was taken away, or a session that has ended, counts at once, also for a page that is still open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from msbot.errors import ConfigError, RegistryError
from msbot.operations import Operations, Outcome
from msbot.web.accounts import Accounts, Session, User
from msbot.web.models import (
    BlueprintDiff,
    Done,
    EditLine,
    JournalLine,
    Me,
    Robot,
    RobotTile,
    Scalar,
    UserLine,
    Value,
)
from msbot.web.roles import Right, role_named
from msbot.web.views import Views

SHARED_S = 0.2
"""So long one look at the robot serves every page."""
CLASS_S = 2.0
"""So long one look at the whole database serves every class view."""


@dataclass(frozen=True, slots=True)
class Records:
    """What the database knows, as functions, so that a robot without one has pages, too."""

    journal: Callable[[int, str | None], list[JournalLine]]
    robots: Callable[[], list[RobotTile]]
    export: Callable[[], str]
    """The present blueprint as TOML."""
    diff: Callable[[str], list[str]]
    """What another blueprint would change; raises ConfigError when it is wrong."""
    apply: Callable[[str, str], str]
    """(TOML, who) -> what was changed, in words."""
    backup: Callable[[], bytes]
    restore: Callable[[bytes, str], str]
    """(backup, who) -> what happens now, in words."""
    trouble: Callable[[], str]


class Service:
    """See the module's docstring.

    Args:
        views: what can be seen.
        operations: what can be done to the robot.
        accounts: who is signed in.
        records: what the database knows.
        robot: the robot's description for `robot()`, without its slots.
        clock: the robot's clock.
    """

    def __init__(
        self, *, views: Views, operations: Operations, accounts: Accounts, records: Records,
        robot: Callable[[], Robot], clock: Callable[[], float],
    ) -> None:  # fmt: skip
        self.views = views
        self.accounts = accounts
        self._operations = operations
        self._records = records
        self._robot = robot
        self._clock = clock
        self._seen_robot: tuple[float, Robot] | None = None
        self._seen_robots: tuple[float, list[RobotTile]] | None = None

    @property
    def robot_name(self) -> str:
        """The robot's name and version."""
        robot = self._robot()
        return robot.name

    # Seeing

    def me(self, session: Session) -> Me:
        """Who is signed in and what they may do."""
        rights = [right.name.lower() for right in Right if session.may(right)]
        return Me(name=session.name, role=session.role.word, rights=rights, csrf=session.csrf)

    def robot(self) -> Robot:
        """The robot with all its slots; worked out once for all pages that ask at the same time."""
        now = self._clock()
        if self._seen_robot is not None and now - self._seen_robot[0] < SHARED_S:
            return self._seen_robot[1]
        slots = self.views.slots()
        robot = self._robot().model_copy(
            update={"slots": slots, "arrivals": self.views.waiting(), "trouble": self._records.trouble()}
        )
        self._seen_robot = (now, robot)
        return robot

    def values(self, slot: str) -> list[Value]:
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
            for value in self._operations.values(slot)
        ]

    def journal(self, limit: int, part: str | None = None) -> list[JournalLine]:
        """The newest lines of the journal, newest first."""
        return self._records.journal(limit, part)

    def edits(self, limit: int) -> list[EditLine]:
        """What people changed, newest first."""
        return [
            EditLine(
                number=edit.id,
                at_ms=edit.at_ns // 1_000_000,
                who=edit.who,
                kind=edit.kind,
                slot=edit.slot,
                words=edit.words,
                undone=edit.undone,
                undoable=edit.can_be_undone,
            )
            for edit in self._operations.edits(limit)
        ]

    def robots(self) -> list[RobotTile]:
        """All robots of the database; read at most every few seconds, however many pages are open."""
        now = self._clock()
        if self._seen_robots is None or now - self._seen_robots[0] >= CLASS_S:
            self._seen_robots = (now, self._records.robots())
        return self._seen_robots[1]

    def blueprint(self) -> str:
        """The present blueprint as `robot.toml`."""
        return self._records.export()

    def blueprint_diff(self, toml: str) -> BlueprintDiff:
        """What applying another blueprint would change.

        Raises:
            ConfigError: it is wrong; the text says where.
        """
        return BlueprintDiff(changes=self._records.diff(toml))

    # Doing: everybody who is signed in

    def stop(self, session: Session, reason: str) -> Done:
        """STOP: every part goes to its safe state."""
        self._need(session, Right.STOP)
        return _done(self._operations.stop(reason or f"{session.name} pressed STOP", who=session.name))

    # Doing: students

    def identify(self, session: Session, part: str) -> Done:
        """Have a part show itself."""
        self._need(session, Right.OPERATE)
        return _done(self._operations.identify(part))

    def operate(self, session: Session, slot: str, control: str, value: Scalar) -> Done:
        """Do something to a simulated part."""
        self._need(session, Right.OPERATE)
        self.views.simulated(slot)
        self.views.bench.operate(slot, control, value)
        return Done(words=f"{slot}: {control} is {value}")

    def plug(self, session: Session, slot: str, *, plugged: bool) -> Done:
        """Plug a simulated part in, or pull it out."""
        self._need(session, Right.OPERATE)
        self.views.simulated(slot)
        (self.views.bench.plug if plugged else self.views.bench.unplug)(slot)
        return Done(words=f"{slot} is {'plugged in' if plugged else 'unplugged'}")

    def set_value(self, session: Session, slot: str, name: str, value: Scalar) -> Done:
        """Set a parameter by hand."""
        self._need(session, Right.SET)
        self.views.check_slot(slot)
        return _done(self._operations.set_value(slot, name, _text(value), who=session.name))

    def reset_value(self, session: Session, slot: str, name: str) -> Done:
        """Forget what was set by hand."""
        self._need(session, Right.SET)
        self.views.check_slot(slot)
        return _done(self._operations.reset_value(slot, name, who=session.name))

    # Doing: teachers

    def go_on(self, session: Session) -> Done:
        """End STOP."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.go_on(who=session.name))

    def adopt(self, session: Session, part: str, slot: str | None) -> Done:
        """Let an unknown or waiting part into a slot."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.adopt(part, slot, who=session.name))

    def ignore(self, session: Session, part: str) -> Done:
        """Show a part among the arrivals no more."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.ignore(part, who=session.name))

    def swap(self, session: Session, slot: str, to_part: str) -> Done:
        """Give a slot to another part."""
        self._need(session, Right.ARRANGE)
        self.views.check_slot(slot)
        return _done(self._operations.swap(slot, to_part, who=session.name))

    def release(self, session: Session, slot: str) -> Done:
        """Take a slot from its part."""
        self._need(session, Right.ARRANGE)
        self.views.check_slot(slot)
        return _done(self._operations.release(slot, who=session.name))

    def block(self, session: Session, part: str, reason: str) -> Done:
        """Let a part in no more."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.block(part, reason or f"blocked by {session.name}", who=session.name))

    def unblock(self, session: Session, part: str) -> Done:
        """Let a blocked part in again."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.unblock(part, who=session.name))

    def open_window(self, session: Session, seconds: float) -> Done:
        """Open the adoption window."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.open_window(seconds, who=session.name))

    def close_window(self, session: Session) -> Done:
        """Close the adoption window."""
        self._need(session, Right.ARRANGE)
        return _done(self._operations.close_window())

    def may_undo(self, session: Session, edit: EditLine) -> bool:
        """Whether to offer it: students take back their own settings only."""
        is_own = edit.who == session.name and edit.kind == "value" and session.may(Right.SET)
        return edit.undoable and (is_own or session.may(Right.ARRANGE))

    def undo(self, session: Session, edit: int | None) -> Done:
        """Take a change back; the latest one when no number is given. A student can take back their own settings."""
        self._need(session, Right.SET)
        if not session.may(Right.ARRANGE):
            self._check_own(session, edit)
        return _done(self._operations.undo(edit, who=session.name))

    def apply_blueprint(self, session: Session, toml: str) -> Done:
        """Make the robot what another blueprint says."""
        self._need(session, Right.DESIGN)
        return Done(words=self._records.apply(toml, session.name))

    # Doing: administrators

    def users(self, session: Session) -> list[UserLine]:
        """Everybody who may sign in."""
        self._need(session, Right.ADMINISTER)
        return [_user_line(user) for user in self.accounts.users()]

    def add_user(self, session: Session, name: str, role: str, password: str) -> Done:
        """Let a person sign in."""
        self._need(session, Right.ADMINISTER)
        self.accounts.add_user(name, role_named(role), password, who=session.name)
        return Done(words=f"{name} can sign in as {role}")

    def change_user(self, session: Session, name: str, role: str | None, password: str | None) -> Done:
        """Give a user another role or password; everybody may change their own password."""
        self._need(session, Right.SEE if name == session.name and role is None else Right.ADMINISTER)
        self.accounts.change_user(name, who=session.name, role=role, password=password)
        return Done(words=f"{name} is changed")

    def remove_user(self, session: Session, name: str) -> Done:
        """Let a person in no more."""
        self._need(session, Right.ADMINISTER)
        self.accounts.remove_user(name, who=session.name)
        return Done(words=f"{name} is removed")

    def new_token(self, session: Session, name: str, purpose: str) -> str:
        """Make an API token for oneself; an administrator makes them for others, too."""
        self._need(session, Right.SEE if name == session.name else Right.ADMINISTER)
        return self.accounts.new_token(name, purpose, who=session.name)

    def remove_token(self, session: Session, name: str, purpose: str) -> Done:
        """Make an API token worthless."""
        self._need(session, Right.SEE if name == session.name else Right.ADMINISTER)
        self.accounts.remove_token(name, purpose, who=session.name)
        return Done(words=f"the token for {purpose} is removed")

    def backup(self, session: Session) -> bytes:
        """The whole database in one file."""
        self._need(session, Right.ADMINISTER)
        return self._records.backup()

    def restore(self, session: Session, content: bytes) -> Done:
        """Go back to a backup."""
        self._need(session, Right.ADMINISTER)
        return Done(words=self._records.restore(content, session.name))

    # Helpers

    def _need(self, session: Session, right: Right) -> None:
        self.accounts.require(session, right)
        self._seen_robot = None  # what follows changes it

    def _check_own(self, session: Session, edit: int | None) -> None:
        found = next(
            (line for line in self._operations.edits(200) if line.can_be_undone and edit in (None, line.id)), None
        )
        if found is None:
            raise ConfigError("there is no such change that could be undone")
        if found.who != session.name or found.kind != "value":
            self.accounts.require(session, Right.ARRANGE)


def no_records(robot: Callable[[], Robot]) -> Records:
    """The records of a robot without a database: all that needs one says so."""

    def refuse(*_: object) -> str:
        raise RegistryError("this robot runs without a database: start it with --db")

    def refuse_octets() -> bytes:
        raise RegistryError("this robot runs without a database: start it with --db")

    def refuse_diff(_toml: str) -> list[str]:
        raise RegistryError("this robot runs without a database: start it with --db")

    def tile() -> list[RobotTile]:
        one = robot()
        return [
            RobotTile(name=one.name, serial_number=one.serial_number, running=True, here=True, owner="",
                      slots=len(one.slots), active=0, last_event="", last_event_age_s=None)
        ]  # fmt: skip

    return Records(
        journal=lambda _limit, _part: [],
        robots=tile,
        export=refuse,
        diff=refuse_diff,
        apply=refuse,
        backup=refuse_octets,
        restore=refuse,
        trouble=str,
    )


def _done(outcome: Outcome) -> Done:
    return Done(words=outcome.words, edit=outcome.edit_id, latency_ms=outcome.latency_ms)


def _text(value: Scalar) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _user_line(user: User) -> UserLine:
    return UserLine(name=user.name, role=user.role.word, tokens=[purpose for purpose, _ in user.tokens])
