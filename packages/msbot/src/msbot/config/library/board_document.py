"""What a board is told of one part that is wired to it: everything that it needs to be that part, as one JSON text.

The board keeps no part types; the master sends a document for each part, in the settings `.part.1`, `.part.2` and so
on. A port that could only publish what nobody measures is left out: it stays silent. The keys:

* `number`, `name`: what the part shows in its claim
* `driver`, `module`: the driver on the board, and its file
* `pins`, `options`: by name
* `sources`: names in the model of what the driver measures or drives
* `ports`: by name: `[comes in, message type, fields, safe value]`
* `values`, `limits`, `settings`: of the model: values at the start; ranges of settings; which values are settings
* `readings`, `outputs`: the model itself, in the words of `[simulator]` (docs/reference/library.md)
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields

from msbot.config.library.board_drivers import BOARD_DRIVERS
from msbot.config.library.board_wiring import WiredPart
from msbot.config.library.field_types import FieldKind, MessageType
from msbot.config.library.part_types import Direction, PartType, Port
from msbot.config.library.simulator import Output, Reading, Simulator
from msbot_agent.text.sentence import said
from msbot_agent.toml.table import Scalar
from msbot_xrce.errors import ConfigError

MARK = ".part."
"""How the settings begin that carry these documents: names of parameters have no dot."""
MOST_OCTETS = 7000
"""All documents of one board together: it takes messages of up to 8 kB."""
CODES = {
    FieldKind.BOOL: "?",
    FieldKind.UINT8: "B",
    FieldKind.UINT16: "H",
    FieldKind.UINT32: "I",
    FieldKind.UINT64: "Q",
    FieldKind.INT8: "b",
    FieldKind.INT16: "h",
    FieldKind.INT32: "i",
    FieldKind.INT64: "q",
    FieldKind.FLOAT32: "f",
    FieldKind.FLOAT64: "d",
    FieldKind.TEXT: "s",
}
"""Kinds of fields as the board names them (`micropython/msbot/message.py`)."""
_OPERANDS = (
    "scale", "offset", "divide_by", "wrap", "least", "most", "slew_per_s", "step", "lasts", "above",
)  # fmt: skip
_NOT_SENT = ("unit", "words", "shown", "noise", "lag_s", "rows", "columns", "name")
"""What only people want to know, and what a real part has by itself."""


def board_document(part: WiredPart) -> str:
    """The document of one part.

    Raises:
        ConfigError: its model does something that boards do not.
    """
    part_type = part.part_type
    driver = BOARD_DRIVERS[part_type.driver.board.driver]
    sources = part_type.driver.board.sources
    model = _Model(part_type, frozenset(sources[: driver.measured]))
    outputs = [output for output in model.simulator.outputs if model.is_known(_used_by(part_type, output))]
    needed = model.needed([*sources, *(name for output in outputs for name in _used_by(part_type, output))])
    document = {
        "number": part.number,
        "name": part.name,
        "driver": part_type.driver.board.driver,
        "module": driver.module,
        "pins": dict(part.pins) | ({} if part.address is None else {"address": part.address}),
        "options": dict(part.options),
        "sources": list(sources),
        "ports": {port.name: _port(port) for port in part_type.ports if _is_used(port, outputs)},
        "stops": {port.name: port.stop for port in part_type.ports if port.stop},
        "values": model.start(needed),
        "limits": {
            one.name: [one.least, one.most]
            for one in part_type.parameters
            if one.name in needed and not (one.least is None and one.most is None)
        },
        "settings": [one.name for one in part_type.parameters if one.name in needed],
        "readings": [_reading(one) for one in model.computed(needed)],
        "outputs": [_output(one) for one in outputs],
    }
    return json.dumps({key: value for key, value in document.items() if value}, separators=(",", ":"))


def board_documents(parts: Mapping[str, WiredPart]) -> dict[str, str]:
    """The settings that a board gets for its parts, by name.

    Raises:
        ConfigError: together they are too long.
    """
    found = {f"{MARK}{at}": board_document(part) for at, part in enumerate(parts.values(), 1)}
    octets = sum(len(text) for text in found.values())
    if octets > MOST_OCTETS:
        raise ConfigError(
            said(
                "the parts of the board need {octets} bytes of {most}; wire some of them to another board",
                octets=octets,
                most=MOST_OCTETS,
            )
        )
    return found


class _Model:
    """The sources of a part type, and what each of them depends on."""

    def __init__(self, part_type: PartType, measured: frozenset[str]) -> None:
        self.simulator = part_type.simulator or Simulator()
        self._part_type = part_type
        self._measured = measured
        self._readings = {reading.name: reading for reading in self.simulator.readings}
        self._controls = {control.name: control for control in self.simulator.controls}

    def needed(self, sources: Iterable[str]) -> set[str]:
        """These sources, and all that they depend on."""
        found: set[str] = set()
        waiting = list(sources)
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                if name in self._readings and name not in self._measured:
                    waiting += _used_by_reading(self._part_type, self._readings[name])
        return found

    def is_known(self, sources: Iterable[str]) -> bool:
        """Whether nothing of it depends on what only a person could do to a simulated part."""
        return not any(name in self._controls and name not in self._measured for name in self.needed(sources))

    def start(self, needed: set[str]) -> dict[str, Scalar]:
        """The values at the start; fields of ports and readings are not among them."""
        values: dict[str, Scalar] = {one.name: one.default for one in self._part_type.parameters if one.name in needed}
        values |= {name: 0 for name in self._measured if name in self._readings}
        return values | {name: control.start for name, control in self._controls.items() if name in needed}

    def computed(self, needed: set[str]) -> list[Reading]:
        """The readings that the board computes; the others are measured."""
        return [one for one in self.simulator.readings if one.name in needed - self._measured]


def _used_by_reading(part_type: PartType, reading: Reading) -> list[str]:
    if reading.text or reading.random_every is not None:
        raise _not_for_boards(part_type, reading.name)
    operands = [getattr(reading, name) for name in _OPERANDS]
    return [reading.follows, *filter(None, [reading.negate]), *(one for one in operands if isinstance(one, str))]


def _not_for_boards(part_type: PartType, what: str) -> ConfigError:
    return ConfigError(
        said(
            "part {number}: its {what} is made of texts or drawn at random, which boards do not do",
            number=part_type.number,
            what=what,
        )
    )


def _used_by(part_type: PartType, output: Output) -> list[str]:
    used = [one for one in (output.every, output.change, output.only_if) if isinstance(one, str) and one]
    for source in output.scalars():
        if isinstance(source, str) and "{" in source:
            raise _not_for_boards(part_type, output.port)
        used += [source] if isinstance(source, str) else []
    return used


def _reading(reading: Reading) -> dict[str, object]:
    """A reading without what is as usual."""
    found: dict[str, object] = {"name": reading.name}
    for one in fields(reading):
        value = getattr(reading, one.name)
        if one.name not in _NOT_SENT and value != one.default:
            found[one.name] = value
    return found


def _output(output: Output) -> dict[str, object]:
    found: dict[str, object] = {"port": output.port, "fields": dict(output.fields)}
    for name in ("every", "on_change", "change", "only_if"):
        if value := getattr(output, name):
            found[name] = value
    return found


def _is_used(port: Port, outputs: Iterable[Output]) -> bool:
    message = port.message
    if message is not None and len(list(_simple(message))) < len(message.fields):
        return False  # lists and messages inside: the drivers of boards have none
    return port.direction is Direction.SUBSCRIBE or any(output.port == port.name for output in outputs)


def _simple(message: MessageType) -> Iterator[tuple[str, FieldKind]]:
    """The fields of a message; only messages of simple fields get here."""
    for name, kind in message.fields.items():
        if isinstance(kind, FieldKind):
            yield name, kind


def _port(port: Port) -> list[object]:
    """Whether it comes in, type, fields, and the safe value."""
    message = port.message
    coded = "" if message is None else " ".join(f"{name}:{CODES[kind]}" for name, kind in _simple(message))
    found: list[object] = [int(port.direction is Direction.SUBSCRIBE), port.type_name, coded]
    return found if port.safe is None else [*found, dict(port.safe)]
