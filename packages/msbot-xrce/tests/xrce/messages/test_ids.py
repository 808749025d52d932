"""Identifiers and their words."""

from __future__ import annotations

import pytest

from msbot_xrce import Status
from msbot_xrce.messages import (
    STREAM_BEST_EFFORT,
    STREAM_RELIABLE,
    ObjectKind,
    kind_of,
    make_object_id,
    read_request_id,
    status_words,
    write_request_id,
)


@pytest.mark.parametrize(
    ("number", "kind", "object_id"), [(1, ObjectKind.DATAWRITER, 0x0015), (0x123, ObjectKind.DATAWRITER, 0x1235)]
)
def test_object_id_is_12_bits_of_number_and_4_of_kind(number: int, kind: ObjectKind, object_id: int) -> None:
    assert make_object_id(number, kind) == object_id
    assert kind_of(object_id) == kind


@pytest.mark.parametrize("status", list(Status))
def test_every_status_has_words(status: Status) -> None:
    assert status.describe
    assert status_words(int(status)) == status.describe


def test_unknown_status_has_words_too() -> None:
    assert status_words(0x99) == "unknown status 0x99"


def test_request_ids_by_rule_never_meet() -> None:
    best_effort = {write_request_id(STREAM_BEST_EFFORT, nr) for nr in range(0x10000)}
    reliable = {write_request_id(STREAM_RELIABLE, nr) for nr in range(0x10000)}
    reads = {read_request_id(object_id) for object_id in range(0x10000)}
    assert best_effort == set(range(0x8000, 0xA000))
    assert reliable == set(range(0xA000, 0xC000))
    assert reads == set(range(0xC000, 0x10000))
