"""From `--db` to a connection, and why not."""

import builtins
import os
from contextlib import closing
from pathlib import Path
from types import ModuleType

import pytest

from msbot.registry.database.engine import (
    WRITE,
    check_file,
    make_engine,
    parse_address,
    use_write_ahead_log,
    without_password,
)
from msbot_xrce.errors import RegistryError


@pytest.mark.parametrize("text", ["robot.db", Path("robot.db"), "sqlite:///robot.db"])
def test_a_file_can_be_named_in_three_ways(text: str | Path) -> None:
    address = parse_address(text)
    assert (address.words, address.path) == ("robot.db", Path("robot.db"))


def test_a_windows_path_or_a_strange_name_is_a_file() -> None:
    assert parse_address("C:\\robots\\a?b=c%20.db").path == Path("C:\\robots\\a?b=c%20.db")


def test_a_server_is_named_without_its_password() -> None:
    address = parse_address("postgresql://teacher:secret@host/robots")
    assert address.words == "postgresql://teacher:***@host/robots"
    assert without_password("postgresql://teacher:secret@host/robots") == address.words
    assert address.url.drivername == "postgresql+psycopg"
    assert address.path is None


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "a database in memory would forget everything: name a file, for example --db robot.db"),
        (":memory:", "a database in memory would forget everything: name a file, for example --db robot.db"),
        ("sqlite://", "a database in memory would forget everything: name a file, as in sqlite:///robot.db"),
        ("sqlite:///:memory:", "a database in memory would forget everything: name a file, as in sqlite:///robot.db"),
        (
            "mysql://u:secret@host/db",
            "the database 'mysql://u:***@host/db' is of an unknown kind; write a file name, sqlite:///robot.db or "
            "postgresql://user@host/name",
        ),
        (
            "postgresql://u:secret@host:port/db",
            "the database address 'postgresql://u:***@host:port/db' cannot be read; write a file name, "
            "sqlite:///robot.db or postgresql://user@host/name",
        ),
        ("://", "the database address '://' cannot be read; write a file name, "),
    ],
)
def test_what_is_no_address_is_told(text: str, sentence: str) -> None:
    with pytest.raises(RegistryError) as caught:
        parse_address(text)
    assert str(caught.value).startswith(sentence)


def _refused(path: Path, *, create: bool = True, read_only: bool = False) -> str:
    with pytest.raises(RegistryError) as caught:
        check_file(parse_address(path), create=create, read_only=read_only)
    return str(caught.value)


def test_a_missing_folder(tmp_path: Path) -> None:
    assert _refused(tmp_path / "no" / "robot.db") == (
        f"the folder {tmp_path}/no of the database does not exist: create it (`mkdir -p {tmp_path}/no`), "
        "or choose another --db"
    )
    assert f"(`mkdir -p '{tmp_path}/to do'`)" in _refused(tmp_path / "to do" / "robot.db")


def test_a_folder_in_place_of_the_file(tmp_path: Path) -> None:
    assert _refused(tmp_path) == (
        f"the database {tmp_path} is a folder: name a file in it, for example {tmp_path}/robot.db"
    )


def test_a_database_that_is_not_there_is_made_only_when_wanted(tmp_path: Path) -> None:
    path = tmp_path / "robot.db"
    assert _refused(path, create=False) == (
        f"there is no database {path}: `msbot master` makes one when it runs, or choose another --db"
    )
    check_file(parse_address(path), create=True, read_only=False)
    assert not path.exists()


def test_a_file_that_is_something_else(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("[robot]")
    assert _refused(path) == (
        f"{path} is not a database: some other file has this name; move it away, or choose another --db"
    )
    assert path.read_text() == "[robot]"


def test_an_empty_file_may_become_a_database(tmp_path: Path) -> None:
    path = tmp_path / "robot.db"
    path.touch()
    check_file(parse_address(path), create=True, read_only=False)


def test_missing_permissions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.db"
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)
    assert _refused(path) == (
        f"the database {path} cannot be made: allow writing to {tmp_path} (`chmod u+w`), or choose another --db"
    )
    path.touch()
    assert _refused(path) == (
        f"the database {path} is read-only: allow writing to the file and its folder (`chmod u+w`), "
        "or choose another --db"
    )
    check_file(parse_address(path), create=False, read_only=True)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="this system has no owners of files")
@pytest.mark.parametrize("read_only", [False, True])
def test_a_file_of_another_user_names_that_user(
    read_only: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    from pwd import getpwuid

    path = tmp_path / "robot.db"
    path.touch()
    monkeypatch.setattr("msbot.registry.database.engine.open_input_file", refuse)
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)
    owner = path.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(RegistryError) as refused:
        check_file(parse_address(path), create=False, read_only=read_only)
    assert str(refused.value) == (
        f"the database {path} belongs to another user: put `sudo -u {getpwuid(owner).pw_name}` before the command, "
        "or choose another --db"
    )


def test_a_file_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    path = tmp_path / "robot.db"
    path.touch()
    monkeypatch.setattr("msbot.registry.database.engine.open_input_file", refuse)
    assert _refused(path) == (
        f"the database {path} cannot be read (Permission denied): mend that, or choose another --db"
    )


def test_a_server_needs_no_file() -> None:
    address = parse_address("postgresql://host/robots")
    check_file(address, create=True, read_only=False)
    engine = make_engine(address, busy_timeout_s=2, read_only=False)
    use_write_ahead_log(engine, address)
    assert engine.dialect.name == "postgresql"


def test_a_missing_driver_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    real_import = builtins.__import__

    def without_psycopg(name: str, *args: object, **kwargs: object) -> ModuleType:
        if name.startswith("psycopg"):
            raise ImportError(name)
        return real_import(name, *args, **kwargs)  # type: ignore[arg-type]  # passed on as they came

    monkeypatch.setattr(builtins, "__import__", without_psycopg)
    with pytest.raises(RegistryError, match=r"PostgreSQL needs a driver: pip install 'msbot\[postgres\]'"):
        make_engine(parse_address("postgresql://host/robots"), busy_timeout_s=2, read_only=False)


def test_every_connection_checks_references_and_survives_a_power_cut(tmp_path: Path) -> None:
    address = parse_address(tmp_path / "robot.db")
    engine = make_engine(address, busy_timeout_s=0.01, read_only=False)
    use_write_ahead_log(engine, address)
    with engine.connect() as connection:
        pragmas = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("foreign_keys", "synchronous", "journal_mode", "busy_timeout", "query_only")
        }
    engine.dispose()
    assert pragmas == {
        "foreign_keys": 1,
        "synchronous": 2,
        "journal_mode": "wal",
        "busy_timeout": 10,
        "query_only": 0,
    }


def test_read_only_connections_cannot_write(tmp_path: Path) -> None:
    engine = make_engine(parse_address(tmp_path / "robot.db"), busy_timeout_s=0.01, read_only=True)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA query_only").scalar() == 1
    engine.dispose()


def test_two_writers_wait_for_each_other_at_the_beginning(tmp_path: Path) -> None:
    address = parse_address(tmp_path / "robot.db")
    engine = make_engine(address, busy_timeout_s=0.01, read_only=False)
    use_write_ahead_log(engine, address)
    writing = engine.execution_options(**{WRITE: True})
    with closing(writing.connect()) as first, closing(writing.connect()) as second, closing(engine.connect()) as reader:
        first.exec_driver_sql("SELECT 1")
        reader.exec_driver_sql("SELECT 1")
        with pytest.raises(Exception, match="database is locked"):
            second.exec_driver_sql("SELECT 1")
    engine.dispose()
