"""A class list: the people of a CSV file, as a spreadsheet or a school's software writes it. Pure."""

from __future__ import annotations

import csv
import secrets

from msbot.operations.rights import Role, role_named
from msbot_agent.text.sentence import said
from msbot_web.access.passwords import check_password
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_BYTES = 256_000
MOST_PEOPLE = 1000
COLUMNS = ("name", "role", "password")
_CONSONANTS, _VOWELS, _SYLLABLES = "bdfgklmnprstvwz", "aeiou", 4


@dataclass(frozen=True, slots=True)
class ClassListEntry:
    """One person of a list."""

    name: str
    role: str
    """Empty: the one that the command names."""
    password: str
    """Empty: one is made up."""
    line: int


@dataclass(frozen=True, slots=True)
class NewAccount:
    """Somebody of a list who can be let in as it stands."""

    name: str
    role: Role
    password: str
    line: int


def read_people(octets: bytes, path: str) -> list[ClassListEntry]:
    """The people of a CSV file: a column with names, and `role` and `password` where it has them.

    The first line may name the columns; without that the first column has the names. Comma, semicolon or tab.

    Args:
        octets: what is in the file.
        path: the file's name, for messages.

    Raises:
        ConfigError: it is too large or no CSV, or nobody or somebody twice is in it.
    """
    text = _text(octets, path)
    lines = text.splitlines()
    delimiter = max(",;\t", key=(lines[0] if lines else "").count)
    rows = [(number, [cell.strip() for cell in row]) for number, row in enumerate(_rows(path, lines, delimiter), 1)]
    rows = [(number, row) for number, row in rows if any(row)]
    columns: list[str] = list(COLUMNS)
    if rows and "name" in (head := [cell.casefold() for cell in rows[0][1]]):
        columns = head
        rows = rows[1:]
    people = [_person(path, number, dict(zip(columns, row, strict=False))) for number, row in rows]
    if not people:
        raise ConfigError(said("{path}: nobody is in it; write a name on each line", path=path))
    if len(people) > MOST_PEOPLE:
        raise ConfigError(
            said("{path}: has more than {most_people} people; divide it", path=path, most_people=MOST_PEOPLE)
        )
    first: dict[str, ClassListEntry] = {}
    for one in people:
        if (other := first.setdefault(one.name, one)) is not one:
            raise ConfigError(
                said(
                    "{path}, line {line}: {name!r} is there already on line {line2}",
                    path=path,
                    line=one.line,
                    name=one.name,
                    line2=other.line,
                )
            )
    return people


def new_accounts(octets: bytes, path: str, role: Role) -> list[NewAccount]:
    """The people of a CSV file, complete with role and password; see `read_people`.

    Args:
        octets: what is in the file.
        path: the file's name, for messages.
        role: the role of those for whom the file has none.

    Raises:
        ConfigError: as `read_people`; a role that there is not, or a password that is too easy.
    """
    people = []
    for one in read_people(octets, path):
        password = one.password or new_password()
        try:
            wanted = role_named(one.role) if one.role else role
            check_password(password)
        except ConfigError as error:
            raise ConfigError(
                said("{path}, line {line}: {error}; nobody was added", path=path, line=one.line, error=str(error))
            ) from None
        people.append(NewAccount(one.name, wanted, password, one.line))
    return people


def read_list(text: str) -> list[tuple[str, str, int]]:
    """Names, groups and lines of a pasted list: a name on each line, the group after a semicolon or a tab.

    Raises:
        ConfigError: nobody or somebody twice is in it, or too many are.
    """
    found: dict[str, tuple[str, str, int]] = {}
    for number, line in enumerate(text.splitlines(), 1):
        name, _, group = (part.strip() for part in line.replace("\t", ";").partition(";"))
        if not name:
            if group:
                raise ConfigError(said("line {number}: the name is missing", number=number))
            continue
        if name in found:
            raise ConfigError(said("line {number}: {name!r} is there twice", number=number, name=name))
        found[name] = (name, group, number)
    if not found:
        raise ConfigError(said("the list is empty: write a name on each line"))
    if len(found) > MOST_PEOPLE:
        raise ConfigError(said("the list has more than {most} names: divide it", most=MOST_PEOPLE))
    return list(found.values())


def new_password() -> str:
    """A password that can be read aloud and typed, such as `bami-roku-4821`: 2^38 different ones."""
    syllables = [secrets.choice(_CONSONANTS) + secrets.choice(_VOWELS) for _ in range(_SYLLABLES)]
    return f"{syllables[0]}{syllables[1]}-{syllables[2]}{syllables[3]}-{secrets.randbelow(10_000):04}"


def _text(octets: bytes, path: str) -> str:
    if len(octets) > MOST_BYTES:
        raise ConfigError(
            said("{path}: is larger than {most_bytes:,} bytes; no class list is", path=path, most_bytes=MOST_BYTES)
        )
    try:
        return octets.decode("utf-8-sig")
    except UnicodeDecodeError:
        return octets.decode("cp1252", "replace")  # what Excel writes on Windows


def _rows(path: str, lines: list[str], delimiter: str) -> list[list[str]]:
    try:
        return list(csv.reader(lines, delimiter=delimiter, strict=True))
    except csv.Error as error:
        raise ConfigError(
            said("{path}: is not a list of people ({error}); save it as CSV", path=path, error=str(error))
        ) from None


def _person(path: str, number: int, cells: dict[str, str]) -> ClassListEntry:
    name = cells.get("name", "")
    if not name:
        raise ConfigError(said("{path}, line {number}: the name is missing", path=path, number=number))
    return ClassListEntry(name, cells.get("role", "").casefold(), cells.get("password", ""), number)
