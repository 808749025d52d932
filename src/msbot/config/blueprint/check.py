"""What must agree in a blueprint: slots with the library, bindings with slots and ports, periods with each other.

Values already found wrong (these are empty) are skipped, so that one mistake is reported only once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from msbot.config.blueprint.model import Binding, Slot, SlotPort, Timing
from msbot.config.library.board_document import board_documents
from msbot.config.library.board_wiring import wired_parts
from msbot.config.library.library import Direction, Library, PartType, Port, scalar_text
from msbot.config.toml.problems import MOST_LISTED, quoted, suggestion
from msbot.config.toml.table import Table
from msbot.errors import ConfigError

RESERVED_TOPICS = (
    "msbot_masterTopic",
    "msbot_inventory_Request",
    "msbot_inventory_Reply",
    "service_name_Request",
    "service_name_Reply",
)
"""Plug-and-play's own topics: the profile, the inventory's service, and the original programs' service."""

_LATE_AFTER_BEATS = 1.5
"""A part is late after this many beat periods; it must be late before it can be delisted."""


class Complaints(Protocol):
    """Collects the problems of one binding: its table in a file, or a list."""

    def problem(self, sentence: str, *steps: str | int) -> None:
        """Note one mistake about a key."""


class _Sentences:
    """Problems of bindings that do not come from a file."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def problem(self, sentence: str, *_steps: str | int) -> None:
        self.found.append(sentence)


def binding_faults(bindings: Sequence[Binding], slots: Sequence[Slot], library: Library) -> list[str]:
    """What is wrong with bindings that do not come from a file, in the same words as for a file."""
    sentences = _Sentences()
    check_bindings([sentences] * len(bindings), bindings, slots, library)
    return sentences.found


def check_timing(table: Table, timing: Timing) -> None:
    """Check that a part that beats in time cannot be delisted."""
    shortest = (timing.life - 1) * timing.tick_period_s
    if shortest < _LATE_AFTER_BEATS * timing.beat_period_s:
        table.problem(
            f"a part that beats every {timing.beat_period_s:g} s could be delisted {shortest:g} s after a beat "
            f"(life {timing.life}, tick {timing.tick_period_s:g} s); use a tick_period_s of at least "
            f"{_LATE_AFTER_BEATS * timing.beat_period_s / (timing.life - 1):g}, a higher life, or a shorter "
            "beat_period_s"
        )


def check_free_topics(table: Table, topics: Sequence[str]) -> None:
    """Check that plug-and-play's own topics are not declared free for all."""
    for position, topic in enumerate(topics):
        if topic in RESERVED_TOPICS:
            table.problem(f'"{topic}" belongs to plug-and-play itself; remove it', "free_topics", position)


def check_slots(root: Table, tables: Sequence[Table], slots: Sequence[Slot], library: Library) -> None:
    """Check that each slot has a unique name, a part type of the library, and settings that the type knows."""
    if not slots and "slot" not in root:
        root.problem('a robot needs at least one slot; add [[slot]] with name = "AA" and part = "ABCD"', "slot")
    first_of: dict[str, Table] = {}
    for table, slot in zip(tables, slots, strict=True):
        first = first_of.setdefault(slot.name, table)
        if slot.name and first is not table:
            table.problem(
                f'there is a slot "{slot.name}" already on line {first.place("name").line}; '
                "give each slot a name of its own",
                "name",
            )
        part_type = library.get(slot.part_number)
        if part_type is not None:
            _check_settings(table, slot, part_type, library)
        elif slot.part_number:
            table.problem(
                f'the library has no part number "{slot.part_number}"; {library.suggest(slot.part_number)}', "part"
            )


def _check_settings(table: Table, slot: Slot, part_type: PartType, library: Library) -> None:
    for name, value in slot.settings.items():
        parameter = part_type.parameter(name)
        if parameter is None:
            known = [parameter.name for parameter in part_type.parameters]
            right = suggestion(name, known, none_known="it has none: remove the line")
            table.problem(f'part {part_type.number} has no parameter "{name}"; {right}', "settings", name)
        elif fault := parameter.fault(value):
            example = f"{name} = {scalar_text(parameter.default)}"
            table.problem(f"{fault}; the library's default is {example}", "settings", name)
    _check_wired(table, slot, part_type, library)


def _check_wired(table: Table, slot: Slot, part_type: PartType, library: Library) -> None:
    """Check what is wired to a board: part numbers, wires, and that no two want the same pin."""
    wired = {name: value for name in part_type.carries if isinstance(value := slot.settings.get(name), str)}
    try:
        board_documents(wired_parts(wired, library))
    except ConfigError as error:
        name, _, fault = str(error).partition(": ")
        if name in wired:
            table.problem(fault, "settings", name)
        else:
            table.problem(str(error), "settings")


