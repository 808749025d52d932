"""What the table of operations says of each: its arguments, who may do it, what is kept of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from enum import Enum
from typing import NamedTuple

from msbot.operations.rights import Right
from msbot.registry import EditRecord
from msbot_xrce.lazy import dataclass


class ArgumentKind(Enum):
    """The kind of an argument; the value is how a sentence names it."""

    TEXT = "a text"
    TEXTS = "a list of texts"
    NUMBER = "a number"
    WHOLE = "a whole number"
    FLAG = "true or false"
    VALUE = "a text, a number, true or false"
    """The value of a parameter, passed on as a person would type it."""


class OperationScope(Enum):
    """Which robots an operation can act on."""

    ANYWHERE = "a running robot, or the database of one that does not run"
    RUNNING = "a running robot"


class EditLog(Enum):
    """What the database keeps of an operation."""

    UNDOABLE = "a change that can be undone"
    CHANGE = "a change"
    LINE = "a line that says who did it"
    NOTHING = "nothing"


class Argument(NamedTuple):
    """One argument of an operation."""

    name: str
    """The name that requests, the API and the reference use."""
    kind: ArgumentKind = ArgumentKind.TEXT
    is_needed: bool = False
    default: object = None
    """Its value when it is left out."""
    parameter: str = ""
    """The name of the method's parameter, if the argument's own name is a Python keyword."""
    least: float | None = None
    most: float | None = None
    """Bounds of a number, both included."""
    longest: int = 254
    """Most characters of a text."""
    option: str = ""
    """The command's option, such as `--to`; empty: a positional argument of the command."""
    shown_as: str = ""
    """What the command's help calls it; empty: derived from the name."""
    help: str = ""
    """What the argument is, in a sentence."""

    @property
    def passed_as(self) -> str:
        """The keyword under which the method takes it."""
        return self.parameter or self.name


class Operation(NamedTuple):
    """One thing that can be done to a robot, or asked about it."""

    name: str
    summary: str
    """What the operation does, as `msbot --help` says it."""
    arguments: tuple[Argument, ...] = ()
    right: Right = Right.SEE
    """Who may do it on the page and in the API; a command acts for the user of the computer, who may do everything."""
    where: OperationScope = OperationScope.RUNNING
    kept: EditLog = EditLog.NOTHING
    journal: str = ""
    """The word for it in the journal of changes."""
    call: str = ""
    """The API call, such as `POST /slots/{slot}/swap`; empty: none, or one that is written by hand in the web room."""
    help: str = ""
    """What the command's help says in addition to the summary."""
    right_for_others: Right | None = None
    """The right needed to act on changes by others; without it only on one's own settings. None: no difference."""

    takes_place: bool = False
    """Whether the method is told from where it is asked for (`Principal.place`)."""
    drops_odd: bool = False
    """Whether an argument that is too long, of the wrong kind or unknown is cut or dropped, and refuses nothing."""

    @property
    def is_question(self) -> bool:
        """Whether it only asks: everybody who may see the robot may ask, and nobody notes who did."""
        return self.right is Right.SEE

    def argument(self, name: str) -> Argument | None:
        """The argument of that name."""
        return next((argument for argument in self.arguments if argument.name == name), None)


# The outcome of an operation, for the person who asked for it.


@dataclass(frozen=True, slots=True)
class Outcome:
    """Something was done, or a question was answered."""

    words: str = ""
    """What was done, in one sentence; empty for a question."""
    edit_id: int | None = None
    """The number for `undo`; None: nothing stored has changed."""
    answer: Mapping[str, object] = field(default_factory=dict)
    """The answer to a question, as JSON."""

    def as_json(self) -> dict[str, object]:
        """The answer to another process."""
        words = {"words": self.words} if self.words else {}
        edit = {} if self.edit_id is None else {"edit": self.edit_id}
        return {**words, **edit, **self.answer}


def outcome_of(edit: EditRecord | None, words: str = "") -> Outcome:
    """What to say about a stored change: `words` if there are any, else those that were stored."""
    return Outcome(words or ("" if edit is None else edit.words), None if edit is None else edit.id)
