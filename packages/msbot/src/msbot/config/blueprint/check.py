"""What must agree in a blueprint: slots with the library, bindings with slots and ports, periods with each other.

Values already found wrong (these are empty) are skipped, so that one mistake is reported only once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from msbot.config.blueprint.blueprint_model import Binding, Slot, SlotPort, Timing
from msbot.config.library.board_document import board_documents
from msbot.config.library.board_wiring import wired_parts
from msbot.config.library.part_library import Direction, Library, PartType, scalar_text
from msbot.config.library.safe_values import safe_faults
from msbot.service_types import reply_topic, request_topic, service_type
from msbot_agent.text.sentence import said
from msbot_agent.toml.problems import MOST_LISTED, quoted, suggestion
from msbot_agent.toml.table import Table
from msbot_xrce.errors import ConfigError

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

    def report(self, sentence: str, *steps: str | int) -> None:
        """Note one mistake about a key."""


class _Sentences:
    """Problems of bindings that do not come from a file."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def report(self, sentence: str, *_steps: str | int) -> None:
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
        table.report(
            said(
                "a part that beats every {beat_period_s:g} s could be delisted {shortest:g} s after a beat "
                "(life {life}, tick {tick_period_s:g} s); use a tick_period_s of at least {value:g}, a higher "
                "life, or a shorter beat_period_s",
                beat_period_s=timing.beat_period_s,
                shortest=shortest,
                life=timing.life,
                tick_period_s=timing.tick_period_s,
                value=_LATE_AFTER_BEATS * timing.beat_period_s / (timing.life - 1),
            )
        )


def check_free_topics(table: Table, topics: Sequence[str]) -> None:
    """Check that plug-and-play's own topics are not declared free for all."""
    for position, topic in enumerate(topics):
        if topic in RESERVED_TOPICS:
            table.report(
                said('"{topic}" belongs to plug-and-play itself; remove it', topic=topic), "free_topics", position
            )


def check_slots(root: Table, tables: Sequence[Table], slots: Sequence[Slot], library: Library) -> None:
    """Check that each slot has a unique name, a part type of the library, and settings that the type knows."""
    if not slots and "slot" not in root:
        root.report(said('a robot needs at least one slot; add [[slot]] with name = "AA" and part = "ABCD"'), "slot")
    first_of: dict[str, Table] = {}
    for table, slot in zip(tables, slots, strict=True):
        first = first_of.setdefault(slot.name, table)
        if slot.name and first is not table:
            table.report(
                said(
                    'there is a slot "{name}" already on line {line}; give each slot a name of its own',
                    name=slot.name,
                    line=first.location("name").line,
                ),
                "name",
            )
        part_type = library.get(slot.part_number)
        if part_type is not None:
            _check_settings(table, slot, part_type, library)
            _check_safe(table, slot, part_type)
        elif slot.part_number:
            table.report(
                said(
                    'the library has no part number "{part_number}"; {right}',
                    part_number=slot.part_number,
                    right=library.suggest(slot.part_number),
                ),
                "part",
            )


def _check_settings(table: Table, slot: Slot, part_type: PartType, library: Library) -> None:
    for name, value in slot.settings.items():
        parameter = part_type.parameter(name)
        if parameter is None:
            known = [parameter.name for parameter in part_type.parameters]
            right = suggestion(name, known, none_known=said("it has none: remove the line"))
            table.report(
                said(
                    'part {number} has no parameter "{name}"; {right}', number=part_type.number, name=name, right=right
                ),
                "settings",
                name,
            )
        elif fault := parameter.fault(value):
            example = f"{name} = {scalar_text(parameter.default)}"
            table.report(
                said("{fault}; the library's default is {example}", fault=fault, example=example), "settings", name
            )
    _check_wired(table, slot, part_type, library)


