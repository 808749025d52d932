"""How pupils come in by themselves, without a password. Pure: time is passed in.

1. A code of six characters, which a teacher shows for a few minutes, stands for a class ticket: it can be typed where
   nothing can be scanned. Guesses are spaced, for each address and for all: 31^6 codes outlast them by far.
2. A pupil of the list picks the own name and three pictures in order, which are printed on the pupil's ticket. They
   follow from the key of this robot's master and from the hash of the password, so nothing is stored, and a new
   password gives new ones. Wrong ones are counted like wrong passwords.
3. Whoever is not in the list waits until a teacher says yes: nobody makes a second account in another browser unseen.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable, Sequence
from enum import Enum, auto
from typing import Final

from msbot.registry.reserved_names import check_name
from msbot_agent.text.sentence import said
from msbot_web.access.sign_in_throttle import SignInRefused, Spacing
from msbot_web.access.users import User
from msbot_xrce.errors import ConfigError, NotThere
from msbot_xrce.lazy import dataclass

SIGNS: Final = "23456789ABCDEFGHJKMNPQRSTUVWXYZ"
"""Of a code: none looks like another one."""
CODE_SIGNS: Final = 6
CODE_S: Final = 1200.0
"""How long a code lets people in."""
MOST_CODES: Final = 100
WRONG_STEP_S, WRONG_BURST = 3.0, 20
"""Wrong codes from one address: a class that mistypes at once, then one in three seconds."""
TOTAL_STEP_S, TOTAL_BURST = 0.2, 100
"""The same for all addresses together."""
MOST_ADDRESSES: Final = 1000
MOST_WAITING: Final = 60
WAIT_S: Final = 1800.0
"""How long somebody who is not in the list is remembered."""
PICTURES: Final = tuple(
    (f"{name}.svg", word)
    for name, word in {
        "cat": said("cat"),
        "dog": said("dog"),
        "fish": said("fish"),
        "bird": said("bird"),
        "tree": said("tree"),
        "flower": said("flower"),
        "moon": said("moon"),
        "star": said("star"),
        "car": said("car"),
        "boat": said("boat"),
        "ball": said("ball"),
        "apple": said("apple"),
    }.items()
)
"""What pupils choose from: the file in `static/joining`, and the word for it. No letters, such as emoji, which many
computers of schools have no font for."""
CHOICES: Final = 3
"""Pictures of a pupil, in order."""


def pictures_of(user: User, key: bytes) -> tuple[int, ...]:
    """The three pictures of a pupil, as numbers in `PICTURES`.

    Args:
        user: whose.
        key: known to this robot's master alone.
    """
    told = f"pictures\0{user.name}\0{user.password_hash}".encode("utf-8", "surrogatepass")
    number = int.from_bytes(hmac.new(key, told, "sha256").digest())
    return tuple(number // len(PICTURES) ** place % len(PICTURES) for place in range(CHOICES))


@dataclass(frozen=True, slots=True)
class _Code:
    maker: str
    ticket: str
    ends_at: float


class JoinCodes:
    """Codes for class tickets; each teacher has one at a time.

    Args:
        clock: seconds, monotonic.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._codes: dict[str, _Code] = {}
        self._spacings: dict[str, Spacing] = {}
        self._total = Spacing(TOTAL_STEP_S, TOTAL_BURST)

    def make(self, maker: str, ticket: str) -> str:
        """A new code for a ticket; the one that this person made before ends."""
        self.forget_those_of(maker)
        if len(self._codes) >= MOST_CODES:
            del self._codes[next(iter(self._codes))]
        code = "".join(secrets.choice(SIGNS) for _ in range(CODE_SIGNS))
        self._codes[code] = _Code(maker, ticket, self._clock() + CODE_S)
        return code

    def left_s(self, code: str) -> float:
        """How long a code lets people in; 0: it does not."""
        found = self._codes.get(code)
        return 0.0 if found is None else max(0.0, found.ends_at - self._clock())

    def ticket_of(self, typed: str, address: str) -> str:
        """The word of the ticket that a code stands for, however it is spaced and written.

        Raises:
            SignInRefused: there is no such code, or too many wrong ones came from this address.
        """
        now = self._clock()
        spacing = self._spacing(address, now)
        wait_s = max(spacing.wait_s(now), self._total.wait_s(now))
        if wait_s > 0:
            raise SignInRefused(said("too many wrong codes: try again in {wait_s:.0f} s", wait_s=wait_s + 1), wait_s)
        code = "".join(sign for sign in typed[:64].upper() if sign in SIGNS)
        found = self._codes.get(code)
        if found is None or found.ends_at <= now:
            spacing.admit(now)
            self._total.admit(now)
            raise SignInRefused(said("there is no such code (any more): look at it again, or ask your teacher"))
        return found.ticket

    def forget_those_of(self, maker: str) -> None:
        """A person's code is worth nothing any more."""
        self._codes = {code: one for code, one in self._codes.items() if one.maker != maker}

    def _spacing(self, address: str, now: float) -> Spacing:
        if address not in self._spacings and len(self._spacings) >= MOST_ADDRESSES:
            self._spacings = {key: one for key, one in self._spacings.items() if one.empty_at > now}
            if len(self._spacings) >= MOST_ADDRESSES:
                del self._spacings[next(iter(self._spacings))]
        return self._spacings.setdefault(address, Spacing(WRONG_STEP_S, WRONG_BURST))


class WaitState(Enum):
    """What has become of somebody who is not in the list."""

    WAITING = auto()
    LET_IN = auto()
    REFUSED = auto()


@dataclass(slots=True)
class WaitingPupil:
    """Somebody who is not in the list."""

    name: str
    ticket: str
    until: float
    state: WaitState = WaitState.WAITING


class WaitingPupils:
    """Those who are not in the list, until a teacher has answered them and they have seen it.

    Args:
        clock: seconds, monotonic.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._by_word: dict[str, WaitingPupil] = {}

    def ask(self, name: str, ticket: str) -> str:
        """Wait for a teacher's yes; returns the word by which the browser asks for it.

        Raises:
            ConfigError: somebody of that name waits already, or too many do.
        """
        self._forget_old()
        others = [one.name for one in self._by_word.values() if one.state is not WaitState.REFUSED]
        if name in others:
            raise ConfigError(said("{name} waits already: choose another name", name=name))
        check_name(name, others)
        if len(self._by_word) >= MOST_WAITING:
            raise ConfigError(said("too many wait to come in: ask your teacher to let them in first"))
        word = secrets.token_urlsafe(16)
        self._by_word[word] = WaitingPupil(name, ticket, self._clock() + WAIT_S)
        return word

    def find(self, word: str) -> WaitingPupil | None:
        """Who asks by that word; None: nobody (any more)."""
        self._forget_old()
        return self._by_word.get(word)

    def names(self) -> Sequence[str]:
        """Who waits, the longest first."""
        self._forget_old()
        return [one.name for one in self._by_word.values() if one.state is WaitState.WAITING]

    def answer(self, name: str, state: WaitState) -> WaitingPupil:
        """A teacher has answered.

        Raises:
            NotThere: nobody of that name waits.
        """
        for one in self._by_word.values():
            if one.name == name and one.state is WaitState.WAITING:
                one.state = state
                return one
        raise NotThere(said("{name} does not wait to come in (any more)", name=name))

    def forget(self, word: str) -> None:
        """The browser has its answer."""
        self._by_word.pop(word, None)

    def _forget_old(self) -> None:
        now = self._clock()
        self._by_word = {word: one for word, one in self._by_word.items() if one.until > now}
