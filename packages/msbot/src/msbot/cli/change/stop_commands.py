"""`msbot stop`: all parts go to their safe states; shows at which robots, which have obeyed and which have not."""

from __future__ import annotations

import json
import os
import shlex
import stat
import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

import click

from msbot.cli.database_place import DEFAULT_BLUEPRINT, database_beside
from msbot.cli.robot_options import robot_options, stop_group_option, user_name
from msbot.registry.records import database_identity
from msbot.stop.masters_of_others import masters_of_others, others_words
from msbot.stop.socket_folders import IS_THERE, own_user
from msbot.stop.socket_names import group_to_stop
from msbot.stop.stop_request import SilentMaster, ask_masters, user_words
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

# How STOP and GO reach a master: by a socket of their own if there is one, else like every other command.


Answer = dict[str, object]


@dataclass(frozen=True, slots=True)
class ChosenRobots:
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
class StopAnswers:
    """Who has answered, and who runs and does not."""

    answers: list[Answer]
    silent: list[SilentMaster]

    @property
    def is_waiting(self) -> bool:
        """Whether STOP holds at a part that has not confirmed it."""
        return any(answer["stopped"] and answer["not_confirmed"] for answer in self.answers)


def say_stop(meant: ChosenRobots, reason: str) -> StopAnswers:
    """Say STOP to the robots meant; if none is named, to every running robot of this user on this computer.

    Raises:
        ConfigError: no master accepts it; the text says so plainly.
    """
    reached = _ask("stop", meant, reason)
    return reached if reached.answers else _by_the_ordinary_way("stop", {"reason": reason}, meant, "NOT delivered")


def say_go(meant: ChosenRobots, number: int | None = None) -> Answer:
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
    only = ChosenRobots(str(one["database"]), str(one["robot"]), str(one.get("stop_group") or ""))
    known = one.get("number") if number is None else number
    answers = _ask("go", only, serial_number=one.get("serial_number"), stop=known).answers
    if not answers:
        raise ConfigError("NOT delivered: the master has ended meanwhile")
    return answers[0]


def stop_status(meant: ChosenRobots) -> StopAnswers:
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


def go_command(one: Answer, among: Sequence[Answer], meant: ChosenRobots) -> str:
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


def _from(one: Answer) -> str:
    return f" from {one['place']}" if one.get("place") else ""


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


def _ask(
    do: str, meant: ChosenRobots, reason: str = "", *, serial_number: object = None, stop: object = None
) -> StopAnswers:
    """The answers of the masters that are meant, and which may be meant and run here without an answer.

    Raises:
        ConfigError: none answers although some are running, or a master reports an error.
    """
    if not IS_THERE:
        return StopAnswers([], [])
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
    return StopAnswers(sorted(answers, key=lambda one: (str(one.get("robot")), str(one.get("serial_number")))), silent)


def _by_the_ordinary_way(do: str, args: dict[str, object], meant: ChosenRobots, without_master: str) -> StopAnswers:
    # Imported late, so that STOP itself loads nothing slow.
    from msbot.cli.change.robot_access import perform, running_master
    from msbot_agent.agent import MASTER, running_processes

    db, robot, group = meant.db, meant.robot, meant.in_group
    groups = [one.details.get("stop_group", "") for one in running_processes() if one.what == MASTER]
    if group and groups and group not in groups:
        raise ConfigError(f"{without_master}: no master of the STOP group {group} runs here")
    master = running_master(db, robot)
    if master is None:  # the database could do nothing here, and a starting master may hold it
        others = others_words(masters_of_others(), _COMMAND_OF[do])
        also = f"; {others}" if others else ""
        raise ConfigError(
            f"{without_master}: no master of this robot runs here; if one is just starting, say it again{also}"
        )
    if group and master.details.get("stop_group", "") != group:
        raise ConfigError(f"{without_master}: no master of the STOP group {group} runs here")
    answer = perform(db, robot, do, args)
    report = answer if do == "stop_report" else perform(db, robot, "stop_report", {})
    return StopAnswers([{**master.details, **report}], [])


