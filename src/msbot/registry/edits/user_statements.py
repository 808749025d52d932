"""The statements about users and the keys of parts."""

from __future__ import annotations

from sqlalchemy import Connection, Row, delete, select

from msbot.errors import ConfigError
from msbot.registry.database.statements import upsert
from msbot.registry.database.tables import keys, users
from msbot.registry.records import KeyRecord, UserRecord, uid_text

ROLES = ("viewer", "student", "teacher", "administrator")
"""What a user may be, from least to most rights."""


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
    """Add a user, or change the one of that name; gives what was done, in words.

    Raises:
        ConfigError: no such role, no name, or nobody would be administrator any more.
    """
    if role not in ROLES:
        raise ConfigError(f"there is no role {role!r}; there are {', '.join(ROLES)}")
    if not name.strip() or not name.isprintable():
        raise ConfigError(f"{name!r} is no name for a user: use letters")
    before = find_user(connection, name)
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
        return f"user {name} added as {role}"
    if before.role != role:
        return f"user {name} is {role} now; was {before.role}"
    return f"user {name} changed: {'tokens' if before.password_hash == password_hash else 'password'}"


def remove_user(connection: Connection, name: str) -> str:
    """Forget a user; gives what was done, in words.

    Raises:
        ConfigError: there is none of that name, or nobody would be administrator any more.
    """
    user = find_user(connection, name)
    if user is None:
        raise ConfigError(f"there is no user {name!r}")
    if user.role == ROLES[-1]:
        _keep_an_administrator(connection, name)
    connection.execute(delete(users).where(users.c.name == name))
    return f"user {name} ({user.role}) removed"


def _keep_an_administrator(connection: Connection, name: str) -> None:
    others = select(users.c.name).where(users.c.role == ROLES[-1], users.c.name != name).limit(1)
    if connection.execute(others).scalar() is None:
        raise ConfigError(f"{name} is the only {ROLES[-1]}: make somebody else {ROLES[-1]} first")


def list_keys(connection: Connection) -> list[KeyRecord]:
    """All parts that have a key, the newest first."""
    query = select(keys.c.uid, keys.c.created_ns, keys.c.created_by).order_by(keys.c.created_ns.desc(), keys.c.uid)
    return [KeyRecord(bytes.fromhex(row.uid), row.created_ns, row.created_by) for row in connection.execute(query)]


def find_key(connection: Connection, uid: bytes) -> bytes | None:
    """The key of that part."""
    key: bytes | None = connection.execute(select(keys.c.key).where(keys.c.uid == uid_text(uid))).scalar()
    return None if key is None else bytes(key)


def keep_key(connection: Connection, uid: bytes, key: bytes, *, who: str, now_ns: int) -> str:
    """Give a part a key in place of the one it may have had; gives what was done, in words.

    Raises:
        ConfigError: the part has no UID.
    """
    identity = uid_text(uid)
    if not identity:
        raise ConfigError("a part without a UID cannot have a key: there is nothing to know it by")
    had = find_key(connection, uid) is not None
    upsert(connection, keys, {"uid": identity}, {"key": key, "created_ns": now_ns, "created_by": who})
    return f"part {identity} has {'another' if had else 'a'} key"


def remove_key(connection: Connection, uid: bytes) -> str:
    """Forget the key of a part; gives what was done, in words.

    Raises:
        ConfigError: it has none.
    """
    if find_key(connection, uid) is None:
        raise ConfigError(f"part {uid.hex()} has no key")
    connection.execute(delete(keys).where(keys.c.uid == uid_text(uid)))
    return f"the key of part {uid.hex()} is removed"


def _user(row: Row[tuple[object, ...]]) -> UserRecord:
    return UserRecord(
        name=row.name,
        role=row.role,
        password_hash=row.password_hash,
        tokens=tuple((what, digest) for what, digest in row.token_hashes),
        created_ns=row.created_ns,
        changed_ns=row.changed_ns,
    )
