"""Errors of a database in words."""

import sqlite3

import pytest
from sqlalchemy.exc import IntegrityError, InterfaceError, NoSuchModuleError, OperationalError, ProgrammingError

from msbot.registry.database.database_errors import fault_words, is_about_the_database, refusal, told_as_registry_error
from msbot_xrce.errors import DatabaseBusy, RegistryError


def _sqlite(name: str) -> OperationalError:
    cause = sqlite3.OperationalError("raw words")
    cause.sqlite_errorname = name
    return OperationalError("SELECT", None, cause)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("SQLITE_BUSY", "is locked by another program: close the other msbot"),
        ("SQLITE_BUSY_SNAPSHOT", "is locked by another program"),
        ("SQLITE_LOCKED", "is locked by another program"),
        ("SQLITE_READONLY_DBMOVED", "is read-only: allow writing to the file and its folder"),
        ("SQLITE_PERM", "may not be used: allow reading and writing"),
        ("SQLITE_CANTOPEN", "cannot be opened: look at the permissions"),
        ("SQLITE_FULL", "has no room: the disk is full"),
        ("SQLITE_IOERR_SHMSIZE", "has no room: the disk is full"),
        ("SQLITE_IOERR_WRITE", "cannot be read or written: the disk answers with an error"),
        ("SQLITE_CORRUPT", "is damaged: move the file away and put a backup in its place"),
        ("SQLITE_NOTADB", "is not a database: some other file has this name"),
    ],
)
def test_what_sqlite_says_is_told_with_the_remedy_and_tried_again(name: str, words: str) -> None:
    assert fault_words(_sqlite(name)).startswith(words)
    assert is_about_the_database(_sqlite(name))


def test_a_wrong_statement_is_not_tried_again() -> None:
    error = IntegrityError("INSERT", None, sqlite3.IntegrityError("UNIQUE constraint failed"))
    assert not is_about_the_database(error)
    assert fault_words(error) == ("cannot be used (UNIQUE constraint failed): mend that, or choose another --db")
    assert not is_about_the_database(_sqlite("SQLITE_ERROR"))
    assert not is_about_the_database(ValueError("a mistake in the program"))
    assert fault_words(ValueError()) == "cannot be used (ValueError): mend that, or choose another --db"


def test_a_server_that_has_gone_is_told_and_tried_again() -> None:
    gone = OperationalError("SELECT", None, Exception("server closed the connection\nunexpectedly"))
    assert is_about_the_database(gone)
    assert fault_words(gone).startswith("cannot be used (server closed the connection):")
    gone.connection_invalidated = True
    assert fault_words(gone) == "does not answer any more: is the server running? Start it, or choose another --db"
    assert is_about_the_database(InterfaceError("SELECT", None, Exception("no connection")))
    assert not is_about_the_database(ProgrammingError("SELECT", None, Exception("syntax error")))


def test_errors_become_a_registry_error_that_names_the_database() -> None:
    with (
        pytest.raises(RegistryError, match=r"^the database robot.db has no room: the disk is full"),
        told_as_registry_error("robot.db"),
    ):
        raise _sqlite("SQLITE_FULL")
    bare = sqlite3.DatabaseError("file is not a database")
    bare.sqlite_errorname = "SQLITE_NOTADB"
    with (
        pytest.raises(RegistryError, match=r"^the database robot.db is not a database"),
        told_as_registry_error("robot.db"),
    ):
        raise bare
    with pytest.raises(RegistryError, match=r"name a file or postgresql://"), told_as_registry_error("x"):
        raise NoSuchModuleError("no such driver")


@pytest.mark.parametrize(
    ("name", "kind"),
    [("SQLITE_BUSY_SNAPSHOT", DatabaseBusy), ("SQLITE_LOCKED", DatabaseBusy), ("SQLITE_FULL", RegistryError)],
)
def test_a_lock_is_told_apart_because_the_same_may_succeed_a_moment_later(name: str, kind: type[RegistryError]) -> None:
    with pytest.raises(RegistryError) as caught, told_as_registry_error("robot.db"):
        raise _sqlite(name)
    assert type(caught.value) is kind
    assert type(refusal(caught.value, is_being_stored=True)) is kind


def test_other_errors_are_left_alone() -> None:
    with pytest.raises(KeyError), told_as_registry_error("robot.db"):
        raise KeyError


@pytest.mark.parametrize(
    ("is_lost", "is_being_stored", "words"),
    [
        (True, True, "it is not known yet whether this change is stored: x. If it is, it counts: look at what was"),
        (True, False, "nothing was changed: x"),
        (False, True, "nothing was changed: x"),
    ],
)
def test_a_change_whose_commit_was_in_hand_when_the_server_went_is_not_called_undone(
    is_lost: bool, is_being_stored: bool, words: str
) -> None:
    error = RegistryError("x")
    error.__cause__ = OperationalError("COMMIT", {}, Exception("gone"), connection_invalidated=is_lost)
    assert str(refusal(error, is_being_stored=is_being_stored)).startswith(words)
