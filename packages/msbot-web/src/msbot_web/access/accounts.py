"""Who is signed in: users, sessions, API tokens. Time is passed in; the database is not queried.

All users are held in memory: a request, and above all STOP, never waits for a database. Changes made there by
administrators in other programs come in through `load`. A changed role and the removal of a user take effect at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

from msbot.operations.rights import Right, Role, role_named
from msbot.registry.reserved_names import check_name, check_reserved
from msbot_agent.text.sentence import said
from msbot_web.access.class_list import NewAccount
from msbot_web.access.clocks import NonDecreasingClock
from msbot_web.access.guests import DEMO, Guests
from msbot_web.access.passwords import LONGEST, Argon2Hasher, Hasher, TooManyHashes, check_password
from msbot_web.access.sessions import KeptSession, Session, SessionEndReason, Sessions, digest_of, octets_of_token
from msbot_web.access.sign_in_throttle import SignInRefused, SignInThrottle
from msbot_web.access.users import OF_PARTS, User, UserStore
from msbot_xrce.errors import ConfigError, MsbotError, RegistryError

# Browsers in which a person has signed in, each with a random word of its own in a cookie. Pure.
#
# Wrong passwords from a known browser are counted for that browser alone: guesses made anywhere else do not keep its
# person out, and guesses made in it keep nobody out elsewhere. A word ends when the person signs out there, when the
# password changes, and when the account is removed. The master knows only its SHA-256.


MOST_OF_ONE = 20
"""Known browsers of one person; beyond that the one that was used the longest ago is known no more."""
MOST_KNOWN = 2000
"""The same for all; beyond that the person with the most loses one."""


class KnownBrowsers:
    """Browsers in which a person has signed in, each with a random word of its own in a cookie. Pure."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        """Who has signed in, by the SHA-256 of the browser's word; the last used last."""

    def find(self, word: str, name: str) -> str:
        """What names that browser if this person has signed in there, else empty."""
        digest = digest_of(word) if word else ""
        return digest if self._names.get(digest) == name else ""

    def note_sign_in(self, word: str, name: str) -> str:
        """That person has signed in with that browser.

        Args:
            word: what its cookie says; empty: nothing.
            name: who.

        Returns:
            What its cookie has to say from now on.
        """
        if not self.find(word, name):
            word = secrets.token_urlsafe(32)
        digest = digest_of(word)
        self._names.pop(digest, None)
        self._names[digest] = name
        self._drop_one(name)
        return word

    def end(self, word: str) -> None:
        """The person has signed out there."""
        if word:
            self._names.pop(digest_of(word), None)

    def end_all_of(self, name: str) -> None:
        """None of that person's browsers is known any more."""
        self._names = {digest: one for digest, one in self._names.items() if one != name}

    def to_persist(self) -> list[tuple[str, str]]:
        """What should outlive the master."""
        return list(self._names.items())

    def bring_back(self, kept: Iterable[tuple[str, str]]) -> None:
        """Know the browsers of an earlier run."""
        for digest, name in kept:
            self._names[digest] = name
            self._drop_one(name)

    def _drop_one(self, name: str) -> None:
        """Make room, if there are too many."""
        counts = Counter(self._names.values())
        if counts[name] <= MOST_OF_ONE and len(self._names) <= MOST_KNOWN:
            return
        greedy = name if counts[name] > MOST_OF_ONE else counts.most_common(1)[0][0]
        del self._names[next(digest for digest, one in self._names.items() if one == greedy)]


MOST_TOKENS = 50
"""API tokens and tickets of one person."""
LINK_OCTETS = 16
"""Random octets of the word of a link: nobody guesses it, and the line with the link fits a terminal of 80 columns."""

_BUSY_S = 10.0
_CLOCKS_NS = 60 * 10**9
"""An account that was made here is stored a moment later, by the clock of the database's computer."""
_NOBODYS_PASSWORD = "no user has this password"


class NotAllowed(MsbotError):
    """The person's role does not have the right that this needs."""


class SignedOut(MsbotError):
    """The session has ended."""


