"""`msbot key`: the keys with which parts prove who they are."""

from __future__ import annotations

import io
import json
import os
import secrets
from datetime import datetime
from pathlib import Path

import click

from msbot.cli import completers
from msbot.cli.database_place import existing_database
from msbot.cli.robot_options import db_option
from msbot.config import ParameterKind, part_number_and_name
from msbot.part.join.part_keys import KEY_OCTETS, key_text
from msbot.part.join.pnp_messages import UID_OCTETS
from msbot.part.join.uid import kept_file, parse_uid, stored_uid, uid_on_board, write_for_user_alone
from msbot.registry import KeyRecord, PartRecord, Registry, open_registry
from msbot_agent.cli.table import print_table
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

# Which parts are wired to a generic board, as the database knows it: for `msbot key board`.


@dataclass(frozen=True, slots=True)
class BoardSlot:
    """A slot for a generic board."""

    robot: str
    name: str
    texts: tuple[str, ...]
    """What is wired to it (`part_1` to `part_8`), those that are not empty."""


def slot_of_board(registry: Registry, board: PartRecord | None, slot: str) -> BoardSlot:
    """The slot of a board, with what is wired to it.

    Args:
        registry: the database.
        board: what the robot knows of it; None: it has never been seen.
        slot: its name, if a person has given it; empty: that of the board.

    Raises:
        ConfigError: there is none, or it is not known which.
    """
    slots = _board_slots(registry)
    if not slots:
        raise ConfigError('no robot of this database has a slot for a board: say what is wired to it ("LED lamp")')
    found = [one for one in slots if board is None or not board.slot or one.robot == board.robot]
    wanted = slot or (_own_slot(board, found) if board is not None else "")
    if wanted:
        found = [one for one in found if one.name.casefold() == wanted.casefold()]
    if len(found) == 1:
        return found[0]
    names = ", ".join(f'"{one.name}" of {one.robot}' for one in slots)
    if slot and not found:
        raise ConfigError(f'there is no slot "{slot}" for a board; there are {names}')
    raise ConfigError(f"which slot is this board's? Say it with --slot NAME; there are {names}")


def _board_slots(registry: Registry) -> list[BoardSlot]:
    found = []
    for robot in registry.robots.all():
        for name in registry.robots.slot_names(robot):
            values = [one for one in registry.robots.values(robot, name) if one.kind == ParameterKind.PART.value]
            if values:
                texts = tuple(text for one in values if (text := str(one.value).strip()))
                found.append(BoardSlot(robot.name, name, texts))
    return found


def _own_slot(board: PartRecord, slots: list[BoardSlot]) -> str:
    """The slot that it is in or asks for by its name; a board that is refused is in none."""
    names = {one.name.casefold() for one in slots}
    return next((name for name in (board.slot, board.local_name) if name and name.casefold() in names), "")


QR_VERSION = "MSBOT1"
"""Prefix of the text in the QR code."""
WHO = "msbot key"


@click.group("key")
def command() -> None:
    """Keys of parts: for robots whose blueprint says authentication = "key"."""


@command.command("new")
@click.argument("part", shell_complete=completers.parts)
@click.option("--uid", help="UID of the key, 16 hexadecimal digits; default: that of PART if known, else a new one.")
@click.option("--name", default="", help="Local name of the part; default: its part number.")
@click.option("--here", is_flag=True, help="The part runs on this computer: keep UID and key where it finds them.")
@click.option("--no-qr", is_flag=True, help="Print no QR code.")
@db_option
def new(part: str, uid: str | None, name: str, db: str | None, *, here: bool, no_qr: bool) -> None:
    """Make a key for PART (a part number, or a part that the robot has seen) and print it with the UID.

    It voids an earlier key of the part. The key is shown only once.
    """
    with open_registry(existing_database(db)) as registry:
        known = None if uid is not None else _known(registry, part)
        number = part if known is None else known.part_number
        if not number.strip() or not number.isprintable():
            raise ConfigError(f"{number!r} is no part number: write it as on the part, for example SG90")
        local_name = name or (known.local_name if known is not None else "") or number
        octets = _uid(uid, known, number, local_name, here=here)
        key = secrets.token_bytes(KEY_OCTETS)
        edit = registry.keys.store(octets, key, WHO)
    click.echo(f"{edit.words}; it is not shown again.\n")
    click.echo(f"  part number   {number}")
    click.echo(f"  UID           {octets.hex()}")
    click.echo(f"  key           {key_text(key)}\n")
    if here:
        _keep(kept_file("uid", number, local_name), octets.hex())
        _keep(kept_file("key", number, local_name), key_text(key))
        click.echo(f"Kept on this computer for part {number} with the local name {local_name}: nothing else to do.")
    else:
        click.echo(f"A part on a computer:  --uid {octets.hex()} --key FILE, with the key in FILE; or $MSBOT_KEY.")
    if not no_qr:
        click.echo("The same to be scanned:\n")
        click.echo(qr_code(":".join((QR_VERSION, number, octets.hex(), key.hex()))))


