"""The programs that people write on the page: each with its versions and a word for sharing it."""

from __future__ import annotations

import secrets
from functools import partial

from sqlalchemy import ColumnElement, Connection, LargeBinary, cast, delete, func, insert, select, update

from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import program_texts, programs
from msbot.registry.records import ProgramRecord, ProgramSource, ProgramVersion
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, NotThere

MOST_PROGRAMS = 100
"""Most programs of one person."""
MOST_VERSIONS = 50
"""How many versions of one program are kept: the newest ones."""
MOST_OF_PROGRAM = 1024 * 1024
"""Octets of the versions of one program: of more, the oldest give way."""
MOST_OF_PERSON = 8 * 1024 * 1024
"""Octets of all programs of one person, with their versions."""
MOST_OF_ALL = 128 * 1024 * 1024
"""Octets of all programs of a database: its backup has to fit into what a page takes back."""


class Programs:
    """See the module's docstring. Every method waits for the database."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage
        self._used: int | None = None
        """Octets of all programs, or more, as versions have given way since it was added up; None: it was not."""

    def of(self, owner: str) -> list[ProgramRecord]:
        """The programs of a person, the most recently changed first.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_programs_of, owner=owner))

    def source(self, owner: str, name: str, number: int | None = None) -> ProgramSource:
        """A program, or an earlier version of it.

        Raises:
            NotThere: there is no such program or version.
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_source_of, owner=owner, name=name, number=number))

    def versions(self, owner: str, name: str) -> list[ProgramVersion]:
        """The versions of a program that are kept, the newest first.

        Raises:
            NotThere: there is no such program.
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_versions_of, owner=owner, name=name))

    def store(self, owner: str, name: str, source: ProgramSource) -> int:
        """Store a program; returns the number of its newest version. What is unchanged makes no new version.

        Raises:
            ConfigError: the person has too many programs, or these or all together have too many octets.
            RegistryError: the database cannot be written; nothing has changed.
        """
        now_ns = self._storage.epoch_ns()
        return self._storage.change(partial(self._keep, owner=owner, name=name, source=source, now_ns=now_ns))

    def _keep(self, connection: Connection, *, owner: str, name: str, source: ProgramSource, now_ns: int) -> int:
        size = len(source.text.encode()) + len(source.blocks.encode())
        number = _keep(connection, owner, name, source, now_ns)
        _check_size_of(connection, owner)
        used = None if self._used is None else self._used + size
        if used is None or used > MOST_OF_ALL:
            used = _octets(connection)
            if used > MOST_OF_ALL:
                raise ConfigError(
                    said(
                        "all programs of this robot have {most} MB: whoever has some that nobody needs removes them",
                        most=MOST_OF_ALL >> 20,
                    )
                )
        self._used = used
        return number

    def remove(self, owner: str, name: str) -> None:
        """Delete a program with all its versions.

        Raises:
            NotThere: there is no such program or version.
            RegistryError: the database cannot be written; nothing has changed.
        """
        self._storage.change(partial(_remove, owner=owner, name=name))

    def share(self, owner: str, name: str) -> str:
        """The word by which others may read a program; the same each time.

        Raises:
            NotThere: there is no such program.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._storage.change(partial(_share, owner=owner, name=name))

    def shared(self, word: str) -> tuple[str, str, ProgramSource]:
        """Owner, name and source of the program shared by that word.

        Raises:
            NotThere: there is no such program or version.
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_shared, word=word))


def remove_programs_of(connection: Connection, owner: str) -> None:
    """Delete all programs of a person who is removed; their versions go with them."""
    connection.execute(delete(programs).where(programs.c.owner == owner))


def _programs_of(connection: Connection, owner: str) -> list[ProgramRecord]:
    query = select(programs).where(programs.c.owner == owner).order_by(programs.c.changed_ns.desc(), programs.c.id)
    return [ProgramRecord(row.owner, row.name, row.share, row.changed_ns) for row in connection.execute(query)]


def _id_of(connection: Connection, owner: str, name: str) -> int:
    query = select(programs.c.id).where(programs.c.owner == owner, programs.c.name == name)
    found: int | None = connection.execute(query).scalar()
    if found is None:
        raise NotThere(said("{owner} has no program {name!r}", owner=owner, name=name))
    return found


def _source_of(connection: Connection, owner: str, name: str, number: int | None) -> ProgramSource:
    texts = program_texts.c
    query = select(texts.text, texts.blocks).where(texts.program_id == _id_of(connection, owner, name))
    if number is not None:
        query = query.where(texts.number == number)
    row = connection.execute(query.order_by(texts.number.desc()).limit(1)).one_or_none()
    if row is None:
        raise NotThere(said("version {number} of {name} is not kept any more", number=number, name=name))
    return ProgramSource(row.text, row.blocks)


