from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.filters import (
    IdFilter,
    eprosima_filters,
    id_range,
    legacy_filters,
    master_filters,
    one_id,
    part_filters,
)
from msbot_agent.link.can.protocol.ids import Assign, Beacon, CanIds, assign_frame, beacon_frame, join_frame, stop_frame


def heard(filters: tuple[IdFilter, ...], can_id: int, *, extended: bool = False) -> bool:
    """As the kernel decides."""
    return any(one.extended == extended and (can_id ^ one.can_id) & one.mask == 0 for one in filters)


@given(st.integers(0, 0x7FF), st.integers(0, 0x7FF))
@settings(deadline=None)
def test_a_range_is_covered_exactly_by_few_filters(one: int, other: int) -> None:
    first, last = sorted((one, other))
    filters = tuple(id_range(first, last))
    assert [number for number in range(0x800) if heard(filters, number)] == list(range(first, last + 1))
    assert len(filters) <= 20


IDS = CanIds()


def test_a_master_hears_parts_and_other_masters_and_nothing_else() -> None:
    filters = master_filters(IDS)
    hears = [number for number in range(0x800) if heard(filters, number)]
    assert hears == [IDS.stop, *range(0x101, 0x179), IDS.beacon]
    join = join_frame(b"\1\2\3\4\5\6\7\x08", 3, IDS)
    assert heard(filters, join.can_id, extended=True)
    assign = assign_frame(Assign(b"\1\2\3\4\5\6\7\x08", 7, 16383, 3), IDS)
    assert not heard(filters, assign.can_id, extended=True)
    assert not heard(filters, 0x123, extended=True)


def test_a_part_hears_the_master_whatever_address_it_gets() -> None:
    filters = part_filters(IDS)
    hears = [number for number in range(0x800) if heard(filters, number)]
    assert hears == [stop_frame(0, IDS).can_id, *range(0x181, 0x1F9), beacon_frame(Beacon(0, 0, 0), IDS).can_id]
    assign = assign_frame(Assign(b"\1\2\3\4\5\6\7\x08", 7, 16383, 3), IDS)
    assert heard(filters, assign.can_id, extended=True)
    assert not heard(filters, join_frame(b"\1\2\3\4\5\6\7\x08", 3, IDS).can_id, extended=True)


def test_legacy_and_eprosima_ends_hear_their_identifiers_and_stop() -> None:
    assert [n for n in range(0x800) if heard(legacy_filters(IDS, 0x123), n)] == [IDS.stop, 0x123]
    agent, client = eprosima_filters(IDS, None), eprosima_filters(IDS, 0xAB1)
    assert heard(agent, 0x1FFFFFFF, extended=True)
    assert heard(agent, IDS.stop)
    assert not heard(agent, 0x123)
    assert heard(client, 0xAB1, extended=True)
    assert not heard(client, 0xAB2, extended=True)


@pytest.mark.parametrize("extended", [False, True])
def test_one_identifier_is_told_by_all_its_bits(extended: bool) -> None:
    only = (one_id(0x123, extended=extended),)
    assert heard(only, 0x123, extended=extended)
    assert not heard(only, 0x122, extended=extended)
    assert not heard(only, 0x123, extended=not extended)


@pytest.mark.parametrize(
    ("first", "last", "count"), [(0, 0x7FF, 1), (0x100, 0x1FF, 1), (0x100, 0x100, 1), (0x101, 0x102, 2), (1, 0x7FE, 20)]
)
def test_a_range_takes_as_few_filters_as_there_are_blocks_in_it(first: int, last: int, count: int) -> None:
    assert len(id_range(first, last)) == count
