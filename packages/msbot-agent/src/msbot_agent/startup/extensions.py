"""Extensions: what other packages bring, by entry points in the groups `msbot.commands`, `msbot.links` and so on.

Each entry point is loaded when it is needed first, and only once. One that cannot be imported, or names something of a
wrong kind, is left out with a sentence in the log; nothing that an extension does at its import ends the program.
"""

from __future__ import annotations

import importlib
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

from msbot_agent.process.user_folders import PACKAGES
from msbot_agent.text.sentence import printable
from msbot_xrce.errors import MsbotError
from msbot_xrce.lazy import dataclass

T = TypeVar("T")

_log = logging.getLogger(__name__)

PREFIX = "msbot."
GROUPS = (
    "commands", "services", "agent_services", "pages", "routes", "links", "spaces", "part_types", "messages", "lessons",
    "missions", "worlds", "faults", "checks", "bridges",
)  # fmt: skip
"""What an extension can bring; `PREFIX` before it is the group of its entry points."""
OWN_GROUPS = ("loaders", "mission_pages", "bridge_runners", "samples", "frame_words")
"""What one distribution of MsBOT brings to a lower one. Not for others: it may change with any version."""
OWN_PACKAGES = tuple(name.replace("_", "-") for name in PACKAGES)
"""The distributions of MsBOT: what they bring is a part of it, not an extension."""
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
    target: str = ""
    """Where it is: `msbot_hello.command:hello`."""

    @property
    def is_own(self) -> bool:
        """Whether a distribution of MsBOT brings it."""
        return self.package.partition(" ")[0] in OWN_PACKAGES


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
        self._problems: dict[tuple[str, str, str], list[str]] = {}

    def names(self, group: str, taken: Iterable[str] = ()) -> dict[str, Extension]:
        """What there is in a group, by name; nothing is imported.

        Args:
            group: one of `GROUPS`.
            taken: names that MsBOT itself uses there; extensions of such a name are left out.
        """
        found = self._look().get(group, {})
        for name in set(found).intersection(taken):
            if not found[name].is_own:
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

    def add_problem(self, group: str, name: str, words: str) -> None:
        """Something in it does not work, but the rest is used: for `msbot extensions`."""
        one = self.names(group).get(name)
        if one is not None:
            self._problems.setdefault(self._key(one), []).append(words)

    def problems(self, one: Extension) -> list[str]:
        """What `add_problem` was told of it."""
        return self._problems.get(self._key(one), [])

    def listed(self) -> Iterator[tuple[Extension, str]]:
        """All extensions, with why they are left out; empty: they are not.

        What MsBOT's own distributions bring is among them only where it is left out.
        """
        everything = [one for group in self._look().values() for one in group.values()]
        doubles = [one for one in self._doubles if one not in everything]
        for one in sorted((*everything, *doubles), key=lambda one: (one.package, one.group, one.name)):
            why = self._left_out.get(self._key(one), "")
            if why or not one.is_own:
                yield one, why

    def _look(self) -> dict[str, dict[str, Extension]]:
        if self._found is None:
            self._found, self._doubles = {}, list[Extension]()
            for one in sorted(self._find(), key=lambda one: (not one.is_own, one.package, one.group, one.name)):
                named = self._found.setdefault(one.group, {})
                other = named.setdefault(one.name, one)
                if other is not one:
                    self._doubles.append(one)
                if one.group not in GROUPS and not (one.is_own and one.group in OWN_GROUPS):
                    self.leave_out(one, f"MsBOT has no group {PREFIX}{one.group}; there are {', '.join(GROUPS)}")
                elif not _NAME.fullmatch(one.name):
                    self.leave_out(one, "a name has small letters, digits, - and _ only, and begins with a letter")
                elif other is not one:
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
    """Everything that installed packages bring.

    Their files are read here: `importlib.metadata` would take longer to import than all of `msbot --help`.
    """
    seen = set[str]()
    for place in sys.path:
        for info in _with_extensions(Path(place)):
            try:
                name, found = _brought_by(info)
            except Exception as error:  # files of others may be broken in any way
                _log.warning("%s: a package that may have extensions cannot be read: %s", info.name, _why(error))
                continue
            if name not in seen:  # hidden by the one before it in sys.path
                seen.add(name)
                yield from found


def _with_extensions(place: Path) -> Iterator[Path]:
    """The descriptions of the packages in a folder of `sys.path` that have entry points for MsBOT."""
    wanted = f"[{PREFIX}".encode()
    try:
        with os.scandir(place or ".") as entries:
            infos = [entry.path for entry in entries if entry.name.endswith((".dist-info", ".egg-info"))]
    except OSError:
        return
    for info in sorted(infos):
        try:
            with open(os.path.join(info, "entry_points.txt"), "rb") as file:
                if wanted in file.read():
                    yield Path(info)
        except OSError:
            continue


def _brought_by(info: Path) -> tuple[str, list[Extension]]:
    """The name of a package, and what it brings."""
    head = dict[str, str]()
    text = (info / ("METADATA" if info.suffix == ".dist-info" else "PKG-INFO")).read_text("utf-8")
    for line in text.partition("\n\n")[0].splitlines():
        key, _, value = line.partition(":")
        head.setdefault(key, value.strip())
    name = head["Name"]
    package, summary = printable(f"{name} {head['Version']}"), printable(head.get("Summary", ""))
    found, section = [], ""
    for line in (info / "entry_points.txt").read_text("utf-8").splitlines():
        point, equals, target = (word.strip() for word in line.partition("="))
        if line.startswith("["):
            section = line.strip("[] \t")
        elif equals and section.startswith(PREFIX) and not line.startswith(("#", ";")):
            group = section.removeprefix(PREFIX)
            found.append(Extension(group, point, package, summary, partial(_load, target), target))
    return name, found


def _load(target: str) -> object:
    """The object of an entry point, `package.module:attribute` or a module."""
    module, _, attributes = target.partition("[")[0].strip().partition(":")
    found: object = importlib.import_module(module.strip())
    for attribute in filter(None, attributes.strip().split(".")):
        found = getattr(found, attribute)
    return found


def _why(error: BaseException) -> str:
    if isinstance(error, MsbotError):
        return str(error)
    words = printable(str(error)).strip()
    if isinstance(error, ModuleNotFoundError) and error.name:
        return f"there is no module {error.name!r}"
    return f"{type(error).__name__}{': ' if words else ''}{words}"


# The version of MsBOT that this is.


@cache
def own_version() -> str:
    """As `msbot --version` says it; `unknown` when MsBOT runs without having been installed."""
    from importlib.metadata import PackageNotFoundError, version  # slow to load, and seldom needed

    try:
        return version("msbot-agent")
    except PackageNotFoundError:
        return "unknown"
