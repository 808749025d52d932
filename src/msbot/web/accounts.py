"""Who is signed in: users, sessions, API tokens, and what happens after wrong passwords. Pure: time is handed in.

A session is a random word in a cookie; everything about it is kept here, so that signing out, a changed role and a
removed user take effect at once. API tokens are random words, too; only their SHA-256 is stored (they cannot be
guessed, so a slow hash would add nothing).
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from msbot.errors import ConfigError, MsbotError
from msbot.web.passwords import Argon2Hasher, Hasher, check_password
from msbot.web.roles import Right, Role, role_named

IDLE_S = 8 * 3600.0
"""A session that is not used for that long ends: a school day."""
LONGEST_S = 7 * 24 * 3600.0
"""No session is longer than a week, however busy."""
FREE_TRIES = 5
"""Wrong passwords in a row before a pause."""
FIRST_PAUSE_S = 30.0
"""The pause after that; it doubles with every further wrong password."""
LONGEST_PAUSE_S = 900.0
MOST_SESSIONS = 1000
MOST_NAMES_WATCHED = 10_000
MAX_NAME = 64

_NOBODYS_PASSWORD = "no user has this password"


@dataclass(frozen=True, slots=True)
class User:
    """One person who may sign in."""

    name: str
    role: Role
    password_hash: str
    tokens: tuple[tuple[str, str], ...] = ()
    """API tokens: (what it is for, SHA-256 in hexadecimal digits)."""


class UserStore(Protocol):
    """Where users are kept: the registry, or memory. Methods may raise `RegistryError`."""

    def users(self) -> list[User]:
        """All users, by name."""

    def user(self, name: str) -> User | None:
        """The user of that name."""

    def keep_user(self, user: User, who: str) -> None:
        """Add a user, or replace the one of that name; journalled with who did it."""

    def remove_user(self, name: str, who: str) -> None:
        """Forget a user."""


class MemoryUsers:
    """A `UserStore` that lasts as long as the process."""

    def __init__(self) -> None:
        self._users: dict[str, User] = {}

    def users(self) -> list[User]:
        """See `UserStore.users`."""
        return sorted(self._users.values(), key=lambda user: user.name)

    def user(self, name: str) -> User | None:
        """See `UserStore.user`."""
        return self._users.get(name)

    def keep_user(self, user: User, who: str) -> None:  # noqa: ARG002 - the protocol's signature
        """See `UserStore.keep_user`."""
        self._users[user.name] = user

    def remove_user(self, name: str, who: str) -> None:  # noqa: ARG002
        """See `UserStore.remove_user`."""
        self._users.pop(name, None)


class SignInRefused(MsbotError):
    """Wrong name or password, or too many of them; `retry_after_s` says when it is worth another try."""

    def __init__(self, words: str, retry_after_s: float = 0.0) -> None:
        super().__init__(words)
        self.retry_after_s = retry_after_s


class NotAllowed(MsbotError):
    """The person's role does not have the right that this needs."""


class SignedOut(MsbotError):
    """The session has ended meanwhile."""


@dataclass(slots=True, eq=False)
class Session:
    """One signed-in browser, or one use of an API token."""

    name: str
    role: Role
    began_at: float
    used_at: float
    token: str = ""
    """The cookie's word; empty for an API token."""
    csrf: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """What a changing request has to show besides the cookie."""
    is_lasting: bool = False
    """True: no user of the store stands behind it (the demo's own administrator)."""

    def may(self, right: Right) -> bool:
        """Whether the role has that right."""
        return self.role >= right.least


@dataclass(slots=True)
class _Tries:
    wrong: int = 0
    open_again_at: float = 0.0


