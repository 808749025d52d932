"""The part library: what part numbers are (the thesis' Hardware Information Module, 5.4.2).

One TOML file describes one part type. MsBOT brings the thesis' three; a robot may add folders of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from importlib.resources import files
from pathlib import Path

from msbot.config.document import Document, parse_document, read_document
from msbot.config.problems import Place, Problems, nearest
from msbot.config.reader import Scalar, Table, kind_words

FORBIDDEN_IN_PORTS = "."
"""A port is named `SLOT.port` in a binding."""

_MOST_HZ = 10_000.0


class Direction(Enum):
    """Which way a port's messages go, seen from the part."""

    PUBLISH = "publish"
    SUBSCRIBE = "subscribe"


class ParameterKind(Enum):
    """What values a parameter takes."""

    BOOL = "bool"
    INT = "int"
    FLOAT = "float"
    TEXT = "text"

    @property
    def words(self) -> str:
        """The kind in a sentence: "must be ..."."""
        return {"bool": "true or false", "int": "a whole number", "float": "a number", "text": "text in quotes"}[
            self.value
        ]

    def takes(self, value: Scalar) -> bool:
        """Whether a TOML value is of this kind; a whole number is a number too."""
        match self:
            case ParameterKind.BOOL:
                return isinstance(value, bool)
            case ParameterKind.INT:
                return isinstance(value, int) and not isinstance(value, bool)
            case ParameterKind.FLOAT:
                return isinstance(value, int | float) and not isinstance(value, bool)
            case ParameterKind.TEXT:
                return isinstance(value, str)


@dataclass(frozen=True, slots=True)
class Port:
    """One kind of message a part sends or takes."""

    name: str
    direction: Direction
    type_name: str
    """Name of the message type, for example `HelloWorld`."""
    rate_hz: float = 0.0
    """How often it is usually sent; 0 = only when something happens."""
    safe: Mapping[str, Scalar] | None = None
    """Fields of the message an actuator applies to itself when its partner or the master is lost; None = keep on."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """Something about a part that can be set."""

    name: str
    kind: ParameterKind
    default: Scalar
    unit: str = ""
    least: float | None = None
    most: float | None = None
    description: str = ""

    def fault(self, value: Scalar) -> str | None:
        """Why this value cannot be set, with what would be right; None when it can."""
        if not self.kind.takes(value):
            return f"must be {self.kind.words}, for example {scalar_text(self.default)!r}; it is {kind_words(value)}"
        if isinstance(value, bool | str):
            return None
        unit = f" {self.unit}" if self.unit else ""
        # Written so that a NaN is out of range too.
        if (self.least is not None and not value >= self.least) or (self.most is not None and not value <= self.most):
            low = "any" if self.least is None else f"{self.least:g}"
            high = "any" if self.most is None else f"{self.most:g}"
            return f"is {value}; it must be {low} to {high}{unit}"
        return None


@dataclass(frozen=True, slots=True)
class PartType:
    """What a part number is."""

    number: str
    name: str
    manufacturer: str = ""
    description: str = ""
    specification: str = ""
    """Electrical data in words, for example `5V`."""
    resolution: str = ""
    ports: tuple[Port, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    compatible_with: tuple[str, ...] = ()
    """Part numbers whose slots this type can fill as well."""
    source: str = ""
    """The file it was read from."""

    def port(self, name: str) -> Port | None:
        """The port of that name."""
        return next((port for port in self.ports if port.name == name), None)

    def parameter(self, name: str) -> Parameter | None:
        """The parameter of that name."""
        return next((parameter for parameter in self.parameters if parameter.name == name), None)


class Library:
    """Part types by number."""

    def __init__(self, types: Iterable[PartType] = ()) -> None:
        self._by_number = {part_type.number: part_type for part_type in types}

    def __len__(self) -> int:
        return len(self._by_number)

    def __iter__(self) -> Iterator[PartType]:
        return iter(self._by_number.values())

    def get(self, number: str) -> PartType | None:
        """The part type with exactly this number."""
        return self._by_number.get(number)

    def numbers(self) -> list[str]:
        """All part numbers, sorted."""
        return sorted(self._by_number)

    def nearest(self, number: str, limit: int = 3) -> list[str]:
        """The part numbers that look most like this one, best first."""
        return nearest(number, self._by_number, limit)


def load_library(*extra_dirs: Path) -> Library:
    """Read the part types MsBOT brings, and those of the folders named.

    Raises:
        ConfigError: a folder is missing, or files are wrong; every problem of every file is told at once.
    """
    problems = Problems()
    types: dict[str, PartType] = {}
    for document in (*_shipped(problems), *_in_folders(extra_dirs, problems)):
        part_type = _read_part_type(document, problems)
        if other := types.get(part_type.number):
            problems.add(
                document.place(("number",)),
                f'part number "{part_type.number}" is taken by {other.source}; give each type a number of its own',
            )
        elif part_type.number:
            types[part_type.number] = part_type
    problems.raise_if_any()
    return Library(types.values())


def scalar_text(value: Scalar) -> str:
    """A value as text, as it is sent to a part: `true`, `false`, a number, or the text itself."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _shipped(problems: Problems) -> Iterator[Document]:
    folder = files("msbot.config") / "library"
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        document = parse_document(entry.read_text("utf-8"), f"msbot library, {entry.name}", problems)
        if document is not None:
            yield document


