"""The message that tells the nodes of a participant, in its two forms."""

from __future__ import annotations

from struct import pack

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.ros.discovery_info import (
    SINCE_IRON,
    UNTIL_HUMBLE,
    NodeInfo,
    decode,
    encode,
    gid_octets_of,
    usual_gid_octets,
)
from msbot_agent.ros.node_names import NodeName
from tests.effort import tries

GUIDS = st.binary(min_size=16, max_size=16)
NODES = st.lists(
    st.builds(
        NodeInfo,
        st.builds(NodeName, st.just("/ROVER"), st.from_regex(r"[a-z]{1,9}", fullmatch=True)),
        st.lists(GUIDS, max_size=3).map(tuple),
        st.lists(GUIDS, max_size=3).map(tuple),
    ),
    max_size=3,
)


def test_the_octets_of_a_node() -> None:
    node = NodeInfo(NodeName("/", "abc"), (bytes(range(16)),), ())
    assert encode(b"P" * 16, [node], SINCE_IRON) == (
        b"P" * 16 + pack("<II2s2xI4s", 1, 2, b"/\0", 4, b"abc\0") + pack("<I", 1) + bytes(range(16)) + pack("<I", 0)
    )


@settings(max_examples=tries(25, 2000))
@given(GUIDS, NODES, st.sampled_from([SINCE_IRON, UNTIL_HUMBLE]))
def test_what_was_told_is_read_again(participant: bytes, nodes: list[NodeInfo], octets: int) -> None:
    told = encode(participant, nodes, octets)
    assert decode(told, octets) == (participant, nodes)
    assert gid_octets_of(told) in (octets, None)


@pytest.mark.parametrize("octets", [SINCE_IRON, UNTIL_HUMBLE])
def test_a_usual_message_shows_its_form(octets: int) -> None:
    node = NodeInfo(NodeName("/", "talker"), (bytes(range(16)),), (bytes(range(16, 32)),))
    assert gid_octets_of(encode(bytes(range(1, 17)), [node], octets)) == octets


@given(st.binary(max_size=80))
def test_octets_of_a_stranger_raise_nothing(octets: bytes) -> None:
    assert gid_octets_of(octets) in (SINCE_IRON, UNTIL_HUMBLE, None)


def test_the_distribution_says_which_form_is_usual() -> None:
    assert [usual_gid_octets(name) for name in ("humble", "iron", "jazzy", None)] == [24, 16, 16, 16]
