"""The inventory's indexes: leases, holders, identities, what is remembered of parts that are gone."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.pnp import THESIS_TIMING, PartState
from msbot.pnp.inventory_index import InventoryIndex, PartSession
from msbot.pnp.inventory_record import InventoryRecord
from tests.effort import tries


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


class PlainIndex:
    """The same without an index: lists of what happened, searched through each time."""

    def __init__(self) -> None:
        self.shown: list[InventoryRecord] = []
        self.said: list[tuple[bytes, InventoryRecord]] = []
        """Who said they were whom, in order."""
        self.ended: list[InventoryRecord] = []
        self.behind: dict[int, InventoryRecord] = {}
        """By session."""
        self.barred: list[tuple[InventoryRecord, str]] = []

    def newest(self, identity: bytes) -> InventoryRecord | None:
        for name, record in reversed(self.said):
            if name == identity:
                return record if record in self.shown and record.identity == identity else None
        return None

    def identify(self, record: InventoryRecord, identity: bytes) -> None:
        old = self.newest(identity)
        if old is not None and old is not record and old in self.ended:
            self.forget(old)
        if old is not record:
            self.said.append((identity, record))

    def forget(self, record: InventoryRecord) -> None:
        self.shown.remove(record)
        self.ended = [one for one in self.ended if one is not record]
        self.barred = [(one, slot) for one, slot in self.barred if one is not record]
        self.behind = {key: one for key, one in self.behind.items() if one is not record}

    def end(self, record: InventoryRecord) -> None:
        self.behind = {key: one for key, one in self.behind.items() if one is not record}
        self.ended.append(record)
        if not record.identity:
            self.forget(record)
        elif len(self.ended) > 2:
            self.forget(self.ended[0])

    def grant(self, record: InventoryRecord, slot: str) -> None:
        self.barred = [(one, name) for one, name in self.barred if one is not record and name != slot]


STEPS = st.tuples(
    st.sampled_from(["settle", "settle", "open", "identify", "grant", "vacate", "bar", "end", "leave", "forget"]),
    st.sampled_from([1, 1, 2, 3]),
    st.sampled_from(["AA", "AA", "BB"]),
    st.sampled_from([b"red", b"red", b"blue", b"green"]),
)


def check(index: InventoryIndex, plain: PlainIndex) -> None:
    assert list(index.records) == plain.shown
    assert sorted((one.client_key, slot) for one, slot in index.barred.items()) == sorted(
        (one.client_key, slot) for one, slot in plain.barred
    )
    for key in (1, 2, 3):
        assert index.record_of(key) is plain.behind.get(key)
    held = {record.slot for record in plain.shown if record.holds_slot}
    for record in plain.shown:
        speaks = plain.behind.get(record.client_key) is record
        assert index.pupil_of(record) == (f"pupil {record.client_key}" if speaks else "")
        lost = record in plain.ended and record.slot not in held
        assert index.slot_of(record) == (record.slot if record.holds_slot or lost else None)
        if record.identity:
            assert index.is_newest(record) is (plain.newest(record.identity) is record)
        for client_key in (1, 2, 3):
            is_own = record.lease != 0 and client_key == record.client_key
            assert index.by_lease(record.lease, client_key) is (record if is_own else None)
        assert record in index.find(f"{record.client_key:08X}")
        assert (record in index.find(record.slot or "none")) is (record.slot is not None)
    for identity in (b"red", b"blue", b"green"):
        newest = plain.newest(identity)
        assert index.has_identity(identity) is (newest is not None)
        for record in plain.shown:
            rival = newest is not None and newest is not record and newest.holds_slot
            assert index.rival(record, identity) is (newest if rival else None)


@settings(max_examples=tries(100, 2000))
@given(st.lists(STEPS, min_size=5, max_size=40))
def test_whatever_happens_the_indexes_say_what_a_search_through_all_would(
    steps: list[tuple[str, int, str, bytes]],
) -> None:
    index, plain = index_of(*range(1, 50)), PlainIndex()
    for what, key, slot, identity in steps:
        record = plain.behind.get(key)
        if what in ("open", "settle") and record is None:
            index.sessions[key] = PartSession(key, f"peer {key}", 0.0)
            index.sessions[key].pupil = f"pupil {key}"
            record = plain.behind[key] = index.open_record(index.sessions[key])
            record.move(PartState.NEW, 0.0, "test")
            plain.shown.append(record)
        if record is None:
            continue
        if what in ("identify", "settle"):
            plain.identify(record, identity)
            index.identify(record, identity)
        if what in ("grant", "settle") and not record.holds_slot:
            if all(one.slot != slot for one in plain.shown if one.holds_slot):
                plain.grant(record, slot)
                index.grant(record, slot)
        elif what == "bar" and not record.holds_slot:
            plain.barred = [*((one, name) for one, name in plain.barred if one is not record), (record, slot)]
            index.barred[record] = slot
        elif what == "forget" and not record.holds_slot:
            plain.forget(record)
            index.forget(record)
        elif what in ("vacate", "end", "leave"):
            held = record.slot if record.holds_slot else None
            assert index.vacate(record) == held
            assert (record.lease, record.holds_slot) == (0, False)
        if what == "leave":
            del index.sessions[key]
        if what in ("end", "leave"):
            record.move(PartState.LEFT, 0.0, "test")
            plain.end(record)
            index.detach(record)
        check(index, plain)
