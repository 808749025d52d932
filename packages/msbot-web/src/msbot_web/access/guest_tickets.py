"""Tickets for guests: whoever scans one joins with a part from their own device, without an account. Pure: time is
passed in.

A ticket is a random word in a link, of which only the SHA-256 is kept. It opens one program, for a few minutes, for one
device or for a class. The guest may see the robot, press STOP and run parts, nothing else; behind each guest is the
person who made the ticket.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable

from msbot_agent.text.sentence import said
from msbot_web.access.sessions import digest_of
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

TICKET_S = 600.0
"""How long a ticket can be used."""
MOST_GUESTS = 30
"""Devices that a ticket lets in at most: a class."""
MOST_OF_ONE = 20
"""Tickets of one person; a further one ends the oldest."""


@dataclass(slots=True)
class Ticket:
    """One ticket."""

    maker: str
    """Who made it."""
    path: str
    """The page of this server that it opens."""
    ends_at: float
    left: int
    """How many more devices it lets in."""
    guests: int = 0
    """How many it has let in."""


class GuestTickets:
    """See the module's docstring.

    Args:
        clock: seconds, monotonic.
        lasts_s: how long a ticket can be used.
    """

    def __init__(self, clock: Callable[[], float], lasts_s: float = TICKET_S) -> None:
        self._clock = clock
        self._lasts_s = lasts_s
        self._by_digest: dict[str, Ticket] = {}

    def make(self, maker: str, path: str, guests: int) -> tuple[str, Ticket]:
        """Make a ticket for so many devices; returns its word, which cannot be read again.

        Raises:
            ConfigError: not so many.
        """
        if not 1 <= guests <= MOST_GUESTS:
            raise ConfigError(
                said("a ticket is for 1 to {most} devices, not {guests}", most=MOST_GUESTS, guests=guests)
            )
        self._forget_old()
        mine = [digest for digest, one in self._by_digest.items() if one.maker == maker]
        if len(mine) >= MOST_OF_ONE:
            del self._by_digest[mine[0]]
        word = secrets.token_urlsafe(24)
        ticket = self._by_digest[digest_of(word)] = Ticket(maker, path, self._clock() + self._lasts_s, guests)
        return word, ticket

    def find(self, word: str) -> Ticket:
        """A ticket that can be used; looking at it does not use it.

        Raises:
            SignInRefused: it is used up, too old, or none of this run.
        """
        self._forget_old()
        ticket = self._by_digest.get(digest_of(word))
        if ticket is None or not ticket.left:
            raise SignInRefused(said("this code is used up or too old: have a new one shown to you"))
        return ticket

    def path_of(self, word: str) -> str:
        """What the ticket of that word opens, also when it is used up; empty when there is no such ticket."""
        ticket = self._by_digest.get(digest_of(word))
        return "" if ticket is None else ticket.path

    def admit(self, word: str) -> Ticket:
        """Let a device in; raises as `find`."""
        ticket = self.find(word)
        ticket.left -= 1
        ticket.guests += 1
        return ticket

    def give_back(self, word: str) -> None:
        """Whoever was let in by `use` does not come in after all."""
        ticket = self._by_digest.get(digest_of(word))
        if ticket is not None and ticket.guests:
            ticket.left += 1
            ticket.guests -= 1

    def forget_those_of(self, maker: str) -> None:
        """A person's tickets are worth nothing any more."""
        self._by_digest = {digest: one for digest, one in self._by_digest.items() if one.maker != maker}

    def _forget_old(self) -> None:
        now = self._clock()
        self._by_digest = {digest: one for digest, one in self._by_digest.items() if one.ends_at > now}
