"""The one thread that writes: notes from the event loop and people's changes are queued and stored in order.

Two kinds of work share one queue. A *note* (a line of the journal, a memory of a part) never blocks and never raises in
the loop: while the database cannot be written (locked, full, frozen, away) notes are kept in memory and tried again,
many in one transaction; only when the queue is full is the oldest dropped, and counted in `lost`. A *change* by a
person is tried once, in its own transaction, after all notes before it; the person waits for a limited time and is told
whether it is stored.

While there is nothing to do, the thread checks now and then whether the database still answers
(`DatabaseWriter.watch`).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from threading import Condition, Thread
from time import monotonic
from typing import Generic, TypeVar, cast

from sqlalchemy import Connection, Engine

from msbot.registry.database.database_errors import (
    fault_words,
    is_about_the_database,
    kind_of,
    not_known,
    refusal,
    told_as_registry_error,
)
from msbot.registry.database.engine import WAIT_S, WRITE
from msbot_agent.text.sentence import said
from msbot_xrce.errors import DatabaseBusy, MsbotError, RegistryError

# A person's change on its way to the database, and how a thread or an event loop waits for it.


_T = TypeVar("_T")


class PendingChange(Executor, Generic[_T]):
    """A person's change on its way to the database; made by `DatabaseWriter.submit`.

    It is an executor so that an event loop with a virtual clock knows that a thread is working for it.
    """

    def __init__(
        self, give_up: Callable[[PendingChange[_T]], _T], change: Callable[[Connection], _T], wait_s: float
    ) -> None:
        self.change = change
        self.wait_s = wait_s
        """How long it waits for another program that is writing."""
        self.done: Future[_T] = Future()
        self.is_given_up = False
        self.is_being_stored = False
        self._give_up = give_up

    def submit(self, _fn: object, /, *_args: object, **_kwargs: object) -> Future[_T]:  # type: ignore[override]
        """The future that the event loop waits for."""
        return self.done

    def wait(self, limit_s: float) -> _T:
        """Wait until it is stored; returns what the change returns.

        Raises:
            RegistryError: it cannot be stored and nothing has changed, or it is unknown whether it was; the text says
                which.
            Exception: what the change raises.
        """
        try:
            return self.done.result(limit_s)
        except TimeoutError:
            return self._give_up(self)

    async def stored(self, limit_s: float) -> _T:
        """The same for an event loop, without blocking it."""
        waiting = asyncio.get_running_loop().run_in_executor(self, self.done.result)
        done, _ = await asyncio.wait({waiting}, timeout=limit_s)
        if done:
            return waiting.result()
        waiting.cancel()
        return self._give_up(self)

    def answer(self, made: _T | None = None, *, error: BaseException | None = None) -> None:
        """Tell who waits what came of it; who has stopped waiting has cancelled it and is told nothing."""
        if not self.done.set_running_or_notify_cancel():
            return
        if error is None:
            self.done.set_result(cast("_T", made))
        else:
            self.done.set_exception(error)


Note = Callable[[Connection], None]
"""Executes its statements on the connection; must not commit, and may be called again after a failed transaction."""

CAPACITY = 10_000
BATCH = 256
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 5.0
SILENT_S = 2.0
"""A database that has not answered for this long counts as silent."""
WATCH_S = 1.0
"""Period in which an idle database is checked."""

_log = logging.getLogger(__name__)
Follow = Callable[[Connection], Callable[[bool], None]]


class DatabaseWriter:
    """The thread that writes; created and closed by the registry.

    Args:
        engine: where to write.
        database: the database in words.
        capacity: most notes kept in memory.
        first_retry_s: pause after the first failure; doubles up to 5 s.
        check: called before each transaction; raises `RegistryError` when the database was replaced or lost.
    """

    def __init__(
        self,
        engine: Engine,
        database: str,
        *,
        capacity: int = CAPACITY,
        first_retry_s: float = FIRST_RETRY_S,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self.lost = 0
        """Notes that were dropped: the queue was full, or the database does not accept them."""
        self._follow: Follow = lambda _: lambda _: None
        self._watch: Callable[[Connection], None] | None = None
        self._engine = engine.execution_options(**{WRITE: True})
        self._plain = engine
        self._database = database
        self._capacity = capacity
        self._first_retry_s = first_retry_s
        self._check = check
        self._fence: Note = lambda _: None
        self._changed = Condition()
        self._waiting: deque[Note | PendingChange[object]] = deque()
        self._in_hand: Sequence[Note] = ()
        self._fault = ""
        self._fault_kind: type[RegistryError] = RegistryError
        self._tries = 0
        self._last_failed = 0
        """Number of the most recent try that failed."""
        self._asked_at: float | None = None
        """When the request was made that the database has not answered yet."""
        self._hurry = False
        self._closing = False
        self._thread = Thread(target=self._serve, name="msbot registry writer", daemon=True)
        self._thread.start()

    @property
    def pending(self) -> int:
        """Notes and changes that are not stored yet."""
        return len(self._waiting) + len(self._in_hand)

    @property
    def fault(self) -> str | None:
        """What is wrong with the database, as the second half of a sentence; None if all is well."""
        if self._fault:
            return self._fault
        asked_at = self._asked_at
        if asked_at is not None and (silent_s := monotonic() - asked_at) > SILENT_S:
            return said(
                "has not answered for {silent_s:.0f} s: look whether its server, or the disk, is busy or hangs",
                silent_s=silent_s,
            )
        return None

    @property
    def trouble(self) -> str | None:
        """Why changes are not being stored, in words; None if all is well."""
        fault = self.fault
        if fault is None:
            return None
        return said(
            "the database {database} {fault}; changes kept in memory until it can be written: {pending}",
            database=self._database,
            fault=fault,
            pending=self.pending,
        )

    def watch(self, look: Callable[[Connection], None], follow: Follow) -> None:
        """Register functions that follow what changes in the database.

        Args:
            look: called about once a second while there is nothing to write.
            follow: called in the transaction of each change; the function that it returns is called once the change is
                stored, with True if nobody waits for it any more.
        """
        with self._changed:
            self._watch, self._follow = look, follow
            self._changed.notify_all()

    def use_fence(self, fence: Note) -> None:
        """Begin every transaction with this call, which raises `RegistryError` when this process may write no more."""
        self._fence = fence

    def put(self, note: Note) -> None:
        """Hand over one note; never blocks and never raises."""
        with self._changed:
            if self._closing:
                self.lost += 1
                _log.error("a change came after the database %s was closed; it is lost", self._database)
                return
            if len(self._waiting) >= self._capacity:
                self._waiting.popleft()
                self.lost += 1
            self._waiting.append(note)
            self._changed.notify_all()

    def submit(self, change: Callable[[Connection], _T], *, wait_s: float) -> PendingChange[_T]:
        """Make a person's change after everything that was handed over before.

        Args:
            change: executes its statements; called once.
            wait_s: how long the database waits for another program that is writing.

        Raises:
            RegistryError: too many changes are waiting already, or the database is closed; nothing has changed.
        """
        job = PendingChange(self.give_up, change, wait_s)
        with self._changed:
            if self._closing:
                raise RegistryError(said("the database {database} is closed", database=self._database))
            if len(self._waiting) >= self._capacity:
                raise self._not_made()
            self._waiting.append(cast("PendingChange[object]", job))
            self._hurry = True
            self._changed.notify_all()
        return job

    def give_up(self, job: PendingChange[_T]) -> _T:
        """Stop waiting for a change; returns its result if it is stored by now.

        Raises:
            RegistryError: nothing has changed, or it is unknown whether the change was stored.
        """
        with self._changed:
            job.is_given_up = True
            if job.done.done() and not job.done.cancelled():
                return job.done.result()
            if job.is_being_stored:
                raise not_known(self.trouble or self._busy)
            with contextlib.suppress(ValueError):
                self._waiting.remove(cast("PendingChange[object]", job))
            raise self._not_made()

    @property
    def _busy(self) -> str:
        return said("the database {database} is busy: try again", database=self._database)

    def _not_made(self) -> RegistryError:
        """The error for a change that was not made; of another kind where only its turn, or a lock, was waited for."""
        trouble = self.trouble
        kind = DatabaseBusy if trouble is None else self._fault_kind if self._fault else RegistryError
        return kind(said("nothing was changed: {why}", why=trouble or self._busy))

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything handed over is stored; False: a try has just failed, or it took too long."""
        until = monotonic() + timeout_s
        with self._changed:
            # A try already under way may have met a fault that has been cured since; the next one counts.
            last_try = self._tries
            self._hurry = self.pending > 0
            self._changed.notify_all()
            while self.pending and self._last_failed <= last_try and self._thread.is_alive():
                if not self._changed.wait(until - monotonic()):
                    break
            return not self.pending

    def close(self, timeout_s: float = 10.0) -> bool:
        """Store what can be stored, then end the thread; what cannot is lost and logged. False: something was lost."""
        until = monotonic() + timeout_s
        self.flush(timeout_s)
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(max(0.1, until - monotonic()))
        if left := self.pending:
            _log.error(
                "the database %s was closed before all changes were stored, %d are lost: it %s",
                self._database,
                left,
                self.fault or "is too slow",
            )
        return not left

    # The thread

    def _serve(self) -> None:
        while True:
            job = self._take()
            if isinstance(job, PendingChange):
                self._make(job)
            elif job == "end" or (job == "notes" and not self._store()):
                return
            elif job == "nothing":
                self._look()

    def _take(self) -> PendingChange[object] | str:
        """The next change, or what to do: `notes` are ready, `nothing` to do for a while, or the `end`."""
        with self._changed:
            while not self._waiting and not self._closing:
                if not self._changed.wait(None if self._watch is None else WATCH_S):
                    return "nothing"
            if not self._waiting:
                return "end"
            first = self._waiting.popleft()
            if isinstance(first, PendingChange):
                return first
            notes = [first]
            while self._waiting and len(notes) < BATCH and not isinstance(self._waiting[0], PendingChange):
                note = self._waiting.popleft()
                assert not isinstance(note, PendingChange)
                notes.append(note)
            self._in_hand = notes
            return "notes"

    def _look(self) -> None:
        """Find out whether the database answers before somebody needs it."""
        watch = self._watch
        if watch is None:
            return
        self._asked_at = monotonic()
        try:
            self._check()
            with self._plain.connect() as connection:
                watch(connection)
        except Exception as error:
            self._note_fault(error)
        else:
            self._note_health()
        finally:
            self._asked_at = None

    def _make(self, job: PendingChange[object]) -> None:
        """Make a person's change, or say why not."""
        with self._changed:
            if job.is_given_up:
                return
            self._tries += 1
        self._asked_at = monotonic()
        try:
            with told_as_registry_error(self._database):
                self._check()
                engine = self._engine.execution_options(**{WAIT_S: job.wait_s})
                with engine.connect() as connection, connection.begin():
                    self._fence(connection)
                    made = job.change(connection)
                    then = self._follow(connection)
                    with self._changed:
                        if job.is_given_up:
                            raise RegistryError(said("nobody waits for this change any more"))
                        job.is_being_stored = True
        except RegistryError as error:
            job.answer(error=refusal(error, is_being_stored=job.is_being_stored))
        except MsbotError as error:
            job.answer(error=error)
        except Exception as error:
            _log.exception("a change failed")
            job.answer(error=error)
        else:
            then(job.is_given_up)
            job.answer(made)
            self._note_health()
        finally:
            self._asked_at = None
            with self._changed:
                self._changed.notify_all()

    def _store(self) -> bool:
        """Store the notes taken from the queue; False: the writer had to end before that could be done."""
        pause_s = self._first_retry_s
        at_once = len(self._in_hand)
        while self._in_hand:
            group = self._in_hand[:at_once]
            error = self._try(group)
            if error is None:
                self._done(len(group))
                pause_s = self._first_retry_s
            elif is_about_the_database(error):
                if not self._wait_after(error, pause_s):
                    return False
                pause_s = min(2 * pause_s, LONGEST_RETRY_S)
            elif at_once > 1:
                at_once = 1  # to find the one that is wrong
            else:
                self._give_up(error)
        return True

    def _try(self, notes: Sequence[Note]) -> Exception | None:
        """Store all of the notes or none; returns the error, if any."""
        with self._changed:
            self._tries += 1
        self._asked_at = monotonic()
        try:
            self._check()
            with self._engine.connect() as connection, connection.begin():
                self._fence(connection)
                for note in notes:
                    note(connection)
        except Exception as error:
            return error
        finally:
            self._asked_at = None
        return None

    def _done(self, count: int) -> None:
        with self._changed:
            self._in_hand = self._in_hand[count:]
            self._changed.notify_all()
        self._note_health()

    def _note_health(self) -> None:
        with self._changed:
            if self._fault:
                _log.warning("the database %s can be written again", self._database)
                self._fault = ""

    def _note_fault(self, error: Exception) -> None:
        with self._changed:
            words = fault_words(error)
            if not self._fault:
                _log.warning("the database %s %s; until then changes are kept in memory", self._database, words)
            self._fault, self._fault_kind = words, kind_of(error)

    def _wait_after(self, error: Exception, pause_s: float) -> bool:
        """Note a failure and wait for the next try; False: the writer has to end."""
        self._note_fault(error)
        with self._changed:
            self._last_failed = self._tries
            self._refuse_changes()
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._hurry or self._closing, pause_s)
            self._hurry = False
            return not self._closing

    def _refuse_changes(self) -> None:
        """Refuse all waiting changes: nobody should wait for one that cannot be made now."""
        for job in [one for one in self._waiting if isinstance(one, PendingChange)]:
            self._waiting.remove(job)
            job.answer(error=self._not_made())

    def _give_up(self, error: Exception) -> None:
        with self._changed:
            self._in_hand = self._in_hand[1:]
            self.lost += 1
            _log.error("the database %s does not take a change", self._database, exc_info=error)
            self._changed.notify_all()
