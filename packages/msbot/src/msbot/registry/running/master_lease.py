"""The lease that one of several masters holds while it serves a robot: only on a server that all of them reach.

Theory of operation. The row of the robot in `master_leases` says who serves it and until when, by the server's clock.
The holder renews it; whoever waits takes it when it has run out, which makes its epoch one greater. Two rules keep two
masters from serving at the same time:

* A holder counts from *before* it asked for a renewal, so its own end is never later than the server's. Some time
  before it, the master stops serving in good order (`MasterLease.left_s`). Should it not manage, or stand still, the
  system ends the process: a timer of the kernel (`SIGALRM`, not handled) is set with every renewal. A process that was
  frozen (SIGSTOP) ends when it is thawed, before it has run one instruction.
* Every transaction of the holder begins with a look at the epoch, and keeps the row from being taken until it has
  ended (`fence`). What a former holder wants to write is refused; one that stands still in the middle of a transaction
  loses it after a second.
"""

from __future__ import annotations

import logging
import os
import platform
import signal
from collections.abc import Callable
from threading import Event, Thread
from time import monotonic, sleep
from typing import Final

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import SQLAlchemyError

from msbot.registry.database.database_errors import fault_words, told_as_registry_error
from msbot.registry.database.engine import Address, make_lease_engine, parse_address
from msbot.registry.records import RobotRecord
from msbot_xrce.errors import ConfigError, RegistryError

TTL_S: Final = 2.4
"""How long a lease lasts unless it is renewed."""
RENEW_S: Final = 0.4
ASK_S: Final = 0.25
"""How often a master that waits asks."""
HARD_S: Final = 0.2
"""The system ends the holder so long before the lease runs out."""
SOFT_S: Final = 0.6
"""So long before that, the holder has to begin to stop by itself."""
STILL_S: Final = 3.0
"""A master whose event loop has stood still for so long does not renew."""
IDLE_MS: Final = 1000
"""A transaction of the holder in which nothing happens for so long is ended by the server."""

LOCK_CLASS: Final = 0x4D734254
"""First of the two numbers of the advisory lock of a master without a lease; the second is the robot's."""
_NOW: Final = "(extract(epoch from clock_timestamp()) * 1000000000)::bigint"
_MAKE: Final = text(
    "INSERT INTO master_leases (robot_id, epoch, holder, until_ns) VALUES (:robot, 0, '', 0) ON CONFLICT DO NOTHING"
)
_LOOK: Final = text(f"SELECT epoch, holder, until_ns - {_NOW} AS left_ns FROM master_leases WHERE robot_id = :robot")
_LOOK_ALONE: Final = text(_LOOK.text + " FOR UPDATE")
_IS_FREE: Final = text("SELECT pg_try_advisory_xact_lock(:kind, :robot)")
_TAKE: Final = text(
    f"UPDATE master_leases SET epoch = epoch + 1, holder = :holder, until_ns = {_NOW} + :ttl "
    "WHERE robot_id = :robot RETURNING epoch"
)
_RENEW: Final = text(
    f"UPDATE master_leases SET until_ns = {_NOW} + :ttl WHERE robot_id = :robot AND epoch = :epoch RETURNING epoch"
)
_RELEASE: Final = text("UPDATE master_leases SET until_ns = 0 WHERE robot_id = :robot AND epoch = :epoch")
_FENCE: Final = text(
    "SELECT epoch, set_config('idle_in_transaction_session_timeout', :idle, true) FROM master_leases "
    "WHERE robot_id = :robot FOR KEY SHARE"
)

_log = logging.getLogger(__name__)


class LeaseLost(RegistryError):
    """This master may not serve the robot any more."""


