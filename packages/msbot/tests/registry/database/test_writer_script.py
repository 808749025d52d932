"""The writer beside a database that follows a script, in virtual time: all that is asked, said and stored, in order."""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, current_thread
from typing import Any, TypeVar

import pytest
from sqlalchemy import Connection
from sqlalchemy.exc import OperationalError

from msbot.registry.database import database_writer as writer_module
from msbot.registry.database.database_writer import DatabaseWriter, Note, PendingChange
from msbot.registry.database.engine import WAIT_S, WRITE
from msbot_xrce.errors import ConfigError, MsbotError, RegistryError

_T = TypeVar("_T")
LOCKED = (
    "is locked by another program: close the other msbot or database tool that writes to it, or choose another --db"
)


def busy() -> OperationalError:
    cause = sqlite3.OperationalError("database is locked")
    cause.sqlite_errorname = "SQLITE_BUSY"
    return OperationalError("BEGIN", None, cause)


def gone() -> OperationalError:
    return OperationalError("COMMIT", {}, Exception("gone"), connection_invalidated=True)


class Scripted:
    """An engine, its connection and its transaction; and the clock of the writer's thread."""

    def __init__(self) -> None:
        self.said: list[object] = []
        self.faults: deque[tuple[str, Exception | None]] = deque()
        """Where the next transactions fail: at `check`, `begin` or `commit`; None: not."""
        self.now = 100.0
        self.at_commit: Callable[[], object] = lambda: None

    def execution_options(self, **options: object) -> View:
        return View(self, options)

    def connect(self) -> Any:
        return View(self, {}).connect()

    def fail(self, *places: str, error: Callable[[], Exception | None] = busy) -> None:
        self.faults.extend((place, error()) for place in places)

    def meet(self, place: str) -> None:
        if self.faults and self.faults[0][0] == place:
            error = self.faults.popleft()[1]
            if error is not None:
                raise error

    def check(self) -> None:
        self.meet("check")

    def note(self, name: object) -> Note:
        def write(_connection: Connection) -> None:
            self.said.append(name)

        return write


class View:
    def __init__(self, script: Scripted, options: dict[str, object]) -> None:
        self.script, self.options = script, options

    def execution_options(self, **options: object) -> View:
        return View(self.script, self.options | options)

    @contextmanager
    def _connected(self) -> Iterator[View]:
        yield self

    def connect(self) -> Any:
        return self._connected()

    @contextmanager
    def begin(self) -> Iterator[None]:
        script = self.script
        script.said.append(("begin", self.options[WRITE], self.options.get(WAIT_S)))
        script.meet("begin")
        try:
            yield
            script.at_commit()
            script.meet("commit")
        except BaseException:
            script.said.append("rollback")
            raise
        script.said.append("commit")


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Scripted:
    script = Scripted()

    class Virtual(threading.Condition):
        """For the writer's thread, time passes while it waits; others wait until it is done."""

        def wait(self, timeout: float | None = None) -> bool:
            if current_thread().name != "msbot registry writer":
                return timeout is not None and timeout > 0 and super().wait(20)
            if timeout is None:
                return super().wait()
            script.said.append(("waits", timeout))
            script.now += timeout
            super().wait(0)
            return False

        def wait_for(self, predicate: Callable[[], _T], timeout: float | None = None) -> _T:
            if not (is_so := predicate()):
                self.wait(timeout)
            return is_so or predicate()

    monkeypatch.setattr(writer_module, "Condition", Virtual)
    monkeypatch.setattr(writer_module, "monotonic", lambda: script.now)
    return script


@pytest.fixture
def writer(script: Scripted) -> Iterator[DatabaseWriter]:
    writer = DatabaseWriter(script, "robot.db", capacity=8, check=script.check)  # type: ignore[arg-type]  # as far as it is used
    yield writer
    writer.close()
    writer._thread.join(20)  # its patience was virtual
    assert not writer._thread.is_alive()


@contextmanager
def held(writer: DatabaseWriter, script: Scripted) -> Iterator[None]:
    """The writer is in the middle of a transaction; what is handed over meanwhile waits. Then all of it is done."""
    started, go_on = Event(), Event()

    def hold(_connection: Connection) -> None:
        started.set()
        assert go_on.wait(20)

    writer.put(hold)
    assert started.wait(20)
    script.said.clear()
    yield
    go_on.set()


def one(*said: object, wait_s: float | None = None) -> list[object]:
    """A transaction."""
    return [("begin", True, wait_s), *said, "commit"]


def test_all_is_done_in_order_many_notes_at_once_and_each_change_alone(
    writer: DatabaseWriter, script: Scripted, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "BATCH", 2)
    stored: list[object] = []

    def follow(_connection: Connection) -> Callable[[bool], None]:
        script.said.append("follow")
        return lambda is_given_up: stored.append(("then", is_given_up, list(script.said)[-1]))

    writer.use_fence(script.note("fence"))
    writer.watch(lambda _: None, follow)

    def change(_connection: Connection) -> str:
        script.said.append("change")
        return "made"

    with held(writer, script):
        for number in range(5):
            writer.put(script.note(number))
        job = writer.submit(change, wait_s=0.25)
        writer.put(script.note(5))
        assert writer.pending == 8
    assert writer.flush()
    said = [word for word in script.said if not isinstance(word, tuple) or word[0] == "begin"]
    assert said == [
        "commit",
        *one("fence", 0, 1),
        *one("fence", 2, 3),
        *one("fence", 4),
        *one("fence", "change", "follow", wait_s=0.25),
        *one("fence", 5),
    ]
    assert (job.wait(0), stored) == ("made", [("then", False, "commit")])
    assert (writer.pending, writer.lost, writer.trouble) == (0, 0, None)


