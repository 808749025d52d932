"""A roll-out while it goes on, or its undo: what is done at each robot, and how far each one is.

Whoever runs it calls `do` for each robot, one after the other or in threads; others may look at it meanwhile. Robots of
one database take turns, because a master that runs waits for the lock of its file only a moment; where another program
has that lock, the same is tried again. One robot that cannot be changed holds up no other one for long.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, replace
from enum import Enum
from pathlib import Path
from typing import Any

from msbot_agent.process.user_folders import alone_in, make_own_folder, state_folder
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError, DatabaseBusy, MsbotError
from msbot_xrce.lazy import dataclass

TURN_S = 20.0
"""How long a robot of a roll-out waits for another one of its database, and then for the lock of its file: longer than
a change takes on a slow disk of a busy computer."""
AGAIN_S = 0.2
"""How long it is until a database that was locked is asked again."""


class NoAnswer(ConfigError):
    """A master was asked to change something and has not answered: whether it has is not known."""


class StepState(Enum):
    """How far one robot is."""

    WAITING = "waiting"
    WORKING = "being changed"
    CHANGED = "changed"
    REFUSED = "refused"
    SILENT = "no answer"
    LEFT = "not begun"


@dataclass(frozen=True, slots=True)
class RobotStep:
    """One robot of a roll-out."""

    robot: str
    state: StepState = StepState.WAITING
    words: str = ""
    """What was done, or why not."""
    edit: int | None = None
    """Number of the change in its database."""


@dataclass(frozen=True, slots=True)
class RobotChange:
    """What was done to one robot."""

    words: str
    edit: int | None


@dataclass(frozen=True, slots=True)
class RobotJob:
    """What is to be done at one robot."""

    robot: str
    do: Callable[[], RobotChange]
    """Raises NoAnswer when nobody knows whether it is done, and another MsbotError when it is not."""
    database: str = ""
    """Where it is stored; jobs of one database are done one after the other. Empty: on a computer of its own."""


class RollOutRun:
    """See the module's docstring.

    Args:
        blueprint: where the blueprint is from.
        jobs: in the order in which they are begun.
        is_undo: whether a roll-out is taken back.
        turn_s: how long a robot waits for another one of its database; then it is changed all the same. As long is
            tried again what a locked database did not take.
    """

    def __init__(
        self, blueprint: str, jobs: Sequence[RobotJob], *, is_undo: bool = False, turn_s: float = TURN_S
    ) -> None:
        self.blueprint = blueprint
        self.is_undo = is_undo
        self.began_at = time.time()
        """Seconds since 1970."""
        self._jobs = jobs
        self._lock = threading.Lock()
        self._turns = {job.database: threading.Lock() for job in jobs if job.database}
        self._turn_s = turn_s
        self._steps = [RobotStep(job.robot) for job in jobs]
        self._is_halted = threading.Event()

    @property
    def steps(self) -> tuple[RobotStep, ...]:
        """How far each robot is."""
        with self._lock:
            return tuple(self._steps)

    @property
    def is_over(self) -> bool:
        """Whether nothing more is done."""
        return all(step.state not in (StepState.WAITING, StepState.WORKING) for step in self.steps)

    def halt(self, why: str) -> None:
        """Begin with no further robot; those that are being changed are."""
        self._is_halted.set()
        with self._lock:
            self._steps = [
                replace(step, state=StepState.LEFT, words=why) if step.state is StepState.WAITING else step
                for step in self._steps
            ]

    def do(self, number: int) -> RobotStep:
        """Do what is to be done at that robot, which takes a while; returns how it went."""
        turn = self._turns.get(self._jobs[number].database)
        has_turn = turn is not None and turn.acquire(timeout=self._turn_s)
        try:
            return self._do(number)
        finally:
            if turn is not None and has_turn:
                turn.release()

    def _do(self, number: int) -> RobotStep:
        with self._lock:
            step = self._steps[number]
            if step.state is not StepState.WAITING:
                return step
            self._steps[number] = replace(step, state=StepState.WORKING)
        after = replace(step, state=StepState.SILENT, words=said("this failed in a way that MsBOT does not know"))
        try:
            change = self._change(self._jobs[number])
            after = replace(step, state=StepState.CHANGED, words=change.words, edit=change.edit)
        except NoAnswer as error:
            after = replace(step, state=StepState.SILENT, words=str(error))
        except MsbotError as error:
            after = replace(step, state=StepState.REFUSED, words=str(error))
        finally:  # a mistake of ours is told to whoever runs it, and nobody waits for this robot for ever
            with self._lock:
                self._steps[number] = after
        return after

    def _change(self, job: RobotJob) -> RobotChange:
        """Change that robot, again and again while its database is locked."""
        until = time.monotonic() + self._turn_s
        while True:
            try:
                return job.do()
            except DatabaseBusy:
                if time.monotonic() >= until or self._is_halted.wait(AGAIN_S):
                    raise


# Remembers which roll-outs there were, robot by robot, so that they can be taken back even if they were interrupted.
#
# The terminal and the pages of all masters of this user share it.


MOST_ROLLOUTS = 20
"""Roll-outs that are remembered; the oldest is forgotten first."""

_in_this_process = threading.Lock()


@dataclass(frozen=True, slots=True)
class RolledOutChange:
    """A change that a roll-out has made."""

    robot: str
    serial_number: str
    database: str
    """Without a password; of a robot elsewhere, the address of its page."""
    edit: int


@dataclass(frozen=True, slots=True)
class RollOutEntry:
    """A roll-out that was begun."""

    at: float
    """When, seconds since 1970; no two have the same."""
    blueprint: str
    """Where the blueprint is from."""
    done: tuple[RolledOutChange, ...]
    """What has not been taken back."""


class RollOutLog:
    """See the comment above.

    Args:
        folder: where it is kept; None: in the user's state folder.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = (folder or state_folder()) / "rollouts.json"

    def begin(self, blueprint: str) -> float:
        """Begin a roll-out; returns what it is known by, `RollOutEntry.at`."""
        at = time.time()

        def begun(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
            nonlocal at
            at = max([at, *(float(entry["at"]) + 0.001 for entry in entries)])
            return [*entries, {"at": at, "blueprint": blueprint, "done": []}][-MOST_ROLLOUTS:]

        self._change(begun)
        return at

    def note(self, at: float, change: RolledOutChange) -> None:
        """A robot was changed."""

        def noted(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
            found = [entry for entry in entries if entry["at"] == at]
            if not found:
                raise ConfigError(f"{self._path} does not know this roll-out any more: it cannot be taken back")
            found[0]["done"].append(asdict(change))
            return entries

        self._change(noted)

    def taken_back(self, at: float, changes: Collection[RolledOutChange]) -> None:
        """These changes of that roll-out are no more."""

        def less(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
            for entry in entries:
                if entry["at"] == at:
                    entry["done"] = [one for one in entry["done"] if RolledOutChange(**one) not in changes]
            return entries

        self._change(less)

    def last(self) -> RollOutEntry | None:
        """The latest roll-out of which something was not taken back."""
        for entry in reversed(self._read()):
            if entry["done"]:
                return _remembered(entry)
        return None

    def _change(self, change: Callable[[list[dict[str, Any]]], list[dict[str, Any]]]) -> None:
        with self._alone():
            self._write(change(self._read()))

    def _alone(self) -> AbstractContextManager[object]:
        stack = ExitStack()
        try:
            stack.enter_context(_in_this_process)
            make_own_folder(self._path.parent)
            stack.enter_context(alone_in(self._path.parent))
        except OSError as error:
            stack.close()
            raise self._cannot_write(error) from error
        return stack

    def _read(self) -> list[dict[str, Any]]:
        try:
            entries = read_json(self._path.read_text(encoding="utf-8"))
            if not isinstance(entries, list):
                raise TypeError("it is no list")
            for entry in entries:
                _remembered(entry)
        except FileNotFoundError:
            return []
        except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
            raise ConfigError(f"cannot read which roll-outs there were, {self._path}: {error}; move it away") from error
        return entries

    def _write(self, entries: list[dict[str, Any]]) -> None:
        try:
            new = self._path.with_suffix(".new")
            new.write_text(json.dumps(entries), encoding="utf-8")
            new.replace(self._path)
        except OSError as error:
            raise self._cannot_write(error) from error

    def _cannot_write(self, error: OSError) -> ConfigError:
        return ConfigError(f"cannot write down what was changed, {self._path}: {error.strerror}")


def _remembered(entry: dict[str, Any]) -> RollOutEntry:
    return RollOutEntry(
        float(entry["at"]), str(entry["blueprint"]), tuple(RolledOutChange(**one) for one in entry["done"])
    )