def _versions_of(connection: Connection, owner: str, name: str) -> list[ProgramVersion]:
    texts = program_texts.c
    query = select(texts.number, texts.saved_ns, func.length(texts.text).label("size"))
    query = query.where(texts.program_id == _id_of(connection, owner, name)).order_by(texts.number.desc())
    return [ProgramVersion(row.number, row.saved_ns, row.size) for row in connection.execute(query)]


def _keep(connection: Connection, owner: str, name: str, source: ProgramSource, now_ns: int) -> int:
    try:
        program = _id_of(connection, owner, name)
    except NotThere:
        program = _make(connection, owner, name, now_ns)
    texts = program_texts.c
    query = select(texts.number, texts.text, texts.blocks).where(texts.program_id == program)
    newest = connection.execute(query.order_by(texts.number.desc()).limit(1)).one_or_none()
    if newest is not None and ProgramSource(newest.text, newest.blocks) == source:
        return int(newest.number)
    number = 1 if newest is None else int(newest.number) + 1
    kept = insert(program_texts).values(program_id=program, number=number, saved_ns=now_ns)
    connection.execute(kept.values(text=source.text, blocks=source.blocks))
    connection.execute(delete(program_texts).where(texts.program_id == program, texts.number <= number - MOST_VERSIONS))
    _drop_old_versions(connection, program)
    connection.execute(update(programs).where(programs.c.id == program).values(changed_ns=now_ns))
    return number


def _drop_old_versions(connection: Connection, program: int) -> None:
    """Of more octets than one program may have, the oldest versions go; the newest stays."""
    texts = program_texts.c
    query = select(texts.number, _size(connection)).where(texts.program_id == program).order_by(texts.number.desc())
    used = 0
    for place, (number, size) in enumerate(connection.execute(query).all()):
        used += size
        if place and used > MOST_OF_PROGRAM:
            connection.execute(delete(program_texts).where(texts.program_id == program, texts.number <= number))
            return


def _check_size_of(connection: Connection, owner: str) -> None:
    if _octets(connection, owner) > MOST_OF_PERSON:
        raise ConfigError(
            said(
                "the programs of {owner} have {most} MB with their versions: remove one that nobody needs first",
                owner=owner,
                most=MOST_OF_PERSON >> 20,
            )
        )


def _octets(connection: Connection, owner: str | None = None) -> int:
    """Octets of the programs of a person, or of all."""
    query = select(func.coalesce(func.sum(_size(connection)), 0))
    if owner is not None:
        query = query.where(program_texts.c.program_id == programs.c.id, programs.c.owner == owner)
    return int(connection.execute(query).scalar_one())


def _size(connection: Connection) -> ColumnElement[int]:
    """Octets of one version; SQLite counts those of a text only when it is cast, older ones have no `octet_length`."""
    parts = program_texts.c.text, program_texts.c.blocks
    if connection.dialect.name == "sqlite":
        text, blocks = (func.length(cast(part, LargeBinary)) for part in parts)
    else:
        text, blocks = (func.octet_length(part) for part in parts)
    return text + blocks


def _make(connection: Connection, owner: str, name: str, now_ns: int) -> int:
    count = connection.execute(select(func.count()).select_from(programs).where(programs.c.owner == owner)).scalar_one()
    if count >= MOST_PROGRAMS:
        raise ConfigError(
            said("{owner} has {most} programs already: remove one first", owner=owner, most=MOST_PROGRAMS)
        )
    made = connection.execute(insert(programs).values(owner=owner, name=name, share="", changed_ns=now_ns))
    assert made.inserted_primary_key is not None
    return int(made.inserted_primary_key[0])


def _remove(connection: Connection, owner: str, name: str) -> None:
    connection.execute(delete(programs).where(programs.c.id == _id_of(connection, owner, name)))


def _share(connection: Connection, owner: str, name: str) -> str:
    program = _id_of(connection, owner, name)
    word: str | None = connection.execute(select(programs.c.share).where(programs.c.id == program)).scalar()
    if not word:
        word = secrets.token_urlsafe(12)
        connection.execute(update(programs).where(programs.c.id == program).values(share=word))
    return word


def _shared(connection: Connection, word: str) -> tuple[str, str, ProgramSource]:
    row = None
    if word:
        row = connection.execute(select(programs).where(programs.c.share == word)).one_or_none()
    if row is None:
        raise NotThere(said("nobody shares a program by that link (any more)"))
    return row.owner, row.name, _source_of(connection, row.owner, row.name, None)
