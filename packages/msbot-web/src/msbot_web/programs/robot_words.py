"""What blocks are made from: the parts that a program can be in this robot, their ports, settings and messages.

The page hands it to the browser as JSON, anew whenever it has changed, so that drop-downs list what this robot has.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, TypeAlias, TypedDict

from msbot.config import Direction, FieldKind, Library, ParameterKind, Port
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot_agent.text.untrusted_input import read_json
from msbot_web.models.robot_models import SlotCard, WirePort

HELD = ("active", "late")
"""States of slots that a part holds."""
MOST_NUMBERS = 60
"""Most parts that a program can choose from; a robot has some ten."""


class FieldWords(TypedDict):
    """A field of a message."""

    name: str
    kind: str
    unit: str


class TypeWords(TypedDict):
    """A message type."""

    standard: bool
    """Whether `msbot` brings its class; else the program makes it."""
    fields: list[FieldWords]


class PortWords(TypedDict):
    """A port of a part."""

    name: str
    sends: bool
    type: str
    what: str
    """What it is for, in the person's language."""
    wired: bool
    silent: list[str]
    """The slots that should send to it and hold no part, as long as there is no other."""


class SettingWords(TypedDict):
    """A setting of a part."""

    name: str
    kind: str
    default: str | float | bool
    unit: str


class PartWords(TypedDict):
    """A part that a program can be."""

    number: str
    name: str
    slot: str
    """The first slot that wants it, the free ones before the others."""
    free: bool
    ports: list[PortWords]
    settings: list[SettingWords]


class RobotWords(TypedDict):
    """A robot as blocks know it."""

    parts: list[PartWords]
    types: dict[str, TypeWords]


def robot_words(
    cards: Sequence[SlotCard], wires: Iterable[WirePort], library: Library, say: Callable[[str], str]
) -> RobotWords:
    """The parts that the robot has slots for, the free slots first, and all messages that blocks can hold.

    Args:
        cards: the robot's slots as they are now.
        wires: the ports of all slots, with their topics.
        library: its part library.
        say: puts a text of the library into the person's language.
    """
    wiring, types = _Wiring(cards, wires), _types(library)
    found: dict[str, PartWords] = {}
    # A part that is simulated here comes last: a program can only be it once it is pulled out.
    for card in sorted(cards, key=lambda card: card.state in HELD and card.simulated):
        part_type = library.get(card.part_number)
        if part_type is None or card.part_number in found or len(found) >= MOST_NUMBERS:
            continue
        ports = [wiring.words(card.name, port, say) for port in part_type.ports if port.type_name in types]
        found[card.part_number] = PartWords(
            number=part_type.number,
            name=say(part_type.name),
            slot=card.name,
            free=card.state not in HELD,
            ports=sorted(ports, key=lambda port: not port["wired"]),
            settings=[
                SettingWords(name=one.name, kind=one.kind.value, default=one.default, unit=one.unit)
                for one in part_type.parameters
                if one.kind is not ParameterKind.PART
            ],
        )
    return RobotWords(parts=list(found.values()), types=types)


def _types(library: Library) -> dict[str, TypeWords]:
    """The messages whose names Python can write, and that have neither lists nor others inside."""
    return {
        name: TypeWords(
            standard=name in STANDARD_MESSAGES,
            fields=[
                FieldWords(name=field, kind=kind.word, unit=message.units.get(field, ""))
                for field, kind in message.fields.items()
            ],
        )
        for name, message in sorted(library.messages.items())
        if all(word.isidentifier() and word.isascii() for word in (name, *message.fields))
        and all(isinstance(kind, FieldKind) for kind in message.fields.values())
    }


class _Wiring:
    """Which ports are wired, and to whom."""

    def __init__(self, cards: Sequence[SlotCard], wires: Iterable[WirePort]) -> None:
        self._held = {card.name for card in cards if card.state in HELD}
        self._topics: dict[tuple[str, str], str] = {}
        self._senders: dict[str, list[str]] = {}
        for wire in wires:
            self._topics[wire.slot, wire.port] = wire.topic
            if wire.publishes and wire.topic:
                self._senders.setdefault(wire.topic, []).append(wire.slot)

    def words(self, slot: str, port: Port, say: Callable[[str], str]) -> PortWords:
        """A port of a slot."""
        sends = port.direction is Direction.PUBLISH
        topic = self._topics.get((slot, port.name), "")
        others = [] if sends else self._senders.get(topic, [])
        return PortWords(
            name=port.name,
            sends=sends,
            type=port.type_name,
            what=say(port.description),
            wired=bool(topic),
            silent=[] if any(other in self._held for other in others) else others,
        )


# How a program that has blocks is shown: as these, or as text. It is kept with the blocks. Pure.


View: TypeAlias = Literal["blocks", "python"]
BLOCKS: View = "blocks"
PYTHON: View = "python"


def view_of(doc: str) -> View:
    """How a program was shown when it was kept."""
    return BLOCKS if _read(doc).get("view") == BLOCKS else PYTHON


def with_view(doc: str, view: View) -> str:
    """The same blocks, of a program that is shown so; what is no blocks stays as it is."""
    found = _read(doc)
    return json.dumps(found | {"view": view}, ensure_ascii=False, separators=(",", ":")) if found else doc


def _read(doc: str) -> dict[str, object]:
    try:
        found = read_json(doc) if doc else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
