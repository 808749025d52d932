"""Users and the keys of parts: who may log in, and what a part must prove to know."""

from __future__ import annotations

from functools import partial

from sqlalchemy import Connection

from msbot.registry.database.storage import Storage
from msbot.registry.edits import user_statements as statements
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.edits.editing import Edits
from msbot.registry.records import EditKind, EditRecord, KeyRecord, UserRecord


class Users:
    """Who may sign in."""

    def __init__(self, storage: Storage, edits: Edits) -> None:
        self._storage = storage
        self._edits = edits

    def all(self) -> list[UserRecord]:
        """All users, by name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(statements.list_users)

    def find(self, name: str) -> UserRecord | None:
        """The user of that name.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(statements.find_user, name=name))

    def keep(
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

        def make(connection: Connection, author: Author) -> EditRecord:
            words = statements.keep_user(
                connection, name, role, password_hash=password_hash, tokens=tokens, now_ns=author.now_ns
            )
            return record(connection, author, EditKind.USER, words)

        return self._edits.make(None, who, make)

    def remove(self, name: str, who: str) -> EditRecord:
        """Forget a user.

        Raises:
            ConfigError: there is none of that name, or nobody would be administrator any more.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            return record(connection, author, EditKind.USER, statements.remove_user(connection, name))

        return self._edits.make(None, who, make)


class PartKeys:
    """The secrets of parts, for robots that ask for one."""

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
        """Give a part a key in place of the one it may have had.

        Raises:
            ConfigError: the part has no UID.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            words = statements.keep_key(connection, uid, key, who=who, now_ns=author.now_ns)
            return record(connection, author, EditKind.KEY, words)

        return self._edits.make(None, who, make)

    def remove(self, uid: bytes, who: str) -> EditRecord:
        """Forget the key of a part.

        Raises:
            ConfigError: it has none.
            RegistryError: the database cannot be written; nothing has changed.
        """

        def make(connection: Connection, author: Author) -> EditRecord:
            return record(connection, author, EditKind.KEY, statements.remove_key(connection, uid))

        return self._edits.make(None, who, make)
