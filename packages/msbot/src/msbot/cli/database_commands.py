"""How commands look into a robot's database: quickly if possible, else through the registry."""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import TYPE_CHECKING, Protocol

import click

from msbot.cli import completers
from msbot.cli.change.robot_access import (
    database_to_read,
    masters_of,
    one_robot,
    perform,
    running_master,
    say,
    until_stored,
)
from msbot.cli.database_place import database_here, existing_database, is_there
from msbot.cli.robot_options import db_option, robot_and_json_options, robot_options, user_name
from msbot.pnp import PartState
from msbot.registry import JournalEntry, PartRecord, RobotRecord
from msbot.registry.read_only_database import look_into
from msbot_agent.cli.options import WholeRange, json_option
from msbot_agent.cli.table import for_terminal, print_table
from msbot_agent.text.sentence import printable
from msbot_agent.text.similar_names import did_you_mean, instead_of, nearest
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, RegistryError

if TYPE_CHECKING:
    from msbot.registry import Registry


class RobotDatabase(Protocol):
    """What these commands read."""

    @property
    def database(self) -> str:
        """The database, for messages."""

    def robots(self) -> list[RobotRecord]:
        """All robots, the one with the most recently applied blueprint first."""

    def is_run(self, robot: RobotRecord) -> bool:
        """Whether a master is running this robot now."""

    def slot_names(self, robot: RobotRecord) -> list[str]:
        """The slots of a robot."""

    def parts(self, robot: RobotRecord | None = None) -> list[PartRecord]:
        """All parts that were ever seen, of one robot or of all."""

    def journal(self, limit: int, part: str, robot: RobotRecord | None = None) -> list[JournalEntry]:
        """The newest lines of the journal about a part, of one robot or of all."""


@contextmanager
def open_robot_database(database: str) -> Iterator[RobotDatabase]:
    """A database, open for reading.

    Raises:
        RegistryError: it cannot be read; the text says why and what to do.
    """
    quick = look_into(database)
    if quick is not None:
        try:
            with quick:
                yield quick
        except sqlite3.Error as error:
            raise RegistryError(f"the database {database} cannot be read ({error}): look at `msbot db check`") from None
        return
    from msbot.registry import open_registry

    with open_registry(database, read_only=True) as registry:
        yield _RegistryDatabase(registry)


class _RegistryDatabase:
    """A `RobotDatabase` at whatever the registry can open."""

    def __init__(self, registry: Registry) -> None:
        self.database = registry.database
        self.robots = registry.robots.all
        self.is_run = registry.runs.is_run
        self.slot_names = registry.robots.slot_names
        self.parts = registry.robots.parts
        self._robots = registry.robots

    def journal(self, limit: int, part: str, robot: RobotRecord | None = None) -> list[JournalEntry]:
        """See `RobotDatabase.journal`."""
        return self._robots.journal(limit, part, robot=robot)


# `msbot parts`: what a robot's database knows about its parts.


@click.group("parts", invoke_without_command=True)
@click.option(
    "--slot",
    "slots",
    multiple=True,
    metavar="SLOT",
    shell_complete=completers.slots,
    help="Of this slot; repeatable.",
)
@click.option(
    "--state",
    "states",
    multiple=True,
    type=click.Choice([one.value for one in PartState]),
    help="In this state; repeatable.",
)
@click.option(
    "--number",
    "numbers",
    multiple=True,
    metavar="NUMBER",
    shell_complete=completers.seen_part_numbers,
    help="With this part number; repeatable.",
)
@click.option("-a", "--all", "want_all", is_flag=True, help="Also parts that are gone and belong to no slot.")
@robot_options
@json_option
@click.pass_context
def parts_command(
    context: click.Context,
    *,
    slots: tuple[str, ...],
    states: tuple[str, ...],
    numbers: tuple[str, ...],
    db: str | None,
    robot: str | None,
    want_all: bool,
    as_json: bool,
) -> None:
    """List the parts of a robot: slot, state, since when, and while it runs, where each runs and its version.

    Parts that are gone and belong to no slot are listed with --all, or when --slot, --state or --number asks for them.
    States come from the journal of transitions, which the master writes; heartbeats are never stored.
    """
    if context.invoked_subcommand is not None:
        if any(context.params.values()):
            raise click.UsageError(f"write options behind `{context.invoked_subcommand}`")
        return
    path = database_to_read(db, robot)
    until_stored(path)
    told = _versions(path)
    with open_robot_database(path) as look:
        robots = look.robots()
        several = robot is None and len(robots) > 1
        seen = look.parts(None if robot is None else one_robot(look.database, robots, robot))
        _check_slots(slots, [name for one in robots for name in look.slot_names(one)])
    wanted = [
        row
        for row in seen
        if _fits(row.slot or "", slots) and _fits(row.state, states) and _fits(row.part_number, numbers)
    ]
    is_whole = want_all or bool(slots or states or numbers)
    rows = [row for row in wanted if is_whole or row.slot or not PartState(row.state).is_over]
    if as_json:
        click.echo(json.dumps([_parts_as_json(row) | _versions_of(row, told) for row in rows]))
        return
    if not rows:
        click.echo("No part has been seen yet." if not seen else "No such part has been seen." if is_whole else "")
    else:
        _print_parts(rows, told, several=several)
    if left_out := len(wanted) - len(rows):
        is_gone = amount(left_out, "part is gone and belongs", "parts are gone and belong")
        click.echo(f"{is_gone} to no slot: `msbot parts --all` lists them too.")


