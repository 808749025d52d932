"""Versions of parts: a part may show `SG90@2.1`, and a library entry may say which versions it describes."""

from __future__ import annotations

import re

from msbot_xrce.lazy import dataclass

VERSION_SIGN = "@"
"""Separates part number and version in what a part shows."""

_VERSION = re.compile(r"\d{1,6}(\.\d{1,6}){0,3}")
_RULE = re.compile(r"(>=|<=|==|!=|<|>)\s*(\S+)")
_ORDERS = {
    ">=": lambda order: order >= 0,
    "<=": lambda order: order <= 0,
    "==": lambda order: order == 0,
    "!=": lambda order: order != 0,
    "<": lambda order: order < 0,
    ">": lambda order: order > 0,
}


@dataclass(frozen=True, slots=True)
class VersionRange:
    """A range of versions such as `>=1.0, <2`; every rule must hold. No rule: every version."""

    rules: tuple[tuple[str, tuple[int, ...]], ...] = ()
    """Pairs of a sign and a version."""

    def __contains__(self, version: object) -> bool:
        """Whether a version, as text, is in the range; a text that is no version is only in the range of all
        versions."""
        if not self.rules:
            return True
        numbers = parse_version(version) if isinstance(version, str) else None
        return numbers is not None and all(_ORDERS[sign](_compare(numbers, than)) for sign, than in self.rules)

    def __str__(self) -> str:
        """As it is written in a file."""
        return ", ".join(f"{sign}{'.'.join(map(str, version))}" for sign, version in self.rules)


ANY_VERSION = VersionRange()


def parse_version(text: str) -> tuple[int, ...] | None:
    """`1.2` as numbers, or None when it is not a version."""
    return tuple(map(int, text.split("."))) if _VERSION.fullmatch(text) else None


def parse_versions(text: str) -> VersionRange | None:
    """A range from its text, or None when it is not a range."""
    rules = []
    for rule in filter(None, (piece.strip() for piece in text.split(","))):
        found = _RULE.fullmatch(rule)
        version = parse_version(found[2]) if found else None
        if found is None or version is None:
            return None
        rules.append((found[1], version))
    return VersionRange(tuple(rules))


def split_number(shown: str) -> tuple[str, str]:
    """Part number and version of what a part shows: `("SG90", "2.1")` of `SG90@2.1`; no version: ""."""
    number, _, version = shown.partition(VERSION_SIGN)
    return number, version


def _compare(one: tuple[int, ...], other: tuple[int, ...]) -> int:
    """Negative, zero or positive, like a comparison; missing places count as 0, so 1 equals 1.0."""
    length = max(len(one), len(other))
    left, right = (numbers + (0,) * (length - len(numbers)) for numbers in (one, other))
    return (left > right) - (left < right)
