"""The people who may sign in, and where they are kept."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Protocol

from msbot.operations.rights import Role
from msbot_xrce.lazy import dataclass

OF_PARTS = "parts:"


@dataclass(frozen=True, slots=True)
class User:
    """One person who may sign in."""

    name: str
    role: Role
    password_hash: str
    tokens: tuple[tuple[str, str], ...] = ()
    """API tokens: (what it is for, SHA-256 in hexadecimal digits); with `OF_PARTS` before it, a ticket for a relay or an
    agent, which opens the door of parts and no other."""
    since_ns: int = 0
    """When the account was made, on the wall clock: another account of the same name is another person."""

    @property
    def api_tokens(self) -> list[str]:
        """What the API tokens are for."""
        return [purpose for purpose, digest in self.tokens if not digest.startswith(OF_PARTS)]

    @property
    def tickets(self) -> list[str]:
        """For which relays and agents there are tickets."""
        return [purpose for purpose, digest in self.tokens if digest.startswith(OF_PARTS)]

    @property
    def fingerprint(self) -> str:
        """Tells this account with this password from every other, also from a later one of the same name."""
        return hashlib.sha256(f"{self.name}\0{self.password_hash}".encode("utf-8", "surrogatepass")).hexdigest()


class UserStore(Protocol):
    """Where users are kept: the registry, or memory. Methods may raise `RegistryError`.

    A change waits until it is stored, without blocking the event loop.
    """

    def users(self) -> list[User]:
        """All users, by name."""

    async def keep_users(self, users: Sequence[User], who: str) -> None:
        """Add users, or replace those of these names: all of them, or nobody; journalled with who did it."""

    async def remove_user(self, name: str, who: str) -> None:
        """Forget a user."""


class MemoryUsers:
    """A `UserStore` that lasts as long as the process."""

    def __init__(self, *users: User) -> None:
        self._users = {user.name: user for user in users}

    def users(self) -> list[User]:
        """See `UserStore.users`."""
        return sorted(self._users.values(), key=lambda user: user.name)

    async def keep_users(self, users: Sequence[User], who: str) -> None:  # noqa: ARG002 - the protocol's signature
        """See `UserStore.keep_users`."""
        self._users.update({user.name: user for user in users})

    async def remove_user(self, name: str, who: str) -> None:  # noqa: ARG002
        """See `UserStore.remove_user`."""
        self._users.pop(name, None)
