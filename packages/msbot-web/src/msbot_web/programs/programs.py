"""What a signed-in person can do with programs; rights and limits are checked here, for page and API alike."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import NoReturn, Protocol

from msbot.operations.rights import Right
from msbot.registry import ProgramRecord, ProgramSource, ProgramVersion, Registry
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import read_json
from msbot_web.access.accounts import Accounts
from msbot_web.access.guest_tickets import Ticket
from msbot_web.access.sessions import Session
from msbot_web.programs.browser_files import examples
from msbot_xrce.errors import ConfigError, NotThere

# Where people's programs are kept, what a program may be called and how long it and its blocks may be.


MAX_PROGRAM = 64 * 1024
"""Octets of a program."""
MAX_BLOCKS = 256 * 1024
"""Octets of the blocks that it is made of; a block has some 150."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}\.py")


class ProgramStore(Protocol):
    """Keeps programs; every method raises RegistryError when it cannot."""

    async def of(self, owner: str) -> Sequence[ProgramRecord]:
        """The programs of a person, the one changed last first."""

    async def source(self, owner: str, name: str, number: int | None = None) -> ProgramSource:
        """A program, or an earlier version of it; raises NotThere."""

    async def versions(self, owner: str, name: str) -> Sequence[ProgramVersion]:
        """What is kept of a program, the newest first; raises NotThere."""

    async def store(self, owner: str, name: str, source: ProgramSource) -> int:
        """Keep a program; returns its version."""

    async def remove(self, owner: str, name: str) -> None:
        """Forget a program; raises NotThere."""

    async def share(self, owner: str, name: str) -> str:
        """The word by which others may read a program; raises NotThere."""

    async def shared(self, word: str) -> tuple[str, str, ProgramSource]:
        """Owner, name and source of a shared program; raises NotThere."""


class RegistryProgramStore:
    """In the robot's database."""

    def __init__(self, registry: Registry) -> None:
        self._storage = registry.storage
        self._kept = registry.programs

    async def of(self, owner: str) -> Sequence[ProgramRecord]:
        """See `ProgramStore`."""
        return await self._storage.in_time(self._kept.of, owner)

    async def source(self, owner: str, name: str, number: int | None = None) -> ProgramSource:
        """See `ProgramStore`."""
        return await self._storage.in_time(self._kept.source, owner, name, number)

    async def versions(self, owner: str, name: str) -> Sequence[ProgramVersion]:
        """See `ProgramStore`."""
        return await self._storage.in_time(self._kept.versions, owner, name)

    async def store(self, owner: str, name: str, source: ProgramSource) -> int:
        """See `ProgramStore`."""
        return await self._storage.in_time(self._kept.store, owner, name, source)

    async def remove(self, owner: str, name: str) -> None:
        """See `ProgramStore`."""
        await self._storage.in_time(self._kept.remove, owner, name)

    async def share(self, owner: str, name: str) -> str:
        """See `ProgramStore`."""
        return await self._storage.in_time(self._kept.share, owner, name)

    async def shared(self, word: str) -> tuple[str, str, ProgramSource]:
        """See `ProgramStore`."""
        return await self._storage.in_time(self._kept.shared, word)


class NoProgramStore:
    """A robot without a database keeps nothing; programs run all the same."""

    async def of(self, owner: str) -> Sequence[ProgramRecord]:  # noqa: ARG002 - nobody has any
        """See `ProgramStore`."""
        return ()

    async def _refuse(self, *_: object) -> NoReturn:
        raise ConfigError(said("this robot has no database: programs are not kept, copy them elsewhere"))

    source = versions = store = remove = share = shared = _refuse


def check_program(name: str, source: ProgramSource) -> None:
    """Check what somebody wants to keep.

    Raises:
        ConfigError: the name, the length or the form of the blocks will not do.
    """
    text = source.text
    if not _NAME.fullmatch(name):
        raise ConfigError(
            said("{name!r} is no name for a program: 1 to 40 letters, digits, - and _, then .py", name=name[:60])
        )
    size = len(text.encode("utf-8", "surrogatepass"))
    if size > MAX_PROGRAM:
        raise ConfigError(
            said(
                "a program has at most {most} kB; this one has {size} kB",
                most=MAX_PROGRAM // 1024,
                size=size // 1024 + 1,
            )
        )
    if "\0" in text or not _is_text(text):
        raise ConfigError(said("a program is text; this one holds characters that are none"))
    if source.blocks:
        _check_blocks(source.blocks)


