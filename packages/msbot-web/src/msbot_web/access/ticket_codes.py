"""Passes: the codes on pupils' tickets, which sign one pupil in without a password. Pure: time is passed in.

A pass says for whom it is and until when, and proves both with the key that only this robot's master has. Nothing is
stored, so it works on every device and after a restart. It covers the hash of the password: whoever gets a new password
has no pass any more, and nobody above a student ever has one.
"""

from __future__ import annotations

import base64
import binascii
import hmac
from collections.abc import Callable

from msbot.operations.rights import Right, Role
from msbot_agent.text.sentence import said
from msbot_web.access.accounts import Accounts
from msbot_web.access.guest_tickets import GuestTickets, Ticket
from msbot_web.access.guests import DEMO
from msbot_web.access.sessions import Session, json_size
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.users import User
from msbot_xrce.errors import ConfigError

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
            or not hmac.compare_digest(self._proof(user, ends_at).encode(), json_size(proof))
        ):
            raise SignInRefused(said("this ticket is not valid (any more): ask your teacher for a new one"))
        return name

    def admit(self, word: str) -> Session:
        """Sign in by a pass; raises as `find`."""
        user = self._user(self.find(word))
        assert user is not None
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