class Accounts:
    """See the module's docstring.

    Args:
        store: where users are kept.
        clock: seconds, monotonic.
        hasher: for passwords.
        wall_clock: seconds since 1970.

    Raises:
        RegistryError: the users cannot be read.
    """

    def __init__(
        self,
        store: UserStore,
        *,
        clock: Callable[[], float],
        hasher: Hasher | None = None,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._store = store
        self._clock = clock
        self.forward_clock = NonDecreasingClock(wall_clock, clock)
        """For what is printed with a date."""
        self._hasher = hasher or Argon2Hasher()
        self.sessions = Sessions(clock)
        self.guests = Guests(self, clock)
        self.browsers = KnownBrowsers()
        self._attempts = SignInThrottle()
        self._users: dict[str, User] = {}
        self._token_users: dict[str, str] = {}
        self._decoy = ""
        self._setup_token = ""
        self._entry_token = ""
        self.ticket_key = secrets.token_bytes(32)
        """For the proofs on pupils' tickets; kept over restarts with the sessions."""
        self._gone_listeners: list[Callable[[str], object]] = []
        self._role_listeners: list[Callable[[str], object]] = []
        self._token_listeners: list[Callable[[str, str], object]] = []
        self._changing = asyncio.Lock()
        """Held from reading a user until the change is stored, so that no other change comes in between."""
        self.load(store.users())

    def load(self, users: Iterable[User]) -> None:
        """Take over the present content of the store; sessions of removed people end.

        Does nothing while a user is being changed here: the store would have only half of the change.
        """
        if not self._changing.locked():
            self._take(users)

    def on_gone(self, listener: Callable[[str], object]) -> None:
        """Call the listener with the name of everybody who is removed; whoever has that name later is another."""
        self._gone_listeners.append(listener)

    def on_role(self, listener: Callable[[str], object]) -> None:
        """Call the listener with the name of everybody who gets another role."""
        self._role_listeners.append(listener)

    def on_token_end(self, listener: Callable[[str, str], object]) -> None:
        """Call the listener with every API token that is worthless from now on (as `Session.program` has it), and whose
        it was."""
        self._token_listeners.append(listener)

    @property
    def clock(self) -> Callable[[], float]:
        """By which sessions and tickets age: seconds, monotonic."""
        return self._clock

    def _index_tokens(self) -> None:
        """Find users by their tokens, and say which tokens have ended."""
        before, self._token_users = (
            self._token_users,
            {digest: user.name for user in self._users.values() for _, digest in user.tokens},
        )
        for digest, name in before.items():
            if self._token_users.get(digest) != name:
                for listener in self._token_listeners:
                    listener(digest, name)

    def _role_changed(self, name: str, role: Role) -> None:
        self.sessions.change_role(name, role)
        for listener in self._role_listeners:
            listener(name)

    def _take(self, users: Iterable[User]) -> None:
        before, self._users = self._users, {user.name: user for user in users}
        self._index_tokens()
        for name, old in before.items():
            new = self._users.get(name)
            is_another = new is not None and 0 < old.since_ns < new.since_ns - _CLOCKS_NS
            if new is None or is_another:
                for listener in self._gone_listeners:
                    listener(name)
            if new is None or is_another or new.password_hash != old.password_hash:
                self._end_all_of(
                    name, SessionEndReason.REMOVED if new is None or is_another else SessionEndReason.NEW_PASSWORD
                )
            elif new.role is not old.role:
                self._role_changed(name, new.role)

    # Links on the terminal

    @property
    def needs_setup(self) -> bool:
        """Whether there is nobody who could sign in."""
        return not self._users

    @property
    def has_entry_link(self) -> bool:
        """Whether a link signs people in without a password."""
        return bool(self._entry_token)

    def setup_token(self) -> str:
        """The word of the one-time set-up link; the same until it is used."""
        self._setup_token = self._setup_token or secrets.token_urlsafe(LINK_OCTETS)
        return self._setup_token

    async def set_up(self, token: str, name: str, password: str) -> Session:
        """Make the first administrator; the link no longer works afterwards.

        Raises:
            SignInRefused: it is not the link's word, or somebody has used it.
            ConfigError: the name or the password is not acceptable.
        """
        if not self._setup_token or not hmac.compare_digest(octets_of_token(token), self._setup_token.encode()):
            raise SignInRefused(
                said("this set-up link is not valid (any more): start msbot again for a new one, or sign in")
            )
        if not self.needs_setup:
            raise SignInRefused(said("there is an administrator already: sign in"))
        self._check_name(name)
        check_password(password)
        link, self._setup_token = self._setup_token, ""  # nobody else uses it while the password is hashed
        try:
            await self.add_user(name, Role.ADMINISTRATOR, password, who=name)
        except BaseException:
            self._setup_token = link
            raise
        return self.sessions.begin(name, Role.ADMINISTRATOR)

    def entry_token(self) -> str:
        """The word of a link that signs an administrator in without a password: for the demo only."""
        self._entry_token = self._entry_token or secrets.token_urlsafe(LINK_OCTETS)
        return self._entry_token

    def of_demo(self) -> tuple[str, list[KeptSession]]:
        """The word of the demo's link, and the sessions behind which no account is: for the next robot in its place."""
        return self._entry_token, self.sessions.of_demo(DEMO)

    def take_over(self, entry_token: str, kept: Iterable[KeptSession]) -> None:
        """Go on with what `of_demo` gave: the link that was printed first still opens, and nobody signs in again."""
        self._entry_token = entry_token
        self.sessions.take_over(kept)

    def enter(self, token: str) -> Session:
        """Sign the demo's administrator in.

        Raises:
            SignInRefused: it is not the link's word.
        """
        if not self._entry_token or not hmac.compare_digest(octets_of_token(token), self._entry_token.encode()):
            raise SignInRefused(said("this link is of another run: copy the one that msbot has printed last"))
        return self.sessions.begin(DEMO, Role.ADMINISTRATOR, is_lasting=True)

    # Signing in and out

    async def sign_in(self, name: str, password: str, address: str, device: str = "") -> Session:
        """Begin a session.

        Args:
            name: who.
            password: what was typed.
            address: where the person is.
            device: the word of this browser (`KnownBrowsers.note_sign_in`), or empty.

        Raises:
            SignInRefused: wrong name or password (never says which), or too many tries.
        """
        user = await self._check(name, password, address, self.browsers.find(device, name))
        if user is None:
            raise SignInRefused(said("wrong name or password"))
        return self.sessions.begin(user.name, user.role)

    async def _check(self, name: str, password: str, address: str, known: str) -> User | None:
        """Whose password that is, as the user is now; None: it is wrong. Every try counts.

        Args:
            name: who it should be.
            password: what was typed.
            address: where the person is.
            known: names the browser if the person is known there, else empty.

        Raises:
            SignInRefused: too many tries.
        """
        asker = known or address
        wait_s = self._attempts.admit(name, address, known, self._clock())
        try:
            if wait_s:
                await asyncio.sleep(wait_s)
            # An unknown name takes as long as a wrong password.
            self._decoy = self._decoy or await self._hasher.hash(_NOBODYS_PASSWORD, asker=asker)
            user = self._users.get(name)
            stored = self._decoy if user is None else user.password_hash
            is_right = await self._hasher.matches(stored, password[: LONGEST + 1], asker=asker)
        except TooManyHashes as error:
            self._attempts.abandoned(name, address, known)
            raise SignInRefused(str(error), _BUSY_S) from None
        except asyncio.CancelledError:
            self._attempts.abandoned(name, address, known)
            raise
        user = self._users.get(name)  # as it is now: hashing takes a while
        if user is None or not is_right or user.password_hash != stored:
            return None
        self._attempts.right(name, address, known)
        if self._hasher.is_outdated(stored):
            await self._hash_anew(user, password, asker)
        return user

    async def _hash_anew(self, user: User, password: str, asker: str) -> None:
        """Store a better hash of the same password; if that fails, it is done at the next sign-in."""
        with contextlib.suppress(RegistryError, TooManyHashes):
            hashed = await self._hasher.hash(password, asker=asker)
            async with self._changing:
                present = self._users.get(user.name)
                if present is not None and present.password_hash == user.password_hash:
                    await self._keep(user.name, replace(present, password_hash=hashed))

    def mark_of(self, name: str) -> str:
        """Tells the account of that name from every other, also a later one; empty: there is none."""
        user = self._users.get(name)
        return "" if user is None else user.fingerprint

    def role_of(self, name: str) -> Role | None:
        """The role of a user, or None when there is no such user."""
        user = self._users.get(name)
        return None if user is None else user.role

    def session(self, token: str) -> Session | None:
        """The session of a cookie; None when it has expired, or its user is gone."""
        session = self.sessions.find(token)
        if session is None:
            return None
        if not self.holds(session):
            self.sessions.end(session)
            return None
        self.sessions.touch(session)
        return session

    def holds(self, session: Session) -> bool:
        """Whether a session has not ended; asking does not count as using it."""
        if session.is_program:
            return True
        if session.guest_of:
            return self.sessions.is_fresh(session) and self.guests.may_invite(session.guest_of)
        return self.sessions.is_fresh(session) and (session.is_lasting or session.name in self._users)

    def by_word_of_parts(self, token: str) -> Session | None:
        """The same at the door of parts: for an API token, or the ticket of a relay or an agent."""
        return self.by_api_token(token) or self._by_digest(OF_PARTS + digest_of(token))

    def by_api_token(self, token: str) -> Session | None:
        """A temporary session for a program that shows a user's API token."""
        return self._by_digest(digest_of(token))

    def _by_digest(self, digest: str) -> Session | None:
        name = self._token_users.get(digest)
        if name is None:
            return None
        now = self._clock()
        return Session(name, self._users[name].role, now, now, program=digest)

    def sign_out(self, session: Session, device: str = "") -> None:
        """End a session; the browser with that word is no longer known."""
        self.sessions.end(session)
        self.browsers.end(device)

    def require(self, session: Session, right: Right) -> None:
        """Check at the moment of the action that the session still holds and has that right.

        Raises:
            SignedOut: it has ended.
            NotAllowed: the role does not have it.
        """
        if not self.holds(session):
            raise SignedOut(said("you are signed out: sign in again"))
        self.sessions.touch(session)
        if not session.may(right):
            raise NotAllowed(
                said(
                    "{one} may not {right}; {least} may",
                    one=session.role.with_article,
                    right=said(right.value),
                    least=right.least.with_article,
                )
            )

    def since_ns(self, session: Session) -> int:
        """When the account behind a session was made; 0: no account is."""
        user = None if session.is_lasting or session.guest_of else self._users.get(session.name)
        return 0 if user is None else user.since_ns

    # Administration

    def users(self) -> list[User]:
        """All users, by name."""
        return [self._users[name] for name in sorted(self._users, key=lambda name: (name.casefold(), name))]

    async def add_user(self, name: str, role: Role, password: str, *, who: str) -> None:
        """Let a person sign in.

        Raises:
            ConfigError: the name is taken or makes no sense, or the password is too easy.
        """
        self._check_name(name)
        check_password(password)
        hashed = await self._hasher.hash(password, asker=who)
        async with self._changing:
            self._check_name(name)  # somebody else may have taken it in the meantime
            await self._keep(who, User(name, role, hashed, since_ns=time.time_ns()))

    async def add_people(self, people: Iterable[NewAccount], *, who: str) -> None:
        """Let a whole class sign in: all of them or none.

        Raises:
            ConfigError: a name is taken or makes no sense.
        """
        newcomers = list(people)
        earlier: list[str] = []
        for one in newcomers:
            try:
                self._check_name(one.name)
                check_name(one.name, earlier)
                earlier.append(one.name)
            except ConfigError as error:
                raise ConfigError(said("line {line}: {error}", line=one.line, error=str(error))) from None
        users = [
            User(one.name, one.role, await self._hasher.hash(one.password, asker=who), since_ns=time.time_ns())
            for one in newcomers
        ]
        async with self._changing:
            for user in users:
                self._check_name(user.name)
            await self._keep(who, *users)

    async def change_role(self, name: str, role: str, *, who: str) -> None:
        """Give a user another role; it counts at once.

        Raises:
            ConfigError: there is no such user or role, or it is the last administrator.
        """
        wanted = role_named(role)
        async with self._changing:
            user = self._find(name)
            if wanted is not Role.ADMINISTRATOR:
                self._check_not_last(user, "have another role")
            await self._keep(who, replace(user, role=wanted))
        self._role_changed(name, wanted)

    async def change_password(
        self, name: str, password: str, *, who: str, old: str | None = None, browser: str = ""
    ) -> None:
        """Give a user another password; sessions and API tokens of that user end.

        Args:
            name: whose.
            password: the new one.
            who: who changes it.
            old: the present one, which people have to say for their own; None: an administrator helps another.
            browser: names the signed-in browser in which that is done: wrong tries count there.

        Raises:
            ConfigError: there is no such user, the old password is wrong, or the new one is too easy.
            SignInRefused: too many tries at the old password.
            TooManyHashes: that person has too many under way.
        """
        self._find(name)
        check_password(password)
        if old is not None and await self._check(name, old, "", f"session {browser}") is None:
            raise ConfigError(said("the old password is wrong"))
        hashed = await self._hasher.hash(password, asker=who)
        async with self._changing:
            await self._keep(who, replace(self._find(name), password_hash=hashed, tokens=()))
        self._end_all_of(name, SessionEndReason.NEW_PASSWORD)

    async def remove_user(self, name: str, *, who: str) -> None:
        """Remove a person, who can no longer sign in.

        Raises:
            ConfigError: there is no such user, or it is the last administrator.
        """
        async with self._changing:
            self._check_not_last(self._find(name), "be removed")
            await self._store.remove_user(name, who)
            self._take([user for user in self._users.values() if user.name != name])

    async def new_ticket(self, name: str, purpose: str, *, who: str) -> str:
        """Make a ticket with which a relay or an agent brings parts as that teacher's, and which opens nothing else.

        Raises:
            ConfigError: as `new_token`; or it is no teacher, whose parts would be a pupil's.
        """
        if self._find(name).role < Right.ARRANGE.least:
            raise ConfigError(said("a ticket for a relay or an agent is a teacher's: {name} is none", name=name))
        return await self.new_token(name, purpose, who=who, kind=OF_PARTS)

    async def new_token(self, name: str, purpose: str, *, who: str, kind: str = "") -> str:
        """Make an API token; this is the only time it can be read. `kind`: what stands before its hash.

        Raises:
            ConfigError: there is no such user, or the purpose is taken or makes no sense.
        """
        token = f"msbot_{secrets.token_urlsafe(32)}"
        async with self._changing:
            user = self._find(name)
            if any(purpose == known for known, _ in user.tokens):
                raise ConfigError(
                    said("{name} has a token for {purpose!r} already: remove it first", name=name, purpose=purpose)
                )
            check_name(purpose, (known for known, _ in user.tokens))
            if len(user.tokens) >= MOST_TOKENS:
                raise ConfigError(
                    said(
                        "{name} has {most} tokens and tickets already: remove one that nobody uses",
                        name=name,
                        most=MOST_TOKENS,
                    )
                )
            await self._keep(who, replace(user, tokens=(*user.tokens, (purpose, kind + digest_of(token)))))
        return token

    async def remove_token(self, name: str, purpose: str, *, who: str) -> None:
        """Make an API token worthless.

        Raises:
            ConfigError: there is no such user or token.
        """
        async with self._changing:
            user = self._find(name)
            tokens = tuple(token for token in user.tokens if token[0] != purpose)
            if tokens == user.tokens:
                raise ConfigError(said("{name} has no token for {purpose!r}", name=name, purpose=purpose))
            await self._keep(who, replace(user, tokens=tokens))

    # Helpers

    def _end_all_of(self, name: str, why: SessionEndReason) -> None:
        self.guests.end_all_of(name, why)
        self.browsers.end_all_of(name)

    async def _keep(self, who: str, *users: User) -> None:
        """Store users; a change that the store refuses does not take effect."""
        await self._store.keep_users(users, who)
        self._users.update({user.name: user for user in users})
        self._index_tokens()

    def check_new_name(self, name: str) -> None:
        """Check that somebody may be called that.

        Raises:
            ConfigError: the name is taken or makes no sense.
        """
        self._check_name(name)

    def _check_name(self, name: str) -> None:
        check_reserved(name)
        if name in self._users:
            raise ConfigError(said("there is a user {name!r} already: choose another name", name=name))
        check_name(name, self._users)

    def _find(self, name: str) -> User:
        user = self._users.get(name)
        if user is None:
            known = ", ".join(sorted(self._users)) or "nobody"
            raise ConfigError(said("there is no user {name!r}; there are {known}", name=name, known=known))
        return user

    def _check_not_last(self, user: User, deed: str) -> None:
        others = [one for one in self._users.values() if one.role is Role.ADMINISTRATOR and one.name != user.name]
        if user.role is Role.ADMINISTRATOR and not others:
            raise ConfigError(
                said(
                    "{user} is the last administrator and cannot {deed}: make another one first",
                    user=user.name,
                    deed=deed,
                )
            )
