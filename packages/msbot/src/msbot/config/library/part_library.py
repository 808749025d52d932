"""The part library: what part numbers mean (the thesis' Hardware Information Module, 5.4.2).

One TOML file describes one part type. MsBOT brings more than thirty; extensions and folders of a robot add to
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

from msbot.config.library.agreement import check_agreement
from msbot.config.library.field_types import FieldKind, MessageType
from msbot.config.library.message_types import standard_message_types
from msbot.config.library.part_file_reader import LibraryFile, add_message_types, open_library_file, read_part_type
from msbot.config.library.part_types import (
    BusKind,
    Category,
    Direction,
    DriverPin,
    DriverSpec,
    Parameter,
    ParameterKind,
    PartType,
    Pin,
    PinKind,
    Port,
    Supply,
    scalar_text,
)
from msbot.config.library.search import PartSearch
from msbot.config.library.versions import split_number
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_agent.toml.document import Document, packaged_document, read_document
from msbot_agent.toml.problems import MOST_LISTED, FileLocation, Problems, quoted
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

__all__ = [
    "BusKind",
    "Category",
    "Direction",
    "DriverPin",
    "DriverSpec",
    "FieldKind",
    "Library",
    "MessageType",
    "Parameter",
    "ParameterKind",
    "PartType",
    "Pin",
    "PinKind",
    "Port",
    "Supply",
    "load_library",
    "scalar_text",
]


SHIPPED = "msbot library, "
"""Prefix of the source of a part type that comes with MsBOT."""
SAID_BY_PART = "what the part says"
"""Source of what a part says of itself."""
MOST_FILES = 1000
"""A folder with more TOML files than this is not a part library."""


def carried_by(part_type: PartType) -> set[str]:
    """The names of the messages that its ports carry, and of those inside."""
    ports = (message for port in part_type.ports for message in (port.message, port.reply))
    return {name for message in ports if message is not None for name in message.described()}


class Library:
    """Part types by number, and message types by name."""

    def __init__(self, types: Iterable[PartType] = (), messages: Mapping[str, MessageType] | None = None) -> None:
        self._by_number = {part_type.number: part_type for part_type in types}
        self.messages = standard_message_types() if messages is None else messages
        """Every message type that a port can have."""
        self._search: PartSearch | None = None

    def __len__(self) -> int:
        return len(self._by_number)

    def __iter__(self) -> Iterator[PartType]:
        return iter(self._by_number.values())

    def get(self, number: str) -> PartType | None:
        """The part type with exactly this number."""
        return self._by_number.get(number)

    def units(self, type_name: str) -> Mapping[str, str]:
        """The units of a message type's fields, by field; none for a type that is not known."""
        message = self.messages.get(type_name)
        return {} if message is None else message.units

    def find(self, shown: str) -> PartType | None:
        """The part type that a part shows: exactly this number, or the one before its @ if the version fits."""
        if exact := self._by_number.get(shown):
            return exact
        number, version = split_number(shown)
        part_type = self._by_number.get(number)
        return part_type if part_type is not None and version and version in part_type.versions else None

    def require(self, shown: str) -> PartType:
        """As `find`.

        Raises:
            ConfigError: the library has no such number; the text says which ones are near.
        """
        if found := self.find(shown):
            return found
        number, version = split_number(shown)
        known = self.get(number)
        if known is not None:
            raise ConfigError(
                said(
                    "part {number} is known, but not in version {version!r}; known: {versions}",
                    number=number,
                    version=version,
                    versions=known.versions,
                )
            )
        right = self.suggest(number)
        raise ConfigError(
            said('the library has no part number "{part_number}"; {right}', part_number=shown, right=right)
        )

    def with_type(self, part_type: PartType, messages: Iterable[MessageType] = ()) -> Library:
        """A library with one part type more, or another one of that number, and its message types."""
        others = (entry for entry in self if entry.number != part_type.number)
        return Library((*others, part_type), {**self.messages, **{message.name: message for message in messages}})

    def without_type(self, number: str) -> Library:
        """A library without that part type, and without the messages of its own that no other part type carries."""
        gone, others = self.get(number), [entry for entry in self if entry.number != number]
        sources = (gone.source, SAID_BY_PART) if gone is not None else ()
        carried = {name for entry in others for name in carried_by(entry)}
        messages = {name: one for name, one in self.messages.items() if name in carried or one.source not in sources}
        return Library(others, messages)

    def become(self, other: Library) -> None:
        """Take over the content of another library, for all who use this one."""
        self._by_number, self.messages, self._search = other._by_number, other.messages, None

    def numbers(self) -> list[str]:
        """All part numbers, sorted."""
        return sorted(self._by_number)

    def nearest(self, number: str, limit: int = 3) -> list[str]:
        """The part numbers that look most like this one, best first."""
        return nearest(number, self._by_number, limit)

    def suggest(self, number: str) -> str:
        """What to write instead of an unknown number: similar numbers, or what it may mean."""
        if near := self.nearest(number):
            return did_you_mean([f'"{one}"' for one in near])
        self._search = self._search or PartSearch(self)
        if found := self._search.find(number, limit=3):
            return did_you_mean(
                [said('"{number}" ({name})', number=entry.number, name=said(entry.name)) for entry in found]
            )
        if 0 < len(self) <= MOST_LISTED:
            return said("known: {listed}", listed=quoted(self.numbers()))
        return said("`msbot library list` shows what there is") if len(self) else said("the library is empty")


