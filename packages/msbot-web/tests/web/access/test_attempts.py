"""Waiting after wrong passwords, in virtual time: guessing is slow, and nobody is locked out by somebody else."""

from __future__ import annotations

import pytest

from msbot_web.access.sign_in_throttle import (
    ADDRESS_BURST,
    ADDRESS_STEP_S,
    FIRST_PAUSE_S,
    FREE_TRIES,
    FREE_TRIES_OF_ALL,
    LONGEST_PAUSE_S,
    MOST_WATCHED,
    SignInRefused,
    SignInThrottle,
)


def test_too_many_wrong_passwords_pause_that_name_at_that_address_only() -> None:
    attempts = SignInThrottle()
    for _ in range(FREE_TRIES):
        attempts.admit("ada", "a", "", 0.0)
    with pytest.raises(SignInRefused, match="too many") as refused:
        attempts.admit("ADA", "a", "", 0.0)
    assert refused.value.retry_after_s == FIRST_PAUSE_S
    attempts.admit("ada", "another desk", "", 0.0)
    attempts.admit("bob", "a", "", 0.0)
    attempts.admit("ada", "a", "known", 0.0)
    attempts.admit("ada", "a", "", FIRST_PAUSE_S + 0.1)


def test_the_pause_doubles_up_to_a_limit() -> None:
    attempts, now, pauses = SignInThrottle(), 0.0, []
    for _ in range(FREE_TRIES + 12):
        try:
            attempts.admit("ada", "a", "known", now)
        except SignInRefused as refused:
            pauses.append(refused.retry_after_s)
            now += refused.retry_after_s + 0.1
    assert pauses[:3] == [FIRST_PAUSE_S, pytest.approx(2 * FIRST_PAUSE_S), pytest.approx(4 * FIRST_PAUSE_S)]
    assert max(pauses) == LONGEST_PAUSE_S


def test_guesses_at_one_name_from_many_addresses_are_paused_together() -> None:
    attempts = SignInThrottle()
    for number in range(FREE_TRIES_OF_ALL):
        attempts.admit("ada", f"address {number}", "", 0.0)
    with pytest.raises(SignInRefused, match="too many wrong passwords"):
        attempts.admit("ada", "a new address", "", 0.0)
    attempts.admit("ada", "a new address", "known", 0.0)


def test_a_class_behind_one_router_signs_in_at_once_and_many_more_wait_their_turn() -> None:
    attempts = SignInThrottle()
    waits = [attempts.admit(f"pupil {number}", "router", "", 0.0) for number in range(ADDRESS_BURST + 3)]
    assert waits[:ADDRESS_BURST] == [0.0] * ADDRESS_BURST
    assert waits[ADDRESS_BURST:] == pytest.approx([ADDRESS_STEP_S, 2 * ADDRESS_STEP_S, 3 * ADDRESS_STEP_S])
    for number in range(17):  # those who wait ten seconds at most
        attempts.admit(f"somebody {number}", "router", "", 0.0)
    with pytest.raises(SignInRefused, match="at this moment"):
        attempts.admit("somebody", "router", "", 0.0)
    assert attempts.admit("somebody", "another house", "", 0.0) == 0.0


def test_what_is_remembered_is_bounded() -> None:
    attempts = SignInThrottle()
    for number in range(MOST_WATCHED + 100):
        attempts.admit(f"one {number}", f"address {number}", "", 1000.0 * number)
        attempts.admit(f"name {number}", "a", f"known {number}", 0.0)
    assert len(attempts._tries) <= MOST_WATCHED
    assert len(attempts._spacings) <= MOST_WATCHED


def test_of_many_tries_at_once_no_more_are_looked_at_than_one_after_the_other() -> None:
    attempts, refused = SignInThrottle(), 0
    for _ in range(FREE_TRIES + 20):  # none of them has been told anything yet
        try:
            attempts.admit("ada", "a", "", 0.0)
        except SignInRefused:
            refused += 1
    assert refused == 20


def test_a_try_that_was_told_nothing_does_not_count() -> None:
    attempts = SignInThrottle()
    for _ in range(FREE_TRIES + 20):
        attempts.admit("ada", "a", "", 0.0)
        attempts.abandoned("ada", "a", "")
    assert not attempts._tries


def test_tries_in_a_known_browser_count_there_alone() -> None:
    attempts = SignInThrottle()
    for _ in range(FREE_TRIES):
        attempts.admit("ada", "a", "one", 0.0)
    with pytest.raises(SignInRefused, match="too many wrong"):
        attempts.admit("ada", "a", "one", 0.0)
    attempts.admit("ada", "a", "another", 0.0)
    attempts.admit("ada", "a", "", 0.0)
