"""Results are kept for the same object only, at most so many."""

from __future__ import annotations

import gc

import pytest

from msbot_xrce.identity_cache import IdentityCache


def test_the_same_object_is_asked_for_once_and_an_equal_one_anew() -> None:
    asked: list[list[int]] = []

    def total(of: list[int]) -> int:
        asked.append(of)
        return sum(of)

    kept = IdentityCache(total, 8)
    one, equal = [1, 2], [1, 2]
    assert [kept(one), kept(one), kept(equal), kept(equal)] == [3, 3, 3, 3]
    assert len(asked) == 2
    assert asked[0] is one
    assert asked[1] is equal


def test_an_object_that_is_gone_is_never_taken_for_another() -> None:
    kept: IdentityCache[list[int], int] = IdentityCache(lambda of: of[0], 4)
    for number in range(1000):
        assert kept([number]) == number, "lists of that size lie where earlier ones lay"


def test_no_more_than_allowed_are_kept() -> None:
    class Thing:
        alive = 0

        def __init__(self) -> None:
            Thing.alive += 1

        def __del__(self) -> None:
            Thing.alive -= 1

    kept = IdentityCache(id, 4)
    for _ in range(50):
        kept(Thing())
        assert Thing.alive <= 4
    del kept
    gc.collect()
    assert Thing.alive == 0


def test_what_it_raises_is_not_kept() -> None:
    kept: IdentityCache[str, int] = IdentityCache(int, 4)
    for _ in range(2):
        with pytest.raises(ValueError, match="invalid literal"):
            kept("no number")