def load_library(*extra: Path) -> Library:
    """Read MsBOT's part types, those of extensions, and those of the given folders (or files), each folder once.

    Raises:
        ConfigError: a folder is missing, or files are wrong; every problem of every file is reported at once.
    """
    read = _shipped()
    if extra:
        problems = Problems()
        read = _Read(dict(read.messages), dict(read.types))
        _add(read, _in(extra, problems), problems)
    return Library((part_type for _, part_type in read.types.values()), dict(read.messages))


@dataclass(frozen=True, slots=True)
class _Read:
    """What the files of a library say: message types by name, part types by number with their file."""

    messages: dict[str, MessageType]
    types: dict[str, tuple[LibraryFile, PartType]]


@cache
def _shipped() -> _Read:
    """What MsBOT and its extensions bring; read once, since it does not change while a program runs."""
    problems = Problems()
    read = _Read(dict(standard_message_types()), {})
    folder = files("msbot.config.library") / "types"
    entries = sorted((entry for entry in folder.iterdir() if entry.name.endswith(".toml")), key=lambda one: one.name)
    _add(read, (packaged_document(entry, f"{SHIPPED}{entry.name}") for entry in entries), problems)
    return _with_extensions(read)


def _with_extensions(read: _Read) -> _Read:
    """The part and message types of extensions, too; an extension with a mistake in a file brings none."""
    for group in ("messages", "part_types"):
        for name, folder in extensions().folders(group).items():
            problems, more = Problems(), _Read(dict(read.messages), dict(read.types))
            try:
                _add(more, _in([folder], problems), problems)
            except ConfigError as error:
                extensions().leave_out_named(group, name, str(error))
            else:
                read = more
    return read


def _add(read: _Read, documents: Iterable[Document], problems: Problems) -> None:
    """Read more files, which must agree with each other and with those before them.

    Raises:
        ConfigError: files are wrong.
    """
    opened = [open_library_file(document, problems) for document in documents]
    for file in opened:
        add_message_types(read.messages, file)
    for file in opened:
        part_type = read_part_type(file, read.messages)
        if part_type is None:
            continue
        if part_type.number in read.types:
            _, other = read.types[part_type.number]
            if not _is_same_file(part_type.source, other.source):  # as the folder of an extension that is installed
                file.table.report(
                    f'part number "{part_type.number}" is taken by {other.source}; give each type a number of its own',
                    "number",
                )
        elif part_type.number:
            read.types[part_type.number] = (file, part_type)
    check_agreement({number: (file.table, part_type) for number, (file, part_type) in read.types.items()})
    problems.raise_if_any()


def _is_same_file(source: str, other: str) -> bool:
    try:
        return Path(source).samefile(other)
    except OSError:  # a part type that comes with MsBOT has no path
        return False


def _in(places: Iterable[Path], problems: Problems) -> Iterator[Document]:
    for place in {place.absolute(): place for place in places}.values():
        if not place.is_dir() and place.suffix != ".toml":
            problems.add(FileLocation(str(place)), "there is no such library folder; create it or name another one")
            continue
        found = sorted(place.glob("*.toml")) if place.is_dir() else [place]
        if len(found) > MOST_FILES:
            problems.add(
                FileLocation(str(place)), f"has more than {MOST_FILES} TOML files; name the folder of the library"
            )
            continue
        for path in found:
            document = read_document(path, problems)
            if document is not None:
                yield document
