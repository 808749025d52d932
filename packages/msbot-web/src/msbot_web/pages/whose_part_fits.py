"""Whose part fits: which part types have a message, and which could fill another's slot, with what is lost then."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from msbot.config import Direction, PartType, substitute
from msbot_agent.startup.extensions import extensions
from msbot_xrce.lazy import dataclass

MESSAGES = ("Speed", "Angle", "Level", "Distance", "Switch", "Battery", "Place", "Temperature", "Light", "Colour")
"""Those for which parts are looked for most: what moves, measures, switches, feeds, and knows where it is."""
MOST_NAMED = 6
"""Part numbers in one cell."""
MOST_SUBSTITUTES = 12


class Fit(Protocol):
    """What a world of `msbot bridge` says: a standard message, and kinds of its devices."""

    @property
    def message(self) -> str:
        """The name of the message."""

    @property
    def reports(self) -> Sequence[str]:
        """Kinds that send it."""

    @property
    def driven(self) -> Sequence[str]:
        """Kinds that it drives."""


@dataclass(frozen=True, slots=True)
class MessageLine:
    """A message, and who has it."""

    message: str
    reports: tuple[str, ...]
    """Part numbers that send it."""
    driven: tuple[str, ...]
    """Part numbers that it drives."""
    worlds: tuple[str, ...]
    """Worlds whose devices have it, each with kinds of devices."""


@dataclass(frozen=True, slots=True)
class Substitute:
    """A part type that could fill the slot of another one."""

    number: str
    name: str
    ports: tuple[str, ...]
    """Ports that are lost."""
    settings: tuple[str, ...]
    """Settings that are lost, or whose value it does not take."""


def message_lines(
    types: Iterable[PartType], worlds: Mapping[str, Sequence[Fit]], say: Callable[[str], str] = str
) -> list[MessageLine]:
    """Who has each of the messages; `say` translates kinds of devices."""
    parts = list(types)
    lines = []
    for message in MESSAGES:
        reports, driven = (
            tuple(
                part.number
                for part in parts
                if any(port.direction is direction and port.type_name == message for port in part.ports)
            )
            for direction in (Direction.PUBLISH, Direction.SUBSCRIBE)
        )
        found = []
        for name, fits in sorted(worlds.items()):
            kinds = [kind for fit in fits if fit.message == message for kind in (*fit.reports, *fit.driven)]
            if kinds:
                found.append(f"{name}: {'; '.join(map(say, dict.fromkeys(kinds)))}")
        lines.append(MessageLine(message, reports, driven, tuple(found)))
    return lines


def substitutes(of: PartType, types: Iterable[PartType]) -> list[Substitute]:
    """Part types that have at least one port of `of`, those that lose least first."""
    found = []
    for other in types:
        if other.number == of.number:
            continue
        lost = substitute(of, other, (), {})
        if len(lost.ports) < len(of.ports):
            found.append(Substitute(other.number, other.name, lost.ports, (*lost.settings, *lost.values)))
    return sorted(found, key=lambda one: (len(one.ports), len(one.settings), one.number))[:MOST_SUBSTITUTES]


def named(numbers: Sequence[str]) -> str:
    """The first of them, and that there are more."""
    if not numbers:
        return "–"
    return ", ".join(numbers[:MOST_NAMED]) + (" …" if len(numbers) > MOST_NAMED else "")


def worlds_that_fit() -> dict[str, Sequence[Fit]]:
    """What the worlds that are installed say; MsBOT's page knows none of them by name."""
    found = {}
    for name, kind in extensions().all("bridges", object).items():
        says = getattr(kind, "fits", None)
        if callable(says):
            found[name] = says()
    return found