@parts_command.command("forget")
@click.argument("part", shell_complete=completers.parts)
@click.option("--yes", is_flag=True, help="Do not ask.")
@robot_and_json_options
def forget(part: str, db: str | None, robot: str | None, *, yes: bool) -> None:
    """Forget PART, which is gone: a name, part number or UID.

    The robot keeps no slot for it, and lists it no longer; the journal keeps its lines. If it comes again, it is a new
    part.
    """
    if not yes:
        click.confirm(f"Forget {printable(part)}, and which slot it had?", abort=True, err=True)
    say(db, robot, "forget_part", {"part": part})


def _fits(value: str, wanted: tuple[str, ...]) -> bool:
    return not wanted or value.casefold() in [one.casefold() for one in wanted]


def _check_slots(wanted: tuple[str, ...], known: list[str]) -> None:
    """Refuse slots that there are not; part numbers may be any."""
    for slot in wanted:
        if not _fits(slot, (*known,)):
            raise ConfigError(f"there is no slot {slot!r}; {instead_of(slot, known)}")


_SAID = ("home", "msbot", "hardware", "software")
_Versions = dict[tuple[str, str], dict[str, str]]
"""By robot and slot: what the part there says of itself."""


def _versions(database: str) -> _Versions:
    """What the parts say that are there, from the masters that use the database."""
    told: _Versions = {}
    for master in masters_of(database):
        try:
            slots = master.ask({"do": "versions", "args": {}, "who": user_name()}).get("slots")
        except ConfigError:  # it has just ended, or does not answer: `until_stored` has said so
            continue
        if isinstance(slots, dict):  # an older master does not know the question
            told |= {(master.details.get("robot", ""), slot): said for slot, said in slots.items()}
    return told


def _versions_of(row: PartRecord, told: _Versions) -> dict[str, str]:
    here = told.get((row.robot, row.slot or ""), {}) if PartState(row.state).is_registered else {}
    return {name: here.get(name, "") for name in _SAID}


def _version_words(said: dict[str, str]) -> str:
    """The version of the part's own program; where it says none, that of MsBOT."""
    return said["software"] or (f"MsBOT {said['msbot']}" if said["msbot"] else "-")


def _print_parts(rows: list[PartRecord], told: _Versions, *, several: bool) -> None:
    now = datetime.now()
    count = Counter((row.robot, row.name) for row in rows)
    said = [_versions_of(row, told) for row in rows]
    knows = any(any(one.values()) for one in said)
    titles = (*["robot"] * several, "part", "number", "slot", "state", "since", *["home", "version"] * knows, "reason")
    print_table(
        titles,
        [
            (
                *[row.robot] * several,
                *(
                    _told_apart(row) if count[row.robot, row.name] > 1 else row.name,
                    row.part_number,
                    row.slot or "-",
                    row.state,
                ),
                _when(datetime.fromtimestamp(row.changed_ns / 1e9), now),
                *[one["home"] or "-", _version_words(one)] * knows,
                row.reason,
            )
            for row, one in zip(rows, said, strict=True)
        ],
    )


def _told_apart(row: PartRecord) -> str:
    """A part whose name others have, too: with its UID, which `parts forget` takes, or else where it was."""
    return f"{row.name} ({row.uid.hex() or row.address})"


def _when(at: datetime, now: datetime) -> str:
    """When something was, as briefly as can be: so the reason has room on a narrow terminal."""
    return at.strftime("%H:%M:%S" if at.date() == now.date() else "%Y-%m-%d %H:%M")


def _parts_as_json(row: PartRecord) -> dict[str, str | int | None]:
    return {
        "robot": row.robot,
        "name": row.name,
        "part_number": row.part_number,
        "uid": row.uid.hex(),
        "slot": row.slot,
        "state": row.state,
        "reason": row.reason,
        "address": row.address,
        "changed_at_ms": row.changed_ns // 1_000_000,
    }


# `msbot robots`: the robots of a database.


