"""Everything wrong with the files that people write, collected and reported at once.

A reader does not stop at the first mistake: it adds a problem, goes on with a harmless value, and raises at the end.
Each problem says where it is (file, line, path of the key), what is wrong, and what would be right.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import date, datetime, time

from msbot_agent.text.sentence import joined, printable, said
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_TOLD = 50
"""Most mistakes that are reported; reading ends there."""
LONGEST_SENTENCE = 600
LONGEST_STEP = 60
"""Most characters shown of a sentence, and of one key in a path."""
MOST_LISTED = 12
"""How many known words are listed when none is similar."""

KeyPath = tuple[str | int, ...]
"""The way to a value: table names, keys, and positions in lists (counted from 0, as Python does)."""


@dataclass(frozen=True, slots=True)
class FileLocation:
    """A place in a file."""

    file: str
    line: int | None = None
    """Counted from 1; None when the mistake has no line (a missing file)."""
    path: KeyPath = ()

    def __str__(self) -> str:
        """For example `robot.toml, line 12, slot[1].part`."""
        parts = [self.file]
        if self.line is not None:
            parts.append(said("line {number}", number=self.line))
        if self.path:
            parts.append(path_words(self.path))
        return joined(", ", parts)


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake: where it is, and a sentence with the remedy."""

    place: FileLocation
    sentence: str

    def __str__(self) -> str:
        """`place: sentence`."""
        return said("{place}: {sentence}", place=str(self.place), sentence=self.sentence)


class InvalidFileError(ConfigError):
    """Everything that is wrong with files, up to `MOST_TOLD`.

    Attributes:
        problems: one for each mistake, in the order of the files' lines.
    """

    def __init__(self, message: str, problems: Sequence[Problem]) -> None:
        super().__init__(message)
        self.problems = tuple(problems)

    def __reduce__(self) -> tuple[type[InvalidFileError], tuple[str, tuple[Problem, ...]]]:
        """Makes the error picklable, so that it can come from another process."""
        return InvalidFileError, (str(self), self.problems)


class Problems:
    """A list of mistakes that becomes one `ConfigError`."""

    def __init__(self) -> None:
        self.found: list[Problem] = []

    def add(self, place: FileLocation, sentence: str, excerpt: str = "") -> None:
        """Note one mistake.

        Args:
            place: where it is.
            sentence: what is wrong, and what would be right.
            excerpt: the line itself, shown below.

        Raises:
            ConfigError: there are too many mistakes: the rest is not read.
        """
        shown = printable(sentence)
        shown = shown if len(shown) <= LONGEST_SENTENCE else f"{shown[:LONGEST_SENTENCE]} ..."
        if excerpt:
            shown = said("{sentence}\n    {excerpt}", sentence=shown, excerpt=printable(excerpt))
        self.found.append(Problem(place, shown))
        if len(self.found) >= MOST_TOLD:
            self.raise_if_any()

    def raise_if_any(self) -> None:
        """Raise everything found so far, in the order of the files' lines.

        Raises:
            ConfigError: something was found; its text names every problem.
        """
        if not self.found:
            return
        ordered = sorted(self.found, key=lambda problem: (problem.place.file, problem.place.line or 0))
        if len(ordered) == 1:
            raise InvalidFileError(str(ordered[0]), ordered)
        more = "" if len(ordered) < MOST_TOLD else said(", and perhaps more behind them")
        lines = joined("\n  ", [str(problem) for problem in ordered])
        raise InvalidFileError(
            said("{count} problems were found{more}:\n  {lines}", count=len(ordered), more=more, lines=lines), ordered
        )


def problems_json(found: InvalidFileError) -> list[dict[str, str | int | None]]:
    """The mistakes for programs."""
    return [
        {"file": one.place.file, "line": one.place.line, "key": path_words(one.place.path), "words": one.sentence}
        for one in found.problems
    ]


def path_words(path: KeyPath) -> str:
    """A path as it is written for people, for example `slot[1].settings.period_s`."""
    words = ""
    for step in path:
        if isinstance(step, int):
            words += f"[{step}]"
        else:
            shown = printable(step if len(step) <= LONGEST_STEP else f"{step[:LONGEST_STEP]}...")
            words += f".{shown}" if words else shown
    return words


def quoted(words: Iterable[str], joint: str = ", ") -> str:
    """The words in quotes, joined."""
    return joint.join(f'"{word}"' for word in words)


def suggestion(word: str, known: Sequence[str], *, none_known: str) -> str:
    """What would be right instead of `word`: the nearest known words, else a list of them.

    Args:
        word: what was written.
        known: what could have been written.
        none_known: the remedy when nothing at all is known.
    """
    if not known:
        return none_known
    if near := nearest(word, known):
        return did_you_mean([f'"{word}"' for word in near])
    listed = quoted(known[:MOST_LISTED]) + (", ..." if len(known) > MOST_LISTED else "")
    return said("known: {listed}", listed=listed)


def toml_value_in_words(value: object) -> str:
    """What a TOML value is, in words, for example `the number 5`."""
    match value:
        case bool():
            return said("the truth value {lower}", lower=str(value).lower())
        case int() | float():
            return said("the number {value}", value=value)
        case str():
            return said('the text "{value}"', value=value[:40])
        case list():
            return said("a list")
        case datetime() | date() | time():
            return said("the date or time {value} without quotes", value=value)
        case _:
            return said("a table")
