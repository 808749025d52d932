"""Conformance cases 79 to 86: statuses, samples and acknowledgements at the client's end."""

from __future__ import annotations

import pytest

from msbot_xrce.errors import LinkFull
from msbot_xrce.messages import STREAM_RELIABLE
from msbot_xrce.sessions import StatusReceived, WindowOpened
from tests.xrce.client_bench import Bench, acknack, data, fragment, head, heartbeat, received, status


def written(number: int) -> str:
    """Message `number` of stream 0x80, which writes one octet."""
    return head(0x80, number) + f"07010500{10 + number:04x}0015{number:02x}000000"


def write(bench: Bench, count: int, first: int = 0) -> list[str]:
    """Write that many samples, each in a message of its own."""
    sent = []
    for number in range(first, first + count):
        bench.session.write(0x0015, bytes([number]), STREAM_RELIABLE)
        sent += bench.pull()
    return sent


def test_case_79_status_is_told_and_acknowledged() -> None:
    bench = Bench()
    assert bench.feed("8180000005010600000a00110000") == ["810000000a0105000100000080"]
    assert bench.events() == [StatusReceived(0x000A, 0x0011, 0)]


def test_case_80_data_before_its_time_waits() -> None:
    bench = Bench()
    assert bench.feed("8180010009010800000a001601010101") == ["810000000a0105000000000180"]
    assert bench.events() == []
    assert bench.feed("8180000009010800000a001600000000") == ["810000000a0105000200000080"]
    assert bench.events() == [received("00000000"), received("01010101")]


def test_case_81_duplicate_data_is_told_once_and_acknowledged_again() -> None:
    bench = Bench()
    packet = "8180000009010800000a001600000000"
    assert bench.feed(packet) + bench.feed(packet) == [acknack(1), acknack(1)]
    assert bench.events() == [received("00000000")]


def test_case_81b_two_data_in_one_message_with_padding_between() -> None:
    bench = Bench()
    bench.feed("8101080009010900000a0016010203040500000009010800000a0016b8b8b8b8")
    assert bench.events() == [received("0102030405", 1), received("b8b8b8b8", 1)]


def test_case_81c_data_with_the_big_endian_flag_is_told_untouched() -> None:
    bench = Bench()
    assert bench.feed("8180000009000800000a001601020304") == [acknack(1)]
    assert bench.events() == [received("01020304")]


def test_case_81d_data_on_none_is_told_and_not_acknowledged() -> None:
    bench = Bench()
    assert bench.feed("8100000009010800000a001600ffffff") == []
    assert bench.events() == [received("00ffffff", 0)]


def test_case_82_what_is_not_acknowledged_is_announced_every_100_ms_and_sent_again() -> None:
    bench = Bench()
    assert write(bench, 3) == [written(0), written(1), written(2)]
    assert bench.wait(0.35) == ["810000000b0105000000020080"] * 3
    assert bench.feed(acknack(1)) == []
    assert set(bench.wait(1.0)) == {"810000000b0105000100020080"}
    assert bench.feed(acknack(1, 0b10)) == [written(2)]
    assert bench.feed(acknack(3)) == []
    assert bench.wait(10.0) == []


def test_case_82_nothing_acknowledged_at_all() -> None:
    bench = Bench()
    write(bench, 1)
    assert bench.wait(1.0) == ["810000000b0105000000000080"] * 10
    assert bench.feed(acknack(0, 1)) == [written(0)]


@pytest.mark.parametrize("stale", [0, 1, 5, 0xFFFF, 0x8000])
def test_case_83_acknack_older_than_known_or_from_the_future_is_ignored(stale: int) -> None:
    # The C client forgets its history.
    bench = Bench()
    write(bench, 4)
    assert bench.feed(acknack(2)) == []
    assert bench.feed(acknack(stale)) == []
    assert set(bench.wait(0.1)) == {heartbeat(2, 3)}
    assert bench.feed(acknack(2, 0b11)) == [written(2), written(3)]


def test_case_84_heartbeats_are_answered_with_what_is_missing() -> None:
    bench = Bench(window=4)
    bench.feed(head(0x80) + data("00"), head(0x80, 1) + data("01"))
    assert bench.feed(head(0x80, 6) + data("66")) == ["810000000a0105000200001f80"]
    assert bench.feed("810000000b0105000200050080") == ["810000000a0105000200001f80"]
    assert bench.feed(head(0x80, 2) + data("02"))[-1] == "810000000a0105000300000f80"
    assert bench.feed("810000000b0005000000000780") == ["810000000a0105000300001f80"]
    assert Bench().feed("810000000b0105000000030080") == ["810000000a0105000000000f80"]


def test_case_85_fragmented_data_is_told_once() -> None:
    bench = Bench()
    whole = "09015c02000a0016" + "ab" * 600
    assert bench.feed(head(0x80) + fragment(whole[:1000])) == [acknack(1)]
    assert bench.events() == []
    assert bench.feed(head(0x80, 1) + fragment(whole[1000:], last=True)) == [acknack(2)]
    assert bench.events() == [received("ab" * 600)]


def test_case_86_full_window_refuses_and_no_number_is_skipped() -> None:
    bench = Bench(window=4)
    assert write(bench, 4) == [written(number) for number in range(4)]
    for _ in range(3):
        assert not bench.session.has_room(STREAM_RELIABLE)
        with pytest.raises(LinkFull, match="is full"):
            bench.session.write(0x0015, b"!", STREAM_RELIABLE)
    assert bench.pull() == []
    assert bench.feed(acknack(1)) == []
    assert bench.events() == [WindowOpened(STREAM_RELIABLE)]
    bench.session.write(0x0015, b"\4", STREAM_RELIABLE)
    (packet,) = bench.pull()
    assert packet[:8] == head(0x80, 4)
    assert status(0x80, 4, 10)[:8] == packet[:8]
