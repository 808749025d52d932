"""The client's end of a session, packet by packet, as a genuine client speaks (its recorded packets are the tables)."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from msbot_xrce import ClientState
from msbot_xrce.errors import LinkFull, LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages import DeliveryControl
from msbot_xrce.sessions import (
    Connected,
    ConnectFailed,
    DataReceived,
    Pong,
    SessionClosed,
    SessionRestarted,
    StatusReceived,
    TimeSynchronised,
    WindowOpened,
)
from tests.xrce.client_bench import (
    LOGIN,
    LOGOUT,
    PARTICIPANT,
    SECOND,
    WELCOME,
    Bench,
    acknack,
    data,
    fragment,
    head,
    heartbeat,
    received,
    status,
)

# Login.


def test_login_is_sent_until_it_is_answered() -> None:
    bench = Bench(connected=False)
    assert bench.state() is ClientState.IDLE
    assert bench.session.timer() is None
    bench.session.connect(0.0)
    assert bench.state() is ClientState.CONNECTING
    assert bench.wait(2.5) == [LOGIN] * 3
    assert bench.feed(WELCOME) == []
    assert bench.events() == [Connected()]
    assert bench.state() is ClientState.CONNECTED
    assert bench.wait(100.0) == []


def test_login_without_an_answer_fails_after_10_tries_a_second_apart() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    assert bench.wait(9.9) == [LOGIN] * 10
    assert bench.events() == []
    assert bench.wait(0.1) == []
    assert bench.events() == [ConnectFailed(None)]
    assert bench.state() is ClientState.FAILED
    assert bench.session.timer() is None


def test_login_settings() -> None:
    bench = Bench(connected=False, login_period_s=0.5, login_tries=None)
    bench.session.connect(0.0)
    assert bench.wait(49.9) == [LOGIN] * 100


def test_a_link_that_takes_nothing_is_not_filled_with_logins() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    for second in (1.0, 2.0, 3.0):
        bench.session.handle_timer(second)
    assert bench.pull() == [LOGIN]
    for second in range(4, 11):
        bench.session.handle_timer(float(second))
    assert bench.events() == [ConnectFailed(None)]


@pytest.mark.parametrize("code", [0x80, 0x83, 0x86])
def test_a_refused_login_fails_at_once_with_the_status(code: int) -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    bench.feed(f"8100000004010b00{code:02x}00585243450100010f00")
    assert bench.events() == [ConnectFailed(code)]
    assert bench.state() is ClientState.FAILED
    assert bench.wait(10.0) == []


@pytest.mark.parametrize(
    "packet",
    [
        "8200000004010b000000585243450100010f00",
        "8180000004010b000000585243450100010f00",
        head(0) + "04010200" + "0000",
        head(0) + data("00"),
        head(0x80) + data("00"),
        heartbeat(0, 3),
        status(0, 0, 2),
        head(0) + "0f011800" + "00" * 24,
    ],
)
def test_what_is_no_answer_to_the_login_changes_nothing(packet: str) -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    assert bench.feed(packet) == [LOGIN]
    assert bench.events() == []
    assert bench.state() is ClientState.CONNECTING
    assert sum(bench.session.dropped.values()) == 1


def test_keyed_session_has_the_key_in_every_header() -> None:
    bench = Bench(session_id=0x01, connected=False)
    bench.session.connect(0.0)
    bench.session.ping(0.0)
    assert bench.pull() == [
        "00000000aabbccdd00011000585243450100010faabbccdd0100fc01",
        "00000000aabbccdd02010800000afffd02000000",
    ]
    assert bench.feed("01000000aabbccde04010b000000585243450100010f00") == []
    assert bench.events() == []
    bench.feed("01000000aabbccdd04010b000000585243450100010f00")
    assert bench.events() == [Connected()]
    bench.session.write(0x15, b"\0\1\2\3", 1)
    assert bench.pull() == ["01010000aabbccdd07010800000a001500010203"]


def test_login_again_begins_everything_anew() -> None:
    bench = Bench()
    bench.session.write(0x15, b"", 0x80)
    bench.pull()
    bench.feed(head(0x80) + data("00"))
    bench.events()
    bench.session.connect(5.0)
    assert bench.pull() == [LOGIN]
    assert bench.feed(head(0x80, 1) + data("01"), heartbeat(0, 1)) == [], "the old session is over"
    bench.feed(WELCOME)
    assert bench.events() == [Connected()]
    bench.session.write(0x15, b"", 0x80)
    assert bench.pull() == [head(0x80) + "07010400000a0015"]
    bench.feed(head(0x80) + data("02"))
    assert bench.events() == [received("02")]


def test_every_answer_to_a_repeated_login_begins_the_input_anew() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    bench.wait(1.5)
    bench.feed(WELCOME, head(0x80) + data("01"), head(0x80, 1) + data("02"))
    bench.feed(WELCOME, head(0x80) + data("03"))
    assert bench.events() == [Connected(), received("01"), received("02"), received("03")]
    bench.feed(WELCOME, head(0x80) + data("04"))
    assert bench.events() == [SessionRestarted()], "a third answer to two tries"
    assert bench.session.dropped == {"answer that nobody asked for": 1}


def test_an_answer_that_nothing_explains_is_a_copy_until_something_was_sent() -> None:
    bench = Bench()
    bench.feed(WELCOME)
    assert bench.events() == []
    bench.session.write(0x15, b"", 0x80)
    bench.feed(WELCOME.replace("04010b000000", "04010b008500"))
    assert bench.events() == [], "a refusal begins nothing"
    assert bench.feed(acknack(1)) == []
    assert bench.feed(WELCOME) == [heartbeat(0, 0)], "a copy, or does the agent expect message 0 again?"
    assert bench.wait(0.15) == [heartbeat(0, 0)], "it is asked until it answers"
    assert bench.feed(acknack(1)) == []
    assert bench.events() == [], "a copy"
    assert bench.wait(1.0) == []
    assert bench.feed(WELCOME) == [heartbeat(0, 0)]
    bench.feed(acknack(0, 1))
    assert bench.events() == [SessionRestarted()], "the agent expects message 0 again, and we go on with 1"
    bench.session.connect(1.0)
    bench.feed(WELCOME)
    assert bench.events() == [Connected()]
    bench.feed(WELCOME)
    assert bench.events() == []


# Logout.


def test_logout_is_confirmed_by_a_status_on_none() -> None:
    bench = Bench()
    bench.session.write(0x15, b"\1", 1)
    bench.session.close(0.0)
    assert bench.pull() == [head(1) + "07010500000a00150100" + "0000", LOGOUT]
    assert bench.state() is ClientState.CLOSING
    bench.feed(status(0x80, 0, 2), status(0, 0, 3))
    assert bench.state() is ClientState.CLOSING
    bench.feed(status(0, 0, 2, object_id=0xFFFE))
    assert bench.events()[-1] == SessionClosed(confirmed=True)
    assert bench.state() is ClientState.CLOSED
    assert bench.wait(10.0) == []


def test_logout_without_an_answer_ends_after_10_tries() -> None:
    bench = Bench()
    bench.session.close(0.0)
    assert bench.wait(9.5) == [LOGOUT] * 10
    bench.wait(1.0)
    assert bench.events() == [SessionClosed(confirmed=False)]
    assert bench.state() is ClientState.CLOSED


def test_the_timer_is_the_earlier_of_heartbeat_and_logout() -> None:
    bench = Bench(login_period_s=0.3)
    bench.session.write(0x15, b"", 0x80)
    bench.session.close(0.0)
    bench.pull()
    assert bench.session.timer() == 0.1
    assert bench.wait(0.35) == [heartbeat(0, 0), heartbeat(0, 0), LOGOUT, heartbeat(0, 0)]


def test_logout_is_possible_while_the_login_is_on_its_way() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    bench.session.close(0.0)
    assert bench.pull() == [LOGIN, LOGOUT]


def test_what_needs_an_open_session_says_so() -> None:
    session = Bench(connected=False).session
    calls: list[Callable[[], object]] = [
        lambda: session.close(0.0),
        lambda: session.create(0x11, PARTICIPANT),
        lambda: session.delete(0x11),
        lambda: session.read(0x16, 1),
        lambda: session.write(0x15, b"", 1),
        session.sync_time,
    ]
    for call in calls:
        with pytest.raises(LocalProtocolError, match="the session is IDLE"):
            call()


# Requests.


def test_requests_have_the_bytes_of_the_genuine_client() -> None:
    bench = Bench()
    session = bench.session
    requests: list[tuple[Callable[[], int], str]] = [
        (
            lambda: session.create(0x11, PARTICIPANT),
            "01071c00000a0011010300000d0000000001000005000000706172740000" + "0500",
        ),
        (lambda: session.delete(0x12), "03010400000b0012"),
        (lambda: session.read(0x16, 0x80, DeliveryControl()), "08011000000c001680000001ffff000000000000"),
        (lambda: session.read(0x16, 1), "08010800000d001601000000"),
        (lambda: session.read(0x16, 0, DeliveryControl(max_samples=0)), "08011000000e0016000000010000000000000000"),
        (lambda: session.write(0x15, bytes(range(8)), 0x80), "07010c00000f00150001020304050607"),
    ]
    for nr, request in enumerate(requests):
        assert request[0]() == 10 + nr
        assert bench.pull() == [head(0x80, nr) + request[1]]
        bench.feed(acknack(nr + 1))


def test_flags_and_streams_of_requests_can_be_chosen() -> None:
    bench = Bench()
    bench.session.create(0x11, PARTICIPANT, reuse=False, replace=False, stream_id=1)
    bench.session.delete(0x12, 1)
    bench.session.read(0x16, 1, request_stream=1)
    (packet,) = bench.pull()
    assert packet.startswith(head(1) + "01011c00")
    assert "03010400000b0012" + "08010800000c001601000000" in packet


def test_one_turn_is_packed_into_one_message_and_padded() -> None:
    bench = Bench()
    bench.session.write(0x15, bytes((0, 1, 2, 3, 4)), 1)
    bench.session.write(0x15, bytes(range(8)), 1)
    bench.session.write(0x15, b"\1", 0x80)
    bench.session.write(0x15, b"\2", 0)
    assert bench.pull() == [
        head(0) + "07010500000d001502",
        head(0x80) + "07010500000c001501000000",
        head(1) + "07010900000a00150001020304000000" + "07010c00000b00150001020304050607",
    ]


def test_padding_can_be_left_out_for_slow_links() -> None:
    bench = Bench(pads=False)
    bench.session.write(0x15, b"\1", 0x80)
    assert bench.pull() == [head(0x80) + "07010500000a001501"]


def test_full_messages_are_508_bytes_for_a_transport_of_512() -> None:
    bench = Bench()
    bench.session.write(0x15, bytes(600), 0x80)
    first, second = bench.pull()
    assert first.startswith(head(0x80) + "0d01f401" + "07015c02000a0015")
    assert second.startswith(head(0x80, 1) + "0d036c00")
    assert (len(first) // 2, len(second) // 2) == (508, 116)


def test_more_than_64_kib_are_written_with_length_0() -> None:
    bench = Bench(mtu=65532, window=4)
    bench.session.write(0x15, bytes(70_000), 0x80)
    first, _ = bench.pull()
    assert first.startswith(head(0x80) + "0d01f0ff" + "07010000000a0015")


def test_request_ids_wrap_from_65535_to_10() -> None:
    bench = Bench()
    ids = [bench.session.write(0x15, b"", 1) for _ in range(65536)]
    assert (ids[0], ids[-11], ids[-10], ids[-1]) == (10, 65535, 10, 19)


def test_request_ids_by_rule_follow_from_the_message_and_each_sample_has_one() -> None:
    bench = Bench(ids_by_rule=True)
    session = bench.session
    assert session.create(0x0011, PARTICIPANT, stream_id=1) == 10
    assert [session.write(0x15, b"1234", 1), session.write(0x15, b"5678", 1)] == [0x8001, 0x8002]
    assert session.create(0x0011, PARTICIPANT) == 11
    assert session.read(0x0026, 1) == 0xC026
    assert session.write(0x15, b"abcd", 0x80) == 0xA001
    assert session.delete(0x0011) == 12
    assert session.write(0x15, b"", 0) == 13
    assert session.write(0x15, b"", 2) == 14
    sent = bench.pull()
    streams = {
        head(stream, nr) for stream, nr in ((1, 0), (1, 1), (1, 2), (0x80, 0), (0x80, 1), (0x80, 2), (0, 0), (2, 0))
    }
    assert {packet[:8] for packet in sent} == streams
    assert len(sent) == 8
    assert head(1, 2) + "0701080080020015" + b"5678".hex() in sent
    assert head(0x80, 1) + "07010800a0010015" + b"abcd".hex() in sent


def test_request_ids_by_rule_begin_anew_with_their_numbers_and_counted_ones_stay_below() -> None:
    bench = Bench(ids_by_rule=True)
    ids = [bench.session.write(0x15, b"", 1) for _ in range(8193)]
    assert (ids[0], ids[8191], ids[8192]) == (0x8000, 0x9FFF, 0x8000)
    ids = [bench.session.write(0x15, b"", 0) for _ in range(0x8000)]
    assert (max(ids), ids[-10:]) == (0x7FFF, list(range(10, 20)))


def test_a_large_request_by_rule_has_the_id_of_its_first_piece() -> None:
    bench = Bench(ids_by_rule=True, mtu=68)
    assert bench.session.write(0x15, bytes(100), 0x80) == 0xA000
    assert bench.session.write(0x15, b"", 0x80) == 0xA002
    assert [packet[:8] for packet in bench.pull()] == [head(0x80, nr) for nr in range(3)]


def test_best_effort_writes_must_fit_one_message() -> None:
    bench = Bench(mtu=64)
    with pytest.raises(LocalProtocolError, match="use a reliable stream"):
        bench.session.write(0x15, bytes(50), 1)
    bench.session.write(0x15, bytes(40), 1)
    assert [len(packet) // 2 for packet in bench.pull()] == [52]


def test_a_full_window_refuses_writes_and_says_when_it_opens() -> None:
    bench = Bench(window=2)
    for _ in range(2):
        assert bench.session.has_room(0x80)
        bench.session.write(0x15, bytes(4), 0x80)
        bench.pull()
    assert not bench.session.has_room(0x80)
    with pytest.raises(LinkFull, match="0x80 is full"):
        bench.session.write(0x15, bytes(4), 0x80)
    assert bench.pull() == []
    bench.feed(acknack(1))
    assert bench.events() == [WindowOpened(0x80)]
    bench.session.write(0x15, bytes(4), 0x80)
    (packet,) = bench.pull()
    assert packet.startswith(head(0x80, 2)), "no sequence number is skipped"


def test_requests_beyond_the_window_wait_up_to_the_backlog() -> None:
    bench = Bench(window=1, backlog=2, mtu=68)
    for number in range(3):
        bench.session.create(0x11 + 16 * number, PARTICIPANT)
        bench.pull()
    with pytest.raises(LocalProtocolError, match="2 messages wait"):
        bench.session.create(0x41, PARTICIPANT)
    assert len(bench.feed(acknack(1))) == 1
    bench.session.create(0x41, PARTICIPANT)
    assert len(bench.feed(acknack(2)) + bench.feed(acknack(3)) + bench.feed(acknack(4))) == 2


def test_streams_are_limited() -> None:
    bench = Bench(max_streams=1)
    bench.session.write(0x15, b"", 1)
    bench.session.write(0x15, b"", 0x80)
    for stream_id in (2, 0x81):
        with pytest.raises(LocalProtocolError, match="too many streams"):
            bench.session.write(0x15, b"", stream_id)


# Reliable output.


def test_unacknowledged_messages_are_announced_every_100_ms_and_sent_again_byte_for_byte() -> None:
    bench = Bench()
    bench.session.write(0x15, b"\1", 0x80)
    (first,) = bench.pull()
    bench.session.write(0x15, b"\2", 0x80)
    (second,) = bench.pull()
    assert bench.wait(0.25) == [heartbeat(0, 1)] * 2
    assert bench.feed(acknack(0, 0b11)) == [first, second]
    assert bench.feed(acknack(1)) == []
    assert bench.wait(0.1) == [heartbeat(1, 1)]
    assert bench.feed(acknack(2)) == []
    assert bench.wait(10.0) == []


@pytest.mark.parametrize("stale", [0, 1, 4, 65535, 30_000])
def test_stale_acknacks_are_ignored(stale: int) -> None:
    bench = Bench()
    for _ in range(3):
        bench.session.write(0x15, b"", 0x80)
        bench.pull()
    bench.feed(acknack(2))
    assert bench.feed(acknack(stale, 0xFFFF)) == []
    assert bench.wait(0.1) == [heartbeat(2, 2)]


# Input.


def test_status_is_told_and_acknowledged() -> None:
    bench = Bench()
    assert bench.feed(status(0x80, 0, 10)) == [acknack(1)]
    assert bench.feed(status(1, 0, 119, 0x84)) == []
    assert bench.feed(status(0, 0, 120, 0x84)) == []
    assert bench.events() == [StatusReceived(10, 0x11, 0), StatusReceived(119, 0x11, 0x84)]


def test_early_data_waits_for_the_one_before() -> None:
    bench = Bench()
    assert bench.feed(head(0x80, 1) + data("01010101")) == [acknack(0, 0b1)]
    assert bench.events() == []
    assert bench.feed(head(0x80) + data("00000000")) == [acknack(2)]
    assert bench.events() == [received("00000000"), received("01010101")]
    assert bench.feed(head(0x80) + data("00000000")) == [acknack(2)]
    assert bench.events() == []


def test_heartbeats_with_a_history_of_4() -> None:
    bench = Bench(window=4)
    bench.feed(head(0x80) + data("00"), head(0x80, 1) + data("01"))
    assert bench.feed(head(0x80, 6) + data("66")) == [acknack(2, 0x1F)]
    assert bench.feed(heartbeat(2, 5)) == [acknack(2, 0x1F)]
    bench.feed(head(0x80, 2) + data("02"))
    assert bench.feed(head(0) + "0b000500" + "0000000780") == [acknack(3, 0x1F)]


def test_heartbeat_before_any_message() -> None:
    assert Bench().feed(heartbeat(0, 3)) == [acknack(0, 0b1111)]


def test_best_effort_data_must_be_newer() -> None:
    bench = Bench()
    bench.feed(*(head(1, nr) + data(f"{nr:02x}") for nr in (0, 5, 3)))
    assert bench.events() == [received("00", 1), received("05", 1)]


@pytest.mark.parametrize(
    ("packet", "payloads"),
    [
        (head(1) + data("0102030405") + "000000" + data("08"), ["0102030405", "08"]),
        (head(1) + data("22222222", flags=0), ["22222222"]),
        (head(0) + data("00ffffff"), ["00ffffff"]),
        (head(1) + "20010400aabbccdd" + data("b6"), ["b6"]),
        (head(1) + data("01", flags=3) + "000000" + data("02"), []),
        (head(1) + "09010300000a00", []),
        (head(1) + "09010000000a0016" + "00" * 5, ["00" * 5]),
        ("8201" + "0000" + data("b7"), []),
        ("8001" + "0000" + data("b7"), []),
    ],
)
def test_data_in_any_shape(packet: str, payloads: list[str]) -> None:
    bench = Bench()
    assert bench.feed(packet) == []
    assert [event.payload.hex() for event in bench.events() if isinstance(event, DataReceived)] == payloads


def test_fragmented_data_is_joined() -> None:
    bench = Bench()
    whole = "09015c02000a0016" + "ab" * 600
    bench.feed(head(0x80) + fragment(whole[:1000]))
    assert bench.events() == []
    assert bench.feed(head(0x80, 1) + fragment(whole[1000:], last=True)) == [acknack(2)]
    assert bench.events() == [received("ab" * 600)]


def test_the_agents_probe_is_answered_with_a_proper_info() -> None:
    assert Bench().feed(head(0) + "020108000000fffe01000000") == [head(0) + "060108000000fffe00000000"]


@pytest.mark.parametrize("packet", ["", "81", "810000", "01000000aabbcc"])
def test_packets_without_a_whole_header_are_refused(packet: str) -> None:
    with pytest.raises(RemoteProtocolError):
        Bench().feed(packet)


# Ping and time.

PONG = "06011c00000afffd00{:02x}010d585243450100010f00010d000100000000000000"


def test_ping_outside_and_inside_of_a_session() -> None:
    bench = Bench(connected=False)
    bench.session.ping(0.0)
    assert bench.pull() == ["8000000002010800000afffd02000000"]
    bench.now = 0.25
    bench.feed("80000000" + PONG.format(0))
    assert bench.events() == [Pong(agent_knows_us=False, round_trip_s=0.25)]
    bench = Bench()
    bench.session.ping(0.0)
    assert bench.pull() == ["8100000002010800000afffd02000000"]
    bench.feed("81000000" + PONG.format(1))
    bench.feed("81000000" + PONG.format(0))
    assert [event.agent_knows_us for event in bench.events() if isinstance(event, Pong)] == [True, False]


@pytest.mark.parametrize(
    "info",
    [
        "06011c000009fffd0000010d585243450100010f00010d000100000000000000",
        "06011c00000afffd0001010d585243450100010f00010d000000000000000000",
        "06010800000afffd00010000",
        "06010400000afffd",
    ],
)
def test_infos_that_are_no_pong(info: str) -> None:
    bench = Bench()
    bench.session.ping(0.0)
    bench.feed("81000000" + info)
    assert bench.events() == []


def test_time_against_an_agent_5_s_ahead() -> None:
    bench = Bench()
    bench.session.sync_time()
    (packet,) = bench.pull()
    assert packet == head(0) + "0e01080064000000" + "00000000"
    bench.clock_ns += 4_000_000
    times = struct.pack("<iIiIiI", 105, 3_000_000, 105, 1_000_000, 100, 0).hex()
    bench.feed(head(0) + "0f011800" + times[:-8] + "01000000" + "0f011800" + times)
    bench.feed(head(0) + "0f011800" + times)
    assert bench.events() == [TimeSynchronised(-5 * SECOND, 2_000_000)]
    assert bench.session.dropped == {"answer that nobody asked for": 2}