def _check_blocks(blocks: str) -> None:
    """What is in them is looked at by the browser that opens them; here they are only not let grow, and are JSON."""
    size = len(blocks.encode("utf-8", "surrogatepass"))
    if size > MAX_BLOCKS:
        raise ConfigError(
            said(
                "the blocks of a program have at most {most} kB; these have {size} kB: make two programs of them",
                most=MAX_BLOCKS // 1024,
                size=size // 1024 + 1,
            )
        )
    try:
        is_table = isinstance(read_json(blocks), dict)
    except ValueError:
        is_table = False
    if not is_table or "\0" in blocks or not _is_text(blocks):
        raise ConfigError(said("the blocks of a program are a JSON object, as the page makes it; these are not"))


def _is_text(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:  # half of a pair of surrogates
        return False
    return True


class ProgramActions:
    """See the module's docstring. Everybody has programs of their own; others see one only by its word.

    Args:
        shelf: where they are kept.
        accounts: who is signed in.
        check_writing: raises when a person may not change the own programs now.
    """

    def __init__(
        self, shelf: ProgramStore, accounts: Accounts, check_writing: Callable[[Session], None] = lambda _: None
    ) -> None:
        self._check_writing = check_writing
        self._shelf = shelf
        self._accounts = accounts

    async def mine(self, session: Session) -> Sequence[ProgramRecord]:
        """The person's programs, the one changed last first."""
        self._accounts.require(session, Right.OPERATE)
        return await self._shelf.of(session.owner)

    async def source(self, session: Session, name: str, number: int | None = None) -> ProgramSource:
        """A program of the person, or an earlier version of it; an example that the person has not changed.

        Guests have no programs of their own.
        """
        if session.guest_of and number is None and name in examples():
            self._accounts.require(session, Right.JOIN)
            return ProgramSource(examples()[name])
        self._accounts.require(session, Right.OPERATE)
        try:
            return await self._shelf.source(session.owner, name, number)
        except NotThere:
            if number is None and name in examples():
                return ProgramSource(examples()[name])
            raise

    async def versions(self, session: Session, name: str) -> Sequence[ProgramVersion]:
        """The stored versions of a program, the newest first."""
        self._accounts.require(session, Right.OPERATE)
        return await self._shelf.versions(session.owner, name)

    async def store(self, session: Session, name: str, source: ProgramSource) -> int:
        """Keep a program; returns its version."""
        self._accounts.require(session, Right.OPERATE)
        self._check_writing(session)
        check_program(name, source)
        return await self._shelf.store(session.owner, name, source)

    async def remove(self, session: Session, name: str) -> None:
        """Forget a program with all its versions."""
        self._accounts.require(session, Right.OPERATE)
        self._check_writing(session)
        await self._shelf.remove(session.owner, name)

    async def share(self, session: Session, name: str) -> str:
        """The word by which every signed-in person may read a program."""
        self._accounts.require(session, Right.OPERATE)
        return await self._shelf.share(session.owner, name)

    async def shared(self, session: Session, word: str) -> tuple[str, str, ProgramSource]:
        """Owner, name and source of a program that somebody shares."""
        self._accounts.require(session, Right.JOIN)
        return await self._shelf.shared(word)

    async def invite(self, session: Session, name: str, guests: int) -> tuple[str, Ticket]:
        """Make a ticket by which so many devices run a program without an account; returns the path of its link."""
        self._accounts.require(session, Right.OPERATE)
        kept = {program.name for program in await self._shelf.of(session.owner)}
        is_example = name in examples() and name not in kept
        path = f"/program?name={name}" if is_example else f"/program?shared={await self.share(session, name)}"
        word, ticket = self._accounts.guests.invite(session, path, guests)
        return f"/join?ticket={word}", ticket
