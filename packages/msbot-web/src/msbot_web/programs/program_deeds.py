"""What a signed-in person can do with programs; rights and limits are checked here, for page and API alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msbot.operations.rights import Right
from msbot.registry import ProgramRecord, ProgramSource, ProgramVersion
from msbot_web.access.accounts import Accounts
from msbot_web.access.guest_tickets import Ticket
from msbot_web.access.sessions import Session
from msbot_web.programs.browser_files import examples
from msbot_web.programs.program_shelf import ProgramShelf, check_program
from msbot_xrce.errors import NotThere


class ProgramDeeds:
    """See the module's docstring. Everybody has programs of their own; others see one only by its word.

    Args:
        shelf: where they are kept.
        accounts: who is signed in.
        check_writing: raises when a person may not change the own programs now.
    """

    def __init__(
        self, shelf: ProgramShelf, accounts: Accounts, check_writing: Callable[[Session], None] = lambda _: None
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

    async def keep(self, session: Session, name: str, source: ProgramSource) -> int:
        """Keep a program; returns its version."""
        self._accounts.require(session, Right.OPERATE)
        self._check_writing(session)
        check_program(name, source)
        return await self._shelf.keep(session.owner, name, source)

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
