"""`msbot stop`: all parts go to their safe states; shows at which robots, which have obeyed and which have not."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from datetime import datetime

import click

from msbot.cli.change.stop_route import (
    Answer,
    Meant,
    Reached,
    go_command,
    robot_label,
    say_stop,
    silent_words,
    stop_status,
)
from msbot.cli.robot_options import robot_options, stop_group_option
from msbot_xrce.common.amount import amount
from msbot_xrce.errors import ConfigError

PATIENCE_S = 2.0
"""How long the command waits for the parts to confirm."""
LOOK_S = 0.02
NO_WALLS = "HOME, XDG folders and working folders do not keep robots apart; STOP groups do (docs/howto/stop_groups.md)"


@click.command("stop")
@click.option("--reason", default="", help="Why, for the people who see it.")
@click.option("--status", "only_status", is_flag=True, help="Only tell whether STOP holds.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@stop_group_option
@robot_options
def command(
    reason: str, db: str | None, robot: str | None, *, only_status: bool, as_json: bool, stop_group: str | None
) -> None:
    """STOP: every part goes to its safe state at once, and stays there until `msbot go`. It never asks first.

    Which robots: that of --robot or --db; those of a STOP group (--stop-group); else that of the robot.db here. If
    there is none, EVERY robot of yours that runs on this computer, whatever HOME, XDG folders or working folder it was
    started with: only STOP groups keep robots apart. From root: those of all users.
    """
    meant = Meant(db, robot, stop_group)
    if only_status:
        _show_status(stop_status(meant), meant, as_json=as_json)
        return
    if meant.odd_group:
        click.echo(f"{meant.odd_group}: STOP goes to every robot of yours that is meant", err=True)
    said = say_stop(meant, reason)
    reached = said
    until = time.monotonic() + PATIENCE_S
    while reached.waits and time.monotonic() < until:
        time.sleep(LOOK_S)
        reached = stop_status(meant)
    if as_json:
        click.echo(json.dumps(_as_json(reached, said, meant)))
    else:
        for line in [*_header(reached.answers, meant), *_lines(reached.answers, meant)]:
            click.echo(line)
    if said.silent:
        raise ConfigError(f"NOT delivered to {silent_words(said.silent)}; cut the power of their robots")


def _as_json(reached: Reached, said: Reached, meant: Meant) -> dict[str, object]:
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
    return {name: found[name] for name in names} | {
        "robots": robots, "not_reached": [str(one) for one in said.silent]
    }  # fmt: skip


def _show_status(reached: Reached, meant: Meant, *, as_json: bool) -> None:
    status = together(reached.answers)
    if as_json:
        click.echo(json.dumps({name: status[name] for name in ("stopped", "number", "by", "since")}))
        return
    stopped = [one for one in reached.answers if one["stopped"]]
    if not stopped:
        click.echo("no STOP holds")
    for one in stopped:
        since, why = one["since"], f": {one['reason']}" if one["reason"] else ""
        assert isinstance(since, int | float)
        where = f" at {robot_label(one)}" if len(reached.answers) > 1 else ""
        at = f"{datetime.fromtimestamp(since):%Y-%m-%d %H:%M:%S}"
        click.echo(f"STOP {one['number']}{where} since {at}, said by {one['by']}{why}")
        for line in _lines([one], meant, among=reached.answers):
            click.echo(line)
    if reached.silent:
        click.echo(f"not known: {silent_words(reached.silent)}")


def _header(answers: Sequence[Answer], meant: Meant) -> list[str]:
    """Which robots were reached without being named."""
    if not meant.is_all:
        return []
    whose = f"of the STOP group {meant.in_group}" if meant.in_group else "of yours"
    count = len(answers)
    which = f"the one robot {whose} that runs" if count == 1 else f"all {count} robots {whose} that run"
    why = "" if meant.in_group else "; none was named, and there is no robot.db here"
    return [f"STOP at {which} on this computer{why}"] + ([NO_WALLS] if count > 1 and not meant.in_group else [])


def _lines(answers: Sequence[Answer], meant: Meant, among: Sequence[Answer] | None = None) -> list[str]:
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
