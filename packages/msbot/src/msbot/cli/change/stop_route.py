"""How STOP and GO reach a master: by a socket of their own if there is one, else like every other command."""

from __future__ import annotations

import os
import shlex
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path

from msbot.cli.robot_options import DEFAULT_BLUEPRINT, database_beside, user_name
from msbot.registry.database_identity import database_identity
from msbot.stop.asking import SilentMaster, ask_masters, user_words
from msbot.stop.names import group_to_stop
from msbot.stop.places import IS_THERE, own_user
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

Answer = dict[str, object]


@dataclass(frozen=True, slots=True)
class Meant:
    """Which robots a command means."""

    db: str | None
    """The database that was named; None: robot.db here, if there is one."""
    robot: str | None
    """The name or serial number that was given."""
    group: str | None = None
    """The STOP group that was given; then robot.db here does not matter."""

    @property
    def database(self) -> str | None:
        """The database of the robots meant; None: any."""
        if self.db is not None:
            return database_identity(self.db)
        beside = database_beside(DEFAULT_BLUEPRINT)
        return database_identity(beside) if self.group is None and _counts(Path(beside)) else None

    @property
    def in_group(self) -> str:
        """Only masters of this STOP group; empty: all, also when the variable names none that can be used."""
        return group_to_stop()[0] if self.group is None else self.group

    @property
    def odd_group(self) -> str:
        """What is wrong with the group in the variable, if that counts; empty: nothing."""
        return group_to_stop()[1] if self.group is None else ""

    @property
    def is_all(self) -> bool:
        """Whether every robot of the user, or of the group, is meant: nobody has named one."""
        return self.robot is None and self.database is None


@dataclass(frozen=True, slots=True)
class Reached:
    """Who has answered, and who runs and does not."""

    answers: list[Answer]
    silent: list[SilentMaster]

    @property
    def waits(self) -> bool:
        """Whether STOP holds at a part that has not confirmed it."""
        return any(answer["stopped"] and answer["not_confirmed"] for answer in self.answers)


def say_stop(meant: Meant, reason: str) -> Reached:
    """Say STOP to the robots meant; if none is named, to every running robot of this user on this computer.

    Raises:
        ConfigError: no master accepts it; the text says so plainly.
    """
    reached = _ask("stop", meant, reason)
    return reached if reached.answers else _by_the_ordinary_way("stop", {"reason": reason}, meant, "NOT delivered")


def say_go(meant: Meant, number: int | None = None) -> Answer:
    """Say GO to the one robot that is meant.

    Args:
        meant: which.
        number: the latest STOP that this person knows of; None: the one that holds when the command asks.

    Raises:
        ConfigError: several could be meant, nobody said STOP, another one was said since, or no master accepts it.
    """
    if meant.odd_group:
        raise ConfigError(f"NOT delivered: {meant.odd_group}; or name the group with --stop-group")
    found = _ask("status", meant).answers
    if len(found) > 1:
        ways = "; ".join(f"{robot_label(one)}: {go_command(one, found, meant)}" for one in found)
        raise ConfigError(f"{len(found)} masters run here: say with --robot or --db which one may go on: {ways}")
    if not found:
        return _by_the_ordinary_way("go", {"stop": number}, meant, "NOT delivered").answers[0]
    (one,) = found  # to this one alone: another master may stand still, and would find it later
    # By its serial number, too: robots of one name may share a database.
    only = Meant(str(one["database"]), str(one["robot"]), str(one.get("stop_group") or ""))
    known = one.get("number") if number is None else number
    answers = _ask("go", only, serial_number=one.get("serial_number"), stop=known).answers
    if not answers:
        raise ConfigError("NOT delivered: the master has ended meanwhile")
    return answers[0]


def stop_status(meant: Meant) -> Reached:
    """The state of STOP at the robots meant.

    Raises:
        ConfigError: no master answers.
    """
    reached = _ask("status", meant)
    if reached.answers:
        return reached
    return _by_the_ordinary_way("stop_report", {}, meant, "whether STOP holds is not known")


