"""Passes: the codes on pupils' tickets, which sign one pupil in without a password. Pure: time is passed in.

A pass says for whom it is and until when, and proves both with the key that only this robot's master has. Nothing is
stored, so it works on every device and after a restart. It covers the hash of the password: whoever gets a new password
has no pass any more, and nobody above a student ever has one.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import hmac
from collections.abc import Callable, Sequence

from msbot.operations.rights import Right, Role
from msbot_agent.text.sentence import said
from msbot_web.access.accounts import Accounts
from msbot_web.access.class_list import new_password
from msbot_web.access.guest_tickets import GuestTickets, Ticket
from msbot_web.access.guests import DEMO
from msbot_web.access.joining import JoinCodes, WaitingPupils, WaitState, pictures_of
from msbot_web.access.sessions import Session, octets_of_token
from msbot_web.access.sign_in_throttle import SignInRefused, SignInThrottle
from msbot_web.access.users import User
from msbot_xrce.errors import ConfigError, NotThere

LONGEST_DAYS = 30
CLASS_TICKET_S = 3600.0
"""How long a class ticket lets people in."""
_PROOF_OCTETS = 16
_LONGEST = 400


class TicketCodes:
    """See the module's docstring.

    Args:
        accounts: whom they are for.
        clock: seconds, monotonic: for class tickets.
        wall_clock: seconds since 1970: a pass is printed on paper.
    """

    def __init__(self, accounts: Accounts, clock: Callable[[], float], wall_clock: Callable[[], float]) -> None:
        self._accounts = accounts
        self._now = wall_clock
        self.class_tickets = GuestTickets(clock, CLASS_TICKET_S)
        """By which pupils make accounts of their own."""

        self.codes = JoinCodes(clock)
        """Codes that stand for these tickets."""
        self.waiting = WaitingPupils(clock)
        """Who is not in the list, and waits for a teacher's yes."""
        self._clock = clock
        self._picture_tries = SignInThrottle()

    def make(self, name: str, days: int) -> str:
        """The word of a pass for a pupil, valid for so many days.

        Raises:
            ConfigError: there is no such pupil, or not so many days.
        """
        if not 1 <= days <= LONGEST_DAYS:
            raise ConfigError(said("a ticket is valid for 1 to {most} days, not {days}", most=LONGEST_DAYS, days=days))
        user = self._user(name)
        if user is None or user.role > Role.STUDENT:
            raise ConfigError(said("there is no pupil {name!r}: only pupils have tickets", name=name))
        ends_at = int(self._now()) + days * 86_400
        told = base64.urlsafe_b64encode(name.encode()).decode().rstrip("=")
        return f"{told}.{ends_at:x}.{self._proof(user, ends_at)}"

    def find(self, word: str) -> str:
        """For whom a pass is that is valid now; looking does not sign anybody in.

        Raises:
            SignInRefused: it is not valid, or not any more.
        """
        told, _, rest = word[:_LONGEST].partition(".")
        ends, _, proof = rest.partition(".")
        try:
            name = base64.b64decode(told + "=" * (-len(told) % 4), b"-_", validate=True).decode()
            ends_at = int(ends, 16)
        except (binascii.Error, ValueError):
            name, ends_at = "", 0
        user = self._user(name)
        if (
            user is None
            or user.role > Role.STUDENT
            or not self._now() < ends_at <= self._now() + LONGEST_DAYS * 86_400
            or not hmac.compare_digest(self._proof(user, ends_at).encode(), octets_of_token(proof))
        ):
            raise SignInRefused(said("this ticket is not valid (any more): ask your teacher for a new one"))
        return name

    def admit(self, word: str) -> Session:
        """Sign in by a pass; raises as `find`."""
        user = self._user(self.find(word))
        assert user is not None
        return self._accounts.sessions.begin(user.name, user.role)

    def pupils(self) -> list[str]:
        """The list that whoever comes in finds the own name in."""
        names = [user.name for user in self._accounts.users() if user.role is Role.STUDENT]
        return sorted(names, key=str.casefold)

    def pictures(self, name: str) -> tuple[int, ...]:
        """The three pictures of a pupil; of nobody some that nobody has been told."""
        user = self._user(name) or User(name, Role.STUDENT, "")
        return pictures_of(user, self._accounts.ticket_key)

    async def admit_by_pictures(self, name: str, chosen: Sequence[str], address: str) -> Session:
        """Sign a pupil of the list in.

        Args:
            name: who it claims to be.
            chosen: the numbers of the pictures, as they come in.
            address: where from.

        Raises:
            SignInRefused: these are not the pictures, or too many wrong ones were chosen.
        """
        wait_s = self._picture_tries.admit(name, address, "", self._clock())
        try:
            await asyncio.sleep(wait_s)
        except asyncio.CancelledError:
            self._picture_tries.abandoned(name, address, "")
            raise
        user, told = self._user(name), ",".join(map(str, self.pictures(name)))
        is_right = hmac.compare_digest(told.encode(), octets_of_token(",".join(chosen)))
        if user is None or user.role is not Role.STUDENT or not is_right:
            raise SignInRefused(said("these are not your pictures: look at your ticket, or ask your teacher"))
        self._picture_tries.right(name, address, "")
        return self._accounts.sessions.begin(user.name, user.role)

    def ask_to_come_in(self, name: str, ticket: str) -> str:
        """Somebody who is not in the list waits for a teacher's yes; returns the word that tells the answer.

        Raises:
            SignInRefused: as `find_class`.
            ConfigError: the name is taken or makes no sense, or too many wait.
        """
        self.find_class(ticket)
        self._accounts.check_new_name(name)
        word = self.waiting.ask(name, ticket)
        self.class_tickets.admit(ticket)
        return word

    async def let_in(self, name: str, who: str) -> None:
        """A teacher lets somebody in who waits.

        Raises:
            ConfigError: nobody of that name waits, or the name was taken meanwhile.
        """
        if name not in self.waiting.names():
            raise NotThere(said("{name} does not wait to come in (any more)", name=name))
        await self._accounts.add_user(name, Role.STUDENT, new_password(), who=who)
        self.waiting.answer(name, WaitState.LET_IN)

    def turn_away(self, name: str) -> None:
        """A teacher does not let somebody in; raises as `let_in`."""
        self.class_tickets.give_back(self.waiting.answer(name, WaitState.REFUSED).ticket)

    def admit_waiting(self, word: str) -> Session:
        """Sign somebody in whom a teacher has let in.

        Raises:
            SignInRefused: nobody was let in by that word.
        """
        found = self.waiting.find(word)
        user = None if found is None or found.state is not WaitState.LET_IN else self._user(found.name)
        if user is None or user.role is not Role.STUDENT:
            raise SignInRefused(said("you were not let in: ask your teacher"))
        self.waiting.forget(word)
        return self._accounts.sessions.begin(user.name, user.role)

    def find_class(self, word: str) -> Ticket:
        """A class ticket by which pupils can come in now; looking does not use it.

        Raises:
            SignInRefused: it is used up or too old, or who made it may not let anybody in any more.
        """
        ticket = self.class_tickets.find(word)
        role = self._accounts.role_of(ticket.maker)
        is_demo = ticket.maker == DEMO and role is None and self._accounts.has_entry_link
        if not is_demo and (role is None or role < Right.ARRANGE.least):
            raise SignInRefused(said("{name} may not let a class in any more", name=ticket.maker))
        return ticket

    def _user(self, name: str) -> User | None:
        return next((user for user in self._accounts.users() if user.name == name), None)

    def _proof(self, user: User, ends_at: int) -> str:
        told = f"pass\0{user.name}\0{ends_at:x}\0{user.password_hash}".encode()
        proof = hmac.new(self._accounts.ticket_key, told, "sha256").digest()[:_PROOF_OCTETS]
        return base64.urlsafe_b64encode(proof).decode().rstrip("=")