class MasterLease:
    """The right to serve a robot, from `wait_for_lease` until `release` or its end (see the module's docstring)."""

    def __init__(self, engine: Engine, address: Address, robot: RobotRecord, epoch: int, asked_at: float) -> None:
        self.epoch = epoch
        """How often a master has taken over this robot; every write is checked against it."""
        self._engine = engine
        self._words = address.words
        self._robot = robot
        self._valid_until = 0.0
        self._taken_by_another = False
        self._trouble = ""
        self._loop_at: float | None = None
        self._ended = Event()
        self._renewed(asked_at)
        self._thread = Thread(target=self._keep, name="msbot lease", daemon=True)
        self._thread.start()

    def left_s(self) -> float:
        """How long this master may go on serving, seconds; it must have stopped when this is 0.

        To be called several times a second by the event loop: a loop that stands still does not get the lease renewed.
        """
        now = self._loop_at = monotonic()
        return 0.0 if self._taken_by_another else max(0.0, self._valid_until - SOFT_S - now)

    def why_lost(self) -> LeaseLost:
        """Why there is nothing left, as an error for people."""
        if self._taken_by_another:
            return LeaseLost(f"another master serves {self._robot.name} now: this one has stopped")
        trouble = f" ({self._trouble})" if self._trouble else ""
        return LeaseLost(
            f"the database {self._words} has not confirmed for {TTL_S - HARD_S - SOFT_S:.1f} s that this master may "
            f"serve {self._robot.name}{trouble}: it has stopped, so that another one can take over"
        )

    def fence(self, connection: Connection) -> None:
        """Begin a transaction of the holder.

        Raises:
            LeaseLost: another master has taken over.
        """
        row = connection.execute(_FENCE, {"robot": self._robot.id, "idle": str(IDLE_MS)}).one_or_none()
        if row is None or row.epoch != self.epoch:
            self._taken_by_another = True
            raise LeaseLost(f"takes nothing from this master any more: another one serves {self._robot.name}")

    def silent(self) -> None:
        """Nothing of this process speaks to parts any more: it need not be ended."""
        self._ended.set()
        signal.setitimer(signal.ITIMER_REAL, 0)

    def release(self) -> None:
        """Let another master take over at once; only when nothing of this one speaks to parts any more."""
        self.silent()
        self._thread.join(1.0)
        try:
            with self._engine.connect() as connection:
                connection.execute(_RELEASE, {"robot": self._robot.id, "epoch": self.epoch})
        except SQLAlchemyError as error:
            _log.debug("the lease runs out by itself: %s", error)
        self._engine.dispose()

    def _keep(self) -> None:
        """Renew in time; whatever fails is tried again until the lease has run out."""
        while not self._ended.wait(RENEW_S):
            if self._loop_at is not None and monotonic() - self._loop_at > STILL_S:
                self._trouble = "the master stood still"
                continue
            asked_at = monotonic()
            try:
                with self._engine.connect() as connection:
                    values = {"robot": self._robot.id, "epoch": self.epoch, "ttl": round(TTL_S * 1e9)}
                    row = connection.execute(_RENEW, values).one_or_none()
            except SQLAlchemyError as error:
                self._trouble = fault_words(error)
                continue
            if row is None:
                self._taken_by_another = True
                return
            self._renewed(asked_at)

    def _renewed(self, asked_at: float) -> None:
        self._trouble = ""
        self._valid_until = asked_at + TTL_S - HARD_S
        left_s = self._valid_until - monotonic()
        if not self._ended.is_set():
            signal.setitimer(signal.ITIMER_REAL, max(left_s, 0.001))


def wait_for_lease(address: Address, robot: RobotRecord, say: Callable[[str], object]) -> MasterLease:
    """Wait until this process may serve the robot; as long as the database or the other master lasts.

    Args:
        address: the database.
        robot: which robot.
        say: called with what it waits for, whenever that changes.

    Raises:
        ConfigError: the database is a file, or this system cannot end a process in time.
        RegistryError: the database cannot be used, at the first try.
    """
    check_shareable(address.words)
    engine = make_lease_engine(address)
    try:
        with told_as_registry_error(address.words), engine.connect() as connection:
            connection.execute(_MAKE, {"robot": robot.id})
        said = ""
        while True:
            asked_at = monotonic()
            try:
                found: int | tuple[str, float] = _try(engine, robot)
            except SQLAlchemyError as error:
                found = f"the database {address.words} {fault_words(error)}", ASK_S
            match found:
                case int():
                    return MasterLease(engine, address, robot, found, asked_at)
                case (words, left_s):
                    if words != said:
                        said = words
                        say(f"standby: {words}; this one takes over when that ends")
                    sleep(min(ASK_S, left_s))
    except BaseException:
        engine.dispose()
        raise


def check_shareable(database: str) -> None:
    """Make sure that several masters can share a robot of this database.

    Args:
        database: as after `--db`.

    Raises:
        ConfigError: they cannot.
        RegistryError: it is not an address of a database.
    """
    address = parse_address(database)
    if address.path is not None:
        raise ConfigError(
            f"--standby needs a database that both masters reach, and {address.words} is a file: give both the same "
            "--db postgresql://user@host/name"
        )
    if not hasattr(signal, "setitimer"):
        raise ConfigError("--standby needs Linux or macOS: this system cannot end a program that stands still")


def is_leased(connection: Connection, robot_id: int) -> bool:
    """Whether a master holds the lease at the moment; only on a server."""
    row = connection.execute(_LOOK, {"robot": robot_id}).one_or_none()
    return row is not None and row.left_ns > 0


def _try(engine: Engine, robot: RobotRecord) -> int | tuple[str, float]:
    """The epoch, if the lease could be taken; else who has it, in words, and when it is worth asking again, seconds."""
    holder = f"{platform.node()}, process {os.getpid()}"
    with engine.connect() as connection:
        row = connection.execute(_LOOK, {"robot": robot.id}).one()
        if row.left_ns > 0:  # nothing is locked to find that out: the holder must not wait for one that waits
            return f"{robot.name} is served by {row.holder}", float(row.left_ns) / 1e9
    with engine.connect().execution_options(isolation_level="READ COMMITTED") as connection, connection.begin():
        row = connection.execute(_LOOK_ALONE, {"robot": robot.id}).one()
        if row.left_ns > 0:
            return f"{robot.name} is served by {row.holder}", float(row.left_ns) / 1e9
        if not connection.execute(_IS_FREE, {"kind": LOCK_CLASS, "robot": robot.id}).scalar_one():
            return f"{robot.name} is served by a master without --standby", ASK_S
        values = {"robot": robot.id, "holder": holder, "ttl": round(TTL_S * 1e9)}
        return int(connection.execute(_TAKE, values).scalar_one())
