"""Argon2id hashes of passwords, and which passwords are too easy."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.errors import ConfigError
from msbot.web.passwords import LONGEST, SHORTEST, Argon2Hasher, check_password

QUICK = Argon2Hasher(memory_kib=64)


@settings(deadline=None, max_examples=20)
@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1), st.text(st.characters(exclude_categories=["Cs"])))
def test_only_the_password_itself_matches(password: str, other: str) -> None:
    stored = QUICK.hash(password)
    assert QUICK.matches(stored, password)
    assert QUICK.matches(stored, other) == (other == password)


def test_a_hash_is_argon2id_with_the_parameters_that_owasp_names_and_never_the_same() -> None:
    first, second = Argon2Hasher().hash("correct horse"), Argon2Hasher().hash("correct horse")
    assert first.startswith("$argon2id$v=19$m=19456,t=2,p=1$")
    assert first != second
    assert QUICK.matches(first, "correct horse")


@pytest.mark.parametrize("stored", ["", "x", "$argon2id$", "$argon2id$v=19$m=64,t=2,p=1$AAAA$AAAA", "plain words"])
def test_what_is_no_hash_matches_nothing(stored: str) -> None:
    assert not QUICK.matches(stored, "")
    assert not QUICK.matches(stored, stored)


def test_passwords_have_a_shortest_and_a_longest_length() -> None:
    check_password("x" * SHORTEST)
    check_password("x" * LONGEST)
    with pytest.raises(ConfigError, match="at least 8 characters; this one has 7"):
        check_password("x" * 7)
    with pytest.raises(ConfigError, match="at most 256 characters; this one has 257"):
        check_password("x" * 257)
