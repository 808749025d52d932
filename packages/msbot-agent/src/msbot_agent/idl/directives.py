"""Conditions of an IDL file, `#ifdef` to `#endif`: which lines count.

A condition names what is defined, with `--define NAME` or in the file; the value of a macro is never worked out. What
cannot be obeyed is refused, since a file that is half read gives messages of another form.
"""

from __future__ import annotations

import re

from msbot_agent.idl.model import SourceLocation
from msbot_xrce.lazy import dataclass

_REMARK = re.compile(r"//.*|/\*.*?\*/", re.DOTALL)
_CONDITION = re.compile(r"(?P<number>[01])|(?P<not>!?)\s*defined\s*(?:\(\s*(?P<in>\w+)\s*\)|(?P<bare>\w+))")
_NAME = re.compile(r"[A-Za-z_]\w*")
IGNORED = ("pragma", "line", "ident", "warning")
"""Directives that do not change data."""


@dataclass(slots=True)
class _Branch:
    """One `#if` that is open."""

    place: SourceLocation
    outside: bool
    """Whether the lines around it count."""
    counts: bool
    """Whether the lines of the present branch count."""
    had_one: bool
    """Whether a branch of it has counted."""
    has_else: bool = False


class Conditions:
    """What is defined, and which lines of one file count; `defined` is shared by all files that are read together.

    Args:
        defined: names of macros, with what they stand for.
    """

    def __init__(self, defined: dict[str, str]) -> None:
        self.defined = defined
        self._open: list[_Branch] = []

    @property
    def is_active(self) -> bool:
        """Whether the line that comes next counts."""
        return not self._open or self._open[-1].counts

    def obey(self, directive: str, place: SourceLocation) -> bool:
        """Obey a directive; returns whether it is an `#include` that counts, which is left to the caller.

        Raises:
            ConfigError: it cannot be obeyed.
        """
        words = _REMARK.sub(" ", directive[1:].replace("\\\n", " ")).split(None, 1) or [""]
        verb, rest = words[0], words[1].strip() if len(words) > 1 else ""
        if verb in ("if", "ifdef", "ifndef"):
            counts = self.is_active and self._holds(verb, rest, place)
            self._open.append(_Branch(place, self.is_active, counts, counts))
        elif verb in ("elif", "else", "endif"):
            self._go_on(verb, rest, place)
        elif not self.is_active or verb in (*IGNORED, ""):
            return False
        elif verb == "define":
            self._define(rest, place)
        elif verb == "undef":
            self.defined.pop(rest, None)
        elif verb == "error":
            raise place.error(f"the file refuses this: {rest or '#error'}")
        elif verb != "include":
            raise place.error(f"#{verb} is not read")
        return verb == "include"

    def check_end(self) -> None:
        """At the end of the file.

        Raises:
            ConfigError: an `#endif` is missing.
        """
        if self._open:
            raise self._open[-1].place.error("#endif is missing: this condition is never closed")

    def check_name(self, name: str, place: SourceLocation) -> None:
        """A name of the file.

        Raises:
            ConfigError: it is a macro that stands for something, which is not put in its place.
        """
        if self.defined.get(name):
            raise place.error(f"{name} is a macro, whose value is not read: write const long {name} = ...; instead")

    def _go_on(self, verb: str, rest: str, place: SourceLocation) -> None:
        if not self._open:
            raise place.error(f"#{verb} without #if")
        branch = self._open[-1]
        if verb == "endif":
            self._open.pop()
            return
        if branch.has_else:
            raise place.error(f"#{verb} after #else")
        branch.has_else = verb == "else"
        may = branch.outside and not branch.had_one
        branch.counts = may and (verb == "else" or self._holds("if", rest, place))
        branch.had_one = branch.had_one or branch.counts

    def _holds(self, verb: str, rest: str, place: SourceLocation) -> bool:
        if verb != "if":
            if not _NAME.fullmatch(rest):
                raise place.error(f"#{verb} needs one name, not {rest or 'nothing'}")
            return (rest in self.defined) == (verb == "ifdef")
        found = _CONDITION.fullmatch(rest)
        if found is None:
            raise place.error(f"#if {rest} is not read: a condition is 0, 1, defined(NAME) or !defined(NAME)")
        if found["number"]:
            return found["number"] == "1"
        return ((found["in"] or found["bare"]) in self.defined) != bool(found["not"])

    def _define(self, rest: str, place: SourceLocation) -> None:
        found = _NAME.match(rest)
        if found is None:
            raise place.error(f"#define needs a name, not {rest or 'nothing'}")
        self.defined[found[0]] = rest[found.end() :].strip()
