"""The inventory's indexes: leases, holders, identities, what is remembered of parts that are gone."""

from __future__ import annotations

from random import Random

import pytest

from msbot.pnp import THESIS_TIMING, PartState
from msbot.pnp.book import Book, Session
from msbot.pnp.record import Record


class RepeatingRandom(Random):
    """Draws the same few numbers again and again."""

    def __init__(self, *numbers: int) -> None:
        super().__init__(0)
        self.numbers = list(numbers)

    def getrandbits(self, k: int, /) -> int:
        assert k == 32
        return self.numbers.pop(0)


def book_of(*numbers: int, keep_ended: int = 2) -> Book:
    return Book(RepeatingRandom(*numbers), THESIS_TIMING, keep_ended=keep_ended)


def enter(book: Book, key: int, identity: bytes = b"") -> Record:
    book.sessions[key] = Session(key, f"peer {key}", 0.0)
    record = book.open_record(book.sessions[key])
    if identity:
        book.identify(record, identity)
    return record


def end(book: Book, record: Record) -> None:
    record.move(PartState.NEW, 0.0, "test")
    record.move(PartState.LEFT, 0.0, "test")
    book.detach(record)


def test_a_lease_is_never_0_and_never_one_that_is_in_use() -> None:
    book = book_of(7, 0, 7, 8)
    first, second = enter(book, 1), enter(book, 2)
    book.grant(first, "AA")
    book.grant(second, "BB")
    assert (first.lease, second.lease) == (7, 8)


def test_a_new_lease_ends_the_old_one() -> None:
    book = book_of(7, 8)
    record = enter(book, 1)
    book.grant(record, "AA")
    book.grant(record, "AA")
    assert book.by_lease(7, 1) is None
    assert book.by_lease(8, 1) is record


def test_a_lease_is_worth_something_from_its_own_session_only() -> None:
    book = book_of(7)
    record = enter(book, 1)
    book.grant(record, "AA")
    assert book.by_lease(7, 1) is record
    assert book.by_lease(7, 2) is None
    assert book.by_lease(0, 1) is None


def test_vacating_tells_the_slot_that_is_free_now_once() -> None:
    book = book_of(7)
    record = enter(book, 1)
    assert book.vacate(record) is None
    book.grant(record, "AA")
    assert book.vacate(record) == "AA"
    assert book.vacate(record) is None
    assert (record.slot, record.lease, book.holders) == ("AA", 0, {})


def test_a_rival_has_the_same_identity_and_holds_a_slot() -> None:
    book = book_of(7)
    first, second = enter(book, 1, b"uid"), enter(book, 2)
    assert book.rival(second, b"uid") is None
    book.grant(first, "AA")
    assert book.rival(second, b"uid") is first
    assert book.rival(first, b"uid") is None
    assert book.rival(second, b"other") is None


def test_a_part_that_comes_back_continues_its_old_line() -> None:
    book = book_of()
    old = enter(book, 1, b"uid")
    old.refused_claims, old.slot = 3, "AA"
    end(book, old)
    new = enter(book, 2, b"uid")
    assert list(book.records) == [new]
    assert (new.refused_claims, new.slot, len(new.history)) == (3, "AA", 2)


def test_a_part_that_is_still_there_keeps_its_own_line() -> None:
    book = book_of()
    old, new = enter(book, 1, b"uid"), enter(book, 2, b"uid")
    assert list(book.records) == [old, new]


def test_a_part_may_change_its_identity() -> None:
    book = book_of(7)
    record = enter(book, 1, b"one")
    book.identify(record, b"one")
    book.identify(record, b"two")
    book.grant(record, "AA")
    other = enter(book, 2)
    assert book.rival(other, b"one") is None
    assert book.rival(other, b"two") is record


@pytest.mark.parametrize(("keep", "shown"), [(0, 0), (1, 1), (2, 2), (9, 3)])
def test_the_oldest_part_that_is_gone_is_forgotten_first(keep: int, shown: int) -> None:
    book = book_of(keep_ended=keep)
    records = [enter(book, key, bytes([key])) for key in (1, 2, 3)]
    for record in records:
        end(book, record)
    assert list(book.records) == records[3 - shown :]


def test_a_part_that_never_said_who_it_is_is_forgotten_at_once() -> None:
    book = book_of()
    record = enter(book, 1)
    end(book, record)
    assert list(book.records) == []
    assert book.sessions[1].record is None


def test_forgetting_ends_the_tie_with_the_session() -> None:
    book = book_of()
    record = enter(book, 1, b"uid")
    book.forget(record)
    assert book.sessions[1].record is None
    assert list(book.find("peer 1")) == []
