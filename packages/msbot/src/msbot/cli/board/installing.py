"""Putting files on a board: only what is not there yet, and only if there is room for all of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import field

from msbot.carried.board_package import FOLDER, OF_GENERIC_BOARDS, package_files
from msbot.cli.board.connection import Board, BoardFile, Facts
from msbot_agent.text.json_reading import read_json
from msbot_xrce.common.amount import amount
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

SETTINGS = "msbot.json"
LINKS = ("can", "serial", "udp", "ws")
"""Kinds of links that a board has."""
MAIN = "main.py"


@dataclass(slots=True)
class Plan:
    """What there is to do."""

    write: dict[str, bytes] = field(default_factory=dict)
    remove: list[str] = field(default_factory=list)
    there: dict[str, int] = field(default_factory=dict)
    """Sizes of the files that are there and will be replaced or removed."""

    @property
    def octets(self) -> int:
        """How much is written."""
        return sum(map(len, self.write.values()))


def plan_package(board: Board, facts: Facts, *, source: bool, generic: bool) -> Plan:
    """What the package needs: files that are missing or different, without those that are not part of it any more.

    Args:
        board: where to.
        facts: what it is.
        source: not compiled.
        generic: whether to put there what only generic boards need; what is there is kept up to date in any case.
    """
    folder = f"{facts.lib}/{FOLDER}"
    wanted = package_files(None if source else facts.mpy_version)
    there = board.files(folder)
    plan = Plan()
    for name, octets in wanted.items():
        if not generic and name not in there and name.partition(".")[0] in OF_GENERIC_BOARDS:
            continue
        _add(plan, folder, name, octets, there)
    for name in there:
        if name not in wanted:
            plan.remove.append(f"{folder}/{name}")
            plan.there[f"{folder}/{name}"] = there[name].size
    return plan


def plan_files(board: Board, facts: Facts, files: dict[str, bytes]) -> Plan:
    """What files in the folder of programs need."""
    plan = Plan()
    there = board.files(facts.home or "/")
    for name, octets in files.items():
        _add(plan, facts.home, name, octets, there)
    return plan


def _add(plan: Plan, folder: str, name: str, octets: bytes, there: dict[str, BoardFile]) -> None:
    path, known = f"{folder}/{name}", there.get(name)
    if known is not None:
        if known.sha256 == hashlib.sha256(octets).digest():
            return
        plan.there[path] = known.size
    plan.write[path] = octets


def carry_out(board: Board, facts: Facts, plan: Plan, progress: Callable[[int], object]) -> None:
    """Remove and write.

    Raises:
        ConfigError: there is no room for all of it; nothing was changed.
    """
    _check_room(board, facts, plan)
    for path in plan.remove:
        board.remove(path)
    for folder in sorted({path.rpartition("/")[0] for path in plan.write} - {"", facts.home}):
        board.make_folder(folder)
    for path, octets in plan.write.items():
        board.write(path, octets, progress)


def _check_room(board: Board, facts: Facts, plan: Plan) -> None:
    room = board.free(facts.home)
    if room is None:
        return
    free, block = room
    need = sum(_blocks(len(octets), block) for octets in plan.write.values())
    need -= sum(_blocks(size, block) for size in plan.there.values())
    if need * block > free:
        files = amount(len(plan.write), "file")
        raise ConfigError(
            f"the board at {board.port} has no space for this: {plan.octets} octets in {files} need "
            f"{-(-need * block // 1024)} kB more than what they replace, and {free // 1024} kB are free: remove files "
            "from it (msbot board shell; import os; os.listdir())"
        )


def _blocks(size: int, block: int) -> int:
    return -(-size // block)


def settings_file(
    board: Board, facts: Facts, *, link: str | None, wifi: tuple[str, str] | None, token: str | None
) -> bytes | None:
    """The board's `msbot.json` with what is given, everything else in it kept; None if it is as it should be.

    Raises:
        ConfigError: the link is none that a board has.
    """
    if link is None and wifi is None:
        return None
    known: dict[str, object] = {}
    path = f"{facts.home}/{SETTINGS}"
    if SETTINGS in board.files(facts.home or "/"):
        try:
            found = read_json(board.read(path))
            json.dumps(found, allow_nan=False)
        except (ValueError, RecursionError):  # what no board could read
            found = None
        known = found if isinstance(found, dict) else {}
    if link is not None:
        known["link"] = link
    if wifi is not None:
        known["wifi"] = list(wifi)
    if token is not None:
        known["token"] = token
    return (json.dumps(known) + "\n").encode()


def check_link(link: str) -> None:
    """Raise ConfigError if an address is none of a board."""
    kind, colon, rest = link.partition(":")
    if kind not in LINKS or not colon or not rest:
        raise ConfigError(
            f"link {link!r}: a board has can:1?bitrate=500000, serial:1?baudrate=115200&tx=4&rx=5, "
            "udp:192.168.1.20:8888 or ws://192.168.1.20:8080 (docs/howto/micropython.md)"
        )
