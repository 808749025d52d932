"""Signing in, sessions, API tokens and roles, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.operations.rights import Right, Role, role_named
from msbot_web.access.accounts import Accounts, NotAllowed, SignedOut
from msbot_web.access.sessions import IDLE_S, LONGEST_S, Session
from msbot_web.access.sign_in_throttle import FIRST_PAUSE_S, FREE_TRIES, SignInRefused
from msbot_web.access.users import MemoryUsers, User
from msbot_xrce.errors import ConfigError, RegistryError


class PlainHasher:
    """As the real one, but quick: what it does with passwords is tested elsewhere."""

    async def hash(self, password: str, *, asker: str) -> str:
        return f"hash of {password}"

    async def matches(self, stored: str, password: str, *, asker: str) -> bool:
        return stored.removeprefix("old ") == await self.hash(password, asker=asker)

    def is_outdated(self, stored: str) -> bool:
        return stored.startswith("old ")


def user(name: str, role: Role = Role.ADMINISTRATOR, password: str = "correct horse") -> User:
    """Somebody whose password the plain hasher knows."""
    return User(name, role, f"hash of {password}")


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def make() -> tuple[Accounts, Clock]:
    clock = Clock()
    return Accounts(MemoryUsers(user("ada")), clock=clock, hasher=PlainHasher()), clock


async def sign_in(
    accounts: Accounts, name: str = "ada", password: str = "correct horse", address: str = "a"
) -> Session:
    return await accounts.sign_in(name, password, address)


async def test_the_set_up_link_makes_the_first_administrator_and_works_once() -> None:
    accounts = Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())
    assert accounts.needs_setup
    token = accounts.setup_token()
    assert token == accounts.setup_token()
    with pytest.raises(SignInRefused, match="not valid"):
        await accounts.set_up("guess", "eve", "long enough")
    with pytest.raises(ConfigError, match="at least 8 characters"):
        await accounts.set_up(token, "ada", "short")
    session = await accounts.set_up(token, "ada", "correct horse")
    assert session.role is Role.ADMINISTRATOR
    assert accounts.session(session.token) is session
    with pytest.raises(SignInRefused, match="not valid"):
        await accounts.set_up(token, "eve", "long enough")
    assert not accounts.needs_setup


async def test_an_empty_link_word_opens_nothing() -> None:
    accounts = Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())
    with pytest.raises(SignInRefused):
        await accounts.set_up("", "eve", "long enough")
    with pytest.raises(SignInRefused):
        accounts.enter("")


async def test_the_entry_link_signs_in_without_a_user() -> None:
    accounts = Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())
    session = accounts.enter(accounts.entry_token())
    assert accounts.session(session.token) is session
    assert session.may(Right.ADMINISTER)
    with pytest.raises(SignInRefused, match="another run"):
        accounts.enter("x")


async def test_a_wrong_name_and_a_wrong_password_are_told_alike() -> None:
    accounts, _ = make()
    with pytest.raises(SignInRefused) as wrong_password:
        await sign_in(accounts, password="guess")
    with pytest.raises(SignInRefused) as wrong_name:
        await sign_in(accounts, name="nobody")
    assert str(wrong_password.value) == str(wrong_name.value)


async def test_sessions_end_after_idleness_and_in_any_case() -> None:
    accounts, clock = make()
    session = await sign_in(accounts)
    clock.now += IDLE_S - 1
    assert accounts.session(session.token) is session
    clock.now += IDLE_S + 1
    assert accounts.session(session.token) is None
    busy = await sign_in(accounts)
    until = clock.now + LONGEST_S
    while clock.now < until:
        assert accounts.session(busy.token) is busy
        clock.now += IDLE_S / 2
    clock.now += 1
    assert accounts.session(busy.token) is None


async def test_a_changed_role_counts_at_once_and_a_removed_user_is_out() -> None:
    accounts, _ = make()
    await accounts.add_user("bob", Role.TEACHER, "also correct", who="ada")
    session = await sign_in(accounts, "bob", "also correct")
    accounts.require(session, Right.ARRANGE)
    await accounts.change_role("bob", "viewer", who="ada")
    with pytest.raises(NotAllowed, match="a viewer may not arrange parts; a teacher may"):
        accounts.require(session, Right.ARRANGE)
    accounts.require(session, Right.STOP)
    await accounts.remove_user("bob", who="ada")
    with pytest.raises(SignedOut):
        accounts.require(session, Right.SEE)


async def test_a_new_password_ends_the_sessions_of_that_user() -> None:
    accounts, _ = make()
    session = await sign_in(accounts)
    await accounts.change_password("ada", "another horse", who="ada", old="correct horse")
    assert accounts.session(session.token) is None
    with pytest.raises(SignInRefused):
        await sign_in(accounts)
    await sign_in(accounts, password="another horse")


async def test_signing_out_ends_the_session() -> None:
    accounts, _ = make()
    session = await sign_in(accounts)
    accounts.sign_out(session)
    assert accounts.session(session.token) is None
    with pytest.raises(SignedOut):
        accounts.require(session, Right.SEE)


async def test_the_last_administrator_stays() -> None:
    accounts, _ = make()
    with pytest.raises(ConfigError, match="last administrator"):
        await accounts.remove_user("ada", who="ada")
    with pytest.raises(ConfigError, match="last administrator"):
        await accounts.change_role("ada", "teacher", who="ada")
    await accounts.add_user("bob", Role.ADMINISTRATOR, "also correct", who="ada")
    await accounts.change_role("ada", "teacher", who="bob")


@pytest.mark.parametrize("name", ["", " ada", "a" * 65, "a\nb", "ada"])
async def test_names_that_will_not_do(name: str) -> None:
    accounts, _ = make()
    with pytest.raises(ConfigError):
        await accounts.add_user(name, Role.STUDENT, "long enough", who="ada")


async def test_api_tokens_stand_for_their_user_until_they_are_removed() -> None:
    accounts, _ = make()
    token = await accounts.new_token("ada", "logger", who="ada")
    session = accounts.by_api_token(token)
    assert session is not None
    assert (session.name, session.role, session.is_program) == ("ada", Role.ADMINISTRATOR, True)
    assert token not in str(accounts.users())
    with pytest.raises(ConfigError, match="already"):
        await accounts.new_token("ada", "logger", who="ada")
    await accounts.remove_token("ada", "logger", who="ada")
    assert accounts.by_api_token(token) is None
    with pytest.raises(ConfigError, match="no token"):
        await accounts.remove_token("ada", "logger", who="ada")


@given(st.text(max_size=80))
def test_a_guessed_token_opens_nothing(guess: str) -> None:
    accounts, _ = make()
    asyncio.run(accounts.new_token("ada", "logger", who="ada"))
    assert accounts.by_api_token(guess) is None
    assert accounts.session(guess) is None


def test_roles_have_the_rights_of_the_ones_below() -> None:
    for right in Right:
        allowed = [role for role in Role if role >= right.least]
        assert allowed == sorted(allowed)
        assert Role.ADMINISTRATOR in allowed
    assert role_named("teacher") is Role.TEACHER
    with pytest.raises(ConfigError, match="viewer, student, teacher, administrator"):
        role_named("king")


async def test_a_new_password_ends_the_api_tokens_and_asks_for_the_old_one() -> None:
    accounts, _ = make()
    token = await accounts.new_token("ada", "logger", who="ada")
    with pytest.raises(ConfigError, match="old password is wrong"):
        await accounts.change_password("ada", "another horse", who="ada", old="guess")
    assert accounts.by_api_token(token) is not None
    await accounts.change_password("ada", "another horse", who="ada", old="correct horse")
    assert accounts.by_api_token(token) is None


async def test_an_old_hash_still_verifies_and_is_made_anew() -> None:
    store = MemoryUsers(User("ada", Role.ADMINISTRATOR, "old hash of correct horse"))
    accounts = Accounts(store, clock=Clock(), hasher=PlainHasher())
    session = await sign_in(accounts)
    assert store.users()[0].password_hash == "hash of correct horse"
    accounts.load(store.users())
    assert accounts.session(session.token) is session, "a better hash of the same password ends nothing"


class FullDisk(MemoryUsers):
    """A store that takes nothing."""

    async def keep_users(self, users: Sequence[User], who: str) -> None:
        raise RegistryError("nothing was changed: the disk is full")

    async def remove_user(self, name: str, who: str) -> None:
        raise RegistryError("nothing was changed: the disk is full")


async def test_what_cannot_be_stored_does_not_count_and_nobody_is_kept_out_by_it() -> None:
    people = (User("ada", Role.ADMINISTRATOR, "old hash of correct horse"), user("bob"))
    accounts = Accounts(FullDisk(*people), clock=Clock(), hasher=PlainHasher())
    session = await sign_in(accounts)  # the hash is made anew the next time
    deeds = (
        accounts.add_user("eve", Role.STUDENT, "long enough", who="ada"),
        accounts.change_role("bob", "viewer", who="ada"),
        accounts.change_password("bob", "another horse", who="ada"),
        accounts.remove_user("bob", who="ada"),
        accounts.new_token("bob", "logger", who="ada"),
    )
    for deed in deeds:
        with pytest.raises(RegistryError, match="nothing was changed"):
            await deed
    assert accounts.users() == list(people)
    assert accounts.session(session.token) is session


async def test_of_two_administrators_who_turn_each_other_out_one_stays() -> None:
    accounts = Accounts(SlowUsers(user("ada"), user("bob")), clock=Clock(), hasher=PlainHasher())
    done = await asyncio.gather(
        accounts.remove_user("bob", who="ada"), accounts.remove_user("ada", who="bob"), return_exceptions=True
    )
    assert [type(one) for one in done] == [type(None), ConfigError]
    assert [one.name for one in accounts.users()] == ["ada"]


class SlowUsers(MemoryUsers):
    """A store that others get in before."""

    async def remove_user(self, name: str, who: str) -> None:
        await asyncio.sleep(0)
        await super().remove_user(name, who)


async def test_a_browser_that_was_used_before_is_not_kept_out_by_guesses_from_elsewhere() -> None:
    accounts, _ = make()
    device = accounts.browsers.note_sign_in("", "ada")
    for number in range(100):
        with pytest.raises(SignInRefused):
            await sign_in(accounts, password="guess", address=f"address {number}")
    with pytest.raises(SignInRefused, match="too many"):
        await sign_in(accounts, address="a new desk")
    await accounts.sign_in("ada", "correct horse", "a", device)
    with pytest.raises(SignInRefused, match="too many"):
        await accounts.sign_in("ada", "correct horse", "a", accounts.browsers.note_sign_in("", "bob"))


async def test_guesses_in_a_browser_that_a_teacher_has_used_keep_the_teacher_out_nowhere_else() -> None:
    accounts, _ = make()
    own, pupils = accounts.browsers.note_sign_in("", "ada"), accounts.browsers.note_sign_in("", "ada")
    for number in range(100):
        with pytest.raises(SignInRefused, match="too many" if number >= FREE_TRIES else "wrong"):
            await accounts.sign_in("ada", "guess", "school", pupils)
    await accounts.sign_in("ada", "correct horse", "school", own)
    await accounts.sign_in("ada", "correct horse", "school")


async def test_a_browser_is_known_until_its_person_signs_out_there_or_has_a_new_password() -> None:
    accounts, _ = make()
    first, second = accounts.browsers.note_sign_in("", "ada"), accounts.browsers.note_sign_in("", "ada")
    accounts.sign_out(await accounts.sign_in("ada", "correct horse", "a", first), first)
    assert not accounts.browsers.find(first, "ada")
    assert accounts.browsers.find(second, "ada")
    await accounts.change_password("ada", "a new password", who="ada", old="correct horse")
    assert not accounts.browsers.find(second, "ada")


async def test_tries_at_the_old_password_count_in_that_browser() -> None:
    accounts, clock = make()
    session = await sign_in(accounts)
    for number in range(20):
        with pytest.raises(ConfigError if number < FREE_TRIES else SignInRefused):
            await accounts.change_password("ada", "a new password", who="ada", old="guess", browser=session.key)
    with pytest.raises(SignInRefused, match="too many"):
        await accounts.change_password("ada", "a new password", who="ada", old="correct horse", browser=session.key)
    await sign_in(accounts)
    clock.now += FIRST_PAUSE_S + 1
    await accounts.change_password("ada", "a new password", who="ada", old="correct horse", browser=session.key)


async def test_of_many_guesses_at_once_as_many_are_looked_at_as_one_after_the_other() -> None:
    accounts, _ = make()
    guesses = [sign_in(accounts, password="guess") for _ in range(30)]
    told = [str(error) for error in await asyncio.gather(*guesses, return_exceptions=True)]
    assert told.count("wrong name or password") == FREE_TRIES


async def test_fifty_five_wrong_names_from_a_school_lock_nobody_out_there() -> None:
    accounts, _ = make()
    for number in range(35):
        with pytest.raises(SignInRefused, match="wrong"):
            await sign_in(accounts, name=f"name{number}", address="school")
    await sign_in(accounts, address="school")


async def test_users_that_another_program_changed_are_followed() -> None:
    accounts, _ = make()
    ended: list[Session] = []
    accounts.sessions.on_end(ended.append)
    await accounts.add_user("bob", Role.TEACHER, "also correct", who="ada")
    session = await sign_in(accounts, "bob", "also correct")
    accounts.load([user("ada"), user("bob", Role.VIEWER, "also correct")])
    assert session.role is Role.VIEWER
    accounts.load([user("ada")])
    assert ended == [session, session]
    assert not accounts.holds(session)
