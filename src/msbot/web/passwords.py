"""Passwords as Argon2id hashes (RFC 9106), in the PHC string form that says its own parameters."""

from __future__ import annotations

import os
from typing import Protocol

from cryptography.exceptions import InvalidKey
from cryptography.hazmat.primitives.kdf.argon2 import Argon2id

from msbot.errors import ConfigError

SHORTEST = 8
"""Characters a password must have (NIST SP 800-63B)."""
LONGEST = 256

_MEMORY_KIB, _PASSES, _LANES = 19 * 1024, 2, 1
"""19 MiB and two passes: the OWASP minimum, about 35 ms on a small computer."""


class Hasher(Protocol):
    """Turns passwords into what may be stored."""

    def hash(self, password: str) -> str:
        """What is stored of a password; another text every time."""

    def matches(self, stored: str, password: str) -> bool:
        """Whether this is the password that was stored."""


class Argon2Hasher:
    """The `Hasher` of every real installation.

    Args:
        memory_kib: memory a hash takes, KiB.
    """

    def __init__(self, memory_kib: int = _MEMORY_KIB) -> None:
        self._memory_kib = memory_kib

    def hash(self, password: str) -> str:
        """See `Hasher.hash`."""
        kdf = Argon2id(salt=os.urandom(16), length=32, iterations=_PASSES, lanes=_LANES, memory_cost=self._memory_kib)
        return kdf.derive_phc_encoded(password.encode())

    def matches(self, stored: str, password: str) -> bool:
        """See `Hasher.matches`; a stored text that is no hash matches nothing."""
        try:
            Argon2id.verify_phc_encoded(password.encode(), stored)
        except (InvalidKey, ValueError):
            return False
        return True


def check_password(password: str) -> None:
    """Refuse passwords that are too easy to guess.

    Raises:
        ConfigError: it is too short or too long; the text says what would be right.
    """
    if len(password) < SHORTEST:
        raise ConfigError(f"a password needs at least {SHORTEST} characters; this one has {len(password)}")
    if len(password) > LONGEST:
        raise ConfigError(f"a password has at most {LONGEST} characters; this one has {len(password)}")