_COMMAND_OF = {"stop": "msbot stop", "go": "msbot go", "stop_report": "msbot stop --status"}
PATIENCE_S = 2.0
"""How long the command waits for the parts to confirm."""
LOOK_S = 0.02
NO_WALLS = "HOME, XDG folders and working folders do not keep robots apart; STOP groups do (`msbot help stop_groups`)"


@click.command("stop")
@click.option("--reason", default="", help="Why, for the people who see it.")
@click.option("--status", "only_status", is_flag=True, help="Only say whether STOP holds.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@stop_group_option
@robot_options
def command(
    reason: str, db: str | None, robot: str | None, *, only_status: bool, as_json: bool, stop_group: str | None
) -> None:
    """STOP: every part goes to its safe state at once, and stays there until `msbot go`. It never asks first.

    Which robots: that of --robot or --db; those of a STOP group (--stop-group); else that of the robot.db here. If
    there is none, EVERY robot of yours that runs on this computer, whatever HOME, XDG folders or working folder it was
    started with: only STOP groups keep robots apart. As root: those of all users.
    """
    meant = ChosenRobots(db, robot, stop_group)
    if only_status:
        _show_status(stop_status(meant), meant, as_json=as_json)
        return
    if meant.odd_group:
        click.echo(f"{meant.odd_group}: STOP goes to every robot of yours that is meant", err=True)
    said = say_stop(meant, reason)
    reached = said
    until = time.monotonic() + PATIENCE_S
    while reached.is_waiting and time.monotonic() < until:
        time.sleep(LOOK_S)
        reached = stop_status(meant)
    if as_json:
        click.echo(json.dumps(_as_json(reached, said, meant)))
    else:
        for line in [*_header(reached.answers, meant), *_lines(reached.answers, meant)]:
            click.echo(line)
    if said.silent:
        raise ConfigError(f"NOT delivered to {silent_words(said.silent)}; cut the power of their robots")


def _as_json(reached: StopAnswers, said: StopAnswers, meant: ChosenRobots) -> dict[str, object]:
    """What holds for all robots together, and for each."""
    found = together(reached.answers)
    names = ["told", "confirmed", "silent", "stored", *(name for name in ("left_out",) if found.get(name))]
    of_one = (
        "robot",
        "serial_number",
        "database",
        "stop_group",
        "stopped",
        "number",
        "told",
        "not_confirmed",
        "stored",
    )
    robots = [
        {name: one.get(name) for name in of_one} | {"go": go_command(one, reached.answers, meant)}
        for one in reached.answers
    ]
    return {name: found[name] for name in names} | {"robots": robots, "not_reached": [str(one) for one in said.silent]}


def _show_status(reached: StopAnswers, meant: ChosenRobots, *, as_json: bool) -> None:
    status = together(reached.answers)
    if as_json:
        of_one = ("robot", "serial_number", "database", "stopped", "number", "by", "since")
        robots = [{name: one.get(name) for name in of_one} for one in reached.answers]
        told = {name: status[name] for name in ("stopped", "number", "by", "since")}
        click.echo(json.dumps(told | {"robots": robots, "not_known": [str(one) for one in reached.silent]}))
        return
    stopped = [one for one in reached.answers if one["stopped"]]
    if not stopped:
        click.echo(f"no STOP holds at {', '.join(robot_label(one) for one in reached.answers)}")
    for one in stopped:
        since, why = one["since"], f": {one['reason']}" if one["reason"] else ""
        assert isinstance(since, int | float)
        at = f"{datetime.fromtimestamp(since):%Y-%m-%d %H:%M:%S}"
        click.echo(f"STOP {one['number']} at {robot_label(one)} since {at}, said by {one['by']}{_from(one)}{why}")
        for line in _lines([one], meant, among=reached.answers):
            click.echo(line)
    if reached.silent:
        click.echo(f"not known: {silent_words(reached.silent)}")


def _header(answers: Sequence[Answer], meant: ChosenRobots) -> list[str]:
    """Which robots were reached without being named."""
    if not meant.is_all:
        return []
    whose = f"of the STOP group {meant.in_group}" if meant.in_group else "of yours"
    count = len(answers)
    which = f"the one robot {whose} that runs" if count == 1 else f"all {count} robots {whose} that run"
    why = "" if meant.in_group else "; none was named, and there is no robot.db here"
    return [f"STOP at {which} on this computer{why}"] + ([NO_WALLS] if count > 1 and not meant.in_group else [])


def _lines(answers: Sequence[Answer], meant: ChosenRobots, among: Sequence[Answer] | None = None) -> list[str]:
    """How it stands at each; where several are, or none was named, with the command that ends STOP there alone."""
    lines: list[str] = []
    among = answers if among is None else among
    for one in answers:
        first, *others = _words(one)
        if not meant.is_all and len(among) == 1:
            lines += [first, *others]
            continue
        way = f" (to end it there: {go_command(one, among, meant)})" if one["stopped"] else ""
        lines += [f"{robot_label(one)}: {first}{way}", *(f"{robot_label(one)}: {line}" for line in others)]
    return lines


def together(answers: Sequence[Answer]) -> Answer:
    """Combine the answers of several robots; parts then have their robot's name in front."""
    if len(answers) == 1:
        return answers[0]
    first = next((answer for answer in answers if answer["stopped"]), answers[0])
    return first | {
        "told": sum(_whole(answer["told"]) for answer in answers),
        "confirmed": [
            one | {"part": f"{answer['robot']}/{one['part']}"} for answer in answers for one in _of(answer, "confirmed")
        ],
        "silent": [f"{answer['robot']}/{name}" for answer in answers for name in _of(answer, "silent")],
        "not_confirmed": sum(_whole(answer["not_confirmed"]) for answer in answers),
        "left_out": sum(_whole(answer.get("left_out", 0)) for answer in answers),
        "stored": all(answer["stored"] for answer in answers),
        "trouble": "; ".join(str(answer["trouble"]) for answer in answers if answer["trouble"]),
    }


def _of(answer: Answer, name: str) -> list[dict[str, object]]:
    value = answer[name]
    assert isinstance(value, list)
    return value


def _whole(value: object) -> int:
    assert isinstance(value, int)
    return value


def _words(status: dict[str, object]) -> list[str]:
    confirmed, silent = status["confirmed"], status["silent"]
    assert isinstance(confirmed, list)
    assert isinstance(silent, list)
    count, left_out = status["not_confirmed"], status.get("left_out", 0)
    assert isinstance(count, int)
    lines = []
    if not status["stopped"]:
        return ["STOP has been ended meanwhile: `msbot go`, or the page"]
    if not status["told"]:
        lines.append("STOP holds; no part is in the robot")
    elif count:
        told = status["told"]
        assert isinstance(told, int)
        lines.append(
            f"STOP: {told - count} of {amount(told, 'part')} {'has' if told - count == 1 else 'have'} confirmed it"
        )
        others = f" and {amount(count - len(silent), 'other')}" if count > len(silent) else ""
        lines.append(f"NOT confirmed: {', '.join(silent)}{others}: {'it' if count == 1 else 'they'} may still move")
    else:
        slowest = max((float(one["ms"]) for one in confirmed), default=0.0)
        time_words = "" if left_out else f" within {slowest:.1f} ms"
        who = "the one part has" if status["told"] == 1 else f"all {status['told']} parts have"
        lines.append(f"STOP: {who} confirmed it{time_words}")
    if status["trouble"]:
        lines.append(f"{status['trouble']}; it holds as long as this master runs")
    elif not status["stored"]:
        lines.append("STOP is not stored yet: as long as it is not, it ends with this master")
    return lines
