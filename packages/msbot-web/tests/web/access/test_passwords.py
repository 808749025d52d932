"""Argon2id hashes of passwords, and which passwords are too easy."""

from __future__ import annotations

import asyncio

import pytest
from argon2 import PasswordHasher

from msbot_web.access.passwords import (
    AT_ONCE,
    LONGEST,
    MOST_OF_ONE,
    SHORTEST,
    Argon2Hasher,
    TooManyHashes,
    check_password,
)
from msbot_xrce.errors import ConfigError

QUICK = Argon2Hasher(memory_kib=64)


@pytest.mark.parametrize("password", ["correct horse", "ö 猫 \x00", " ", "x" * 256])
async def test_only_the_password_itself_matches(password: str) -> None:
    stored = await QUICK.hash(password, asker="a")
    assert await QUICK.matches(stored, password, asker="a")
    assert not await QUICK.matches(stored, password + "x", asker="a")
    assert not await QUICK.matches(stored, password[1:], asker="a")


async def test_a_hash_is_argon2id_with_the_parameters_that_owasp_names_and_never_the_same() -> None:
    hasher = Argon2Hasher()
    first, second = await hasher.hash("correct horse", asker="a"), await hasher.hash("correct horse", asker="a")
    assert first.startswith("$argon2id$v=19$m=19456,t=2,p=1$")
    assert first != second
    assert await QUICK.matches(first, "correct horse", asker="a")
    assert QUICK.is_outdated(first)
    assert not hasher.is_outdated(first)


async def test_a_hash_of_the_versions_before_still_matches() -> None:
    stored = (  # made with cryptography's Argon2id, which MsBOT used before argon2-cffi
        "$argon2id$v=19$m=19456,t=2,p=1$hasPh/4R9MU2sDHQ6V8zzQ$HMYBwkbbK28dZEDzi+5O/lWLsI1Abeh8kx90fcNuJfk"
    )
    assert await QUICK.matches(stored, "correct horse", asker="a")
    assert not await QUICK.matches(stored, "correct hors", asker="a")
    assert await QUICK.matches(PasswordHasher(1, 64, 1).hash("correct horse"), "correct horse", asker="a")


@pytest.mark.parametrize("stored", ["", "x", "$argon2id$", "$argon2id$v=19$m=64,t=2,p=1$AAAA$AAAA", "plain words"])
async def test_what_is_no_hash_matches_nothing(stored: str) -> None:
    assert not await QUICK.matches(stored, "", asker="a")
    assert not await QUICK.matches(stored, stored, asker="a")


def test_passwords_have_a_shortest_and_a_longest_length() -> None:
    check_password("x" * SHORTEST)
    check_password("x" * LONGEST)
    with pytest.raises(ConfigError, match="at least 8 characters; this one has 7"):
        check_password("x" * 7)
    with pytest.raises(ConfigError, match="at most 256 characters; this one has 257"):
        check_password("x" * 257)


async def test_many_tries_of_one_delay_another_by_one_hash_and_too_many_are_turned_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hasher = Argon2Hasher(memory_kib=64)
    begun: list[str] = []

    def verify(stored: str, password: str) -> bool:
        begun.append(stored)
        return bool(password)

    monkeypatch.setattr(hasher, "_verify", verify)
    flood = [asyncio.ensure_future(hasher.matches("eve", "x", asker="eve")) for _ in range(MOST_OF_ONE + AT_ONCE + 7)]
    await asyncio.sleep(0)
    gone, late = (asyncio.ensure_future(hasher.matches(who, "x", asker=who)) for who in ("gone", "ada"))
    await asyncio.sleep(0)
    gone.cancel()
    assert await late
    told = await asyncio.gather(*flood, return_exceptions=True)
    assert begun.index("ada") <= AT_ONCE + 2
    assert "gone" not in begun
    assert sum(isinstance(one, TooManyHashes) for one in told) == 7
    assert begun.count("eve") == MOST_OF_ONE + AT_ONCE
    hasher.close()
