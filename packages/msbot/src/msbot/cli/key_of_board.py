"""Which parts are wired to a generic board, as the database knows it: for `msbot key board`."""

from __future__ import annotations

from msbot.config import ParameterKind
from msbot.registry import PartRecord, Registry
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError


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
