"""What the pages show of the database: journal, robots, blueprint, users, backups; all SQL stays in the registry."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from msbot.config import Library, blueprint_toml, differences, parse_blueprint
from msbot.operations import Operations
from msbot.pnp import PartState
from msbot.registry import JournalEntry, PartRecord, Registry, RobotRecord, UserRecord, held, upkeep
from msbot.web.accounts import User
from msbot.web.models import JournalLine, RobotTile
from msbot.web.roles import role_named
from msbot.web.service import Records


class RegistryUsers:
    """The `UserStore` of a robot with a database."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry

    def users(self) -> list[User]:
        """See `UserStore.users`."""
        return [_user(record) for record in self._registry.users()]

    def user(self, name: str) -> User | None:
        """See `UserStore.user`."""
        record = self._registry.user(name)
        return None if record is None else _user(record)

    def keep_user(self, user: User, who: str) -> None:
        """See `UserStore.keep_user`."""
        self._registry.keep_user(user.name, user.role.word, who, password_hash=user.password_hash, tokens=user.tokens)

    def remove_user(self, name: str, who: str) -> None:
        """See `UserStore.remove_user`."""
        self._registry.remove_user(name, who)


def registry_records(
    registry: Registry, robot: RobotRecord, operations: Operations, library: Library, *, address: str
) -> Records:
    """The records of a robot with a database.

    Args:
        registry: the database.
        robot: which robot of it.
        operations: what a new blueprint goes through.
        library: what it is checked against.
        address: the database as it was opened: for backups.
    """

    def diff(toml: str) -> list[str]:
        wanted = parse_blueprint(toml, library)
        return [str(difference) for difference in differences(registry.blueprint(robot, by_hand=False), wanted)]

    def apply(toml: str, who: str) -> str:
        return operations.apply(parse_blueprint(toml, library), who=who).words

    def backup() -> bytes:
        with tempfile.TemporaryDirectory(prefix="msbot-backup-") as folder:
            target = Path(folder) / "backup.db"
            upkeep.back_up(address, target)
            return target.read_bytes()

    def restore(content: bytes, who: str) -> str:
        held.hold(address, content)
        registry.note(robot, "restore", "a backup is put in force when the master starts anew", who)
        return "The backup is checked and kept: it is put in force when the master starts anew."

    return Records(
        journal=journal_lines(registry, robot),
        robots=robot_tiles(registry, robot),
        export=lambda: blueprint_toml(registry.blueprint(robot), registry.made_by_hand(robot)),
        diff=diff,
        apply=apply,
        backup=backup,
        restore=restore,
        trouble=lambda: registry.trouble or "",
    )


def journal_lines(registry: Registry, robot: RobotRecord) -> Callable[[int, str | None], list[JournalLine]]:
    """The journal of a robot, newest line first."""

    def read(limit: int, part: str | None) -> list[JournalLine]:
        return [_line(entry) for entry in reversed(registry.journal(limit, part, robot=robot))]

    return read


def robot_tiles(
    registry: Registry, here: RobotRecord, *, epoch_ns: Callable[[], int] = time.time_ns
) -> Callable[[], list[RobotTile]]:
    """All robots of the database; `here` is the one this server runs."""

    def read() -> list[RobotTile]:
        return [_tile(registry, robot, robot.id == here.id, epoch_ns()) for robot in registry.robots()]

    return read


def _tile(registry: Registry, robot: RobotRecord, is_here: bool, now_ns: int) -> RobotTile:
    parts = registry.parts(robot)
    newest = registry.journal(1, robot=robot)
    event = newest[-1] if newest else None
    slots = registry.slot_names(robot)
    return RobotTile(
        name=robot.name,
        serial_number=robot.serial_number,
        running=is_here or registry.is_run(robot),
        here=is_here,
        owner=robot.manufacturer,
        slots=len(slots),
        active=len({part.slot for part in parts if _is_active(part) and part.slot in slots}),
        last_event="" if event is None else event.event.sentences()[0],
        last_event_age_s=None if event is None else max(now_ns - event.at_ns, 0) / 1e9,
    )


def _is_active(part: PartRecord) -> bool:
    return PartState(part.state).is_registered


def _line(entry: JournalEntry) -> JournalLine:
    event = entry.event
    return JournalLine(
        number=entry.number,
        at_ms=entry.at_ns // 1_000_000,
        part=event.part,
        slot=event.slot or "",
        from_state="" if event.from_state is None else event.from_state.value,
        to_state=event.to_state.value,
        reason=event.reason,
        evidence=list(event.evidence),
    )


def _user(record: UserRecord) -> User:
    return User(record.name, role_named(record.role), record.password_hash, record.tokens)
