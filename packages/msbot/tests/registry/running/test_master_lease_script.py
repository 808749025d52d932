"""The lease of a master beside a plain server, in virtual time: each question and each timer, to the tenth of a second.

The times are those of `docs/explain/many_machines.md`, "Masters that take turns".
"""

from __future__ import annotations

import platform
import signal
from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, Self

import pytest
from sqlalchemy.exc import OperationalError

from msbot.registry.database.engine import parse_address
from msbot.registry.records import RobotRecord
from msbot.registry.running import master_lease
from msbot.registry.running.master_lease import LeaseLost, MasterLease, check_shareable, is_leased, wait_for_lease
from msbot_xrce.errors import ConfigError

ROBOT = RobotRecord(7, "R2", "1", "", "", "", 0)
ADDRESS = parse_address("postgresql://user:secret@host/robots")
WORDS = "postgresql://user:***@host/robots"
LASTS, RENEWED_EVERY, STOPS_BEFORE, ENDED_BEFORE = 2.4, 0.4, 0.8, 0.2
ASKED_EVERY = 1 / 4
TAKES = 0.05
"""What each question takes, in this test."""
SERVED = "standby: R2 is served by {}; this one takes over when that ends"
AWAY = "does not answer any more: is the server running? Start it, or choose another --db"


