"""Guests: who may invite them, how they come in, and with whom they go."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from msbot.operations.rights import Right, Role
from msbot_agent.text.sentence import said
from msbot_web.access.guest_tickets import GuestTickets, Ticket
from msbot_web.access.sessions import Session, SessionEndReason, Sessions
from msbot_web.access.sign_in_throttle import SignInRefused

DEMO = "demo"
"""Who the demo's own administrator is; no user of the store."""


class InvitingAccounts(Protocol):
    """What guests need of the accounts of the people who invite them."""

    sessions: Sessions
    """Who is signed in."""

    @property
    def has_entry_link(self) -> bool:
        """Whether the demo's administrator signs in by a link."""

    def require(self, session: Session, right: Right) -> None:
        """Raise SignedOut or NotAllowed unless the session may do this now."""

    def role_of(self, name: str) -> Role | None:
        """The role of a user; None: there is no such user."""


class Guests:
    """See the module's docstring.

    Args:
        accounts: of the people who invite.
        clock: seconds, monotonic.
    """

    def __init__(self, accounts: InvitingAccounts, clock: Callable[[], float]) -> None:
        self._accounts = accounts
        self.tickets = GuestTickets(clock)
        """To look at; `invite` makes one and `admit` uses it."""

    def invite(self, session: Session, path: str, guests: int) -> tuple[str, Ticket]:
        """Make a ticket by which so many devices join without an account; returns its word, too.

        Raises:
            SignedOut: the session has ended.
            NotAllowed: guests invite nobody; a whole class only a teacher.
            ConfigError: not so many devices.
        """
        self._accounts.require(session, Right.OPERATE if guests <= 1 else Right.ARRANGE)
        return self.tickets.make(session.name, path, guests)

    def admit(self, word: str) -> tuple[Session, str]:
        """Begin the session of a guest; returns it with the path that the ticket opens.

        Raises:
            SignInRefused: the ticket is used up or too old, or who made it may not run parts any more.
        """
        ticket = self.tickets.find(word)
        if not self.may_invite(ticket.maker):
            raise SignInRefused(said("{name} may not invite guests any more", name=ticket.maker))
        self.tickets.admit(word)
        name = f"guest of {ticket.maker}"
        return self._accounts.sessions.begin(name, Role.VIEWER, guest_of=ticket.maker), ticket.path

    def may_invite(self, maker: str) -> bool:
        """Whether that person may run parts now, and so may their guests."""
        role = self._accounts.role_of(maker)
        is_demo = maker == DEMO and role is None and self._accounts.has_entry_link
        return is_demo or (role is not None and role >= Right.OPERATE.least)

    def pupil_behind(self, session: Session) -> str:
        """The pupil with whom a teacher holds what somebody runs; empty: it is a teacher.

        A pupil's guest is that pupil: whoever is held is not free by a ticket for the own telephone.
        """
        if session.may(Right.ARRANGE):
            return ""
        role = self._accounts.role_of(session.guest_of) if session.guest_of else None
        return session.name if role is None or role >= Right.ARRANGE.least else session.guest_of

    def end_all_of(self, name: str, why: SessionEndReason) -> None:
        """End the sessions of a person, those of their guests, and their tickets."""
        self.tickets.forget_those_of(name)
        self._accounts.sessions.end_all_of(name, why)
