"""The inventory's indexes: leases, holders, identities, what is remembered of parts that are gone."""

from __future__ import annotations

from random import Random

import pytest

from msbot.pnp import THESIS_TIMING, PartState
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.inventory_record import InventoryRecord


class RepeatingRandom(Random):
    """Draws the same few numbers again and again."""

    def __init__(self, *numbers: int) -> None:
        super().__init__(0)
        self.numbers = list(numbers)

    def getrandbits(self, k: int, /) -> int:
        assert k == 32
        return self.numbers.pop(0)


def index_of(*numbers: int, keep_ended: int = 2) -> InventoryIndex:
    return InventoryIndex(RepeatingRandom(*numbers), THESIS_TIMING, keep_ended=keep_ended)


def enter(index: InventoryIndex, key: int, identity: bytes = b"") -> InventoryRecord:
    index.sessions[key] = PartSession(key, f"peer {key}", 0.0)
    record = index.open_record(index.sessions[key])
    if identity:
        index.identify(record, identity)
    return record


def end(index: InventoryIndex, record: InventoryRecord) -> None:
    record.move(PartState.NEW, 0.0, "test")
    record.move(PartState.LEFT, 0.0, "test")
    index.detach(record)


def test_a_session_shows_its_own_key_unless_told_otherwise_and_nobody_probes_it() -> None:
    assert (PartSession(7, "peer", 0.0).client_key, PartSession(7, "peer", 0.0).patience_s) == (7, 0.0)
    other = PartSession(7, "peer", 0.0, client_key=9, patience_s=2.5)
    assert (other.key, other.client_key, other.patience_s) == (7, 9, 2.5)


def test_a_lease_is_never_0_and_never_one_that_is_in_use() -> None:
    index = index_of(7, 0, 7, 8)
    first, second = enter(index, 1), enter(index, 2)
    index.grant(first, "AA")
    index.grant(second, "BB")
    assert (first.lease, second.lease) == (7, 8)


def test_a_new_lease_ends_the_old_one() -> None:
    index = index_of(7, 8)
    record = enter(index, 1)
    index.grant(record, "AA")
    index.grant(record, "AA")
    assert index.by_lease(7, 1) is None
    assert index.by_lease(8, 1) is record


def test_a_lease_is_worth_something_from_its_own_session_only() -> None:
    index = index_of(7)
    record = enter(index, 1)
    index.grant(record, "AA")
    assert index.by_lease(7, 1) is record
    assert index.by_lease(7, 2) is None
    assert index.by_lease(0, 1) is None


def test_vacating_tells_the_slot_that_is_free_now_once() -> None:
    index = index_of(7)
    record = enter(index, 1)
    assert index.vacate(record) is None
    index.grant(record, "AA")
    assert index.vacate(record) == "AA"
    assert index.vacate(record) is None
    assert (record.slot, record.lease, index.holders) == ("AA", 0, {})


def test_a_rival_has_the_same_identity_and_holds_a_slot() -> None:
    index = index_of(7)
    first, second = enter(index, 1, b"uid"), enter(index, 2)
    assert index.rival(second, b"uid") is None
    index.grant(first, "AA")
    assert index.rival(second, b"uid") is first
    assert index.rival(first, b"uid") is None
    assert index.rival(second, b"other") is None


def test_a_part_that_comes_back_continues_its_old_line() -> None:
    index = index_of()
    old = enter(index, 1, b"uid")
    old.refused_claims, old.slot = 3, "AA"
    end(index, old)
    new = enter(index, 2, b"uid")
    assert list(index.records) == [new]
    assert (new.refused_claims, new.slot, len(new.history)) == (3, "AA", 2)


def test_a_part_that_is_still_there_keeps_its_own_line() -> None:
    index = index_of()
    old, new = enter(index, 1, b"uid"), enter(index, 2, b"uid")
    assert list(index.records) == [old, new]


def test_a_part_may_change_its_identity() -> None:
    index = index_of(7)
    record = enter(index, 1, b"one")
    index.identify(record, b"one")
    index.identify(record, b"two")
    index.grant(record, "AA")
    other = enter(index, 2)
    assert index.rival(other, b"one") is None
    assert index.rival(other, b"two") is record


@pytest.mark.parametrize(("keep", "shown"), [(0, 0), (1, 1), (2, 2), (9, 3)])
def test_the_oldest_part_that_is_gone_is_forgotten_first(keep: int, shown: int) -> None:
    index = index_of(keep_ended=keep)
    records = [enter(index, key, bytes([key])) for key in (1, 2, 3)]
    for record in records:
        end(index, record)
    assert list(index.records) == records[3 - shown :]


def test_a_part_that_never_said_who_it_is_is_forgotten_at_once() -> None:
    index = index_of()
    record = enter(index, 1)
    end(index, record)
    assert list(index.records) == []
    assert index.sessions[1].record is None


def test_forgetting_ends_the_tie_with_the_session() -> None:
    index = index_of()
    record = enter(index, 1, b"uid")
    index.forget(record)
    assert index.sessions[1].record is None
    assert list(index.find("peer 1")) == []


def test_an_identity_is_known_once_a_part_has_shown_it() -> None:
    index = index_of(1)
    assert index.has_identity(b"a") is False
    enter(index, 1, b"a")
    assert index.has_identity(b"a") is True