class Server:
    """A server with its own clock and one row for each robot; also the connection to it."""

    def __init__(self) -> None:
        self.now = 100.0
        self.rows: dict[int, SimpleNamespace] = {}
        self.free = True
        self.is_away = False
        self.asked: list[str] = []
        self.timers: list[float] = []
        self.disposed = 0
        self.before: dict[str, Callable[[], object]] = {}
        """Something that happens just before a question."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def connect(self) -> Self:
        return self

    def execution_options(self, **options: object) -> Self:
        assert options == {"isolation_level": "READ COMMITTED"}
        return self

    def begin(self) -> Any:
        return nullcontext()

    def dispose(self) -> None:
        self.disposed += 1

    @property
    def clock_ns(self) -> int:
        return round((self.now + 5_000) * 1e9)

    def execute(self, statement: object, values: dict[str, Any]) -> Any:
        name = next(name for name, one in vars(master_lease).items() if one is statement)
        self.before.pop(name, lambda: None)()
        self.now += TAKES
        self.asked.append(name)
        if self.is_away:
            raise OperationalError("SELECT", {}, Exception("gone"), connection_invalidated=True)
        found = getattr(self, name.strip("_").lower())(values)
        return SimpleNamespace(one=lambda: found, one_or_none=lambda: found, scalar_one=lambda: found)

    def make(self, values: dict[str, Any]) -> None:
        self.rows.setdefault(values["robot"], SimpleNamespace(epoch=0, holder="", until_ns=0))

    def look(self, values: dict[str, Any]) -> Any:
        row = self.rows.get(values["robot"])
        return row and SimpleNamespace(epoch=row.epoch, holder=row.holder, left_ns=row.until_ns - self.clock_ns)

    look_alone = look

    def is_free(self, values: dict[str, Any]) -> bool:
        assert values == {"kind": 0x4D734254, "robot": 7}
        return self.free

    def take(self, values: dict[str, Any]) -> int:
        row = self.rows[values["robot"]]
        row.epoch, row.holder, row.until_ns = row.epoch + 1, values["holder"], self.clock_ns + values["ttl"]
        return int(row.epoch)

    def renew(self, values: dict[str, Any]) -> Any:
        row = self.rows[values["robot"]]
        if row.epoch != values["epoch"]:
            return None
        row.until_ns = self.clock_ns + values["ttl"]
        return row

    def release(self, values: dict[str, Any]) -> None:
        row = self.rows[values["robot"]]
        row.until_ns = 0 if row.epoch == values["epoch"] else row.until_ns

    def fence(self, values: dict[str, Any]) -> Any:
        assert values["idle"] == "1000", "milliseconds: the server ends a transaction that stands still for a second"
        return self.rows.get(values["robot"])

    def serve(self, holder: str, left_s: float) -> None:
        """Another master has it."""
        row = self.rows.setdefault(7, SimpleNamespace(epoch=0, holder="", until_ns=0))
        row.epoch, row.holder, row.until_ns = row.epoch + 1, holder, self.clock_ns + round(left_s * 1e9)

    def left_s(self) -> float:
        return float(self.rows[7].until_ns - self.clock_ns) / 1e9


class Still:
    """A thread that does not begin by itself."""

    joined: list[float] = []  # noqa: RUF012 - emptied by the fixture

    def __init__(self, target: Callable[[], None], name: str, daemon: bool) -> None:
        assert (name, daemon) == ("msbot lease", True)

    def start(self) -> None:
        pass

    def join(self, limit_s: float) -> None:
        self.joined.append(limit_s)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    server = Server()
    Still.joined.clear()
    monkeypatch.setattr(master_lease, "monotonic", lambda: server.now)
    monkeypatch.setattr(master_lease, "Thread", Still)
    monkeypatch.setattr(master_lease, "make_lease_engine", lambda address: server if address is ADDRESS else None)
    monkeypatch.setattr(signal, "setitimer", lambda which, left_s: server.timers.append((which, round(left_s, 6))[1]))
    return server


class Turns:
    """In place of the event that ends the thread: each turn lets time pass and something happen."""

    def __init__(self, server: Server, *happens: Callable[[], object]) -> None:
        self.server, self.happens, self.is_over = server, [*happens], False

    def wait(self, limit_s: float) -> bool:
        assert limit_s == RENEWED_EVERY
        if not self.happens or self.is_over:
            return True
        self.server.now += limit_s
        self.happens.pop(0)()
        return self.is_over

    def set(self) -> None:
        self.is_over = True

    def is_set(self) -> bool:
        return self.is_over


def hold(server: Server) -> MasterLease:
    server.serve("this one", LASTS)
    server.now += TAKES
    return MasterLease(server, ADDRESS, ROBOT, 1, server.now - TAKES)  # type: ignore[arg-type]  # as far as it is used


def turn(server: Server, lease: MasterLease, *happens: Callable[[], object]) -> None:
    lease._ended = Turns(server, *happens)  # type: ignore[assignment]  # as far as it is used
    lease._keep()


def nothing() -> None:
    pass


def test_a_lease_is_renewed_every_so_often_and_the_holder_ends_before_it_does(server: Server) -> None:
    lease = hold(server)
    whole = LASTS - STOPS_BEFORE
    assert server.timers == [pytest.approx(LASTS - ENDED_BEFORE - TAKES)]
    assert lease.left_s() == pytest.approx(whole - TAKES)
    left: list[float] = []
    turn(server, lease, nothing, lambda: left.append(lease.left_s()), nothing)
    # It counts from before it asked: the time that the answer took is lost.
    assert server.timers == [pytest.approx(LASTS - ENDED_BEFORE - TAKES)] * 4
    assert left == [pytest.approx(whole - RENEWED_EVERY - TAKES)]
    assert lease.left_s() == pytest.approx(whole - TAKES)
    assert server.left_s() == pytest.approx(LASTS)
    assert server.asked == ["_RENEW"] * 3
    for passes, expected in ((whole - TAKES - 0.01, 0.01), (0.01, 0.0), (9.0, 0.0)):
        server.now += passes
        assert lease.left_s() == pytest.approx(expected, abs=1e-9)


def test_what_fails_is_tried_again_and_said_when_it_was_too_long(server: Server) -> None:
    lease = hold(server)

    def away() -> None:
        server.is_away = True

    def back() -> None:
        assert str(lease.why_lost()) == lost.format(f" ({AWAY})")
        server.is_away = False

    lost = f"the database {WORDS} has not confirmed for 1.6 s that this master may serve R2{{}}: it has stopped, so "
    lost += "that another one can take over"
    turn(server, lease, away, nothing, back, nothing)
    assert server.timers == [pytest.approx(LASTS - ENDED_BEFORE - TAKES)] * 3
    assert str(lease.why_lost()) == lost.format("")
    assert isinstance(lease.why_lost(), LeaseLost)


def test_a_master_whose_loop_has_stood_still_for_three_seconds_does_not_renew(server: Server) -> None:
    lease = hold(server)
    lease.left_s()  # the loop's last turn

    def still(seconds: float) -> Callable[[], None]:
        def pass_by() -> None:
            assert lease._loop_at is not None
            server.now = lease._loop_at + seconds

        return pass_by

    turn(server, lease, still(2.9), still(3.0), still(3.1), still(9.0))
    assert server.asked == ["_RENEW"] * 2
    assert "(the master stood still)" in str(lease.why_lost())
    turn(server, lease, lease.left_s)
    assert server.asked == ["_RENEW"] * 3
    assert "stood still" not in str(lease.why_lost())


def test_who_has_lost_it_has_nothing_left(server: Server) -> None:
    lease = hold(server)
    turn(server, lease, lambda: server.serve("another", LASTS), nothing, nothing)
    assert (server.asked, len(server.timers), lease.left_s()) == (["_RENEW"], 1, 0.0)
    assert str(lease.why_lost()) == "another master serves R2 now: this one has stopped"


@pytest.mark.parametrize("row", ["mine", "another's", "none"])
def test_each_transaction_begins_with_a_look_at_the_epoch(server: Server, row: str) -> None:
    lease = hold(server)
    connection: Any = server
    if row == "mine":
        lease.fence(connection)
        assert lease.left_s() > 0
        return
    if row == "none":
        server.rows.clear()
    else:
        server.serve("another", LASTS)
    with pytest.raises(LeaseLost, match="takes nothing from this master any more: another one serves R2"):
        lease.fence(connection)
    assert lease.left_s() == 0


@pytest.mark.parametrize("is_away", [False, True])
def test_a_lease_that_is_released_is_free_at_once_and_no_timer_is_left(server: Server, is_away: bool) -> None:
    lease = hold(server)
    server.is_away = is_away
    lease.release()
    assert (server.timers[-1], len(server.timers), Still.joined, server.asked) == (0, 2, [1.0], ["_RELEASE"])
    assert (server.rows[7].until_ns == 0, server.disposed) == (not is_away, 1)
    lease._renewed(server.now)  # an answer that was on its way
    assert len(server.timers) == 2
    lease._keep()
    assert server.asked == ["_RELEASE"]


def test_a_holder_that_was_told_too_late_is_ended_at_once(server: Server) -> None:
    server.serve("this one", LASTS)
    lease = MasterLease(server, ADDRESS, ROBOT, 1, server.now - 9)  # type: ignore[arg-type]  # as far as it is used
    assert (server.timers, lease.left_s()) == ([0.001], 0.0)


def test_who_waits_asks_four_times_a_second_and_exactly_when_the_lease_runs_out(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(round(seconds, 6))
        server.now += seconds
        if (then := happens.pop(len(slept), None)) is not None:
            then()

    def set_away(value: bool) -> None:
        server.is_away = value

    def take_free() -> None:
        server.free = True

    happens: dict[int, Callable[[], object]] = {4: lambda: set_away(True), 6: lambda: set_away(False), 8: take_free}
    monkeypatch.setattr(master_lease, "sleep", sleep)
    said: list[str] = []
    server.free = False
    server.serve("another, process 9", 0.85)
    lease = wait_for_lease(ADDRESS, ROBOT, said.append)
    # 0.85 s less what asking took: it makes the row, then looks three times, and sleeps twice in between.
    assert slept[:3] == [ASKED_EVERY, ASKED_EVERY, pytest.approx(0.85 - 4 * TAKES - 2 * ASKED_EVERY)]
    assert slept[3:] == [ASKED_EVERY] * 5
    assert said == [
        SERVED.format("another, process 9"),
        SERVED.format("a master without --standby"),
        f"standby: the database {WORDS} {AWAY}; this one takes over when that ends",
        SERVED.format("a master without --standby"),
    ]
    alone = ["_LOOK", "_LOOK_ALONE", "_IS_FREE"]
    assert server.asked == ["_MAKE", *["_LOOK"] * 3, *alone, *["_LOOK"] * 2, *alone * 2, *alone, "_TAKE"]
    row = server.rows[7]
    assert (lease.epoch, row.epoch, server.disposed) == (2, 2, 0)
    assert server.left_s() == pytest.approx(LASTS)
    assert row.holder.startswith(f"{platform.node()}, process ")
    # It counts from before its last look.
    assert server.timers == [pytest.approx(LASTS - ENDED_BEFORE - 4 * TAKES)]


def test_who_is_overtaken_between_two_looks_waits_on(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(_: str) -> None:
        raise KeyboardInterrupt

    server.before["_LOOK_ALONE"] = lambda: server.serve("the quicker one", 1.0)
    with pytest.raises(KeyboardInterrupt):
        wait_for_lease(ADDRESS, ROBOT, stop)
    assert server.asked == ["_MAKE", "_LOOK", "_LOOK_ALONE"]
    assert server.disposed == 1


def test_whether_somebody_holds_it(server: Server) -> None:
    connection: Any = server
    assert not is_leased(connection, 7)
    server.serve("one", 2 * TAKES)
    assert [is_leased(connection, 7), is_leased(connection, 7), is_leased(connection, 8)] == [True, False, False]


def test_a_system_that_cannot_end_a_program_in_time_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    check_shareable("postgresql://host/robots")
    monkeypatch.delattr(signal, "setitimer")
    with pytest.raises(ConfigError, match="--standby needs Linux or macOS"):
        check_shareable("postgresql://host/robots")
