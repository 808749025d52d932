"""Signing in, sessions, API tokens and roles, in virtual time."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.errors import ConfigError
from msbot.web.accounts import (
    FIRST_PAUSE_S,
    FREE_TRIES,
    IDLE_S,
    LONGEST_PAUSE_S,
    LONGEST_S,
    MOST_SESSIONS,
    Accounts,
    MemoryUsers,
    NotAllowed,
    Session,
    SignedOut,
    SignInRefused,
)
from msbot.web.roles import Right, Role, role_named


class PlainHasher:
    """As the real one, but quick: what it does with passwords is tested elsewhere."""

    def hash(self, password: str) -> str:
        return f"hash of {password}"

    def matches(self, stored: str, password: str) -> bool:
        return stored == self.hash(password)


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def make() -> tuple[Accounts, Clock]:
    clock = Clock()
    accounts = Accounts(MemoryUsers(), clock=clock, hasher=PlainHasher())
    accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    return accounts, clock


def sign_in(accounts: Accounts, name: str = "ada", password: str = "correct horse", address: str = "a") -> Session:
    return accounts.sign_in(name, password, address)


def test_the_set_up_link_makes_the_first_administrator_and_works_once() -> None:
    accounts = Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())
    assert accounts.needs_setup
    token = accounts.setup_token()
    assert token == accounts.setup_token()
    with pytest.raises(SignInRefused, match="not valid"):
        accounts.set_up("guess", "eve", "long enough")
    with pytest.raises(ConfigError, match="at least 8 characters"):
        accounts.set_up(token, "ada", "short")
    session = accounts.set_up(token, "ada", "correct horse")
    assert session.role is Role.ADMINISTRATOR
    assert accounts.session(session.token) is session
    with pytest.raises(SignInRefused, match="not valid"):
        accounts.set_up(token, "eve", "long enough")
    assert not accounts.needs_setup


def test_an_empty_link_word_opens_nothing() -> None:
    accounts = Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())
    with pytest.raises(SignInRefused):
        accounts.set_up("", "eve", "long enough")
    with pytest.raises(SignInRefused):
        accounts.enter("")


def test_the_entry_link_signs_in_without_a_user() -> None:
    accounts = Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())
    session = accounts.enter(accounts.entry_token())
    assert accounts.session(session.token) is session
    assert session.may(Right.ADMINISTER)
    with pytest.raises(SignInRefused, match="another run"):
        accounts.enter("x")


def test_a_wrong_name_and_a_wrong_password_are_told_alike() -> None:
    accounts, _ = make()
    with pytest.raises(SignInRefused) as wrong_password:
        sign_in(accounts, password="guess")
    with pytest.raises(SignInRefused) as wrong_name:
        sign_in(accounts, name="nobody")
    assert str(wrong_password.value) == str(wrong_name.value)


def test_too_many_wrong_passwords_pause_that_name_at_that_address_only() -> None:
    accounts, clock = make()
    accounts.add_user("bob", Role.STUDENT, "also correct", who="ada")
    for _ in range(FREE_TRIES):
        with pytest.raises(SignInRefused, match="wrong"):
            sign_in(accounts, password="guess")
    with pytest.raises(SignInRefused, match="too many") as refused:
        sign_in(accounts)
    assert refused.value.retry_after_s == FIRST_PAUSE_S
    sign_in(accounts, address="another desk")
    sign_in(accounts, "bob", "also correct")
    clock.now += FIRST_PAUSE_S + 0.1
    sign_in(accounts)


def test_the_pause_doubles_up_to_a_limit() -> None:
    accounts, clock = make()
    pauses = []
    for _ in range(FREE_TRIES + 12):
        with pytest.raises(SignInRefused):
            sign_in(accounts, password="guess")
        with pytest.raises(SignInRefused) as refused:
            sign_in(accounts, password="guess")
        if refused.value.retry_after_s:
            pauses.append(refused.value.retry_after_s)
            clock.now += refused.value.retry_after_s + 0.1
    assert pauses[:3] == [FIRST_PAUSE_S, pytest.approx(2 * FIRST_PAUSE_S), pytest.approx(4 * FIRST_PAUSE_S)]
    assert max(pauses) == LONGEST_PAUSE_S


def test_one_password_with_many_names_is_stopped_by_the_address() -> None:
    accounts, _ = make()
    words = []
    for number in range(10 * FREE_TRIES + 1):
        with pytest.raises(SignInRefused) as refused:
            sign_in(accounts, name=f"name{number}", password="123456789", address="one")
        words.append(str(refused.value))
    assert "wrong" in words[0]
    assert "too many" in words[-1]


def test_sessions_end_after_idleness_and_in_any_case() -> None:
    accounts, clock = make()
    session = sign_in(accounts)
    clock.now += IDLE_S - 1
    assert accounts.session(session.token) is session
    clock.now += IDLE_S + 1
    assert accounts.session(session.token) is None
    busy = sign_in(accounts)
    until = clock.now + LONGEST_S
    while clock.now < until:
        assert accounts.session(busy.token) is busy
        clock.now += IDLE_S / 2
    clock.now += 1
    assert accounts.session(busy.token) is None


def test_sessions_are_bounded_and_the_one_unused_longest_goes_first() -> None:
    accounts, clock = make()
    sessions = []
    for _ in range(MOST_SESSIONS + 1):
        clock.now += 1
        sessions.append(sign_in(accounts))
    assert accounts.session(sessions[0].token) is None
    assert accounts.session(sessions[-1].token) is sessions[-1]


def test_a_changed_role_counts_at_once_and_a_removed_user_is_out() -> None:
    accounts, _ = make()
    accounts.add_user("bob", Role.TEACHER, "also correct", who="ada")
    session = sign_in(accounts, "bob", "also correct")
    accounts.require(session, Right.ARRANGE)
    accounts.change_user("bob", who="ada", role="viewer")
    with pytest.raises(NotAllowed, match="a viewer may not arrange parts; a teacher may"):
        accounts.require(session, Right.ARRANGE)
    accounts.require(session, Right.STOP)
    accounts.remove_user("bob", who="ada")
    with pytest.raises(SignedOut):
        accounts.require(session, Right.SEE)


def test_a_new_password_ends_the_sessions_of_that_user() -> None:
    accounts, _ = make()
    session = sign_in(accounts)
    accounts.change_user("ada", who="ada", password="another horse")
    assert accounts.session(session.token) is None
    with pytest.raises(SignInRefused):
        sign_in(accounts)
    sign_in(accounts, password="another horse")


def test_signing_out_ends_the_session() -> None:
    accounts, _ = make()
    session = sign_in(accounts)
    accounts.sign_out(session)
    assert accounts.session(session.token) is None
    with pytest.raises(SignedOut):
        accounts.require(session, Right.SEE)


def test_the_last_administrator_stays() -> None:
    accounts, _ = make()
    with pytest.raises(ConfigError, match="last administrator"):
        accounts.remove_user("ada", who="ada")
    with pytest.raises(ConfigError, match="last administrator"):
        accounts.change_user("ada", who="ada", role="teacher")
    accounts.add_user("bob", Role.ADMINISTRATOR, "also correct", who="ada")
    accounts.change_user("ada", who="bob", role="teacher")


@pytest.mark.parametrize("name", ["", " ada", "a" * 65, "a\nb", "ada"])
def test_names_that_will_not_do(name: str) -> None:
    accounts, _ = make()
    with pytest.raises(ConfigError):
        accounts.add_user(name, Role.STUDENT, "long enough", who="ada")


def test_api_tokens_stand_for_their_user_until_they_are_removed() -> None:
    accounts, _ = make()
    token = accounts.new_token("ada", "logger", who="ada")
    session = accounts.by_api_token(token)
    assert session is not None
    assert (session.name, session.role, session.token) == ("ada", Role.ADMINISTRATOR, "")
    assert token not in str(accounts.users())
    with pytest.raises(ConfigError, match="already"):
        accounts.new_token("ada", "logger", who="ada")
    accounts.remove_token("ada", "logger", who="ada")
    assert accounts.by_api_token(token) is None
    with pytest.raises(ConfigError, match="no token"):
        accounts.remove_token("ada", "logger", who="ada")


@given(st.text(max_size=80))
def test_a_guessed_token_opens_nothing(guess: str) -> None:
    accounts, _ = make()
    accounts.new_token("ada", "logger", who="ada")
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
