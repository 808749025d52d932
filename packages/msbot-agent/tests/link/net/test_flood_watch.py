"""A flood of strangers is read in part, a newcomer is heard within one round of turns. In virtual time."""

from __future__ import annotations

import random

import pytest

from msbot_agent.link.net.stranger_filter import (
    AGAIN_S,
    CALM_S,
    CHANCES,
    FLOOD_PER_S,
    LOOK_S,
    MOST_HEARD,
    MOST_TURNS,
    READ_PER_S,
    TURN_S,
    FloodWatch,
)


def looks(watch: FloodWatch, per_s: float, seconds: float, now: float, *, is_spread: bool = True) -> tuple[float, int]:
    """Look on for so long, with that many datagrams a second; gives the time, and how many were read."""
    count, end = 0, now + seconds
    while now < end:
        came = int(per_s * LOOK_S)
        if watch.admission is None:
            read = came
        else:
            share = 1 / watch.admission.turns if is_spread else float(watch.admission.turn == 0)
            read = int(came * share * watch.admission.chance / CHANCES)
        count += read
        now += LOOK_S
        watch.update(read, came - read, now)
    return now, count


def test_few_strangers_are_all_heard() -> None:
    watch = FloodWatch()
    watch.update(0, 0, 0.0)
    looks(watch, FLOOD_PER_S - 10, 10.0, 0.0)
    assert watch.admission is None


@pytest.mark.parametrize("per_s", [2000, 8700, 30_000])
def test_a_flood_from_many_addresses_is_read_in_turns_and_no_more_than_can_be(per_s: int) -> None:
    watch = FloodWatch()
    watch.update(0, 0, 0.0)
    now, _ = looks(watch, per_s, 3.0, 0.0)
    assert watch.admission is not None
    assert watch.admission.turns >= 2
    _, read = looks(watch, per_s, 40.0, now)
    assert read / 40.0 <= 1.5 * READ_PER_S


def test_a_flood_from_one_address_takes_no_turn_but_its_own_and_only_a_part_of_that() -> None:
    watch = FloodWatch()
    watch.update(0, 0, 0.0)
    now, _ = looks(watch, 50_000, 3.0, 0.0, is_spread=False)
    _, read = looks(watch, 50_000, 60.0, now, is_spread=False)
    assert read / 60.0 <= READ_PER_S


def test_every_group_has_its_turn() -> None:
    watch = FloodWatch()
    watch.update(0, 0, 0.0)
    now, _ = looks(watch, 20_000, 3.0, 0.0)
    assert watch.admission is not None
    turns, seen = watch.admission.turns, set()
    for _ in range(turns + 1):
        now, _ = looks(watch, 20_000, TURN_S, now)
        seen.add(watch.admission.turn)
    assert turns <= MOST_TURNS
    assert seen >= set(range(turns))


def test_it_is_over_when_few_have_come_for_a_while_and_not_before() -> None:
    watch = FloodWatch()
    watch.update(0, 0, 0.0)
    now, _ = looks(watch, 8700, 3.0, 0.0)
    now, _ = looks(watch, 100, CALM_S / 2, now)
    now, _ = looks(watch, 8700, LOOK_S, now)
    now, _ = looks(watch, 100, CALM_S - LOOK_S, now)
    assert watch.admission is not None
    looks(watch, 100, 2 * LOOK_S, now)
    assert watch.admission is None


def test_who_asks_again_is_answered_and_who_sends_twice_at_once_is_not() -> None:
    watch = FloodWatch()
    assert not watch.answers("one", 10.0)
    assert not watch.answers("one", 10.0 + AGAIN_S / 2)
    assert not watch.answers("another", 11.0)
    assert watch.answers("one", 11.0)
    assert watch.answers("one", 11.1)


def test_what_is_remembered_is_bounded_and_who_asked_lately_is_among_it() -> None:
    watch, chance = FloodWatch(), random.Random(1)
    for number in range(3 * MOST_HEARD):
        assert not watch.answers(chance.random(), number / 1000)
        if number % 1000 == 0 and number:
            assert watch.answers("board", number / 1000) == (number > 1000)
    assert len(watch._heard) + len(watch._heard_before) <= MOST_HEARD + 1
