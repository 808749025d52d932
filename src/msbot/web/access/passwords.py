"""Passwords as Argon2id hashes (RFC 9106), in the PHC string form that states its own parameters."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError, VerifyMismatchError
from argon2.low_level import Type

from msbot.errors import ConfigError
from msbot.runtime.sentence import said

SHORTEST = 8
"""Characters a password must have (NIST SP 800-63B)."""
LONGEST = 256
AT_ONCE = 2
"""Hashes that are computed at the same time; each takes a processor core and 19 MiB for some 35 ms."""

_MEMORY_KIB, _PASSES, _LANES = 19 * 1024, 2, 1
"""19 MiB and two passes: the OWASP minimum."""


class Hasher(Protocol):
    """Turns passwords into what may be stored."""

    async def hash(self, password: str) -> str:
        """What is stored of a password; another text every time."""

    async def matches(self, stored: str, password: str) -> bool:
        """Whether this is the password that was stored."""

    def is_outdated(self, stored: str) -> bool:
        """Whether the stored hash should be replaced by a new one, now that the password is known."""


class Argon2Hasher:
    """The `Hasher` of every real installation: at most two hashes at once, and never in the event loop.

    Args:
        memory_kib: memory a hash takes, KiB.
    """

    def __init__(self, memory_kib: int = _MEMORY_KIB) -> None:
        self._argon2 = PasswordHasher(_PASSES, memory_kib, _LANES, type=Type.ID)
        self._threads = ThreadPoolExecutor(AT_ONCE, "password")

    async def hash(self, password: str) -> str:
        """See `Hasher.hash`."""
        return await asyncio.get_running_loop().run_in_executor(self._threads, self._argon2.hash, password)

    async def matches(self, stored: str, password: str) -> bool:
        """See `Hasher.matches`; a stored text that is not a hash matches nothing."""
        return await asyncio.get_running_loop().run_in_executor(self._threads, self._verify, stored, password)

    def is_outdated(self, stored: str) -> bool:
        """See `Hasher.is_outdated`: made with other parameters than today's."""
        return self._argon2.check_needs_rehash(stored)

    def close(self) -> None:
        """Stop working out hashes."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _verify(self, stored: str, password: str) -> bool:
        try:
            return self._argon2.verify(stored, password)
        except (VerifyMismatchError, VerificationError, InvalidHashError):
            return False


def check_password(password: str) -> None:
    """Refuse passwords that are too easy to guess.

    Raises:
        ConfigError: it is too short or too long; the text says what would be right.
    """
    if len(password) < SHORTEST:
        raise ConfigError(
            said(
                "a password needs at least {shortest} characters; this one has {count}",
                shortest=SHORTEST,
                count=len(password),
            )
        )
    if len(password) > LONGEST:
        raise ConfigError(
            said(
                "a password has at most {longest} characters; this one has {count}",
                longest=LONGEST,
                count=len(password),
            )
        )
