"""Puts one blueprint into force in many robots, each of which keeps its own profile; and takes that back.

What was done is written down robot by robot, so that it can be taken back even if the roll-out was interrupted.
"""

from __future__ import annotations

import asyncio
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from msbot.config import Blueprint, Library, RobotProfile, blueprint_toml, differences
from msbot.errors import ConfigError, MsbotError
from msbot.registry.database_identity import database_identity
from msbot.runtime.user_folders import state_folder
from msbot.school.class_robots import ClassRobot, FarRobot, find_record, open_database
from msbot.school.far_masters import CHANGE_S, Answer, FarLine, ask_one

MOST_ROLLOUTS = 20
"""Roll-outs that are remembered; the oldest is forgotten first."""


@dataclass(frozen=True, slots=True)
class RollOutPlan:
    """What a roll-out changes in one robot."""

    robot: ClassRobot
    wanted: Blueprint | None
    """What it is afterwards; None: it cannot be changed from here."""
    changes: tuple[str, ...] = ()
    """A line for each."""
    obstacle: str = ""
    """Why it cannot be changed from here."""


@dataclass(frozen=True, slots=True)
class RolledOut:
    """A change that a roll-out has made."""

    robot: str
    serial_number: str
    database: str
    """Without a password; of a robot elsewhere, the address of its page."""
    edit: int


def plan_for(robot: ClassRobot, blueprint: Blueprint) -> RollOutPlan:
    """Compare a robot with a blueprint of which everything but the profile is meant for it, too."""
    if robot.runs_elsewhere:
        return RollOutPlan(
            robot, None, obstacle="its master runs on another computer: `msbot class join` its page first"
        )
    try:
        if robot.far is not None:
            return _far_plan(robot, robot.far, blueprint)
        with open_database(robot.database) as registry:
            record = find_record(registry, robot.name, robot.serial_number)
            if record is None:
                return RollOutPlan(robot, None, obstacle=f"it is not in its database {robot.database} any more")
            present = registry.robots.blueprint(record, by_hand=False)
    except MsbotError as error:
        return RollOutPlan(robot, None, obstacle=str(error))
    wanted = replace(blueprint, robot=present.robot)
    return RollOutPlan(robot, wanted, tuple(str(one) for one in differences(present, wanted)))


def _far_plan(robot: ClassRobot, far: FarRobot, blueprint: Blueprint) -> RollOutPlan:
    """What it would change there, as its own master says, by its own part library.

    Raises:
        FarTrouble: it does not answer, or the blueprint does not fit its library.
    """
    if far.trouble:
        return RollOutPlan(robot, None, obstacle=far.trouble)
    if (robot.name, robot.serial_number) != (far.access.robot, far.access.serial_number):
        known = f"{far.access.robot} {far.access.serial_number}"
        obstacle = f"another robot answers there than {known}: `msbot class join {robot.page}` if that is right"
        return RollOutPlan(robot, None, obstacle=obstacle)
    names = ("robot", "version", "serial_number", "released", "manufacturer")
    wanted = replace(blueprint, robot=RobotProfile(*(far.text(name) for name in names)))
    answer = _ask(far, "POST", "/api/blueprint/diff", {"toml": blueprint_toml(wanted)})
    changes = answer.get("changes")
    assert isinstance(changes, list)
    return RollOutPlan(robot, wanted, tuple(str(one) for one in changes))


def _ask(far: FarRobot, method: str, path: str, body: dict[str, object]) -> Answer:
    def work(line: FarLine) -> Answer:
        return line.mapping(method, path, body)

    return ask_one(far.access, work, CHANGE_S)


class RollOut:
    """One roll-out.

    Args:
        source: the blueprint's file, beside which its part library is found.
        library: the part types that it was checked against.
        folders: further folders of part types, as `--library` names them.
        who: who does it.
    """

    def __init__(self, source: Path, library: Library, folders: Sequence[Path], who: str) -> None:
        self._source = source.resolve()
        self._who = who
        self._library = library
        self._folders = [str(folder.resolve()) for folder in folders]
        self._written = RollOutBook().begin(str(self._source))

    def put_in_force(self, plan: RollOutPlan) -> str:
        """Change one robot; returns what was done, in words.

        Raises:
            ConfigError: its master refuses it, or does not answer.
            RegistryError: it cannot be stored; nothing has changed.
        """
        assert plan.wanted is not None
        robot = plan.robot
        if robot.far is not None:
            words, edit = _done(_ask(robot.far, "PUT", "/api/blueprint", {"toml": blueprint_toml(plan.wanted)}))
        elif robot.master is not None:
            with self._as_file(plan.wanted) as path:
                request = {"do": "apply", "args": {"path": str(path), "folders": self._folders}, "who": self._who}
                words, edit = _done(robot.master.ask(request, patience_s=CHANGE_S))
        else:
            words, edit = self._in_database(robot, plan.wanted)
        if edit is not None:
            self._written(RolledOut(robot.name, robot.serial_number, database_identity(robot.database), edit))
        return words

    def _in_database(self, robot: ClassRobot, wanted: Blueprint) -> tuple[str, int | None]:
        with open_database(robot.database) as registry:
            record = find_record(registry, robot.name, robot.serial_number)
            if record is None:
                raise ConfigError(f"{robot.words} is not in {robot.database} any more")
            registry.runs.begin(record)  # so that no master starts in between
            _, edit = registry.robots.change_blueprint(wanted, self._library, self._who)
        return ("nothing to change", None) if edit is None else (edit.words, edit.id)

    @contextmanager
    def _as_file(self, wanted: Blueprint) -> Iterator[Path]:
        """The blueprint for one robot as a file beside the original, so that relative folders mean the same."""
        try:
            number, name = tempfile.mkstemp(".toml", f".{self._source.stem}-", self._source.parent)
        except OSError as error:
            raise ConfigError(f"cannot write beside {self._source}: {error.strerror}") from error
        path = Path(name)
        try:
            with os.fdopen(number, "w", encoding="utf-8") as file:
                file.write(blueprint_toml(wanted))
            yield path
        finally:
            path.unlink(missing_ok=True)