def _check_safe(table: Table, slot: Slot, part_type: PartType) -> None:
    """Check that each safe value is one that a port of the part takes."""
    driven = [port.name for port in part_type.ports if port.direction is Direction.SUBSCRIBE]
    for name, values in slot.safe.items():
        port = part_type.port(name)
        if port is None or name not in driven:
            right = suggestion(name, driven, none_known=said("it has none that is driven: remove the line"))
            words = said('part {number} has no port "{name}" that is driven', number=part_type.number, name=name)
            table.report(said("{words}; {right}", words=words, right=right), "safe", name)
            continue
        for field, fault in safe_faults(port, values):
            table.report(fault, "safe", name, field)


def _check_wired(table: Table, slot: Slot, part_type: PartType, library: Library) -> None:
    """Check what is wired to a board: part numbers, wires, and that no two want the same pin."""
    wired = {name: value for name in part_type.carries if isinstance(value := slot.settings.get(name), str)}
    try:
        board_documents(wired_parts(wired, library))
    except ConfigError as error:
        name, _, fault = str(error).partition(": ")
        if name in wired:
            table.report(fault, "settings", name)
        else:
            table.report(str(error), "settings")


def check_bindings(
    tables: Sequence[Complaints], bindings: Sequence[Binding], slots: Sequence[Slot], library: Library
) -> None:
    """Check that each binding connects existing ports of the right direction and message type."""
    ports = _Ports(slots, library)
    topics: dict[str, Binding] = {}
    for table, binding in zip(tables, bindings, strict=True):
        _check_topic(table, binding, topics)
        is_service = service_type(binding.type_name) is not None
        ports.check(table, binding, binding.source, Direction.SERVE if is_service else Direction.PUBLISH, "from")
        hears = Direction.CALL if is_service else Direction.SUBSCRIBE
        seen: set[SlotPort] = set()
        for position, target in enumerate(binding.targets):
            if target in seen:
                table.report(said('"{target}" is there twice; keep one', target=target), "to", position)
            else:
                ports.check(table, binding, target, hears, "to", position)
            seen.add(target)
    for table, binding in zip(tables, bindings, strict=True):
        if service_type(binding.type_name) is not None:
            _check_service(table, binding, topics)


def _check_service(table: Complaints, binding: Binding, topics: Mapping[str, Binding]) -> None:
    """What holds for the topics of a service alone."""
    earlier = topics[binding.topic]
    if earlier is not binding and earlier.source != binding.source:
        table.report(
            said(
                'service "{topic}" is served by "{source}" already; give the other one a topic of its own',
                topic=binding.topic,
                source=earlier.source,
            ),
            "from",
        )
    for name in (request_topic(binding.topic), reply_topic(binding.topic)):
        if name in topics or name in RESERVED_TOPICS:
            table.report(
                said(
                    'service "{topic}" needs the topic "{name}", which is in use; choose another name',
                    topic=binding.topic,
                    name=name,
                ),
                "topic",
            )
    if not binding.reliable:
        table.report(said("requests and replies are always reliable; remove it"), "reliable")
    if binding.in_dds.export:
        table.report(said("a service cannot be exported; remove it"), "export")


def _check_topic(table: Complaints, binding: Binding, topics: dict[str, Binding]) -> None:
    if binding.topic in RESERVED_TOPICS:
        table.report(
            said('"{topic}" belongs to plug-and-play itself; choose another name', topic=binding.topic), "topic"
        )
    earlier = topics.setdefault(binding.topic, binding)
    if earlier is binding or not binding.topic:
        return
    if earlier.source == binding.source:
        table.report(
            said(
                '"{source}" is bound to "{topic}" already; put all receivers into one list `to`',
                source=binding.source,
                topic=binding.topic,
            ),
            "topic",
        )
    if earlier.type_name != binding.type_name and binding.type_name:
        table.report(
            said(
                'topic "{topic}" carries "{type_name}" in another binding and "{other}" here; a topic has one type',
                topic=binding.topic,
                type_name=earlier.type_name,
                other=binding.type_name,
            ),
            "type",
        )
    if earlier.in_dds != binding.in_dds:
        table.report(
            said(
                'topic "{topic}" is in DDS in another way in another binding; say the same in both', topic=binding.topic
            ),
            "topic",
        )
    if earlier.reliable != binding.reliable:
        table.report(
            said(
                'topic "{topic}" has reliable = {value} in another binding; say the same in both',
                topic=binding.topic,
                value=scalar_text(earlier.reliable),
            ),
            "reliable",
        )