def robot_label(answer: Mapping[str, object]) -> str:
    """A robot as people know it: name, serial number, and whose it is if it is somebody else's."""
    user = answer.get("user")
    owner = f" of {user_words(user)}" if isinstance(user, int) and user != own_user() else ""
    return f"{answer.get('robot')} {answer.get('serial_number') or ''}".strip() + owner


def go_command(one: Answer, among: Sequence[Answer], meant: Meant) -> str:
    """The command by which that robot alone goes on."""

    def only(word: object) -> bool:
        return sum(word in (other.get("robot"), other.get("serial_number")) for other in among) == 1

    words = ["msbot", "go"]
    name, serial = one.get("robot"), one.get("serial_number")
    words += ["--robot", str(name if only(name) or not serial else serial)]
    is_beside = meant.group is not None and Path(database_beside(DEFAULT_BLUEPRINT)).exists()
    if not only(words[-1]) or meant.db is not None or is_beside:
        words += ["--db", str(one.get("database"))]
    words += [] if meant.group is None else ["--stop-group", meant.group]
    words += ["--stop", str(one["number"])] if one.get("number") else []  # a newer STOP is not ended by it
    return shlex.join(words)


def silent_words(silent: Sequence[SilentMaster]) -> str:
    """Masters that run and do not answer, by name."""
    return f"{', '.join(map(str, silent))}: {'it runs and does' if len(silent) == 1 else 'they run and do'} not answer"


def _counts(database: Path) -> bool:
    """Whether a database in this folder says which robot is meant: a file that this user has put there.

    What others have put there must not lead STOP to another robot than the one that runs. Root is in somebody's folder
    at times: there the file is the owner's, unless everybody may write into it.
    """
    if os.name != "posix":
        return database.exists()
    try:
        found, folder, file = database.lstat(), database.absolute().parent.stat(), database.stat()
    except OSError:
        return False
    if not stat.S_ISREG(file.st_mode):
        return False
    is_own = found.st_uid == own_user()
    return is_own or (own_user() == 0 and found.st_uid == folder.st_uid and not folder.st_mode & 0o022)


def _ask(do: str, meant: Meant, reason: str = "", *, serial_number: object = None, stop: object = None) -> Reached:
    """The answers of the masters that are meant, and which may be meant and run here without an answer.

    Raises:
        ConfigError: none answers although some are running, or a master reports an error.
    """
    if not IS_THERE:
        return Reached([], [])
    request = {
        "do": do,
        "who": user_name(),
        "reason": reason,
        "robot": meant.robot,
        "database": meant.database,
        "serial_number": serial_number,
        "stop": stop,
    }
    answers, silent = ask_masters(request, group=meant.in_group)
    if not answers and silent:
        raise ConfigError(f"NOT delivered to {silent_words(silent)}; cut the power of the robot")
    for answer in answers:
        if "error" in answer:
            raise ConfigError(str(answer["error"]))
    return Reached(sorted(answers, key=lambda one: (str(one.get("robot")), str(one.get("serial_number")))), silent)


def _by_the_ordinary_way(do: str, args: dict[str, object], meant: Meant, without_master: str) -> Reached:
    # Imported late, so that STOP itself loads nothing slow.
    from msbot.cli.change.robot_access import perform, running_master
    from msbot_agent.agent import MASTER, running_processes

    db, robot, group = meant.db, meant.robot, meant.in_group
    groups = [one.details.get("stop_group", "") for one in running_processes() if one.what == MASTER]
    if group and groups and group not in groups:
        raise ConfigError(f"{without_master}: no master of the STOP group {group} runs here")
    master = running_master(db, robot)
    if master is None:  # the database could do nothing here, and a starting master may hold it
        raise ConfigError(f"{without_master}: no master of this robot runs here; if one is just starting, say it again")
    if group and master.details.get("stop_group", "") != group:
        raise ConfigError(f"{without_master}: no master of the STOP group {group} runs here")
    answer = perform(db, robot, do, args)
    report = answer if do == "stop_report" else perform(db, robot, "stop_report", {})
    return Reached([{**master.details, **report}], [])
