"""Extensions: what other packages bring, by entry points in the groups `msbot.commands`, `msbot.links` and so on.

Each entry point is loaded when it is needed first, and only once. One that cannot be imported, or names something of a
wrong kind, is left out with a sentence in the log; nothing that an extension does at its import ends the program.
"""

from __future__ import annotations

import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from msbot.errors import MsbotError
from msbot.runtime.lazy_dataclass import dataclass
from msbot.runtime.printable import printable

if TYPE_CHECKING:
    from importlib.metadata import Distribution

T = TypeVar("T")

_log = logging.getLogger(__name__)

PREFIX = "msbot."
GROUPS = (
    "commands", "pages", "routes", "links", "spaces", "part_types", "messages", "lessons", "missions", "faults",
    "checks",
)  # fmt: skip
"""What an extension can bring; `PREFIX` before it is the group of its entry points."""
_NAME = re.compile(r"[a-z][a-z0-9_-]{0,49}")
"""A name stands in addresses and on command lines."""


@dataclass(frozen=True, slots=True)
class Extension:
    """One thing that a package brings."""

    group: str
    """One of `GROUPS`; anything else is nothing that MsBOT knows."""
    name: str
    """What people type or see."""
    package: str
    """The distribution that brings it, with its version: `msbot-hello 1.0`."""
    summary: str
    """What the distribution says of itself."""
    load: Callable[[], Any]
    """Imports it; may raise anything."""


class Extensions:
    """What extensions bring, and what was left out.

    Args:
        find: looks which there are.
    """

    def __init__(self, find: Callable[[], Iterable[Extension]]) -> None:
        self._find = find
        self._found: dict[str, dict[str, Extension]] | None = None
        self._loaded: dict[tuple[str, str], object] = {}
        self._left_out: dict[tuple[str, str, str], str] = {}

    def names(self, group: str, taken: Iterable[str] = ()) -> dict[str, Extension]:
        """What there is in a group, by name; nothing is imported.

        Args:
            group: one of `GROUPS`.
            taken: names that MsBOT itself uses there; extensions of such a name are left out.
        """
        found = self._look().get(group, {})
        for name in set(found).intersection(taken):
            self.leave_out(found[name], f"MsBOT itself has {name!r} there; give it another name")
        return {name: one for name, one in found.items() if self._key(one) not in self._left_out}

    def get(self, group: str, name: str, kind: type[T]) -> T | None:
        """Load one of them.

        Args:
            group: one of `GROUPS`.
            name: which.
            kind: what it has to be.

        Returns:
            None: there is none of this name, or it is left out.
        """
        one = self.names(group).get(name)
        if one is None:
            return None
        if (group, name) not in self._loaded:
            try:
                self._loaded[group, name] = one.load()
            except (Exception, SystemExit) as error:
                self.leave_out(one, _why(error))
                return None
        found = self._loaded[group, name]
        if not isinstance(found, kind):
            self.leave_out(one, f"it is a {type(found).__name__}, not a {kind.__name__}")
            return None
        return found

    def all(self, group: str, kind: type[T], taken: Iterable[str] = ()) -> dict[str, T]:
        """Load all of a group, by name; see `names` and `get`."""
        pairs = ((name, self.get(group, name, kind)) for name in self.names(group, taken))
        return {name: found for name, found in pairs if found is not None}

    def folders(self, group: str) -> dict[str, Path]:
        """The folders of all packages of a group that bring files, by name."""
        return {
            name: Path(where)
            for name, found in self.all(group, type(sys)).items()
            for where in list(getattr(found, "__path__", ()))[:1]
        }

    def leave_out(self, one: Extension, why: str) -> None:
        """Go on without it; said once in the log."""
        if self._key(one) not in self._left_out:
            self._left_out[self._key(one)] = why
            _log.warning("the extension %s %r of %s is left out: %s", one.group, one.name, one.package, why)

    def leave_out_named(self, group: str, name: str, why: str) -> None:
        """The same by its name."""
        one = self.names(group).get(name)
        if one is not None:
            self.leave_out(one, why)

    def listed(self) -> Iterator[tuple[Extension, str]]:
        """All of them, with why they are left out; empty: they are not."""
        everything = [one for group in self._look().values() for one in group.values()]
        doubles = [one for one in self._doubles if one not in everything]
        for one in sorted((*everything, *doubles), key=lambda one: (one.package, one.group, one.name)):
            yield one, self._left_out.get(self._key(one), "")

    def _look(self) -> dict[str, dict[str, Extension]]:
        if self._found is None:
            self._found, self._doubles = {}, list[Extension]()
            for one in sorted(self._find(), key=lambda one: (one.package, one.group, one.name)):
                named = self._found.setdefault(one.group, {})
                other = named.setdefault(one.name, one)
                if one.group not in GROUPS:
                    self.leave_out(one, f"MsBOT has no group {PREFIX}{one.group}; there are {', '.join(GROUPS)}")
                elif not _NAME.fullmatch(one.name):
                    self.leave_out(one, "a name has small letters, digits, - and _ only, and begins with a letter")
                elif other is not one:
                    self._doubles.append(one)
                    self.leave_out(one, f"{other.package} has {one.name!r} already")
        return self._found

    @staticmethod
    def _key(one: Extension) -> tuple[str, str, str]:
        return one.group, one.name, one.package


@cache
def extensions() -> Extensions:
    """Those that are installed for this Python."""
    return Extensions(installed)


def installed() -> Iterator[Extension]:
    """Everything that installed packages bring; `importlib.metadata` is imported only where there is something."""
    if not any(_mentions(Path(place)) for place in sys.path):
        return
    from importlib.metadata import distributions

    seen = set[str]()
    for distribution in distributions():
        try:
            found = list(_brought_by(distribution))
        except Exception as error:  # files of others may be broken in any way
            _log.warning("a package that may have extensions cannot be read: %s", _why(error))
            continue
        name = distribution.metadata["Name"]
        if name not in seen:  # hidden by the one before it in sys.path
            seen.add(name)
            yield from found


def _brought_by(distribution: Distribution) -> Iterator[Extension]:
    package = printable(f"{distribution.metadata['Name']} {distribution.version}")
    summary = printable(distribution.metadata["Summary"] or "")
    for point in distribution.entry_points:
        if point.group.startswith(PREFIX):
            yield Extension(point.group.removeprefix(PREFIX), point.name, package, summary, point.load)


def _mentions(place: Path) -> bool:
    """Whether a package in a folder of `sys.path` has entry points for MsBOT, seen in a millisecond."""
    wanted = f"[{PREFIX}".encode()
    try:
        with os.scandir(place or ".") as entries:
            infos = [entry.path for entry in entries if entry.name.endswith((".dist-info", ".egg-info"))]
    except OSError:
        return False
    for info in infos:
        try:
            with open(os.path.join(info, "entry_points.txt"), "rb") as file:
                if wanted in file.read():
                    return True
        except OSError:
            continue
    return False


def _why(error: BaseException) -> str:
    if isinstance(error, MsbotError):
        return str(error)
    words = printable(str(error)).strip()
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"there is no module {error.name!r}"
    return f"{type(error).__name__}{': ' if words else ''}{words}"