class Accounts:
    """See the module's docstring.

    Args:
        store: where users are kept.
        hasher: for passwords.
        clock: seconds, monotonic.
    """

    def __init__(self, store: UserStore, *, clock: Callable[[], float], hasher: Hasher | None = None) -> None:
        self._store = store
        self._clock = clock
        self._hasher = hasher or Argon2Hasher()
        self._sessions: dict[str, Session] = {}
        self._tries: dict[tuple[str, str], _Tries] = {}
        self._decoy = self._hasher.hash(_NOBODYS_PASSWORD)
        self._setup_token = ""
        self._entry_token = ""

    # Links on the terminal

    @property
    def needs_setup(self) -> bool:
        """Whether there is nobody who could sign in."""
        return not self._store.users()

    @property
    def has_entry_link(self) -> bool:
        """Whether a link signs people in without a password."""
        return bool(self._entry_token)

    def setup_token(self) -> str:
        """The word of the one-time set-up link; the same until it is used."""
        self._setup_token = self._setup_token or secrets.token_urlsafe(24)
        return self._setup_token

    def set_up(self, token: str, name: str, password: str) -> Session:
        """Make the first administrator; the link works no more afterwards.

        Raises:
            SignInRefused: it is not the link's word, or somebody has used it.
            ConfigError: the name or the password will not do.
        """
        if not self._setup_token or not hmac.compare_digest(token.encode(), self._setup_token.encode()):
            raise SignInRefused("this set-up link is not valid (any more): start msbot again for a new one, or sign in")
        if not self.needs_setup:
            raise SignInRefused("there is an administrator already: sign in")
        self.add_user(name, Role.ADMINISTRATOR, password, who=name)
        self._setup_token = ""
        return self._begin(name, Role.ADMINISTRATOR)

    def entry_token(self) -> str:
        """The word of a link that signs an administrator in without a password: for the demo only."""
        self._entry_token = self._entry_token or secrets.token_urlsafe(24)
        return self._entry_token

    def enter(self, token: str) -> Session:
        """Sign the demo's administrator in.

        Raises:
            SignInRefused: it is not the link's word.
        """
        if not self._entry_token or not hmac.compare_digest(token.encode(), self._entry_token.encode()):
            raise SignInRefused("this link is of another run: copy the one that msbot has printed last")
        session = self._begin("demo", Role.ADMINISTRATOR)
        session.is_lasting = True
        return session

    # Signing in and out

    def sign_in(self, name: str, password: str, address: str) -> Session:
        """Begin a session.

        Raises:
            SignInRefused: wrong name or password (never says which), or too many tries from this address.
        """
        now = self._clock()
        # The name counts together with the address: nobody locks a teacher out from another desk. The address
        # alone counts too, against somebody who tries one password with many names.
        watched = [(name[:MAX_NAME].casefold(), address), ("", address)]
        wait_s = max(self._tries[key].open_again_at - now for key in watched if key in self._tries) if any(
            key in self._tries for key in watched
        ) else 0.0  # fmt: skip
        if wait_s > 0:
            raise SignInRefused(f"too many wrong passwords: try again in {wait_s:.0f} s", wait_s)
        user = self._store.user(name)
        # A name that is not there takes as long as a wrong password.
        is_right = self._hasher.matches(self._decoy if user is None else user.password_hash, password[:1024])
        if user is None or not is_right:
            self._count_wrong(watched, now)
            raise SignInRefused("wrong name or password")
        for key in watched:
            self._tries.pop(key, None)
        return self._begin(user.name, user.role)

    def session(self, token: str) -> Session | None:
        """The session of a cookie; None when it has expired, or its user is gone."""
        session = self._sessions.get(token)
        if session is None:
            return None
        if not self.holds(session):
            del self._sessions[token]
            return None
        session.used_at = self._clock()
        return session

    def holds(self, session: Session) -> bool:
        """Whether a session has not ended; looking at that is no use of it."""
        now = self._clock()
        is_fresh = now - session.used_at <= IDLE_S and now - session.began_at <= LONGEST_S
        return self._sessions.get(session.token) is session and is_fresh and self._follow(session)

    def by_api_token(self, token: str) -> Session | None:
        """A passing session for whoever shows a user's API token."""
        digest = digest_of(token)
        for user in self._store.users():
            if any(hmac.compare_digest(digest, known) for _, known in user.tokens):
                now = self._clock()
                return Session(user.name, user.role, now, now)
        return None

    def sign_out(self, session: Session) -> None:
        """End a session."""
        self._sessions.pop(session.token, None)

    def require(self, session: Session, right: Right) -> None:
        """Check at the moment of the deed that the session still holds and has that right.

        Raises:
            SignedOut: it has ended.
            NotAllowed: the role does not have it.
        """
        if session.token and self.session(session.token) is not session:
            raise SignedOut("you are signed out: sign in again")
        if not session.may(right):
            raise NotAllowed(f"{session.role.one} may not {right.value}; {right.least.one} may")

    # Administration

    def users(self) -> list[User]:
        """All users, by name."""
        return self._store.users()

    def add_user(self, name: str, role: Role, password: str, *, who: str) -> None:
        """Let a person sign in.

        Raises:
            ConfigError: the name is taken or makes no sense, or the password is too easy.
        """
        if not name or len(name) > MAX_NAME or name != name.strip() or not name.isprintable():
            raise ConfigError(f"a user's name has 1 to {MAX_NAME} printable characters, without blanks around it")
        if self._store.user(name) is not None:
            raise ConfigError(f"there is a user {name!r} already: choose another name")
        check_password(password)
        self._store.keep_user(User(name, role, self._hasher.hash(password)), who)

    def change_user(self, name: str, *, who: str, role: str | None = None, password: str | None = None) -> None:
        """Give a user another role or password; a new password ends the user's other sessions.

        Raises:
            ConfigError: there is no such user, it is the last administrator, or the password is too easy.
        """
        user = self._find(name)
        wanted = user.role if role is None else role_named(role)
        if wanted is not Role.ADMINISTRATOR:
            self._check_not_last(user, "have another role")
        hashed = user.password_hash
        if password is not None:
            check_password(password)
            hashed = self._hasher.hash(password)
        self._store.keep_user(User(user.name, wanted, hashed, user.tokens), who)
        if password is not None:
            self._end_sessions(name)

    def remove_user(self, name: str, *, who: str) -> None:
        """Let a person in no more.

        Raises:
            ConfigError: there is no such user, or it is the last administrator.
        """
        self._check_not_last(self._find(name), "be removed")
        self._store.remove_user(name, who)
        self._end_sessions(name)

    def new_token(self, name: str, purpose: str, *, who: str) -> str:
        """Make an API token; this is the only moment it can be read.

        Raises:
            ConfigError: there is no such user, or the purpose is taken or makes no sense.
        """
        user = self._find(name)
        if not purpose or len(purpose) > MAX_NAME or not purpose.isprintable():
            raise ConfigError(f"say what the token is for, in 1 to {MAX_NAME} characters")
        if any(purpose == known for known, _ in user.tokens):
            raise ConfigError(f"{name} has a token for {purpose!r} already: remove it first")
        token = f"msbot_{secrets.token_urlsafe(32)}"
        tokens = (*user.tokens, (purpose, digest_of(token)))
        self._store.keep_user(User(user.name, user.role, user.password_hash, tokens), who)
        return token

    def remove_token(self, name: str, purpose: str, *, who: str) -> None:
        """Make an API token worthless.

        Raises:
            ConfigError: there is no such user or token.
        """
        user = self._find(name)
        tokens = tuple(token for token in user.tokens if token[0] != purpose)
        if tokens == user.tokens:
            raise ConfigError(f"{name} has no token for {purpose!r}")
        self._store.keep_user(User(user.name, user.role, user.password_hash, tokens), who)

    # Helpers

    def _begin(self, name: str, role: Role) -> Session:
        now = self._clock()
        while len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[min(self._sessions, key=lambda token: self._sessions[token].used_at)]
        session = Session(name, role, now, now, token=secrets.token_urlsafe(32))
        self._sessions[session.token] = session
        return session

    def _follow(self, session: Session) -> bool:
        """Give a session the role its user has now; False: there is no such user."""
        if session.is_lasting:
            return True
        user = self._store.user(session.name)
        if user is not None:
            session.role = user.role
        return user is not None

    def _count_wrong(self, keys: list[tuple[str, str]], now: float) -> None:
        for key in keys:
            if key not in self._tries and len(self._tries) >= MOST_NAMES_WATCHED:
                del self._tries[next(iter(self._tries))]
            tries = self._tries.setdefault(key, _Tries())
            tries.wrong += 1
            # Many share one address in a classroom, so it gets more tries than a name.
            free = FREE_TRIES if key[0] else 10 * FREE_TRIES
            if tries.wrong >= free:
                pause_s = min(FIRST_PAUSE_S * 2.0 ** min(tries.wrong - free, 16), LONGEST_PAUSE_S)
                tries.open_again_at = now + pause_s

    def _find(self, name: str) -> User:
        user = self._store.user(name)
        if user is None:
            known = ", ".join(user.name for user in self._store.users()) or "nobody"
            raise ConfigError(f"there is no user {name!r}; there are {known}")
        return user

    def _check_not_last(self, user: User, deed: str) -> None:
        others = [
            other for other in self._store.users() if other.role is Role.ADMINISTRATOR and other.name != user.name
        ]
        if user.role is Role.ADMINISTRATOR and not others:
            raise ConfigError(f"{user.name} is the last administrator and cannot {deed}: make another one first")

    def _end_sessions(self, name: str) -> None:
        for token, session in list(self._sessions.items()):
            if session.name == name and not session.is_lasting:
                del self._sessions[token]


def digest_of(token: str) -> str:
    """What is stored of an API token."""
    return hashlib.sha256(token.encode()).hexdigest()
