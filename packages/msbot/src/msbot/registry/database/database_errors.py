"""What went wrong with a database, in words, with the remedy."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import DBAPIError, NoSuchModuleError, SQLAlchemyError

from msbot_agent.text.sentence import said
from msbot_xrce.errors import DatabaseBusy, RegistryError

ELSE = said("or choose another --db")

_SQLITE_WORDS = {
    "SQLITE_BUSY": said(
        "is locked by another program: close the other msbot or database tool that writes to it, {otherwise}",
        otherwise=ELSE,
    ),
    "SQLITE_LOCKED": said(
        "is locked by another program: close the other msbot or database tool that writes to it, {otherwise}",
        otherwise=ELSE,
    ),
    "SQLITE_READONLY": said(
        "is read-only: allow writing to the file and its folder (`chmod u+w`), {otherwise}", otherwise=ELSE
    ),
    "SQLITE_PERM": said(
        "may not be used: allow reading and writing the file and its folder (`chmod u+rw`), {otherwise}", otherwise=ELSE
    ),
    "SQLITE_CANTOPEN": said(
        "cannot be opened: look at the permissions of the file and its folder, {otherwise}", otherwise=ELSE
    ),
    "SQLITE_FULL": said("has no room: the disk is full; delete something"),
    # The index of its log could not be made larger.
    "SQLITE_IOERR_SHMSIZE": said("has no room: the disk is full; delete something"),
    "SQLITE_IOERR": said("cannot be read or written: the disk answers with an error; look at the disk and its cable"),
    "SQLITE_CORRUPT": said("is damaged: move the file away and put a backup in its place, {otherwise}", otherwise=ELSE),
    "SQLITE_NOTADB": said(
        "is not a database: some other file has this name; move it away, {otherwise}", otherwise=ELSE
    ),
}
"""Sentences by the beginning of SQLite's error name."""

_TRANSIENT = (
    "SQLITE_BUSY",
    "SQLITE_LOCKED",
    "SQLITE_READONLY",
    "SQLITE_PERM",
    "SQLITE_CANTOPEN",
    "SQLITE_FULL",
    "SQLITE_IOERR",
    "SQLITE_CORRUPT",
    "SQLITE_NOTADB",
)


_BUSY = ("SQLITE_BUSY", "SQLITE_LOCKED")


def fault_words(error: BaseException) -> str:
    """The second half of a sentence that begins "the database NAME", for any error of a database driver."""
    if isinstance(error, RegistryError):
        return str(error)
    if name := _sqlite_name(error):
        for beginning, words in _SQLITE_WORDS.items():
            if name.startswith(beginning):
                return words
    if isinstance(error, DBAPIError) and error.connection_invalidated:
        return said("does not answer any more: is the server running? Start it, {otherwise}", otherwise=ELSE)
    return said("cannot be used ({why}): mend that, {otherwise}", why=_first_line(error), otherwise=ELSE)


def kind_of(error: BaseException) -> type[RegistryError]:
    """What to raise for an error of a database driver: of a lock it is known that it ends."""
    is_lock = isinstance(error, DatabaseBusy) or _sqlite_name(error).startswith(_BUSY)
    return DatabaseBusy if is_lock else RegistryError


def is_about_the_database(error: BaseException) -> bool:
    """Whether the same statement may succeed later: the database is locked, full or gone; no wrong statement."""
    if isinstance(error, RegistryError):
        return True  # found out before the statement was tried
    if name := _sqlite_name(error):
        return name.startswith(_TRANSIENT)
    if isinstance(error, DBAPIError):
        return error.connection_invalidated or type(error).__name__ in ("OperationalError", "InterfaceError")
    return False


def was_ended_for_standing_still(error: DBAPIError) -> bool:
    """Whether PostgreSQL ended a transaction in which nothing was done for too long; nothing of it is stored."""
    return getattr(error.orig, "sqlstate", None) == "25P03"  # idle_in_transaction_session_timeout (PostgreSQL App. A)


@contextmanager
def told_as_registry_error(database: str) -> Iterator[None]:
    """Turn every error of the database into a `RegistryError` that names the database and the remedy."""
    try:
        yield
    except NoSuchModuleError as error:
        raise RegistryError(
            said(
                "the database {database} cannot be used ({error}); name a file or postgresql://...",
                database=database,
                error=str(error),
            )
        ) from None
    except (SQLAlchemyError, sqlite3.Error) as error:
        words = said("the database {database} {fault}", database=database, fault=fault_words(error))
        raise kind_of(error)(words) from error


def refusal(error: RegistryError, *, is_being_stored: bool) -> RegistryError:
    """The error for the person who asked for a change that the database did not accept.

    Args:
        error: from `told_as_registry_error`.
        is_being_stored: the commit had begun.
    """
    cause = error.__cause__
    if is_being_stored and isinstance(cause, DBAPIError) and cause.connection_invalidated:
        return not_known(str(error))  # the server went away with it
    return kind_of(error)(said("nothing was changed: {why}", why=str(error)))


def not_known(why: str) -> RegistryError:
    """The error for a change of which nobody knows whether it is stored."""
    return RegistryError(
        said(
            "it is not known yet whether this change is stored: {why}. If it is, it counts: look at what was changed "
            "when the database answers again",
            why=why,
        )
    )


def _sqlite_name(error: BaseException) -> str:
    """SQLite's own name of the error, for example `SQLITE_BUSY`; empty when it is not one of SQLite's."""
    cause = error.orig if isinstance(error, DBAPIError) else error
    if not isinstance(cause, sqlite3.Error):
        return ""
    # Errors found by the driver itself carry no name.
    return getattr(cause, "sqlite_errorname", "")


def _first_line(error: BaseException) -> str:
    cause = error.orig if isinstance(error, DBAPIError) and error.orig is not None else error
    return (str(cause).strip().splitlines() or [type(cause).__name__])[0]
