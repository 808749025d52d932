"""How STOP and GO reach a master: by a socket of their own if there is one, else like every other command."""

from __future__ import annotations

from pathlib import Path

from msbot.cli.options import DEFAULT_BLUEPRINT, database_beside, database_identity, user_name
from msbot.errors import ConfigError
from msbot.runtime.stop_datagram import IS_THERE, ask_masters

Answer = dict[str, object]


def say_stop(db: str | None, robot: str | None, reason: str) -> Answer:
    """Say STOP to the robot named; if none is named, to every running robot of this user on this computer.

    Raises:
        ConfigError: no master accepts it; the text says so plainly.
    """
    answers = _ask("stop", db, robot, reason)
    return _together(answers) if answers else _by_the_ordinary_way("stop", {"reason": reason}, db, robot)


def say_go(db: str | None, robot: str | None) -> Answer:
    """Say GO to the one robot that is meant.

    Raises:
        ConfigError: several could be meant, nobody said STOP, or no master accepts it.
    """
    meant = _ask("status", db, robot)
    if len(meant) > 1:
        names = ", ".join(str(one["robot"]) for one in meant)
        raise ConfigError(f"{len(meant)} masters run here: say with --robot which one may go on: {names}")
    answers = _ask("go", db, robot) if meant else []
    return answers[0] if answers else _by_the_ordinary_way("go", {}, db, robot)


def stop_status(db: str | None, robot: str | None) -> Answer:
    """The state of STOP.

    Raises:
        ConfigError: no master answers.
    """
    answers = _ask("status", db, robot)
    return _together(answers) if answers else _by_the_ordinary_way("stop_report", {}, db, robot)


def _ask(do: str, db: str | None, robot: str | None, reason: str = "") -> list[Answer]:
    """The answers of the masters that are meant: of that robot and database; else of the robot.db here; else all.

    Raises:
        ConfigError: none answers although some are running, or a master reports an error.
    """
    if not IS_THERE:
        return []
    if db is None and Path(beside := database_beside(DEFAULT_BLUEPRINT)).exists():
        db = beside
    database = None if db is None else database_identity(db)
    request = {"do": do, "who": user_name(), "reason": reason, "robot": robot, "database": database}
    answers, silent = ask_masters(request)
    if not answers and silent:
        raise ConfigError("NOT delivered: a master runs here and does not answer; cut the power of the robot")
    for answer in answers:
        if "error" in answer:
            raise ConfigError(str(answer["error"]))
    return answers


def _by_the_ordinary_way(do: str, args: dict[str, object], db: str | None, robot: str | None) -> Answer:
    from msbot.cli.change.robot_access import perform  # imported late, so that STOP itself loads nothing slow

    answer = perform(db, robot, do, args)
    return answer if do == "stop_report" else perform(db, robot, "stop_report", {})


def _together(answers: list[Answer]) -> Answer:
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
