"""Puts one blueprint into force in many robots, each of which keeps its own profile; and takes that back.

What was done is remembered robot by robot (`rollout_book`); who does it, in which order, is `rollout_run`.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from msbot.config import Blueprint, Library, RobotProfile, blueprint_toml, differences
from msbot.registry.records import database_identity
from msbot_agent.agent import RunningProcess
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.text.sentence import said
from msbot_school.classroom.class_robots import (
    ClassRobot,
    DatabaseReader,
    RemoteRobot,
    directly,
    find_record,
    open_database,
)
from msbot_school.classroom.remote_masters import (
    CHANGE_S,
    LOOK_S,
    Answer,
    RemoteMasterConnection,
    RemoteMasterError,
    RemoteMasterRefusal,
    ask_one,
)
from msbot_school.classroom.rollout_run import NoAnswer, RobotChange, RobotJob, RolledOutChange, RollOutLog
from msbot_xrce.errors import ConfigError, DatabaseBusy, MsbotError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.registry import Registry, RobotRecord


NEWEST_EDITS = 1000
"""So many edits of a robot are looked through for one that was undone."""


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


def blueprint_of(robot: ClassRobot, read: DatabaseReader = directly) -> str:
    """The blueprint in force in a robot, with what people have changed by hand, as the text of `robot.toml`.

    Raises:
        ConfigError: it cannot be read from here.
        RegistryError: its database cannot be used.
    """
    if robot.far is not None:
        try:
            return ask_one(robot.far.access, lambda line: line.octets("GET", "/api/blueprint"), LOOK_S).decode()
        except UnicodeDecodeError as error:
            raise ConfigError(said("{robot}: what it gives is no blueprint", robot=robot.describe)) from error
    if not robot.database:
        raise ConfigError(said("{robot} runs without a database: it has no blueprint to give", robot=robot.describe))
    return blueprint_toml(read(_stored_blueprint, robot.database, robot.name, robot.serial_number, by_hand=True))


def _stored_blueprint(database: str, name: str, serial_number: str, *, by_hand: bool) -> Blueprint:
    with open_database(database) as registry:
        return registry.robots.blueprint(_record(registry, name, serial_number), by_hand=by_hand)


def _record(registry: Registry, name: str, serial_number: str) -> RobotRecord:
    record = find_record(registry, name, serial_number)
    if record is None:
        words = said("{robot} is not in its database any more", robot=f"{name} {serial_number}")
        raise ConfigError(words)
    return record


def plan_for(robot: ClassRobot, blueprint: Blueprint, read: DatabaseReader = directly) -> RollOutPlan:
    """Compare a robot with a blueprint of which everything but the profile is meant for it, too."""
    if robot.runs_elsewhere:
        return RollOutPlan(
            robot, None, obstacle=said("its master runs on another computer: `msbot class join` its page first")
        )
    if robot.far is None and not robot.database:
        return RollOutPlan(robot, None, obstacle=said("it runs without a database, so it cannot be changed from here"))
    try:
        if robot.far is not None:
            return _far_plan(robot, robot.far, blueprint)
        present = read(_stored_blueprint, robot.database, robot.name, robot.serial_number, by_hand=False)
    except MsbotError as error:
        return RollOutPlan(robot, None, obstacle=str(error))
    wanted = replace(blueprint, robot=present.robot)
    return RollOutPlan(robot, wanted, tuple(str(one) for one in differences(present, wanted)))


def _far_plan(robot: ClassRobot, far: RemoteRobot, blueprint: Blueprint) -> RollOutPlan:
    """What it would change there, as its own master says, by its own part library.

    Raises:
        RemoteMasterError: it does not answer, or the blueprint does not fit its library.
    """
    if far.trouble:
        return RollOutPlan(robot, None, obstacle=far.trouble)
    if (robot.name, robot.serial_number) != (far.access.robot, far.access.serial_number):
        known = f"{far.access.robot} {far.access.serial_number}"
        obstacle = said(
            "another robot answers there than {known}: `msbot class join {page}` if that is right",
            known=known,
            page=robot.page,
        )
        return RollOutPlan(robot, None, obstacle=obstacle)
    names = ("robot", "version", "serial_number", "released", "manufacturer", "stop_group")
    wanted = replace(blueprint, robot=RobotProfile(*(far.text(name) for name in names)))
    answer = _ask(far, "POST", "/api/blueprint/diff", {"toml": blueprint_toml(wanted)})
    changes = answer.get("changes")
    assert isinstance(changes, list)
    return RollOutPlan(robot, wanted, tuple(str(one) for one in changes))


def _ask(far: RemoteRobot, method: str, path: str, body: dict[str, object]) -> Answer:
    def work(line: RemoteMasterConnection) -> Answer:
        return line.mapping(method, path, body)

    return ask_one(far.access, work, CHANGE_S)


def _change(far: RemoteRobot, method: str, path: str, body: dict[str, object]) -> Answer:
    """The same, of a question that changes the robot.

    Raises:
        RemoteMasterRefusal: it has not changed.
        NoAnswer: whether it has changed is not known.
    """
    try:
        return _ask(far, method, path, body)
    except RemoteMasterRefusal:
        raise
    except RemoteMasterError as trouble:
        raise NoAnswer(str(trouble)) from trouble


def _ask_here(master: RunningProcess, request: Mapping[str, object]) -> Answer:
    try:
        return master.ask(request, patience_s=CHANGE_S)
    except ConfigError as error:
        raise NoAnswer(str(error)) from error


class RollOut:
    """One roll-out.

    Args:
        blueprint: where the blueprint is from, for people.
        folder: where the folders of part types that it names are looked for.
        library: the part types that it was checked against.
        folders: further folders of part types, as `--library` names them.
        who: who does it.
        book: remembers what was done.
        read: calls what opens a database.
    """

    def __init__(
        self,
        blueprint: str,
        folder: Path,
        library: Library,
        folders: Sequence[Path],
        who: str,
        *,
        book: RollOutLog | None = None,
        read: DatabaseReader = directly,
    ) -> None:
        self._folder = folder
        self._who = who
        self._library = library
        self._folders = [str(folder.resolve()) for folder in folders]
        self._book = book or RollOutLog()
        self._read = read
        self._at = self._book.begin(blueprint)

    def job(self, plan: RollOutPlan) -> RobotJob:
        """What is to be done at that robot."""
        robot = plan.robot
        return RobotJob(
            robot.describe, partial(self._put_in_force, plan), "" if robot.far else database_identity(robot.database)
        )

    def _put_in_force(self, plan: RollOutPlan) -> RobotChange:
        """Change one robot.

        Raises:
            NoAnswer: its master does not answer.
            ConfigError: it refuses.
            RegistryError: it cannot be stored; nothing has changed.
        """
        assert plan.wanted is not None
        robot = plan.robot
        if robot.far is not None:
            done = _done(_change(robot.far, "PUT", "/api/blueprint", {"toml": blueprint_toml(plan.wanted)}))
        elif robot.master is not None:
            with self._as_file(plan.wanted) as path:
                request = {"do": "apply", "args": {"path": str(path), "folders": self._folders}, "who": self._who}
                done = _done(_ask_here(robot.master, request))
        else:
            done = self._read(_change_stored, robot.database, plan.wanted, self._library, self._who)
        if done.edit is None:
            return done
        try:
            self._book.note(
                self._at, RolledOutChange(robot.name, robot.serial_number, database_identity(robot.database), done.edit)
            )
        except ConfigError as error:  # it is changed all the same
            words = said("{words}; but it is not remembered for undo: {error}", words=done.words, error=str(error))
            return RobotChange(words, done.edit)
        return done

    @contextmanager
    def _as_file(self, wanted: Blueprint) -> Iterator[Path]:
        """The blueprint for one robot as a file beside the original, so that relative folders mean the same."""
        try:
            number, name = tempfile.mkstemp(".toml", ".rollout-", self._folder)
        except OSError as error:
            raise ConfigError(f"cannot write in {self._folder}: {error.strerror}") from error
        path = Path(name)
        try:
            with os.fdopen(number, "w", encoding="utf-8") as file:
                file.write(blueprint_toml(wanted))
            yield path
        finally:
            path.unlink(missing_ok=True)


def _change_stored(database: str, wanted: Blueprint, library: Library, who: str) -> RobotChange:
    """Change a robot that does not run."""
    with open_database(database) as registry:
        registry.runs.begin(_record(registry, wanted.robot.name, wanted.robot.serial_number))  # no master starts now
        _, edit = registry.robots.change_blueprint(wanted, library, who)
    return RobotChange(said("nothing to change"), None) if edit is None else RobotChange(edit.words, edit.id)


def undo_job(
    at: float,
    change: RolledOutChange,
    robots: Sequence[ClassRobot],
    who: str,
    book: RollOutLog,
    *,
    read: DatabaseReader = directly,
) -> RobotJob:
    """What is to be done to take one change of that roll-out back; then it is remembered no more."""

    def do() -> RobotChange:
        try:
            back = take_back(change, robots, who, read)
        except NoAnswer:
            raise
        except ConfigError as refused:
            if not was_undone(change, robots, who, read):
                raise
            back = RobotChange(said("somebody has taken it back already: {words}", words=str(refused)), None)
        try:
            book.taken_back(at, [change])
        except ConfigError as error:  # it is taken back all the same
            words = said("{words}; but it is still remembered: {error}", words=back.words, error=str(error))
            return RobotChange(words, back.edit)
        return back

    return RobotJob(f"{change.robot} {change.serial_number}", do, change.database)


def take_back(
    done: RolledOutChange, robots: Sequence[ClassRobot], who: str, read: DatabaseReader = directly
) -> RobotChange:
    """Undo one change of a roll-out.

    Raises:
        NoAnswer: its master does not answer.
        ConfigError: it was changed again since, or the robot cannot be changed from here.
        RegistryError: it cannot be stored; nothing has changed.
    """
    request: dict[str, object] = {"do": "undo", "args": {"edit": done.edit}, "who": who}
    robot = _robot_of(done, robots)
    if robot is not None and robot.far is not None:
        answer = _change(robot.far, "POST", "/api/undo", {"edit": done.edit})
    elif robot is not None and robot.master is not None:
        answer = _ask_here(robot.master, request)
    elif done.database.startswith(("http://", "https://")):
        raise ConfigError(f"there is no access to {done.database} any more, or another robot answers there")
    else:
        database = done.database if robot is None else robot.database
        answer = read(_perform_stored, database, done.robot, done.serial_number, request)
    return _done(answer)


def was_undone(done: RolledOutChange, robots: Sequence[ClassRobot], who: str, read: DatabaseReader = directly) -> bool:
    """Whether somebody has undone a change of a roll-out at the robot itself; False also where nobody knows."""
    request: dict[str, object] = {"do": "edits", "args": {"limit": NEWEST_EDITS}, "who": who}
    robot = _robot_of(done, robots)
    try:
        if robot is not None and robot.far is not None:
            path = f"/api/edits?limit={NEWEST_EDITS}"
            lines = ask_one(robot.far.access, lambda line: line.call("GET", path), LOOK_S)
        elif robot is not None and robot.master is not None:
            lines = _ask_here(robot.master, request).get("edits")
        elif robot is not None:
            lines = read(_perform_stored, robot.database, done.robot, done.serial_number, request).get("edits")
        else:
            return False
    except MsbotError:
        return False  # the first answer is told then
    return any(
        isinstance(one, dict) and done.edit in (one.get("id"), one.get("number")) and one.get("undone") is True
        for one in (lines if isinstance(lines, list) else ())
    )


def _robot_of(done: RolledOutChange, robots: Sequence[ClassRobot]) -> ClassRobot | None:
    key = (done.robot, done.serial_number, done.database)
    return next((one for one in robots if (one.name, one.serial_number, database_identity(one.database)) == key), None)


def _perform_stored(database: str, name: str, serial_number: str, request: dict[str, object]) -> Answer:
    """Carry an operation out on a robot that does not run."""
    from msbot.operations.dispatch import perform, stored_operations  # running robots need no SQLAlchemy here

    with open_database(database) as registry:
        record = _record(registry, name, serial_number)
        return run_to_end(perform(stored_operations(registry, record), request))


def _done(answer: Answer) -> RobotChange:
    """What was done, as the master says.

    Raises:
        ConfigError: the master has refused.
        DatabaseBusy: its database was locked at that moment.
    """
    if "error" in answer:
        raise (DatabaseBusy if answer.get("again") is True else ConfigError)(str(answer["error"]))
    number = answer.get("edit")
    return RobotChange(str(answer.get("words", "")), number if isinstance(number, int) else None)