class RollOutBook:
    """The roll-outs of this user on this computer."""

    def __init__(self, folder: Path | None = None) -> None:
        self._path = (folder or state_folder()) / "rollouts.json"

    def begin(self, source: str) -> Callable[[RolledOut], None]:
        """Begin a roll-out; what this returns is called with each change."""
        entry: dict[str, Any] = {"at": time.time(), "blueprint": source, "done": []}
        entries = [*self._read(), entry][-MOST_ROLLOUTS:]
        return partial(self._add, entries, entry)

    def last(self) -> tuple[str, float, list[RolledOut]] | None:
        """Blueprint, time (seconds since 1970) and changes of the latest roll-out that was not taken back."""
        for entry in reversed(self._read()):
            if entry["done"]:
                return str(entry["blueprint"]), float(entry["at"]), [RolledOut(**one) for one in entry["done"]]
        return None

    def taken_back(self, changes: Sequence[RolledOut]) -> None:
        """These changes of the latest roll-out are no more."""
        entries = self._read()
        for entry in reversed(entries):
            if entry["done"]:
                entry["done"] = [one for one in entry["done"] if RolledOut(**one) not in changes]
                break
        self._write(entries)

    def _add(self, entries: list[dict[str, Any]], entry: dict[str, Any], done: RolledOut) -> None:
        entry["done"].append(asdict(done))
        self._write(entries)

    def _read(self) -> list[dict[str, Any]]:
        try:
            entries = json.loads(self._path.read_text(encoding="utf-8"))
            for entry in entries:
                float(entry["at"]), str(entry["blueprint"]), [RolledOut(**one) for one in entry["done"]]
        except FileNotFoundError:
            return []
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ConfigError(f"cannot read which roll-outs there were, {self._path}: {error}; move it away") from error
        assert isinstance(entries, list)
        return entries

    def _write(self, entries: list[dict[str, Any]]) -> None:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            new = self._path.with_suffix(".new")
            new.write_text(json.dumps(entries), encoding="utf-8")
            new.replace(self._path)
        except OSError as error:
            raise ConfigError(f"cannot write down what was changed, {self._path}: {error.strerror}") from error


def take_back(done: RolledOut, robots: Sequence[ClassRobot], who: str) -> str:
    """Undo one change of a roll-out; returns what was done, in words.

    Raises:
        ConfigError: it was changed again since, or the robot cannot be changed from here.
        RegistryError: it cannot be stored; nothing has changed.
    """
    request: dict[str, object] = {"do": "undo", "args": {"edit": done.edit}, "who": who}
    key = (done.robot, done.serial_number, done.database)
    robot = next(
        (one for one in robots if (one.name, one.serial_number, database_identity(one.database)) == key), None
    )  # fmt: skip
    if robot is not None and robot.far is not None:
        answer = _ask(robot.far, "POST", "/api/undo", {"edit": done.edit})
    elif robot is not None and robot.master is not None:
        answer = robot.master.ask(request, patience_s=CHANGE_S)
    elif done.database.startswith(("http://", "https://")):
        raise ConfigError(f"there is no access to {done.database} any more, or another robot answers there")
    else:
        from msbot.operations.dispatch import perform, stored_operations  # running robots need no SQLAlchemy here

        with open_database(done.database if robot is None else robot.database) as registry:
            record = find_record(registry, done.robot, done.serial_number)
            if record is None:
                raise ConfigError(f"{done.robot} {done.serial_number} is not in {done.database} any more")
            answer = asyncio.run(perform(stored_operations(registry, record), request))
    return _done(answer)[0]


def _done(answer: Answer) -> tuple[str, int | None]:
    """The outcome in words, and the number of the edit.

    Raises:
        ConfigError: the master has refused.
    """
    if "error" in answer:
        raise ConfigError(str(answer["error"]))
    number = answer.get("edit")
    return str(answer.get("words", "")), number if isinstance(number, int) else None
