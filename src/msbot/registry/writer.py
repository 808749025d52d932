"""The one thread that writes: changes are queued by the event loop and stored in order, many in one transaction.

A change is never refused and never raises in the loop. While the database cannot be written (locked, full,
read-only) changes are kept in memory and tried again; `trouble` says so in words. Only when the queue is full is the
oldest change given up; it is counted in `lost`.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Sequence
from threading import Condition, Thread
from time import monotonic

from sqlalchemy import Connection, Engine

from msbot.registry.engine import WRITE
from msbot.registry.faults import fault_words, is_about_the_database

Change = Callable[[Connection], None]
"""Executes its statements on the connection; must not commit. May be called again after a failed transaction."""

CAPACITY = 10_000
BATCH = 256
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 5.0

_log = logging.getLogger(__name__)


class Writer:
    """See the module docstring. Made and closed by the registry.

    Args:
        engine: where to write.
        database: the database in words.
        capacity: changes kept in memory at most.
        first_retry_s: pause after a first failure; doubles up to 5 s.
    """

    def __init__(
        self, engine: Engine, database: str, *, capacity: int = CAPACITY, first_retry_s: float = FIRST_RETRY_S
    ) -> None:
        self.lost = 0
        """Changes that were given up: the queue was full, or the database does not take them."""
        self._engine = engine.execution_options(**{WRITE: True})
        self._database = database
        self._capacity = capacity
        self._first_retry_s = first_retry_s
        self._changed = Condition()
        self._waiting: deque[Change] = deque()
        self._in_hand: Sequence[Change] = ()
        self._fault = ""
        self._tries = 0
        self._last_failed = 0
        """Number of the last try that failed."""
        self._hurry = False
        self._closing = False
        self._thread = Thread(target=self._serve, name="msbot registry writer", daemon=True)
        self._thread.start()

    @property
    def pending(self) -> int:
        """Changes that are not stored yet."""
        return len(self._waiting) + len(self._in_hand)

    @property
    def trouble(self) -> str | None:
        """Why changes are not being stored, in words; None when all is well."""
        if not self._fault:
            return None
        kept = f"changes kept in memory until it can be written: {self.pending}"
        return f"the database {self._database} {self._fault}; {kept}"

    def put(self, change: Change) -> None:
        """Hand over one change; never blocks and never raises."""
        with self._changed:
            if self._closing:
                self.lost += 1
                _log.error("a change came after the database %s was closed; it is lost", self._database)
                return
            if len(self._waiting) >= self._capacity:
                self._waiting.popleft()
                self.lost += 1
            self._waiting.append(change)
            self._changed.notify_all()

    def flush(self, timeout_s: float = 10.0) -> bool:
        """Wait until everything handed over is stored; False: a try has just failed, or it took too long."""
        until = monotonic() + timeout_s
        with self._changed:
            # A try that runs already may have met what has been mended since; the next one counts.
            last_try = self._tries
            self._hurry = self.pending > 0
            self._changed.notify_all()
            while self.pending and self._last_failed <= last_try and self._thread.is_alive():
                if not self._changed.wait(until - monotonic()):
                    break
            return not self.pending

    def close(self, timeout_s: float = 10.0) -> None:
        """Store what can be stored, then end the thread; what cannot is lost and logged."""
        self.flush(timeout_s)
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        if left := self.pending:
            _log.error("the database %s was closed before all changes were stored, %d are lost: it %s",
                       self._database, left, self._fault or "is too slow")  # fmt: skip

    def _serve(self) -> None:
        while self._take() and self._store():
            pass

    def _take(self) -> bool:
        """Take the next changes in hand; False when the writer shall end."""
        with self._changed:
            while not self._waiting and not self._closing:
                self._changed.wait()
            if not self._waiting:
                return False
            self._in_hand = [self._waiting.popleft() for _ in range(min(BATCH, len(self._waiting)))]
            return True

    def _store(self) -> bool:
        """Store what is in hand; False: the writer shall end before that could be done."""
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
                at_once = 1  # find the one that is wrong
            else:
                self._give_up(error)
        return True

    def _try(self, changes: Sequence[Change]) -> Exception | None:
        """Store all of the changes or none; gives the error."""
        with self._changed:
            self._tries += 1
        try:
            with self._engine.connect() as connection, connection.begin():
                for change in changes:
                    change(connection)
        except Exception as error:
            return error
        return None

    def _done(self, count: int) -> None:
        with self._changed:
            self._in_hand = self._in_hand[count:]
            if self._fault:
                _log.warning("the database %s can be written again", self._database)
                self._fault = ""
            self._changed.notify_all()

    def _wait_after(self, error: Exception, pause_s: float) -> bool:
        """Note a failure and wait for the next try; False: the writer shall end."""
        with self._changed:
            if not self._fault:
                _log.warning("the database %s %s; until then changes are kept in memory", self._database,
                             fault_words(error))  # fmt: skip
            self._fault = fault_words(error)
            self._last_failed = self._tries
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._hurry or self._closing, pause_s)
            self._hurry = False
            return not self._closing

    def _give_up(self, error: Exception) -> None:
        with self._changed:
            self._in_hand = self._in_hand[1:]
            self.lost += 1
            _log.error("the database %s does not take a change", self._database, exc_info=error)
            self._changed.notify_all()