@command.command("board")
@click.argument("board")
@click.argument("wired", nargs=-1)
@click.option("--slot", default="", help="Slot of the board, if the robot has not seen the board in it.")
@db_option
def board(board: str, wired: tuple[str, ...], slot: str, db: str | None) -> None:
    """Give the parts that are wired to a generic BOARD the board's key.

    BOARD is its UID, or its name or slot if the robot has seen it. By default all parts that its slot names now
    (part_1 to part_8); otherwise those in WIRED: texts as in part_1, "HC-SR04 eye"; the wires may follow.
    """
    if wired and slot:
        raise ConfigError("give either what is wired to the board, or --slot")
    with open_registry(existing_database(db)) as registry:
        known = _known(registry, board)
        uid = parse_uid(board) if known is None else known.uid
        key = registry.keys.find(uid)
        if key is None:
            raise ConfigError(f"board {board} has no key yet: `msbot key new BOARD-8 --uid {uid.hex()}` makes one")
        if not wired:
            found = slot_of_board(registry, known, slot)
            wired = found.texts
            if not wired:
                raise ConfigError(
                    f'nothing is wired to slot "{found.name}" yet: `msbot set "{found.name}" part_1 "LED lamp: s=2"`'
                )
        shown = [part_number_and_name(text) for text in wired]
        if not all(number for number, _ in shown):
            raise ConfigError('a text is empty: write part number and name, for example "HC-SR04 eye"')
        for number, name in shown:
            mine = uid_on_board(uid, number, name)
            registry.keys.store(mine, key, WHO)
            click.echo(f"{mine.hex()}  {name}, part {number}: has the board's key")


@command.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of words.")
@db_option
def list_keys(db: str | None, *, as_json: bool) -> None:
    """List the parts that have a key, without the keys."""
    with open_registry(existing_database(db), read_only=True) as registry:
        rows = registry.keys.all()
        parts = {part.uid: part for part in registry.robots.parts()}
        several = len(registry.robots.all()) > 1
    if as_json:
        click.echo(json.dumps([_as_json(row, parts.get(row.uid)) for row in rows]))
        return
    if not rows:
        click.echo("No part has a key; `msbot key new PART` makes one.")
        return
    seen = {uid: f"{part.name} of {part.robot}" if several else part.name for uid, part in parts.items()}
    print_table(
        ("UID", "made", "part"),
        [
            (
                row.uid.hex(),
                datetime.fromtimestamp(row.created_ns / 1e9).strftime("%Y-%m-%d %H:%M:%S"),
                seen.get(row.uid, "(not seen yet)"),
            )
            for row in rows
        ],
    )


@command.command("remove")
@click.argument("part", shell_complete=completers.parts)
@db_option
def remove(part: str, db: str | None) -> None:
    """Void the key of PART; a part that is in stays until its next claim.

    `msbot block` removes the part at once.
    """
    with open_registry(existing_database(db)) as registry:
        known = _known(registry, part)
        edit = registry.keys.remove(parse_uid(part) if known is None else known.uid, WHO)
    click.echo(f"{edit.words}: it is not let in any more.")


def qr_code(text: str) -> str:
    """A QR code for the terminal, light on dark.

    Raises:
        ConfigError: the library that draws it is not installed.
    """
    try:
        import segno
    except ImportError:
        raise ConfigError(
            "QR codes need the library segno: `pip install 'msbot[master]'`, or use --no-qr (the key above holds)"
        ) from None
    drawn = io.StringIO()
    segno.make(text, micro=False, error="m").terminal(out=drawn, border=2, compact=True)
    return drawn.getvalue()


def _as_json(row: KeyRecord, part: PartRecord | None) -> dict[str, str | int | None]:
    return {
        "uid": row.uid.hex(),
        "part": None if part is None else part.name,
        "robot": None if part is None else part.robot,
        "created_at_ms": row.created_ns // 1_000_000,
    }


def _known(registry: Registry, word: str) -> PartRecord | None:
    """The part that a person means, if the robot has seen it.

    Raises:
        ConfigError: several are meant.
    """
    wanted = word.casefold()
    found = [
        part
        for part in registry.robots.parts()
        if part.uid
        and wanted in (name.casefold() for name in (part.name, part.local_name, part.slot or "", part.uid.hex()))
    ]
    if len(found) > 1:
        listed = ", ".join(f"{part.name} ({part.uid.hex()})" for part in found)
        raise ConfigError(f"{word!r} may be {listed}: give the UID")
    return found[0] if found else None


def _uid(uid: str | None, known: PartRecord | None, number: str, local_name: str, *, here: bool) -> bytes:
    if uid is not None:
        return parse_uid(uid)
    if known is not None:
        return known.uid
    return stored_uid(number, local_name) if here else secrets.token_bytes(UID_OCTETS)


def _keep(path: Path, text: str) -> None:
    """Write a file that only this user can read."""
    try:
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        write_for_user_alone(draft, text)
        draft.replace(path)
    except OSError as error:
        raise ConfigError(f"cannot keep it in {path} ({error}); the key above holds all the same") from None
