"""Users and the keys of parts: who may log in, and the secret that a part must prove to know."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

from sqlalchemy import Connection

from msbot.registry.database.storage import Storage
from msbot.registry.edits import user_statements as statements
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.edits.editing import Edits
from msbot.registry.records import EditKind, EditRecord, KeyRecord, UserRecord


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
        words = statements.keep_user(
            connection, name, role, password_hash=password_hash, tokens=tokens, now_ns=author.now_ns
        )
        edit = record(connection, author, EditKind.USER, words)
    assert edit is not None
    return edit


def remove(connection: Connection, author: Author, name: str) -> EditRecord:
    """Delete a user; for `Edits.make`.

    Raises:
        ConfigError: there is no user with that name, or no administrator would be left.
    """
    return record(connection, author, EditKind.USER, statements.remove_user(connection, name))


class Users:
    """The users who may log in."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def all(self) -> list[UserRecord]:
        """All users, by name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(statements.list_users)

    def find(self, name: str) -> UserRecord | None:
        """The user with that name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(statements.find_user, name=name))


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
        return self._storage.read(statements.list_keys)

    def find(self, uid: bytes) -> bytes | None:
        """The key of that part.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(statements.find_key, uid=uid))

    def keep(self, uid: bytes, key: bytes, who: str) -> EditRecord:
        """Give a part a key, replacing any earlier one.

        Raises:
            ConfigError: the part has no UID.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            words = statements.keep_key(connection, uid, key, who=who, now_ns=author.now_ns)
            return record(connection, author, EditKind.KEY, words)

        return self._edits.make(None, who, make)

    def remove(self, uid: bytes, who: str) -> EditRecord:
        """Delete the key of a part.

        Raises:
            ConfigError: it has none.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            return record(connection, author, EditKind.KEY, statements.remove_key(connection, uid))

        return self._edits.make(None, who, make)
