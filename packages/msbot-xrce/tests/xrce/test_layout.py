"""The table of fields says what the decoders say, for every message of the genuine client and agent."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce import dissector, read_fields
from msbot_xrce.layout import BODIES
from msbot_xrce.messages import Create, SubmessageId, decode_header, iter_submessages
from tests import ROOT

VECTORS = ROOT / "tests" / "vectors"
CAPTURES = sorted(path for path in VECTORS.glob("udp_*.jsonl") if "malformed" not in path.name)


def packets(path: Path) -> list[bytes]:
    return [bytes.fromhex(json.loads(line)["hex"]) for line in path.read_text().splitlines()]


def decoded(packet: bytes) -> list[tuple[str, dict[str, object]]]:
    """The submessages with their attributes, by the decoders that the robot uses."""
    found = []
    for one in iter_submessages(packet, decode_header(packet).size):
        values = {field.name: getattr(one, field.name) for field in dataclasses.fields(one)}
        if isinstance(one, Create):
            values |= {"kind": int(one.variant.kind), "format": int(one.variant.format)}
        found.append((SubmessageId(one.ID).name, values))
    return found


@pytest.mark.parametrize("path", CAPTURES, ids=lambda path: path.stem)
def test_the_fields_of_genuine_messages_are_what_the_decoders_read(path: Path) -> None:
    compared = 0
    for packet in packets(path):
        fields, fault = read_fields(packet)
        if fault:
            continue  # what eProsima's tools send wrong on purpose; both tell the same, see below
        header = decode_header(packet)
        told = {one.name: one.value for one in fields if one.part == "header"}
        assert (told["session_id"], told["stream_id"], told["sequence_nr"], told.get("client_key")) == (
            header.session_id,
            header.stream_id,
            header.sequence_nr,
            header.client_key,
        )
        rest = [one for one in fields if one.part != "header"]
        begins = [number for number, one in enumerate(rest) if one.name == "submessage_id"]
        groups = [rest[begin:end] for begin, end in zip(begins, [*begins[1:], len(rest)], strict=True)]
        submessages = decoded(packet)
        assert [group[0].part for group in groups] == [name for name, _ in submessages]
        for group, (_, values) in zip(groups, submessages, strict=True):
            for one in group:
                if one.name in values:
                    assert (one.octets if one.value is None else one.value) == values[one.name], one
                    compared += 1
    assert compared, "something was compared"


def test_fields_follow_each_other_and_are_those_octets() -> None:
    for packet in packets(VECTORS / "udp_reqrep_req.jsonl"):
        fields, fault = read_fields(packet)
        assert not fault
        for one, after in zip(fields, [*fields[1:], None], strict=True):
            assert packet[one.start : one.start + len(one.octets)] == one.octets
            gap = (len(packet) if after is None else after.start) - one.start - len(one.octets)
            assert 0 <= gap <= 3, "but for padding, every byte has a name"


@given(st.binary(max_size=80))
def test_whatever_the_octets_they_are_read_without_an_exception(packet: bytes) -> None:
    for one in read_fields(packet)[0]:
        assert packet[one.start : one.start + len(one.octets)] == one.octets


def test_every_submessage_has_its_fields_and_its_row_in_the_dissector() -> None:
    assert set(BODIES) == set(SubmessageId)
    text = dissector((8888, 7777))
    for kind, body in BODIES.items():
        assert f"  [{int(kind)}] = {{" in text
        for field in body:
            assert f"f.{field.name} = ProtoField." in text
    assert "ports:add(7777, xrce)" in text


@pytest.mark.parametrize("flags", [0, 1])
@pytest.mark.parametrize("kind", [SubmessageId.TIMESTAMP, SubmessageId.TIMESTAMP_REPLY])
def test_numbers_are_read_in_the_order_of_octets_that_the_message_says(kind: SubmessageId, flags: int) -> None:
    size = sum(field.size for field in BODIES[kind] if field.size)
    body = bytes(range(1, size + 1))
    packet = bytes([0x80, 0, 0, 0, kind, flags, size, 0])
    fields, fault = read_fields(packet + body)
    assert not fault
    found = [one for one in fields if one.part == kind.name][3:]
    order: Literal["little", "big"] = "little" if flags else "big"
    assert [one.value for one in found] == [int.from_bytes(body[at : at + 4], order) for at in range(0, size, 4)]
