"""What the registry returns about robots, parts and the journal."""

from __future__ import annotations

import os.path
from enum import Enum
from typing import TYPE_CHECKING

from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.config import ParameterKind, Scalar
    from msbot.pnp import PartEvent


NO_UID = bytes(8)


@dataclass(frozen=True, slots=True)
class RobotRecord:
    """A robot that the database knows."""

    id: int
    name: str
    serial_number: str
    version: str
    released: str
    manufacturer: str
    applied_ns: int
    """When its blueprint was last applied, nanoseconds since 1970."""


@dataclass(frozen=True, slots=True)
class PartRecord:
    """A part that the database knows, as it was after its last change of state."""

    robot: str
    """Name of the robot where it was seen."""
    uid: bytes
    """8 octets; empty when it has none."""
    part_number: str
    local_name: str
    slot: str | None
    """The slot that it is in, or was last in."""
    state: str
    """Value of `PartState`."""
    reason: str
    address: str
    first_seen_ns: int
    changed_ns: int

    @property
    def name(self) -> str:
        """What people call it: local name, else slot, else part number."""
        return self.local_name or self.slot or self.part_number


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """One line of the journal."""

    number: int
    """Counted over the whole database."""
    robot: str
    at_ns: int
    """Nanoseconds since 1970."""
    event: PartEvent
    """What happened; its `at` is in seconds since 1970, and its session is not stored."""


class EditKind(Enum):
    """What a person changed; the value is the word in the row."""

    VALUE = "value"
    PLACE = "place"
    BLOCK = "block"
    BIND = "bind"
    APPLY = "apply"
    UNDO = "undo"
    USER = "user"
    KEY = "key"
    STOP = "stop"
    GO = "go"
    WINDOW = "window"
    HAND = "hand"
    LIBRARY = "library"
    RESTORE = "restore"
    FAULT = "fault"
    MISSION = "mission"
    LESSON = "lesson"
    CLASS = "class"


NOTED = frozenset(
    kind.value
    for kind in (
        EditKind.STOP,
        EditKind.GO,
        EditKind.WINDOW,
        EditKind.HAND,
        EditKind.RESTORE,
        EditKind.FAULT,
        EditKind.MISSION,
        EditKind.LESSON,
        EditKind.CLASS,
    )
)
"""The kinds of lines that change nothing in the database: who only said or did something."""

UNDOABLE = frozenset(
    kind.value for kind in (EditKind.VALUE, EditKind.PLACE, EditKind.BLOCK, EditKind.BIND, EditKind.APPLY)
)
"""The kinds that an undo without a number takes back; it skips the others."""


@dataclass(frozen=True, slots=True)
class EditRecord:
    """One thing a person changed."""

    id: int
    """Counted over the whole database; the number that `undo` takes."""
    at_ns: int
    """Nanoseconds since 1970."""
    who: str
    kind: str
    """The value of an `EditKind`."""
    slot: str
    """The slot that the edit is about; empty if it is about none or several."""
    words: str
    """What the edit did, in words for people."""
    undone: bool
    """Whether it was undone."""
    slots: tuple[str, ...] = ()
    """Slots whose configuration the edit changed."""
    placed: tuple[tuple[bytes, str | None], ...] = ()
    """UIDs that belong elsewhere since the edit, and the slots they belong in; None: in none."""
    placed_before: tuple[tuple[bytes, str | None], ...] = ()
    """The same UIDs, and the slots that they belonged in before."""
    can_be_undone: bool = False
    """Whether an undo without a number may take it back."""
    is_kept: bool = True
    """Whether what was before it is kept, so that an undo by its number can restore it."""
    """Whether `undo` without a number can take it back."""


@dataclass(frozen=True, slots=True)
class ValueRecord:
    """A parameter of a slot: what it is, its value, and where the value comes from."""

    name: str
    kind: str
    """`bool`, `int`, `float` or `text`."""
    unit: str
    least: float | None
    most: float | None
    default: Scalar
    """The library's value."""
    value: Scalar
    """The value in force."""
    origin: str
    """`library`, `blueprint` or `hand`: where the value comes from."""
    description: str
    changed_ns: int
    """When the parameter got this value, nanoseconds since 1970."""
    who: str
    """Who set it by hand; empty for any other origin."""

    def read(self, text: str) -> Scalar:
        """The value that a person means by this text.

        Raises:
            ConfigError: it is not a value of this parameter; the text says what would be right.
        """
        from msbot.config import Parameter, ParameterKind  # listing parts needs no library

        parameter = Parameter(self.name, ParameterKind(self.kind), self.default, self.unit, self.least, self.most)
        value = _scalar(parameter.kind, text)
        fault = parameter.fault(value)
        if fault is not None:
            raise ConfigError(said("{name}: {fault}", name=self.name, fault=fault))
        return value


def _scalar(kind: ParameterKind, text: str) -> Scalar:
    """The text as a value of this kind, or the text itself when it is not one."""
    from msbot.config import ParameterKind

    text = text if kind is ParameterKind.TEXT else text.strip()
    match kind:
        case ParameterKind.BOOL:
            return _TRUTH.get(text.casefold(), text)
        case ParameterKind.INT | ParameterKind.FLOAT:
            try:
                return int(text)
            except ValueError:
                pass
            try:
                return float(text) if kind is ParameterKind.FLOAT else text
            except ValueError:
                return text
        case ParameterKind.TEXT | ParameterKind.PART:
            return text


_TRUTH = {"true": True, "on": True, "yes": True, "1": True, "false": False, "off": False, "no": False, "0": False}


@dataclass(frozen=True, slots=True)
class UserRecord:
    """Somebody who may log in."""

    name: str
    role: str
    """`viewer`, `student`, `teacher` or `administrator`."""
    password_hash: str
    """Salted hash; empty: no password is accepted."""
    tokens: tuple[tuple[str, str], ...]
    """Pairs of (purpose, hash)."""
    created_ns: int
    changed_ns: int


@dataclass(frozen=True, slots=True)
class KeyRecord:
    """A part that has a key; only `PartKeys.find` returns the key itself."""

    uid: bytes
    created_ns: int
    created_by: str


@dataclass(frozen=True, slots=True)
class ProgramRecord:
    """A program that somebody wrote on the page."""

    owner: str
    name: str
    """File name."""
    share: str
    """Word by which others may read it; empty: nobody may."""
    changed_ns: int


@dataclass(frozen=True, slots=True)
class ProgramSource:
    """What a person wrote: a program, and the blocks that it was made of."""

    text: str
    blocks: str = ""
    """As JSON (`msbot_web.programs.programs`); empty: it was never made of blocks."""


@dataclass(frozen=True, slots=True)
class ProgramVersion:
    """One kept version of a program."""

    number: int
    saved_ns: int
    size: int
    """Characters."""


def uid_text(uid: bytes) -> str:
    """A UID as the tables hold it: 16 hexadecimal digits; empty for a part without one."""
    return "" if not uid or uid == NO_UID else uid.hex()


# One spelling for each database, so that programs can tell whether they mean the same one.


def database_identity(db: str) -> str:
    """A unique spelling for each database: the full path of a file; a server's address without user and password."""
    scheme, separator, rest = db.partition("://")
    if not separator:
        return os.path.abspath(db)
    if scheme == "sqlite":
        return os.path.abspath(rest.removeprefix("/"))
    return f"{scheme.partition('+')[0]}://{rest.rpartition('@')[2]}"