@click.command("robots")
@db_option
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def robots_command(db: str | None, *, as_json: bool) -> None:
    """List the robots of a database, the latest blueprint first."""
    path = existing_database(db)
    until_stored(path)
    with open_robot_database(path) as look:
        rows = [_row(look, robot) for robot in look.robots()]
    if as_json:
        click.echo(json.dumps(rows))
        return
    if not rows:
        click.echo("There is no robot in it yet: `msbot apply robot.toml` or `msbot master robot.toml` puts one there.")
        return
    print_table(
        ("robot", "serial number", "master", "slots", "blueprint applied"),
        [
            (
                str(row["name"]),
                str(row["serial_number"]),
                "runs" if row["running"] else "-",
                f"{row['filled']} of {row['slots']} filled" if row["running"] else str(row["slots"]),
                datetime.fromtimestamp(int(row["applied_at_ms"]) / 1000).strftime("%Y-%m-%d %H:%M"),
            )
            for row in rows
        ],
    )


def _row(look: RobotDatabase, robot: RobotRecord) -> dict[str, str | int | bool]:
    active = {part.slot for part in look.parts(robot) if PartState(part.state).is_registered}
    return {
        "name": robot.name,
        "serial_number": robot.serial_number,
        "version": robot.version,
        "manufacturer": robot.manufacturer,
        "running": look.is_run(robot),
        "slots": len(look.slot_names(robot)),
        "filled": len(active),
        "applied_at_ms": robot.applied_ns // 1_000_000,
    }


# `msbot why`: the reason for a part's state, with the evidence.


@click.command("why")
@click.argument("part", shell_complete=completers.parts)
@click.option("--last", type=WholeRange(min=1), default=3, show_default=True, help="How many changes to explain.")
@robot_options
@json_option
def why_command(part: str, last: int, db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Explain why PART (a name, slot, part number or UID) is in the robot, or is not.

    Prints its latest changes of state, newest last, each with the rules that were tried and their outcome, and its
    present state if the robot runs.
    """
    master = running_master(db, robot)
    lines: list[str] = []
    troubles: list[str] = []
    runs: list[str] = []
    if master is not None:
        found = perform(db, robot, "why", {"part": part})
        lines, troubles = _texts(found["lines"]), _texts(found["troubles"])
        runs = _texts(found.get("runs", []))  # an older master does not say it
        if db is None and not is_there(database_here()):
            db = master.details.get("database")
    try:
        entries, several, empty = _read(part, last, db, robot, must_be_there=not lines)
    except RegistryError as error:
        if not lines:
            raise
        click.echo(f"msbot: {error}; this is what the master knows:", err=True)
        if as_json:
            click.echo(json.dumps({"history": [], "now": lines, "troubles": troubles}))
            return
        for line in lines:
            click.echo(for_terminal(line))
        return
    if empty:
        lines = [empty]
    if as_json:
        history = [_why_as_json(entry) for entry in entries]
        click.echo(json.dumps({"history": history, "now": lines, "troubles": troubles}))
        return
    for entry in entries:
        when = datetime.fromtimestamp(entry.at_ns / 1e9).strftime("%Y-%m-%d %H:%M:%S")
        first, *evidence = entry.event.sentences()
        click.echo(for_terminal(f"{when}  {entry.robot}: {first}" if several else f"{when}  {first}"))
        for line in evidence:
            click.echo(for_terminal(line))
    if lines:
        click.echo(for_terminal(f"now: {lines[0]}"))
    for line in (*runs, *troubles):
        click.echo(for_terminal(f"now: {line}"))


def _why_as_json(entry: JournalEntry) -> dict[str, object]:
    event = entry.event
    return {
        "at_ms": entry.at_ns // 1_000_000,
        "robot": entry.robot,
        "part": event.part,
        "slot": event.slot,
        "from": None if event.from_state is None else event.from_state.value,
        "to": event.to_state.value,
        "reason": event.reason,
        "evidence": [list(pair) for pair in event.evidence],
    }


def _texts(found: object) -> list[str]:
    assert isinstance(found, list)
    return found


def _read(
    part: str, last: int, db: str | None, robot: str | None, *, must_be_there: bool
) -> tuple[list[JournalEntry], bool, str]:
    """The lines of the journal, whether they may be those of several robots, and what there is to say of an empty
    slot."""
    path = existing_database(db)
    until_stored(path)
    with open_robot_database(path) as look:
        robots = look.robots()
        meant = None if robot is None else one_robot(look.database, robots, robot)
        entries = look.journal(last, part, meant)
        if not entries and must_be_there:
            empty = [slot for one in robots if meant in (None, one) for slot in look.slot_names(one)]
            slot = next((slot for slot in empty if slot.casefold() == part.casefold()), None)
            if slot is None:
                near = nearest(part, [*empty, *(record.name for record in look.parts(meant))])
                hint = did_you_mean(list(dict.fromkeys(near))) if near else _seen(look, meant)
                raise ConfigError(f"no part {part!r} is in the journal; {hint}")
            return (
                [],
                False,
                f"no part has ever been in slot {slot}; `msbot simulate {slot}` lets a simulated one stand in",
            )
    return entries, meant is None and len(robots) > 1, ""


def _seen(look: RobotDatabase, robot: RobotRecord | None) -> str:
    names = sorted({record.name for record in look.parts(robot)})
    return f"seen so far: {', '.join(names)}" if names else "nothing has been plugged in yet"
