"""Argon2id hashes of passwords, and which passwords are too easy."""

from __future__ import annotations

import pytest
from argon2 import PasswordHasher

from msbot.errors import ConfigError
from msbot.web.access.passwords import LONGEST, SHORTEST, Argon2Hasher, check_password

QUICK = Argon2Hasher(memory_kib=64)


@pytest.mark.parametrize("password", ["correct horse", "ö 猫 \x00", " ", "x" * 256])
async def test_only_the_password_itself_matches(password: str) -> None:
    stored = await QUICK.hash(password)
    assert await QUICK.matches(stored, password)
    assert not await QUICK.matches(stored, password + "x")
    assert not await QUICK.matches(stored, password[1:])


async def test_a_hash_is_argon2id_with_the_parameters_that_owasp_names_and_never_the_same() -> None:
    hasher = Argon2Hasher()
    first, second = await hasher.hash("correct horse"), await hasher.hash("correct horse")
    assert first.startswith("$argon2id$v=19$m=19456,t=2,p=1$")
    assert first != second
    assert await QUICK.matches(first, "correct horse")
    assert QUICK.is_outdated(first)
    assert not hasher.is_outdated(first)


async def test_a_hash_of_the_versions_before_still_matches() -> None:
    stored = (  # made with cryptography's Argon2id, which MsBOT used before argon2-cffi
        "$argon2id$v=19$m=19456,t=2,p=1$hasPh/4R9MU2sDHQ6V8zzQ$HMYBwkbbK28dZEDzi+5O/lWLsI1Abeh8kx90fcNuJfk"
    )
    assert await QUICK.matches(stored, "correct horse")
    assert not await QUICK.matches(stored, "correct hors")
    assert await QUICK.matches(PasswordHasher(1, 64, 1).hash("correct horse"), "correct horse")


@pytest.mark.parametrize("stored", ["", "x", "$argon2id$", "$argon2id$v=19$m=64,t=2,p=1$AAAA$AAAA", "plain words"])
async def test_what_is_no_hash_matches_nothing(stored: str) -> None:
    assert not await QUICK.matches(stored, "")
    assert not await QUICK.matches(stored, stored)


def test_passwords_have_a_shortest_and_a_longest_length() -> None:
    check_password("x" * SHORTEST)
    check_password("x" * LONGEST)
    with pytest.raises(ConfigError, match="at least 8 characters; this one has 7"):
        check_password("x" * 7)
    with pytest.raises(ConfigError, match="at most 256 characters; this one has 257"):
        check_password("x" * 257)
