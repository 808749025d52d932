"""Users and the keys of parts: who may log in, and the secret that a part must prove to know."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

from sqlalchemy import Connection, Row, delete, select

from msbot.registry.class_groups import remove_from_groups
from msbot.registry.database.statements import upsert
from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import keys, users
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.edits.editing import Edits
from msbot.registry.hand_ins import remove_hand_ins_of
from msbot.registry.lesson_ticks import remove_ticks_of
from msbot.registry.programs import remove_programs_of
from msbot.registry.records import EditKind, EditRecord, KeyRecord, UserRecord, uid_text
from msbot.registry.reserved_names import check_name, check_reserved
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

# The statements about users and the keys of parts.


ROLES = ("viewer", "student", "teacher", "administrator")
"""The roles of users, from least to most rights."""


def list_users(connection: Connection) -> list[UserRecord]:
    """All users, by name."""
    return [_user(row) for row in connection.execute(select(users).order_by(users.c.name))]


def find_user(connection: Connection, name: str) -> UserRecord | None:
    """The user of that name."""
    row = connection.execute(select(users).where(users.c.name == name)).one_or_none()
    return None if row is None else _user(row)


def keep_user(
    connection: Connection,
    name: str,
    role: str,
    *,
    password_hash: str,
    tokens: tuple[tuple[str, str], ...],
    now_ns: int,
) -> str:
    """Add a user, or change the one with that name; returns what was done, in words.

    Raises:
        ConfigError: there is no such role, no name was given, or no administrator would be left.
    """
    if role not in ROLES:
        raise ConfigError(said("there is no role {role!r}; there are {roles}", role=role, roles=", ".join(ROLES)))
    before = find_user(connection, name)
    if before is None:
        check_name(name, connection.execute(select(users.c.name)).scalars())
        check_reserved(name)
    if before is not None and before.role == ROLES[-1] != role:
        _keep_an_administrator(connection, name)
    values = {
        "role": role,
        "password_hash": password_hash,
        "token_hashes": [list(pair) for pair in tokens],
        "changed_ns": now_ns,
    }
    upsert(connection, users, {"name": name}, values, created_ns=now_ns)
    if before is None:
        return said("user {name} added as {role}", name=name, role=said(role))
    if before.role != role:
        return said("user {name} is {role} now; was {before}", name=name, role=said(role), before=said(before.role))
    if before.password_hash == password_hash:
        return said("user {name} changed: tokens", name=name)
    return said("user {name} changed: password", name=name)


def remove_user(connection: Connection, name: str) -> str:
    """Delete a user; returns what was done, in words.

    Raises:
        ConfigError: there is no user with that name, or no administrator would be left.
    """
    user = find_user(connection, name)
    if user is None:
        raise ConfigError(said("there is no user {name!r}", name=name))
    if user.role == ROLES[-1]:
        _keep_an_administrator(connection, name)
    connection.execute(delete(users).where(users.c.name == name))
    remove_programs_of(connection, name)
    remove_ticks_of(connection, name)
    remove_hand_ins_of(connection, name)
    remove_from_groups(connection, name)
    return said("user {name} ({role}) removed", name=name, role=said(user.role))


def _keep_an_administrator(connection: Connection, name: str) -> None:
    others = select(users.c.name).where(users.c.role == ROLES[-1], users.c.name != name).limit(1)
    if connection.execute(others).scalar() is None:
        raise ConfigError(
            said("{name} is the only {roles}: make somebody else {roles} first", name=name, roles=ROLES[-1])
        )


def list_keys(connection: Connection) -> list[KeyRecord]:
    """All parts that have a key, the newest first."""
    query = select(keys.c.uid, keys.c.created_ns, keys.c.created_by).order_by(keys.c.created_ns.desc(), keys.c.uid)
    return [KeyRecord(bytes.fromhex(row.uid), row.created_ns, row.created_by) for row in connection.execute(query)]


def find_key(connection: Connection, uid: bytes) -> bytes | None:
    """The key of that part."""
    key: bytes | None = connection.execute(select(keys.c.key).where(keys.c.uid == uid_text(uid))).scalar()
    return None if key is None else bytes(key)


def keep_key(connection: Connection, uid: bytes, key: bytes, *, who: str, now_ns: int) -> str:
    """Give a part a key, replacing any earlier one; returns what was done, in words.

    Raises:
        ConfigError: the part has no UID.
    """
    identity = uid_text(uid)
    if not identity:
        raise ConfigError(said("a part without a UID cannot have a key: there is nothing to know it by"))
    had = find_key(connection, uid) is not None
    upsert(connection, keys, {"uid": identity}, {"key": key, "created_ns": now_ns, "created_by": who})
    return said("part {uid} has another key", uid=identity) if had else said("part {uid} has a key", uid=identity)


def remove_key(connection: Connection, uid: bytes) -> str:
    """Delete the key of a part; returns what was done, in words.

    Raises:
        ConfigError: it has none.
    """
    if find_key(connection, uid) is None:
        raise ConfigError(said("part {uid} has no key", uid=uid.hex()))
    connection.execute(delete(keys).where(keys.c.uid == uid_text(uid)))
    return said("the key of part {uid} is removed", uid=uid.hex())


def _user(row: Row[tuple[object, ...]]) -> UserRecord:
    return UserRecord(
        name=row.name,
        role=row.role,
        password_hash=row.password_hash,
        tokens=tuple((what, digest) for what, digest in row.token_hashes),
        created_ns=row.created_ns,
        changed_ns=row.changed_ns,
    )


class Person(NamedTuple):
    """A user as they are to be stored."""

    name: str
    """The name to log in with."""
    role: str
    """`viewer`, `student`, `teacher` or `administrator`."""
    password_hash: str = ""
    """Salted hash; empty: no password is accepted."""
    tokens: tuple[tuple[str, str], ...] = ()
    """Pairs of (purpose, hash) of tokens that replace a password."""


def keep(connection: Connection, author: Author, people: Iterable[Person]) -> EditRecord:
    """Add users, or change those with these names, all or nothing; for `Edits.make`. Returns the last edit.

    Raises:
        ConfigError: there is no such role, or no administrator would be left.
    """
    edit = None
    for name, role, password_hash, tokens in people:
        words = keep_user(connection, name, role, password_hash=password_hash, tokens=tokens, now_ns=author.now_ns)
        edit = record(connection, author, EditKind.USER, words)
    assert edit is not None
    return edit


def remove(connection: Connection, author: Author, name: str) -> EditRecord:
    """Delete a user; for `Edits.make`.

    Raises:
        ConfigError: there is no user with that name, or no administrator would be left.
    """
    return record(connection, author, EditKind.USER, remove_user(connection, name))


class Users:
    """The users who may log in."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def all(self) -> list[UserRecord]:
        """All users, by name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(list_users)

    def find(self, name: str) -> UserRecord | None:
        """The user with that name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(find_user, name=name))


class PartKeys:
    """The secret keys of parts, for robots that ask for them."""

    def __init__(self, storage: Storage, edits: Edits) -> None:
        self._storage = storage
        self._edits = edits

    def all(self) -> list[KeyRecord]:
        """All parts that have a key, the newest first.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(list_keys)

    def find(self, uid: bytes) -> bytes | None:
        """The key of that part.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(find_key, uid=uid))

    def store(self, uid: bytes, key: bytes, who: str) -> EditRecord:
        """Give a part a key, replacing any earlier one.

        Raises:
            ConfigError: the part has no UID.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            words = keep_key(connection, uid, key, who=who, now_ns=author.now_ns)
            return record(connection, author, EditKind.KEY, words)

        return self._edits.make(None, who, make)

    def remove(self, uid: bytes, who: str) -> EditRecord:
        """Delete the key of a part.

        Raises:
            ConfigError: it has none.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            return record(connection, author, EditKind.KEY, remove_key(connection, uid))

        return self._edits.make(None, who, make)
