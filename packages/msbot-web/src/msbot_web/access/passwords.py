"""Passwords as Argon2id hashes (RFC 9106), in the PHC string form that states its own parameters."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Generic, Protocol, TypeVar

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError, VerifyMismatchError
from argon2.low_level import Type

from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, MsbotError

# Whose password is hashed next: everybody in turn, so that nobody's many tries delay another's. Pure.
#
# Hashing is slow on purpose, so tries wait. Each asker (a browser, an address, a person who administers) has a queue of
# its own, and the queues have their turn one after the other: whoever sends a hundred tries at once delays another one's
# by a single hash.


Job = TypeVar("Job")

MOST_OF_ONE = 40
"""Tries of one asker that may wait: a class behind one router signs in at once."""
MOST_ALL = 400
"""Tries that may wait in all."""


class HashQueue(Generic[Job]):
    """Whose password is hashed next: everybody in turn, so that nobody's many tries delay another's. Pure."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Job]] = {}
        """By asker; whose turn it is first."""

    def __len__(self) -> int:
        """How many wait."""
        return sum(map(len, self._waiting.values()))

    def add(self, asker: str, job: Job) -> bool:
        """Have a job wait for its turn; False: too many wait already, and it does not."""
        waiting = self._waiting.get(asker, ())
        if len(waiting) >= MOST_OF_ONE or len(self) >= MOST_ALL:
            return False
        self._waiting.setdefault(asker, deque()).append(job)
        return True

    def next(self) -> Job | None:
        """Whose turn it is, which waits no more; None: nobody waits."""
        if not self._waiting:
            return None
        asker, jobs = next(iter(self._waiting.items()))
        del self._waiting[asker]
        job = jobs.popleft()
        if jobs:  # the next one of theirs after all others
            self._waiting[asker] = jobs
        return job


T = TypeVar("T")

SHORTEST = 8
"""Characters a password must have (NIST SP 800-63B)."""
LONGEST = 256
AT_ONCE = 2
"""Hashes that are computed at the same time; each takes a processor core and 19 MiB for some 35 ms."""

_MEMORY_KIB, _PASSES, _LANES = 19 * 1024, 2, 1
"""19 MiB and two passes: the OWASP minimum."""


class TooManyHashes(MsbotError):
    """So many passwords of one asker, or of all, wait to be hashed that this one is turned away."""


class Hasher(Protocol):
    """Turns passwords into what may be stored."""

    async def hash(self, password: str, *, asker: str) -> str:
        """What is stored of a password; another text every time.

        Args:
            password: what somebody has typed.
            asker: who waits for it; different askers have their turn one after the other.

        Raises:
            TooManyHashes: see there.
        """

    async def matches(self, stored: str, password: str, *, asker: str) -> bool:
        """Whether this is the password that was stored; `asker` as in `hash`."""

    def is_outdated(self, stored: str) -> bool:
        """Whether the stored hash should be replaced by a new one, now that the password is known."""


class Argon2Hasher:
    """The `Hasher` of every real installation: at most two hashes at once, in threads of their own.

    Args:
        memory_kib: memory a hash takes, KiB.
    """

    def __init__(self, memory_kib: int = _MEMORY_KIB) -> None:
        self._argon2 = PasswordHasher(_PASSES, memory_kib, _LANES, type=Type.ID)
        self._threads = ThreadPoolExecutor(AT_ONCE, "password")
        self._queue: HashQueue[tuple[asyncio.Future[Any], Callable[[], object]]] = HashQueue()
        self._running = 0

    async def hash(self, password: str, *, asker: str) -> str:
        """See `Hasher.hash`."""
        return await self._in_turn(asker, partial(self._argon2.hash, password))

    async def matches(self, stored: str, password: str, *, asker: str) -> bool:
        """See `Hasher.matches`; a stored text that is not a hash matches nothing."""
        return await self._in_turn(asker, partial(self._verify, stored, password))

    def is_outdated(self, stored: str) -> bool:
        """See `Hasher.is_outdated`: made with other parameters than today's."""
        return self._argon2.check_needs_rehash(stored)

    def close(self) -> None:
        """Stop working out hashes."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _in_turn(self, asker: str, work: Callable[[], T]) -> T:
        done: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        if not self._queue.add(asker, (done, work)):
            raise TooManyHashes(said("too many people are signing in at this moment: try again in 10 s"))
        self._begin()
        return await done

    def _begin(self) -> None:
        """Begin with whoever's turn it is, as long as a thread is free."""
        while self._running < AT_ONCE and (found := self._queue.next()) is not None:
            done, work = found
            if done.done():  # who has asked did not wait for it
                continue
            self._running += 1
            working = done.get_loop().run_in_executor(self._threads, work)
            working.add_done_callback(partial(self._finish, done))

    def _finish(self, done: asyncio.Future[Any], working: asyncio.Future[Any]) -> None:
        self._running -= 1
        if not done.done():
            if working.cancelled():
                done.cancel()
            elif (error := working.exception()) is not None:
                done.set_exception(error)
            else:
                done.set_result(working.result())
        self._begin()

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
