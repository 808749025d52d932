"""What people change: settings, places, blocks, wires, users and keys; each is one transaction, most can be undone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from sqlalchemy import Connection, Engine

from msbot.config import Endpoint, Scalar
from msbot.registry import changes, edits, people, values
from msbot.registry.database import Database
from msbot.registry.edits import Author
from msbot.registry.engine import Address
from msbot.registry.records import EditRecord, KeyRecord, RobotRecord, UserRecord, ValueRecord
from msbot.registry.robot_store import RobotStore


class Editing(Database):
    """The half of `Registry` that people's changes go through.

    A change waits until everything told before is stored, so that it is made upon what is true; when the database
    cannot be written it is refused and nothing has changed.
    """

    def __init__(
        self,
        engine: Engine,
        address: Address,
        epoch_ns: Callable[[], int],
        *,
        busy_timeout_s: float,
        read_only: bool,
    ) -> None:
        super().__init__(engine, address, epoch_ns, busy_timeout_s=busy_timeout_s, read_only=read_only)
        self._stores: dict[int, RobotStore] = {}
        """What the robots that this process runs read and write, by number; they hear of edits."""

    # What people change; each is one transaction, or nothing has changed

    def values(self, robot: RobotRecord, slot: str) -> tuple[ValueRecord, ...]:
        """The parameters of a slot, the values that hold, and where these come from.

        Raises:
            ConfigError: there is no such slot.
            RegistryError: the database cannot be read.
        """
        return self._read(partial(values.read_values, robot_id=robot.id, slot=slot))

    def set_value(self, robot: RobotRecord, slot: str, name: str, value: Scalar | None, who: str) -> EditRecord:
        """Set a parameter of a slot by hand; None takes that back, so that blueprint or library hold again.

        Raises:
            ConfigError: no such slot or parameter, or the value is not allowed.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(robot, who, partial(changes.set_value, slot=slot, name=name, value=value))

    def place(
        self,
        robot: RobotRecord,
        uid: bytes,
        slot: str | None,
        who: str,
        *,
        words: str = "",
        by_hand: bool = True,
        before: dict[bytes, str | None] | None = None,
    ) -> EditRecord:
        """Let a part belong in a slot, or in none; others that belonged in that slot belong nowhere.

        Args:
            robot: whose slot.
            uid: the part; it must have been seen before.
            slot: where it belongs from now on; None: nowhere.
            who: who does it.
            words: what happened, for people; made from the rest when empty.
            by_hand: the part then goes into that slot before all rules, whatever the library says.
            before: where parts belonged before, if that is not what is stored now: an undo brings it back.

        Raises:
            ConfigError: the part was never seen, has no UID, or there is no such slot.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(
            robot, who, partial(changes.place, uid=uid, slot=slot, words=words, by_hand=by_hand, before=before)
        )

    def place_swap(self, robot: RobotRecord, uid: bytes, slot: str, who: str, *, other: bytes = b"") -> EditRecord:
        """Let a part belong in a slot, and `other`, which was there, where the part came from (in no slot: nowhere).

        Raises:
            ConfigError: a part was never seen, has no UID, or there is no such slot.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(robot, who, partial(changes.place_swap, uid=uid, slot=slot, other=other))

    def block(self, robot: RobotRecord, kind: str, key: str, reason: str, who: str) -> EditRecord:
        """Let a UID (`kind` "uid", 16 hexadecimal digits) or a part number (`kind` "number") in no more.

        Raises:
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(robot, who, partial(changes.block, kind=kind, key=key, reason=reason or "no reason given"))

    def unblock(self, robot: RobotRecord, kind: str, key: str, who: str) -> EditRecord:
        """Let a UID or part number in again.

        Raises:
            ConfigError: it is not blocked.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(robot, who, partial(changes.block, kind=kind, key=key, reason=""))

    def bind(
        self,
        robot: RobotRecord,
        topic: str,
        who: str,
        *,
        type_name: str,
        source: Endpoint | None,
        targets: Sequence[Endpoint] = (),
        reliable: bool = True,
    ) -> EditRecord:
        """Join ports by a topic, besides those it joins; it then has this reliability at all its ports.

        Raises:
            ConfigError: a port does not exist, has another direction or type, or is bound to another topic.
            RegistryError: the database cannot be written; nothing has changed.
        """
        change = partial(
            changes.bind, topic=topic, type_name=type_name, source=source, targets=targets, reliable=reliable
        )
        return self._edit(robot, who, change)

    def unbind(self, robot: RobotRecord, topic: str, endpoint: Endpoint | None, who: str) -> EditRecord:
        """Take a port off a topic, or all its ports.

        Raises:
            ConfigError: there is no such topic, or the port is not bound to it.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(robot, who, partial(changes.unbind, topic=topic, endpoint=endpoint))

    def undo(self, robot: RobotRecord, number: int | None, who: str) -> EditRecord:
        """Take back an edit, the newest that is not undone if none is named; an undo can be undone, too.

        `slots` and `placed` of what is returned say what is otherwise now.

        Raises:
            ConfigError: there is no such edit, it is undone already, or what it changed has been changed since.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit(robot, who, partial(edits.undo, number=number))

    def note(self, robot: RobotRecord, kind: str, words: str, who: str) -> EditRecord:
        """Keep a line about something a person did that changed nothing stored: `kind` is "stop" or "go".

        Raises:
            RegistryError: the database cannot be written.
        """

        def write(connection: Connection, author: Author) -> EditRecord:
            return edits.record(connection, author, kind, words, before={}, after={})

        return self._edit(robot, who, write)

    def edits(self, robot: RobotRecord | None, limit: int = 50) -> list[EditRecord]:
        """The newest edits, the newest first; without a robot those of users and keys.

        Raises:
            RegistryError: the database cannot be read.
        """
        robot_id = None if robot is None else robot.id
        return self._read(partial(edits.read_edits, robot_id=robot_id, limit=limit))

    # Users and keys

    def users(self) -> list[UserRecord]:
        """All users, by name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(people.list_users)

    def user(self, name: str) -> UserRecord | None:
        """The user of that name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(partial(people.find_user, name=name))

    def keep_user(
        self, name: str, role: str, who: str, *, password_hash: str, tokens: tuple[tuple[str, str], ...] = ()
    ) -> EditRecord:
        """Add a user, or change the one of that name.

        Args:
            name: to log in with.
            role: viewer, student, teacher or administrator.
            who: who does it.
            password_hash: salted; empty: no password will do.
            tokens: pairs of (what for, hash) that stand for a password.

        Raises:
            ConfigError: no such role, or nobody would be administrator any more.
            RegistryError: the database cannot be written; nothing has changed.
        """
        now_ns = self._epoch_ns()
        change = partial(
            people.keep_user, name=name, role=role, password_hash=password_hash, tokens=tokens, now_ns=now_ns
        )
        return self._edit_people("user", who, change)

    def remove_user(self, name: str, who: str) -> EditRecord:
        """Forget a user.

        Raises:
            ConfigError: there is none of that name, or nobody would be administrator any more.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit_people("user", who, partial(people.remove_user, name=name))

    def keys(self) -> list[KeyRecord]:
        """All parts that have a key, the newest first.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(people.list_keys)

    def key_of(self, uid: bytes) -> bytes | None:
        """The key of that part.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._read(partial(people.find_key, uid=uid))

    def keep_key(self, uid: bytes, key: bytes, who: str) -> EditRecord:
        """Give a part a key in place of the one it may have had.

        Raises:
            ConfigError: the part has no UID.
            RegistryError: the database cannot be written; nothing has changed.
        """
        change = partial(people.keep_key, uid=uid, key=key, who=who, now_ns=self._epoch_ns())
        return self._edit_people("key", who, change)

    def remove_key(self, uid: bytes, who: str) -> EditRecord:
        """Forget the key of a part.

        Raises:
            ConfigError: it has none.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._edit_people("key", who, partial(people.remove_key, uid=uid))

    def _edit(self, robot: RobotRecord, who: str, change: Callable[[Connection, Author], EditRecord]) -> EditRecord:
        made = self._in_order(lambda connection: change(connection, Author(robot.id, who, self._epoch_ns())))
        if store_of_run := self._stores.get(robot.id):
            store_of_run.reread_places([uid for uid, _ in made.placed])
        return made

    def _edit_people(self, kind: str, who: str, change: Callable[[Connection], str]) -> EditRecord:
        def write(connection: Connection) -> EditRecord:
            author = Author(None, who, self._epoch_ns())
            return edits.record(connection, author, kind, change(connection), before={}, after={})

        return self._in_order(write)