def test_a_locked_database_is_asked_less_and_less_often_and_said_once(
    writer: DatabaseWriter, script: Scripted, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    script.faults.append(("commit", None))  # the one that is held
    with held(writer, script):
        script.fail(*["begin"] * 4, "check", "begin", "begin", "commit", "begin")
        for name in ("one", "two"):
            writer.put(script.note(name))
    with writer._changed:
        while writer.pending:
            writer._changed.wait(1)
    begun: list[object] = [("begin", True, None)]
    tries = [
        begun,
        begun,
        begun,
        begun,
        [],
        begun,
        begun,
        [*begun, "one", "two", "rollback"],
        begun,
        one("one", "two"),
    ]
    expected: list[object] = ["commit"]
    for pause, words in zip((None, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0), tries, strict=True):
        expected += [*([] if pause is None else [("waits", pause)]), *words]
    assert script.said == expected
    writer.close()
    assert caplog.messages == [
        f"the database robot.db {LOCKED}; until then changes are kept in memory",
        "the database robot.db can be written again",
    ]
    assert (writer.pending, writer.lost, writer.fault, writer.trouble) == (0, 0, None, None)


def test_one_that_is_wrong_is_given_up_alone_and_a_success_makes_the_pauses_short_again(
    writer: DatabaseWriter, script: Scripted, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)

    def wrong(_connection: Connection) -> None:
        raise KeyError("a mistake")

    with held(writer, script):
        script.faults.append(("commit", None))
        script.fail("begin", "begin")
        for note in (script.note(1), wrong, script.note(2), wrong, script.note(3)):
            writer.put(note)
    script.faults.append(("commit", None))
    assert writer.flush() or writer.flush() or writer.flush()
    begun, rolled = ("begin", True, None), "rollback"
    tries = [word for word in script.said if not isinstance(word, tuple) or word[0] == "begin"]
    assert tries == [
        "commit",
        begun,
        begun,
        begun,
        1,
        rolled,
        *one(1),
        begun,
        rolled,
        *one(2),
        begun,
        rolled,
        *one(3),
    ]
    assert writer.lost == 2
    assert caplog.messages == [
        f"the database robot.db {LOCKED}; until then changes are kept in memory",
        "the database robot.db can be written again",
        *["the database robot.db does not take a change"] * 2,
    ]


@pytest.mark.parametrize(
    ("place", "error", "raised", "words", "is_logged"),
    [
        ("begin", busy, RegistryError, f"nothing was changed: the database robot.db {LOCKED}", False),
        ("commit", busy, RegistryError, f"nothing was changed: the database robot.db {LOCKED}", False),
        (
            "commit",
            gone,
            RegistryError,
            "it is not known yet whether this change is stored: the database robot.db does not answer any more",
            False,
        ),
        ("begin", gone, RegistryError, "nothing was changed: the database robot.db does not answer any more", False),
        ("check", lambda: RegistryError("is away"), RegistryError, "nothing was changed: is away", False),
        ("fence", lambda: RegistryError("takes nothing"), RegistryError, "nothing was changed: takes nothing", False),
        ("change", lambda: ConfigError("no such slot"), ConfigError, "no such slot", False),
        ("change", lambda: KeyError("a mistake"), KeyError, "a mistake", True),
        ("follow", lambda: KeyError("a mistake"), KeyError, "a mistake", True),
    ],
)
def test_whoever_makes_a_change_that_fails_is_told_and_nothing_of_it_stays(
    writer: DatabaseWriter,
    script: Scripted,
    caplog: pytest.LogCaptureFixture,
    place: str,
    error: Callable[[], Exception],
    raised: type[Exception],
    words: str,
    is_logged: bool,
) -> None:
    caplog.set_level(logging.DEBUG)

    def at(here: str) -> Note:
        def meet(_connection: Connection) -> None:
            script.said.append(here)
            script.meet(here)

        return meet

    def follow(connection: Connection) -> Callable[[bool], None]:
        at("follow")(connection)
        return lambda _: script.said.append("then")

    writer.use_fence(at("fence"))
    writer.watch(lambda _: None, follow)
    script.fail(place, error=error)
    job = writer.submit(at("change"), wait_s=1.5)
    with pytest.raises(raised) as caught:
        job.wait(20)
    assert str(caught.value).strip("'").startswith(words)
    assert isinstance(caught.value, MsbotError) is not is_logged
    said = [word for word in script.said if not isinstance(word, tuple) or word[0] == "begin"]
    whole: list[object] = [("begin", True, 1.5), "fence", "change", "follow"]
    end = {"check": 0, "begin": 1, "fence": 2, "change": 3, "follow": 4, "commit": 4}[place]
    assert said == [*whole[:end], *(["rollback"] if end > 1 else [])]
    assert caplog.messages == (["a change failed"] if is_logged else [])
    assert (writer.lost, writer.fault) == (0, None)
    assert writer.submit(lambda _: "made", wait_s=1.0).wait(20) == "made"


def test_a_change_that_is_given_up_counts_only_if_it_is_being_stored(writer: DatabaseWriter, script: Scripted) -> None:
    told: list[object] = []
    writer.watch(lambda _: None, lambda _: told.append)
    jobs: list[PendingChange[str]] = []

    def give_up() -> None:
        with pytest.raises(RegistryError) as caught:
            writer.give_up(jobs.pop())
        told.append(str(caught.value).partition(":")[0])

    with held(writer, script):
        jobs.append(writer.submit(lambda _: "not made", wait_s=1.0))
        assert writer.pending == 2
        give_up()
        assert writer.pending == 1
    writer.flush()
    assert told == ["nothing was changed"]

    def make(_connection: Connection) -> str:
        give_up()
        return "made"

    with held(writer, script):  # in the middle of it
        jobs.append(writer.submit(make, wait_s=1.0))
        late = jobs[0]
    with pytest.raises(RegistryError, match="nothing was changed: nobody waits for this change any more"):
        late.wait(20)
    assert told == ["nothing was changed"] * 2

    with held(writer, script):  # while it is stored
        jobs.append(writer.submit(lambda _: "stored", wait_s=1.0))
        late = jobs[0]
        hooks = iter((lambda: None, give_up))

        def at_commit() -> None:
            next(hooks)()

        script.at_commit = at_commit
    assert late.wait(20) == "stored"
    assert told[2:] == ["it is not known yet whether this change is stored", True]
    assert writer.give_up(late) == "stored"


def test_an_idle_database_is_looked_at_once_a_second_and_what_is_wrong_with_it_is_said(
    script: Scripted, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    writer = DatabaseWriter(script, "robot.db", check=script.check)  # type: ignore[arg-type]  # as far as it is used
    found: list[object] = []
    done = Event()

    def look(connection: Any) -> None:
        assert connection.options == {}
        found.append((script.now, writer.fault))
        if len(found) == 2:
            script.now += 2.0
            found.append(writer.fault)
            script.now += 0.5
            found.append(writer.trouble)
            raise busy()
        if len(found) == 5:
            script.fail("check", error=lambda: RegistryError("was moved"))
        if len(found) >= 6:
            writer._closing = True
            done.set()

    writer.watch(look, lambda _: lambda _: None)
    assert done.wait(20)
    writer.close()
    silent = "has not answered for 2 s: look whether its server, or the disk, is busy or hangs"
    assert found == [
        (101.0, None),
        (102.0, None),
        None,
        f"the database robot.db {silent}; changes kept in memory until it can be written: 0",
        (105.5, LOCKED),
        (107.5, "was moved"),
    ]
    assert caplog.messages == [
        f"the database robot.db {LOCKED}; until then changes are kept in memory",
        "the database robot.db can be written again",
        "the database robot.db was moved; until then changes are kept in memory",
        "the database robot.db can be written again",
    ]


def test_more_than_it_can_hold_is_lost_or_refused_and_so_is_what_comes_after_the_end(
    writer: DatabaseWriter, script: Scripted, caplog: pytest.LogCaptureFixture
) -> None:
    with held(writer, script):
        for number in range(9):
            assert (writer.pending, writer.lost) == (number + 1, 0) or number == 8
            writer.put(script.note(number))
        assert (writer.pending, writer.lost) == (9, 1)
        with pytest.raises(RegistryError, match=r"nothing was changed: the database robot\.db is busy: try again"):
            writer.submit(lambda _: None, wait_s=1.0)
    assert writer.flush()
    assert script.said == ["commit", *one(*range(1, 9))]
    writer.close()
    writer.put(script.note("late"))
    with pytest.raises(RegistryError, match=r"the database robot\.db is closed"):
        writer.submit(lambda _: None, wait_s=1.0)
    assert (writer.lost, writer.pending) == (2, 0)
    assert caplog.messages == ["a change came after the database robot.db was closed; it is lost"]


def test_a_change_that_waits_behind_what_cannot_be_stored_is_refused_at_once(
    writer: DatabaseWriter, script: Scripted
) -> None:
    with held(writer, script):
        script.faults.append(("commit", None))
        script.fail("begin")
        writer.put(script.note("note"))
        jobs = [writer.submit(lambda _: None, wait_s=1.0) for _ in range(2)]
        writer.put(script.note("another"))
    for job in jobs:
        with pytest.raises(RegistryError) as caught:
            job.wait(20)
        assert str(caught.value).startswith(f"nothing was changed: the database robot.db {LOCKED}; changes kept in ")
    assert writer.flush() or writer.flush()
    said = [word for word in script.said if not isinstance(word, tuple) or word[0] == "begin"]
    assert said == ["commit", ("begin", True, None), *one("note"), *one("another")]
