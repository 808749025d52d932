"""STOP while a robot's master loses its lease and the one that waits takes over: real masters, parts and database.

Two masters with `--standby` share a robot in PostgreSQL; each has an address, and folders as on a computer of its own.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest import mock

from sqlalchemy import text

from msbot.registry.database.engine import make_lease_engine, parse_address
from msbot.stop.stop_request import ask_masters
from tests.e2e.processes import Process, running
from tests.e2e.two_masters import prefer
from tests.hostile.robot import until
from tests.registry.postgres import running_server
from tests.stop.oracle import Verdict
from tests.stop.real_robots import RealRobot, Trial

ANSWER_S = 2.0
"""How long a master has to answer: one that is frozen does not."""
TAKEN = text("UPDATE master_leases SET epoch = epoch + 1, holder = 'another computer'")
"""As if another master had taken over, because the holder could not renew its lease; it runs out as it is."""


class Computer(RealRobot):
    """One of the two."""

    process: Process

    def start(self) -> None:
        """Start its master, which waits until nobody else serves."""
        words = ("master", "--standby", "--no-page", "--link", self.link, "--db", self.db or "")
        self.process = self.stack.enter_context(running(*words, cwd=self.folder, env=self.env))
        prefer(self.process.pid)

    def serves(self) -> bool:
        """Whether its master serves the robot now."""
        with mock.patch.dict(os.environ, self.env):
            answers, _ = ask_masters({"do": "status", "who": "ann"}, ANSWER_S)
        return bool(answers)


class SharedRobot:
    """The robot of two computers; its parts know the addresses of both."""

    def __init__(self, folder: Path, stack: ExitStack, db: str) -> None:
        self._db = db
        self._ended: Computer | None = None
        self.computers: list[Computer] = []
        for name in ("a", "b"):
            (folder / name).mkdir()
            computer = Computer(folder / name, stack, db)
            computer.env["MSBOT_STOP_GROUP"] = f"{name}{os.getpid()}"  # nobody here means the other one's master
            self.computers.append(computer)
        first, second = self.computers
        self._active = first
        blueprint = first.folder / "robot.toml"
        sample = blueprint.read_text()
        assert 'preset = "thesis" ' in sample
        for computer in self.computers:  # parts that beat more often sooner see that their master is gone
            (computer.folder / "robot.toml").write_text(sample.replace('preset = "thesis" ', 'preset = "fast" '))
        first.start()
        first.process.wait_for("is up on")
        second.start()
        second.process.wait_for("standby:", "is served by")
        first.begin_parts(f"{first.link},{second.link}")

    @property
    def active(self) -> Computer:
        """Whose master serves, as soon as one does."""
        until(self._find_active)
        return self._active

    def _find_active(self) -> bool:
        """Whoever served last is asked first."""
        for one in sorted(self.computers, key=lambda one: one is not self._active):
            if one.serves():
                self._active = one
                return True
        return False

    def heard(self) -> int:
        """See `Watched`."""
        return self.computers[0].heard()

    def said(self) -> int:
        """See `Watched`."""
        return self.computers[0].said()

    def tell(self, do: str) -> dict[str, object]:
        """See `Watched`."""
        return self.active.tell(do)

    def press(self) -> None:
        """A part says STOP, whoever serves."""
        button = self.computers[0].folder / "button"
        button.touch()
        until(lambda: not button.exists())

    def ready(self) -> None:
        """Both masters run: one serves, the other one waits."""
        if self._ended is not None:
            self._ended.process.end(signal.SIGKILL)
            self._ended.start()
            self._ended.process.wait_for("standby:", "is served by")
            self._ended = None

    def lose(self, lost: Computer, how: Callable[[Computer], None]) -> None:
        """Its master ends by that, and the other one takes over."""
        (other,) = (one for one in self.computers if one is not lost)
        self._ended = lost
        how(lost)
        until(other.serves)

    def take_lease(self) -> None:
        """Whoever serves has lost its lease."""
        engine = make_lease_engine(parse_address(self._db))
        try:
            with engine.connect() as connection:
                assert connection.execute(TAKEN).rowcount == 1
        finally:
            engine.dispose()


def _kill(computer: Computer) -> None:
    computer.process.end(signal.SIGKILL)


def _freeze(computer: Computer) -> None:
    computer.process.send(signal.SIGSTOP)


def killed(robot: SharedRobot) -> Verdict:
    """STOP, the master is killed, the one that waits takes over"""
    trial, lost = Trial(robot), robot.active
    robot.tell("stop")
    trial.all_confirm()
    robot.lose(lost, _kill)
    trial.until_confirmed()
    return trial.go()


def said_by_nobody(robot: SharedRobot) -> Verdict:
    """the master is killed, STOP by a part while nobody serves, the one that waits takes over"""
    trial, lost = Trial(robot), robot.active

    def kill_and_press(computer: Computer) -> None:
        _kill(computer)
        robot.press()

    robot.lose(lost, kill_and_press)
    trial.all_confirm()
    assert robot.tell("status")["by"] == "AA"
    return trial.go()


def frozen(robot: SharedRobot) -> Verdict:
    """STOP, the master is frozen, the one that waits takes over, the frozen one wakes up"""
    trial, lost = Trial(robot), robot.active
    robot.tell("stop")
    trial.all_confirm()
    robot.lose(lost, _freeze)
    trial.until_confirmed()
    status = lost.process.end(signal.SIGCONT)
    assert status == -signal.SIGALRM, status
    return trial.go()


def lease_lost(robot: SharedRobot) -> Verdict:
    """STOP, the master loses its lease, one of the two takes over"""
    trial, lost = Trial(robot), robot.active
    robot.tell("stop")
    trial.all_confirm()
    robot.take_lease()
    lost.process.wait_for("another master serves")
    trial.until_confirmed()
    return trial.go()


def said_after(robot: SharedRobot) -> Verdict:
    """the master is killed, STOP as soon as the one that waits has taken over"""
    trial, lost = Trial(robot), robot.active
    robot.lose(lost, _kill)
    robot.active.tell("stop")
    trial.all_confirm()
    return trial.go()


Deed = Callable[[SharedRobot], Verdict]
DEEDS: tuple[Deed, ...] = (lease_lost, said_by_nobody, killed, frozen, said_after)


@contextmanager
def shared_robot(folder: Path, programs: Path) -> Iterator[SharedRobot]:
    """A robot at work.

    Args:
        folder: for its files.
        programs: where PostgreSQL is.
    """
    with running_server(programs) as address, ExitStack() as stack:
        yield SharedRobot(folder, stack, address.format("postgres"))


def lease_stories(folder: Path, programs: Path, deeds: tuple[Deed, ...] = DEEDS) -> Mapping[str, Verdict]:
    """One robot, and one deed after the other."""
    verdicts: dict[str, Verdict] = {}
    with shared_robot(folder, programs) as robot:
        for deed in deeds:
            robot.ready()
            verdicts[deed.__doc__ or ""] = deed(robot)
    return verdicts
