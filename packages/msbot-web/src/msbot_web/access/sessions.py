"""The browsers that are signed in. Pure: time is handed in.

A session is a random word in a cookie; the master knows only its SHA-256, so what is kept over a restart signs nobody
in. When a session ends, those who asked are told: open pages are closed then, not at their next click.
"""

from __future__ import annotations

import hashlib
import secrets
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import field
from enum import Enum, auto

from msbot.operations.rights import Right, Role
from msbot_agent.text.sentence import said
from msbot_xrce.lazy import dataclass

IDLE_S = 8 * 3600.0
"""A session that is not used for this long ends: a school day."""
LONGEST_S = 7 * 24 * 3600.0
"""No session is longer than a week, however busy."""
GUEST_S = 4 * 3600.0
"""A guest of a lesson stays no longer."""
MOST_SESSIONS = 1000
"""If there are more, the person with the most loses their longest unused one: nobody ends another's."""


class SessionEndReason(Enum):
    """Why a session has ended, as far as the person has to be told."""

    SIGNED_OUT = auto()
    REMOVED = auto()
    NEW_PASSWORD = auto()
    TIME_OVER = auto()
    GUEST_OVER = auto()

    def describe(self, name: str) -> str:
        """What the browser of that person says about it; empty: nothing."""
        match self:
            case SessionEndReason.REMOVED:
                return said("the account {name} was removed: ask your teacher if that is a mistake", name=name)
            case SessionEndReason.NEW_PASSWORD:
                return said("the password of {name} was changed: sign in with the new one", name=name)
            case SessionEndReason.TIME_OVER:
                return said("{name} was signed out because nothing was done here for long: sign in again", name=name)
            case SessionEndReason.GUEST_OVER:
                return said("your time as a guest is over: ask for a new code")
        return ""


@dataclass(slots=True, eq=False)
class Session:
    """One signed-in browser, or one use of an API token."""

    name: str
    role: Role
    began_at: float
    used_at: float
    key: str = ""
    """The SHA-256 of the cookie's word; empty for an API token."""
    program: str = ""
    """The SHA-256 of the API token; empty for a browser."""
    token: str = ""
    """The cookie's word; known only where the session began."""
    csrf: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """What a changing request has to show in addition to the cookie."""
    is_lasting: bool = False
    """True: no user of the store stands behind it (the demo's own administrator)."""
    guest_of: str = ""
    """Who made the ticket by which a guest came in; empty for people who have signed in."""

    @property
    def owner(self) -> str:
        """Whose programs are kept under: no account's where no account is behind it."""
        return f"({self.name})" if self.is_lasting or self.guest_of else self.name

    @property
    def holder(self) -> str:
        """What holds what is driven by hand: the browser's session, or the API token."""
        return self.key or self.program

    @property
    def is_program(self) -> bool:
        """Whether a program with an API token is behind it, and no browser."""
        return not self.key

    def may(self, right: Right) -> bool:
        """Whether the role has that right, or a guest came to make use of it."""
        return self.role >= right.least or (bool(self.guest_of) and right is Right.JOIN)

    def is_of(self, name: str) -> bool:
        """Whether that user has signed in here; a guest is no user, whatever users are called."""
        return self.name == name and not self.is_lasting and not self.guest_of


@dataclass(frozen=True, slots=True)
class KeptSession:
    """The part of a session that outlives the master: nothing that could be used instead of the cookie."""

    key: str
    name: str
    csrf: str
    age_s: float
    idle_s: float
    guest_of: str = ""
    mark: str = ""
    """Of the account behind it (`User.fingerprint`): an account of the same name that was made since is another."""