def check_bindings(
    tables: Sequence[Complaints], bindings: Sequence[Binding], slots: Sequence[Slot], library: Library
) -> None:
    """Check that each binding connects existing ports of the right direction and message type."""
    ports = _Ports(slots, library)
    topics: dict[str, Binding] = {}
    for table, binding in zip(tables, bindings, strict=True):
        _check_topic(table, binding, topics)
        ports.check(table, binding, binding.source, Direction.PUBLISH, "from")
        seen: set[SlotPort] = set()
        for position, target in enumerate(binding.targets):
            if target in seen:
                table.problem(f'"{target}" is there twice; keep one', "to", position)
            else:
                ports.check(table, binding, target, Direction.SUBSCRIBE, "to", position)
            seen.add(target)


def _check_topic(table: Complaints, binding: Binding, topics: dict[str, Binding]) -> None:
    if binding.topic in RESERVED_TOPICS:
        table.problem(f'"{binding.topic}" belongs to plug-and-play itself; choose another name', "topic")
    earlier = topics.setdefault(binding.topic, binding)
    if earlier is binding or not binding.topic:
        return
    if earlier.source == binding.source:
        table.problem(
            f'"{binding.source}" is bound to "{binding.topic}" already; put all receivers into one list `to`', "topic"
        )
    if earlier.type_name != binding.type_name and binding.type_name:
        table.problem(
            f'topic "{binding.topic}" carries "{earlier.type_name}" in another binding and "{binding.type_name}" '
            "here; a topic has one type",
            "type",
        )
    if earlier.in_dds != binding.in_dds:
        table.problem(
            f'topic "{binding.topic}" is in DDS in another way in another binding; say the same in both', "topic"
        )
    if earlier.reliable != binding.reliable:
        table.problem(
            f'topic "{binding.topic}" has reliable = {scalar_text(earlier.reliable)} in another binding; '
            "say the same in both",
            "reliable",
        )


class _Ports:
    """The ports of a robot, by slot."""

    def __init__(self, slots: Sequence[Slot], library: Library) -> None:
        self._slots = {slot.name: slot for slot in slots if slot.name}
        self._library = library
        self._topics: dict[SlotPort, str] = {}

    def check(
        self, table: Complaints, binding: Binding, endpoint: SlotPort, direction: Direction, *steps: str | int
    ) -> None:
        """Note what is wrong with one end of a binding."""
        if not endpoint.slot:
            return
        slot = self._slots.get(endpoint.slot)
        if not endpoint.port:
            example = f"{endpoint.slot if slot else 'AA'}.{self._example(slot, direction)}"
            table.problem(f'"{endpoint}" names no port; write slot, dot, port, for example "{example}"', *steps)
        elif slot is None:
            right = suggestion(endpoint.slot, list(self._slots), none_known="add the slot first")
            table.problem(f'"{endpoint}": there is no slot "{endpoint.slot}"; {right}', *steps)
        elif (part_type := self._library.get(slot.part_number)) and _check_port(
            table, binding, endpoint, part_type, direction, *steps
        ):
            self._check_one_topic(table, binding, endpoint, direction, *steps)

    def _check_one_topic(
        self, table: Complaints, binding: Binding, endpoint: SlotPort, direction: Direction, *steps: str | int
    ) -> None:
        earlier = self._topics.setdefault(endpoint, binding.topic)
        if earlier != binding.topic and earlier and binding.topic:
            remedy = "let all senders publish that topic"
            if direction is Direction.PUBLISH:
                remedy = "list all receivers in one binding"
            table.problem(f'"{endpoint}" is bound to "{earlier}" already and carries one topic; {remedy}', *steps)

    def _example(self, slot: Slot | None, direction: Direction) -> str:
        part_type = self._library.get(slot.part_number) if slot else None
        ports = [port.name for port in part_type.ports if port.direction is direction] if part_type else []
        return ports[0] if ports else {Direction.PUBLISH: "out", Direction.SUBSCRIBE: "in"}[direction]


def _check_port(
    table: Complaints,
    binding: Binding,
    endpoint: SlotPort,
    part_type: PartType,
    direction: Direction,
    *steps: str | int,
) -> bool:
    """Whether the port exists and has that direction and the binding's type; otherwise a problem is noted."""
    port = part_type.port(endpoint.port)
    what = f"part {part_type.number} ({part_type.name})"
    if port is None:
        known = [port.name for port in part_type.ports if port.direction is direction]
        right = suggestion(endpoint.port, known, none_known=f"it has none that can {direction.value}")
        table.problem(f'"{endpoint}": {what} has no port "{endpoint.port}"; {right}', *steps)
    elif port.direction is not direction:
        table.problem(f'"{endpoint}": this port can only {port.direction.value}; {_fitting(part_type, port)}', *steps)
    elif binding.type_name and port.type_name != binding.type_name:
        table.problem(
            f'"{endpoint}" carries messages of type "{port.type_name}", the binding says "{binding.type_name}"; '
            f'write type = "{port.type_name}" or bind another port',
            *steps,
        )
    else:
        return True
    return False


def _fitting(part_type: PartType, wrong: Port) -> str:
    fitting = [port.name for port in part_type.ports if port.direction is not wrong.direction]
    if not fitting:
        return f"part {part_type.number} has no port of the other direction: choose another slot"
    return f"use {quoted(fitting[:MOST_LISTED], ' or ')}"