_USUAL_NAMES = {
    Direction.PUBLISH: "out",
    Direction.SUBSCRIBE: "in",
    Direction.SERVE: "serve",
    Direction.CALL: "ask",
}


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
            table.report(
                said(
                    '"{endpoint}" names no port; write slot, dot, port, for example "{example}"',
                    endpoint=endpoint,
                    example=example,
                ),
                *steps,
            )
        elif slot is None:
            right = suggestion(endpoint.slot, list(self._slots), none_known=said("add the slot first"))
            table.report(
                said(
                    '"{endpoint}": there is no slot "{slot}"; {right}',
                    endpoint=endpoint,
                    slot=endpoint.slot,
                    right=right,
                ),
                *steps,
            )
        elif (part_type := self._library.get(slot.part_number)) and _check_port(
            table, binding, endpoint, part_type, direction, *steps
        ):
            self._check_one_topic(table, binding, endpoint, direction, *steps)

    def _check_one_topic(
        self, table: Complaints, binding: Binding, endpoint: SlotPort, direction: Direction, *steps: str | int
    ) -> None:
        earlier = self._topics.setdefault(endpoint, binding.topic)
        if earlier != binding.topic and earlier and binding.topic:
            remedy = said("let all senders publish that topic")
            if direction in (Direction.PUBLISH, Direction.SERVE):
                remedy = said("list all receivers in one binding")
            table.report(
                said(
                    '"{endpoint}" is bound to "{earlier}" already and carries one topic; {remedy}',
                    endpoint=endpoint,
                    earlier=earlier,
                    remedy=remedy,
                ),
                *steps,
            )

    def _example(self, slot: Slot | None, direction: Direction) -> str:
        part_type = self._library.get(slot.part_number) if slot else None
        ports = [port.name for port in part_type.ports if port.direction is direction] if part_type else []
        return ports[0] if ports else _USUAL_NAMES[direction]


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
    what = said("part {number} ({name})", number=part_type.number, name=part_type.name)
    if port is None:
        known = [port.name for port in part_type.ports if port.direction is direction]
        right = suggestion(endpoint.port, known, none_known=said("it has none that can {value}", value=direction.value))
        table.report(
            said(
                '"{endpoint}": {what} has no port "{port}"; {right}',
                endpoint=endpoint,
                what=what,
                port=endpoint.port,
                right=right,
            ),
            *steps,
        )
    elif port.direction is _SERVICE_ENDS.get(direction):
        table.report(
            said(
                '"{endpoint}" is a port of a service: write its type with both messages, "{type_name}"',
                endpoint=endpoint,
                type_name=port.type_name,
            ),
            *steps,
        )
    elif port.direction is not direction:
        table.report(
            said(
                '"{endpoint}": this port can only {value}; {right}',
                endpoint=endpoint,
                value=port.direction.value,
                right=_fitting(part_type, direction),
            ),
            *steps,
        )
    elif binding.type_name and port.type_name != binding.type_name:
        table.report(
            said(
                '"{endpoint}" carries messages of type "{type_name}", the binding says "{other}"; '
                'write type = "{type_name}" or bind another port',
                endpoint=endpoint,
                type_name=port.type_name,
                other=binding.type_name,
            ),
            *steps,
        )
    else:
        return True
    return False


_SERVICE_ENDS = {Direction.PUBLISH: Direction.SERVE, Direction.SUBSCRIBE: Direction.CALL}
"""What a port may be where the type of the binding makes it a topic, and the port says that it is a service."""


def _fitting(part_type: PartType, wanted: Direction) -> str:
    fitting = [port.name for port in part_type.ports if port.direction is wanted]
    if not fitting:
        return said(
            "part {number} has no port that can {value}: choose another slot",
            number=part_type.number,
            value=wanted.value,
        )
    return said("use {words}", words=quoted(fitting[:MOST_LISTED], " or "))