def _in_folders(folders: Iterable[Path], problems: Problems) -> Iterator[Document]:
    for folder in folders:
        if not folder.is_dir():
            problems.add(Place(str(folder)), "there is no such library folder; create it or name another one")
            continue
        for path in sorted(folder.glob("*.toml")):
            document = read_document(path, problems)
            if document is not None:
                yield document


def _read_part_type(document: Document, problems: Problems) -> PartType:
    table = Table(document, problems, document.values)
    part_type = PartType(
        number=table.name("number", "ABCD"),
        name=table.name("name", "Light sensor"),
        manufacturer=table.text("manufacturer", "Massey University"),
        description=table.text("description", "Measures brightness"),
        specification=table.text("specification", "5V"),
        resolution=table.text("resolution", "10 bit"),
        ports=tuple(_read_port(port) for port in table.tables("port")),
        parameters=tuple(_read_parameter(parameter) for parameter in table.tables("parameter")),
        compatible_with=tuple(table.names("compatible_with", "ABCD")),
        source=document.file,
    )
    table.finish()
    _check_twice(table, "port", [port.name for port in part_type.ports])
    _check_twice(table, "parameter", [parameter.name for parameter in part_type.parameters])
    return part_type


def _read_port(table: Table) -> Port:
    port = Port(
        name=table.name("name", "light", forbidden=FORBIDDEN_IN_PORTS),
        direction=Direction(table.choice("direction", [direction.value for direction in Direction])),
        type_name=table.name("type", "HelloWorld"),
        rate_hz=table.number("rate_hz", default=0.0, least=0.0, most=_MOST_HZ, unit="times a second"),
        safe=table.scalars("safe") if "safe" in table else None,
    )
    if port.safe is not None and port.direction is Direction.PUBLISH:
        table.problem("only a port that subscribes can have a safe value; remove it", "safe")
    table.finish()
    return port


def _read_parameter(table: Table) -> Parameter:
    kind = ParameterKind(table.choice("type", [kind.value for kind in ParameterKind]))
    if "default" not in table:
        table.problem("is missing; add the value that holds when nobody sets another", "default")
    default = table.scalar("default")
    parameter = Parameter(
        name=table.name("name", "period_s"),
        kind=kind,
        default="" if default is None else default,
        unit=table.text("unit", "s"),
        least=_limit(table, "min", kind),
        most=_limit(table, "max", kind),
        description=table.text("description", "Time between two measurements"),
    )
    table.finish()
    if default is not None and (fault := parameter.fault(default)):
        table.problem(fault, "default")
    return parameter


def _limit(table: Table, key: str, kind: ParameterKind) -> float | None:
    if key not in table:
        return None
    if kind not in (ParameterKind.INT, ParameterKind.FLOAT):
        table.problem("only a parameter of type int or float has limits; remove it", key)
    return table.number(key, default=0.0, least=-1e300, most=1e300)


def _check_twice(table: Table, key: str, names: list[str]) -> None:
    for position, name in enumerate(names):
        if name and name in names[:position]:
            table.problem(f'there are two with the name "{name}"; give each its own', key, position, "name")