class Sessions:
    """See the module's docstring.

    Args:
        clock: seconds, monotonic.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._by_key: dict[str, Session] = {}
        self._why_ended: dict[str, str] = {}
        """What those are told whose sessions have ended, by the SHA-256 of the cookie's word; the newest last."""
        self._listeners: list[Callable[[Session], None]] = []

    @property
    def count(self) -> int:
        """How many there are; some may be too old."""
        return len(self._by_key)

    def on_end(self, listener: Callable[[Session], None]) -> None:
        """Call `listener` with every session that ends, or whose pages must be rebuilt because the role changed."""
        self._listeners.append(listener)

    def begin(self, name: str, role: Role, *, is_lasting: bool = False, guest_of: str = "") -> Session:
        """Begin a session."""
        if len(self._by_key) >= MOST_SESSIONS:
            self._drop_one()
        now, token = self._clock(), secrets.token_urlsafe(32)
        session = Session(
            name, role, now, now, key=digest_of(token), token=token, is_lasting=is_lasting, guest_of=guest_of
        )
        self._by_key[session.key] = session
        return session

    def find(self, token: str) -> Session | None:
        """The session of a cookie, whether or not it still holds."""
        return self._by_key.get(digest_of(token)) if token else None

    def is_fresh(self, session: Session) -> bool:
        """Whether a session has not ended and is not too old; looking at that does not count as using it."""
        now = self._clock()
        longest_s = GUEST_S if session.guest_of else LONGEST_S
        is_young = now - session.used_at <= IDLE_S and now - session.began_at <= longest_s
        return self._by_key.get(session.key) is session and is_young

    def touch(self, session: Session) -> None:
        """Note that the person did something."""
        session.used_at = self._clock()

    def end(self, session: Session, why: SessionEndReason = SessionEndReason.SIGNED_OUT) -> None:
        """End a session."""
        if self._by_key.get(session.key) is session:
            if why is SessionEndReason.SIGNED_OUT and not self.is_fresh(session):
                why = SessionEndReason.TIME_OVER
            del self._by_key[session.key]
            self._note_end(session, why)
            self._tell(session)

    def end_all_of(self, name: str, why: SessionEndReason) -> None:
        """End the sessions of a person, and of the guests whom that person has let in."""
        for session in list(self._by_key.values()):
            if session.is_of(name) or session.guest_of == name:
                self.end(session, why)

    def why_ended(self, token: str) -> str:
        """Why the session of a cookie has ended, in words for its person; empty: there is nothing to tell."""
        return self._why_ended.get(digest_of(token), "") if token else ""

    def _note_end(self, session: Session | KeptSession, why: SessionEndReason) -> None:
        words = (SessionEndReason.GUEST_OVER if session.guest_of else why).describe(session.name)
        if words:
            self._why_ended[session.key] = words
            if len(self._why_ended) > MOST_SESSIONS:
                del self._why_ended[next(iter(self._why_ended))]

    def change_role(self, name: str, role: Role) -> None:
        """Give the sessions of a person another role; their open pages are rebuilt."""
        for session in self.of(name):
            if session.role is not role:
                session.role = role
                self._tell(session)

    def end_old(self) -> None:
        """End the sessions whose time is over; to be called now and then."""
        for session in list(self._by_key.values()):
            if not self.is_fresh(session):
                self.end(session)

    def of(self, name: str) -> list[Session]:
        """The sessions of a user."""
        return [one for one in self._by_key.values() if one.is_of(name)]

    def to_persist(self, mark_of: Callable[[str], str]) -> list[KeptSession]:
        """The sessions that should outlive the master; `mark_of`: the mark of the account of a name."""
        now = self._clock()
        return [
            KeptSession(
                one.key,
                one.name,
                one.csrf,
                now - one.began_at,
                now - one.used_at,
                one.guest_of,
                mark_of(one.guest_of or one.name),
            )
            for one in self._by_key.values()
            if not one.is_lasting
        ]

    def of_demo(self, maker: str) -> list[KeptSession]:
        """The sessions behind which no account is, for the robot that takes this one's place: the demo's own
        administrator's, and those of the guests whom `maker`, that one, has let in."""
        now = self._clock()
        return [
            KeptSession(one.key, one.name, one.csrf, now - one.began_at, now - one.used_at, one.guest_of)
            for one in self._by_key.values()
            if one.is_lasting or one.guest_of == maker
        ]

    def take_over(self, kept: Iterable[KeptSession]) -> None:
        """Go on with what `of_demo` gave."""
        now = self._clock()
        for one in kept:
            role, is_lasting = (Role.VIEWER, False) if one.guest_of else (Role.ADMINISTRATOR, True)
            self._by_key[one.key] = Session(
                one.name,
                role,
                now - one.age_s,
                now - one.idle_s,
                key=one.key,
                csrf=one.csrf,
                is_lasting=is_lasting,
                guest_of=one.guest_of,
            )

    def bring_back(
        self,
        kept: Iterable[KeptSession],
        away_s: float,
        role_of: Callable[[str], Role | None],
        mark_of: Callable[[str], str],
    ) -> None:
        """Restore sessions of an earlier run.

        Args:
            kept: what `kept` gave.
            away_s: seconds since then.
            role_of: the role of a user; None: there is no such user any more.
            mark_of: the mark of the account of a name, as `kept` had it.
        """
        now = self._clock()
        for one in kept:
            role = role_of(one.guest_of or one.name)
            if role is None:
                self._note_end(one, SessionEndReason.REMOVED)
            elif one.mark != mark_of(one.guest_of or one.name):
                self._note_end(one, SessionEndReason.NEW_PASSWORD)
                continue
            if role is None or len(self._by_key) >= MOST_SESSIONS:
                continue
            session = Session(
                one.name,
                Role.VIEWER if one.guest_of else role,
                now - one.age_s - away_s,
                now - one.idle_s - away_s,
                key=one.key,
                csrf=one.csrf,
                guest_of=one.guest_of,
            )
            self._by_key[one.key] = session
            if not self.is_fresh(session):
                del self._by_key[one.key]
                self._note_end(session, SessionEndReason.TIME_OVER)

    def _drop_one(self) -> None:
        ((greedy, _),) = Counter(session.name for session in self._by_key.values()).most_common(1)
        oldest = min((one for one in self._by_key.values() if one.name == greedy), key=lambda one: one.used_at)
        self.end(oldest)

    def _tell(self, session: Session) -> None:
        for listener in self._listeners:
            listener(session)


def digest_of(token: str) -> str:
    """What is stored of a random word: it cannot be guessed, so a slow hash would add nothing."""
    return hashlib.sha256(octets_of_token(token)).hexdigest()


def octets_of_token(word: str) -> bytes:
    """A word that somebody has shown, for comparing it in constant time: whatever characters or halves are in it."""
    return word.encode("utf-8", "surrogatepass")
