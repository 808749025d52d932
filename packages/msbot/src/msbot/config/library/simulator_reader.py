"""Reads and checks the `[simulator]` table of a part type, and fills in what it does not say.

Every name in it must mean something: what a reading follows, a field of a message, a number that is the name of a
parameter. A port about which the table says nothing gets a control or a reading for each of its fields.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from msbot.config.library.field_types import (
    EnumType,
    FieldKind,
    FieldType,
    LeafType,
    ListType,
    MessageType,
    fault_of,
)
from msbot.config.library.part_types import Direction, Parameter, Port
from msbot.config.library.simulator import (
    DRIVES,
    FUNCTIONS,
    SENSES,
    Control,
    ControlKind,
    FieldSource,
    Operand,
    Output,
    Reading,
    Simulator,
)
from msbot_agent.toml.problems import suggestion, toml_value_in_words
from msbot_agent.toml.table import Scalar, Table

# Texts with sources in braces: `turn-on {output:d}`; the form after a colon is that of Python's `format`.


PLACEHOLDER = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")
"""A source in a text: its name, and a form if there is one."""

_WHOLE = "bcdoxX"
"""Forms that need a whole number."""


def format_text(text: str, values: Mapping[str, Scalar]) -> str:
    """The text with its sources filled in; a value that does not suit its form is written as it is."""

    def fill(found: re.Match[str]) -> str:
        value, form = values[found[1]], found[2]
        if form and can_format(value, form):
            return format(_plain(value, form), form)
        if isinstance(value, float):
            return f"{value:g}"
        return str(value).lower() if isinstance(value, bool) else str(value)

    return PLACEHOLDER.sub(fill, text)


def sources_in(text: str) -> set[str]:
    """The names of the sources in a text."""
    return {found[1] for found in PLACEHOLDER.finditer(text)}


def can_format(value: Scalar, form: str) -> bool:
    """Whether a value of this kind can be written in that form."""
    try:
        format(_plain(value, form), form)
    except ValueError:
        return False
    return True


def _plain(value: Scalar, form: str) -> Scalar:
    """The value in the type that the form needs."""
    return round(value) if form[-1] in _WHOLE and not isinstance(value, str) else value


FORBIDDEN_IN_NAMES = ".#{}="
"""Characters with a special meaning in names of sources."""

_LEAST, _MOST = -1e300, 1e300


class SimulatorReader:
    """Reads one simulator; `sources` grows as the file goes down, so that nothing can follow itself."""

    def __init__(self, table: Table, ports: Sequence[Port], parameters: Sequence[Parameter]) -> None:
        self._table = table
        self._ports = ports
        self._sources: dict[str, Scalar] = {entry.name: entry.default for entry in parameters}
        for port in ports:
            self._sources[f"#{port.name}"] = 0
            if port.direction is Direction.SUBSCRIBE and port.message is not None:
                self._sources |= {f"{port.name}.{name}": kind.zero for name, kind in port.message.leaves.items()}

    def read(self) -> Simulator:
        """The simulator; what is wrong becomes a problem."""
        controls = [self._read_control(table) for table in self._table.tables("control")]
        readings = [self._read_reading(table) for table in self._table.tables("reading")]
        tables = self._table.tables("publish")
        said = [table.scalar("port") for table in tables]
        # Filled in before the outputs are read, so that these can use them.
        controls += self._missing_controls(said)
        outputs = [self._read_output(table) for table in tables]
        self._table.finish()
        readings += self._missing_readings(readings)
        outputs += self._missing_outputs(said)
        return Simulator(tuple(controls), tuple(readings), tuple(outputs))

    def _read_control(self, table: Table) -> Control:
        kind = ControlKind(table.choice("type", [kind.value for kind in ControlKind]))
        choices = tuple(table.names("choices", "low", required=kind is ControlKind.CHOICE))
        if choices and kind is not ControlKind.CHOICE:
            table.report('only a control of type "choice" has choices; remove it', "choices")
        start = table.scalar("start")
        control = Control(
            name=self._own_name(table),
            kind=kind,
            start=_start_of(kind, choices) if start is None else start,
            least=self._limit(table, "min", kind),
            most=self._limit(table, "max", kind),
            unit=table.text("unit", "lx"),
            words=table.text("words", "Light that falls on the sensor"),
            choices=choices,
            momentary=table.flag("momentary", default=False),
            senses=table.choice("senses", tuple(SENSES)) if "senses" in table else "",
        )
        table.finish()
        if control.senses and SENSES[control.senses] is not kind:
            table.report(f'"{control.senses}" is for a control of type "{SENSES[control.senses].value}"', "senses")
        if start is None and kind is ControlKind.NUMBER:
            table.report("is missing; add the value before anybody does something", "start")
        elif start is not None and (fault := control.fault(start)):
            table.report(fault, "start")
        self._sources[control.name] = control.start
        return control

    def _limit(self, table: Table, key: str, kind: ControlKind) -> float | None:
        if key not in table:
            return None
        if kind is not ControlKind.NUMBER:
            table.report('only a control of type "number" has limits; remove it', key)
        return table.number(key, default=0.0, least=_LEAST, most=_MOST)

    def _read_reading(self, table: Table) -> Reading:
        reading = Reading(
            name=self._own_name(table),
            unit=table.text("unit", "deg"),
            words=table.text("words", "Angle of the arm"),
            shown=not table.flag("hidden", default=False),
            start=table.scalar("start"),
            follows=self._source(table, "follows"),
            text=self._template(table, "text"),
            random_every=self._operand(table, "random_every"),
            lasts=self._operand(table, "lasts") or 0.0,
            pattern=self._pattern(table),
            equals=table.scalar("equals"),
            above=self._operand(table, "above"),
            negate=self._source(table, "negate"),
            function=table.choice("function", FUNCTIONS, default="none").replace("none", ""),
            scale=_or(self._operand(table, "scale"), 1.0),
            offset=_or(self._operand(table, "offset"), 0.0),
            divide_by=_or(self._operand(table, "divide_by"), 1.0),
            wrap=self._operand(table, "wrap"),
            least=self._operand(table, "min"),
            most=self._operand(table, "max"),
            integrate=table.flag("integrate", default=False),
            lag_s=_or(self._operand(table, "lag_s"), 0.0),
            slew_per_s=_or(self._operand(table, "slew_per_s"), 0.0),
            noise=_or(self._operand(table, "noise"), 0.0),
            step=_or(self._operand(table, "step"), 0.0),
            rows=table.whole("rows", default=0, least=0, most=200),
            columns=table.whole("columns", default=0, least=0, most=1000),
            drives=table.choice("drives", DRIVES) if "drives" in table else "",
        )
        table.finish()
        ways = [bool(reading.follows), bool(reading.text), reading.random_every is not None]
        if sum(ways) != 1:
            table.report("needs exactly one of follows, text and random_every: where its value comes from")
        if reading.random_every is not None and (reading.least is None or reading.most is None):
            table.report("a reading that is drawn needs min and max")
        self._sources[reading.name] = self._value_of(reading)
        return reading

    def _value_of(self, reading: Reading) -> Scalar:
        """A value of the kind that the reading has."""
        if reading.equals is not None or reading.above is not None:
            return False
        source = self._sources.get(reading.follows, 0.0)
        numeric = any(
            (
                reading.function,
                reading.scale != 1,
                reading.offset,
                reading.divide_by != 1,
                reading.integrate,
                reading.lag_s,
                reading.slew_per_s,
            )
        )
        if reading.text or reading.pattern:
            source = ""
        return source if isinstance(source, bool | str) and not numeric else 0.0

    def _read_output(self, table: Table) -> Output:
        name = table.name("port", "light")
        port = next((port for port in self._ports if port.name == name), None)
        fields: dict[str, FieldSource] = {}
        publishing = [port.name for port in self._ports if port.direction is Direction.PUBLISH]
        if name not in publishing:
            if name:
                right = suggestion(name, publishing, none_known="the part type has none")
                table.report(f'there is no port "{name}" that publishes; {right}', "port")
            table.table("fields")
        elif port is not None and port.message is not None:
            fields = self._read_fields(table.table("fields"), port.name, port.message)
        rate_hz = port.rate_hz if port is not None else 0.0
        every = self._operand(table, "every")
        on_change = table.flag("on_change", default=every is None and rate_hz == 0)
        output = Output(
            port=name,
            fields=fields,
            every=every if every is not None else 1 / rate_hz if rate_hz and not on_change else 0.0,
            on_change=on_change,
            change=self._operand(table, "change") or 0.0,
            only_if=self._source(table, "only_if"),
        )
        table.finish()
        return output

    def _read_fields(self, table: Table, port: str, message: MessageType) -> dict[str, FieldSource]:
        fields: dict[str, FieldSource] = {}
        for key in table.present_keys():
            kind, listed = message.leaves.get(key), table.item(key)
            if isinstance(kind, ListType) and isinstance(listed, list):
                fields[key] = self._read_list(table, key, kind, listed)
                continue
            value = table.scalar(key)
            if key not in message.leaves:
                right = suggestion(key, list(message.leaves), none_known="remove it")
                table.report(f'a {message.name} has no field "{key}"; {right}', key)
            elif isinstance(value, str):
                fields[key] = self._template(table, key) if "{" in value else self._source(table, key)
            elif value is not None:
                fields[key] = value
                if fault := message.leaves[key].fault(value):
                    table.report(fault, key)
        for key in message.leaves:
            if key not in fields and key not in table.present_keys():
                fields[key] = self._source_of_field(table, port, key, message)
        return fields

    def _read_list(self, table: Table, key: str, kind: ListType, items: list[object]) -> FieldSource:
        if len(items) > kind.most or (kind.is_fixed and len(items) < kind.most):
            table.report(
                f"must have {'' if kind.is_fixed else 'at most '}{kind.most} elements; it has {len(items)}", key
            )
        return tuple(self._read_element(table, key, kind.element, one) for one in items)

    def _read_element(self, table: Table, key: str, kind: FieldType, value: object) -> FieldSource:
        if isinstance(kind, MessageType) and isinstance(value, list) and len(value) == len(kind.fields):
            pairs = zip(kind.fields.values(), value, strict=True)
            return tuple(self._read_element(table, key, inner, one) for inner, one in pairs)
        if isinstance(value, str):
            self._check_source(table, key, value)
            return value
        if fault := fault_of(kind, value):
            table.report(f"each element is the name of a source or a value, which {fault}", key)
        return value if isinstance(value, bool | int | float) else 0

    def _source_of_field(self, table: Table, port: str, key: str, message: MessageType) -> Scalar:
        """The source of a field about which the file says nothing: one with the field's name, or with the port's."""
        for name in (key, port) if len(message.leaves) == 1 else (key,):
            if name in self._sources:
                return name
        table.report(f'says nothing of the field "{key}"; add {key} = and the name of a control or reading', key)
        return message.leaves[key].zero

    def _own_name(self, table: Table) -> str:
        name = table.name("name", "brightness", forbidden=FORBIDDEN_IN_NAMES)
        if name in self._sources:
            table.report(f'"{name}" is the name of something else already; choose another', "name")
        return name

    def _source(self, table: Table, key: str) -> str:
        name = table.name(key, "brightness", default="")
        if name:
            self._check_source(table, key, name)
        return name

    def _check_source(self, table: Table, key: str, name: str) -> None:
        if name not in self._sources:
            right = suggestion(name, list(self._sources), none_known="add a control")
            table.report(f'"{name}" is not a parameter, control, reading above or field of a port; {right}', key)

    def _operand(self, table: Table, key: str) -> Operand | None:
        value = table.scalar(key)
        if isinstance(value, str):
            self._check_source(table, key, value)
            return value
        if isinstance(value, bool):
            table.report(f"must be a number or the name of a source; it is {toml_value_in_words(value)}", key)
            return None
        return None if value is None else table.number(key, default=0.0, least=_LEAST, most=_MOST)

    def _template(self, table: Table, key: str) -> str:
        text = table.text(key, "{red} of 255")
        for found in PLACEHOLDER.finditer(text):
            self._check_source(table, key, found[1])
            value, form = self._sources.get(found[1]), found[2]
            if form and value is not None and not can_format(value, form):
                table.report(
                    f'"{form}" is not a format for {toml_value_in_words(value)}; for example {{{found[1]}:.1f}}', key
                )
        return text

    def _pattern(self, table: Table) -> str:
        text = table.text("pattern", "turn-on ([0-7])")
        try:
            groups = re.compile(text).groups
        except re.error as error:
            table.report(f"is not a regular expression ({error}); for example pattern = 'turn-on ([0-7])'", "pattern")
        else:
            if text and groups != 1:
                table.report("must have one group in (), which is taken out of the text", "pattern")
        return text

    def _missing_controls(self, said: Collection[Scalar | None]) -> list[Control]:
        controls = []
        for port in self._ports:
            if port.direction is Direction.PUBLISH and port.name not in said and port.message is not None:
                for name, kind in port.message.leaves.items():
                    if _only_name(port, name) not in self._sources:
                        controls.append(_control_for(port, name, kind, port.message))
                        self._sources[controls[-1].name] = controls[-1].start
        return controls

    def _missing_outputs(self, said: Collection[Scalar | None]) -> list[Output]:
        return [
            Output(
                port.name,
                {name: _only_name(port, name) for name in port.message.leaves},
                every=1 / port.rate_hz if port.rate_hz else 0.0,
                on_change=not port.rate_hz,
            )
            for port in self._ports
            if port.direction is Direction.PUBLISH and port.name not in said and port.message is not None
        ]

    def _missing_readings(self, readings: Sequence[Reading]) -> list[Reading]:
        """A reading for each field of a subscribing port that nothing refers to."""
        followed = {reading.follows for reading in readings}
        followed |= {source for reading in readings for source in sources_in(reading.text)}
        ports = [port for port in self._ports if port.direction is Direction.SUBSCRIBE and port.message is not None]
        return [
            Reading(name, (port.message.units if port.message else {}).get(field, ""), follows=f"{port.name}.{field}")
            for port in ports
            if not any(source == f"#{port.name}" or source.startswith(f"{port.name}.") for source in followed)
            for field in (port.message.leaves if port.message else ())
            if (name := _only_name(port, field)) not in self._sources
        ]


def _only_name(port: Port, field: str) -> str:
    """The name of a filled-in reading or control: the port's, followed by the field's if there are several."""
    return (
        port.name
        if port.message is not None and len(port.message.leaves) == 1
        else f"{port.name}_{field.replace('.', '_')}"
    )


def _control_for(port: Port, field: str, kind: LeafType, message: MessageType) -> Control:
    name, unit = _only_name(port, field), message.units.get(field, "")
    words = f"What it says at port {port.name}"
    if isinstance(kind, EnumType):
        return Control(name, ControlKind.CHOICE, kind.zero, None, None, unit, words, choices=kind.names)
    if kind is FieldKind.BOOL:
        return Control(name, ControlKind.BOOL, kind.zero, None, None, unit, words)
    if not isinstance(kind, FieldKind) or kind is FieldKind.TEXT:
        return Control(name, ControlKind.TEXT, kind.zero, None, None, unit, words)
    least, most = kind.limits if kind.is_whole else (None, None)
    return Control(name, ControlKind.NUMBER, kind.zero, least, most, unit, words)


def _start_of(kind: ControlKind, choices: tuple[str, ...]) -> Scalar:
    starts: Mapping[ControlKind, Scalar] = {ControlKind.BOOL: False, ControlKind.NUMBER: 0.0, ControlKind.TEXT: ""}
    return starts.get(kind, choices[0] if choices else "")


def _or(operand: Operand | None, otherwise: float) -> Operand:
    return otherwise if operand is None else operand
