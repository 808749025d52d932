"""How STOP and GO reach a master: by a socket of their own if there is one, else like every other command."""

from __future__ import annotations

from pathlib import Path

from msbot.cli.options import DEFAULT_BLUEPRINT, database_beside, user_name
from msbot.errors import ConfigError
from msbot.registry.database_identity import database_identity
from msbot.runtime.stop_datagram import IS_THERE, ask_masters

Answer = dict[str, object]


def say_stop(db: str | None, robot: str | None, reason: str) -> Answer:
    """Say STOP to the robot named; if none is named, to every running robot of this user on this computer.

    Returns:
        The state of STOP; `unreached` counts masters that run here and do not answer.

    Raises:
        ConfigError: no master accepts it; the text says so plainly.
    """
    answers, silent = _ask("stop", db, robot, reason)
    if answers:
        return _together(answers) | {"unreached": silent}
    return _by_the_ordinary_way("stop", {"reason": reason}, db, robot, "NOT delivered")


def say_go(db: str | None, robot: str | None) -> Answer:
    """Say GO to the one robot that is meant.

    Raises:
        ConfigError: several could be meant, nobody said STOP, or no master accepts it.
    """
    meant, _ = _ask("status", db, robot)
    if len(meant) > 1:
        from msbot.cli.change.robot_access import robot_words  # as below

        names = ", ".join(robot_words(one) for one in meant)
        raise ConfigError(f"{len(meant)} masters run here: say with --robot or --db which one may go on: {names}")
    if not meant:
        return _by_the_ordinary_way("go", {}, db, robot, "NOT delivered")
    (one,) = meant  # to this one alone: another master may stand still, and would find it later
    # By its serial number, too: robots of one name may share a database.
    answers, _ = _ask("go", str(one["database"]), str(one["robot"]), serial_number=one.get("serial_number"))
    if not answers:
        raise ConfigError("NOT delivered: the master has ended meanwhile")
    return answers[0]


def stop_status(db: str | None, robot: str | None) -> Answer:
    """The state of STOP; `unreached` as for `say_stop`.

    Raises:
        ConfigError: no master answers.
    """
    answers, silent = _ask("status", db, robot)
    if answers:
        return _together(answers) | {"unreached": silent}
    return _by_the_ordinary_way("stop_report", {}, db, robot, "whether STOP holds is not known")


def _ask(
    do: str, db: str | None, robot: str | None, reason: str = "", *, serial_number: object = None
) -> tuple[list[Answer], int]:
    """The answers of the masters that are meant (of that robot and database; else of the robot.db here; else all), and
    how many run here without an answer; 0 if the robot was named, as they are then of others.

    Raises:
        ConfigError: none answers although some are running, or a master reports an error.
    """
    if not IS_THERE:
        return [], 0
    if db is None and Path(beside := database_beside(DEFAULT_BLUEPRINT)).exists():
        db = beside
    database = None if db is None else database_identity(db)
    request = {"do": do, "who": user_name(), "reason": reason, "robot": robot, "database": database,
               "serial_number": serial_number}  # fmt: skip
    answers, silent = ask_masters(request)
    if not answers and silent:
        raise ConfigError("NOT delivered: a master runs here and does not answer; cut the power of the robot")
    for answer in answers:
        if "error" in answer:
            raise ConfigError(str(answer["error"]))
    return answers, 0 if robot is not None else silent


def _by_the_ordinary_way(
    do: str, args: dict[str, object], db: str | None, robot: str | None, without_master: str
) -> Answer:
    # Imported late, so that STOP itself loads nothing slow.
    from msbot.cli.change.robot_access import perform, running_master

    if running_master(db, robot) is None:  # the database could do nothing here, and a starting master may hold it
        raise ConfigError(f"{without_master}: no master of this robot runs here; if one is just starting, say it again")
    answer = perform(db, robot, do, args)
    return (answer if do == "stop_report" else perform(db, robot, "stop_report", {})) | {"unreached": 0}


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
