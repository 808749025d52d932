"""The agent's end of a session, packet by packet, as a genuine agent answers (its recorded answers are the tables)."""

from __future__ import annotations

import struct

import pytest

from msbot_xrce import AgentSession, AgentSessionSettings
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import DeliveryControl
from msbot_xrce.sessions import (
    AgentEvent,
    CreateRequested,
    DataHandler,
    DataWritten,
    DeleteRequested,
    InfoRequested,
    Memory,
    ReadRequested,
    SessionDeleteRequested,
    SessionReset,
    WindowOpened,
)
from msbot_xrce.streams.acknack_schedule import GUESSES_MAX

KEY = 0xAABBCCDD
MTU = 508
SECOND = 1_000_000_000


class Bench:
    """A session and an owner that says OK to everything; packets in and out as hex."""

    def __init__(
        self,
        *,
        session_id: int = 0x81,
        mtu: int = MTU,
        settings: AgentSessionSettings | None = None,
        on_data: DataHandler | None = None,
    ) -> None:
        self.session = AgentSession(KEY, session_id, mtu, epoch_ns=self._clock, settings=settings, on_data=on_data)
        self.events: list[AgentEvent] = []
        self.now = 0.0
        self._epoch_ns = 1_700_000_000 * SECOND

    def _clock(self) -> int:
        self._epoch_ns += 1
        return self._epoch_ns

    def feed(self, *packets: str) -> list[str]:
        """Let packets arrive; everything that is sent then."""
        for packet in packets:
            self.session.receive_packet(bytes.fromhex(packet), self.now)
            while (event := self.session.next_event()) is not None:
                self.events.append(event)
                self._answer(event)
        return self.pull()

    def pull(self) -> list[str]:
        return [packet.hex() for packet in self.session.packets_to_send(self.now)]

    def wait(self, seconds: float) -> list[str]:
        """Let time pass, timer by timer; everything that is sent."""
        end, sent = self.now + seconds, self.pull()
        while (at := self.session.timer()) is not None and at <= end:
            self.now = at
            self.session.handle_timer(at)
            sent += self.pull()
        self.now = end
        return sent

    def writes(self) -> list[bytes]:
        """The payloads written since the last call; everything else that happened is forgotten."""
        events, self.events = self.events, []
        return [event.payload for event in events if isinstance(event, DataWritten)]

    def _answer(self, event: AgentEvent) -> None:
        match event:
            case CreateRequested() | DeleteRequested() | SessionDeleteRequested():
                self.session.send_status(event.request_id, event.object_id, 0, event.stream_id)
            case InfoRequested():
                self.session.send_info(event.request_id, event.object_id)


def head(stream_id: int, sequence_nr: int = 0) -> str:
    return struct.pack("<BBH", 0x81, stream_id, sequence_nr).hex()


def create(request_id: int, object_id: int = 0x0011) -> str:
    """CREATE of a participant by BIN, domain 0, without a name."""
    return f"01011000{request_id:04x}{object_id:04x}0103000002000000" + "00000000"


def write(payload: str, *, flags: int = 1, length: int | None = None) -> str:
    size = 4 + len(payload) // 2 if length is None else length
    return f"07{flags:02x}" + struct.pack("<H", size).hex() + "001e0015" + payload


def fragment(piece: str, *, last: bool = False) -> str:
    return f"0d{3 if last else 1:02x}" + struct.pack("<H", len(piece) // 2).hex() + piece


def status(stream_id: int, sequence_nr: int, request_id: int, object_id: int = 0x0011) -> str:
    return head(stream_id, sequence_nr) + f"05010600{request_id:04x}{object_id:04x}0000"


def acknack(first: int, bitmap: int = 0, stream_id: int = 0x80) -> str:
    return head(0) + "0a010500" + struct.pack("<H", first).hex() + f"{bitmap:04x}{stream_id:02x}"


def heartbeat(first: int, last: int, stream_id: int = 0x80) -> str:
    return head(0) + "0b010500" + struct.pack("<HHB", first, last, stream_id).hex()


RESET = head(0) + "0c010000"


# What requests become.


@pytest.mark.parametrize(
    ("flags", "length", "expected"),
    [
        ("01", "02000000", (False, False, True)),
        ("03", "02000000", (True, False, True)),
        ("05", "02000000", (False, True, True)),
        ("06", "00000002", (True, True, False)),
    ],
)
def test_create_carries_its_flags_and_byte_order(flags: str, length: str, expected: tuple[bool, bool, bool]) -> None:
    bench = Bench()
    bench.feed(head(0x80) + f"01{flags}1000000a001101030000{length}00000000")
    (event,) = bench.events
    assert isinstance(event, CreateRequested)
    assert (event.request_id, event.object_id, event.stream_id) == (10, 0x11, 0x80)
    assert (event.reuse, event.replace, event.little_endian) == expected
    assert event.variant.blob == b"\0\0"


def test_a_packet_that_is_a_header_alone_is_a_packet() -> None:
    """XRCE 1.0 §8.3.2: four octets, eight with the client's key; less is no message."""
    for session_id, whole in ((0x81, "81000000"), (0x01, "01000000" + f"{KEY:08x}")):
        bench = Bench(session_id=session_id)
        octets = bytes.fromhex(whole)
        bench.session.receive_packet(octets, 1.0)
        assert (bench.session.counters.packets_in, bench.session.last_heard) == (1, 1.0)
        with pytest.raises(RemoteProtocolError, match="too short for a message header"):
            bench.session.receive_packet(octets[:-1], 2.0)


def test_requests_become_events() -> None:
    bench = Bench()
    bench.feed(
        head(0x80) + "08011000001d001680000001ffff000000000000",
        head(0x80, 1) + "03010400000c0012",
        head(0) + "02010800000afffd02000000",
        head(1) + write("0102030405"),
    )
    read, delete, info, written = bench.events
    assert isinstance(read, ReadRequested)
    assert (read.request_id, read.object_id, read.read.stream_id) == (0x1D, 0x16, 0x80)
    assert read.read.delivery == DeliveryControl(0xFFFF, 0, 0, 0)
    assert delete == DeleteRequested(0x0C, 0x12, 0x80)
    assert info == InfoRequested(10, 0xFFFD, 2)
    assert written == DataWritten(0x15, 0x1E, bytes.fromhex("0102030405"))


def test_info_says_that_the_client_is_known() -> None:
    assert Bench().feed(head(0) + "02010800000afffd02000000") == [
        "8100000006011c00000afffd0001010d585243450100010f00010d000100000000000000"
    ]


# Statuses and their streams.


def test_reliable_create_gives_status_then_acknack() -> None:
    assert Bench().feed(head(0x80) + create(10)) == [status(0x80, 0, 10), acknack(1)]


def test_keyed_session_has_the_key_in_every_header() -> None:
    bench = Bench(session_id=0x01)
    assert bench.feed("01800000aabbccdd" + create(10)) == [
        "01800000aabbccdd05010600000a00110000",
        "01000000aabbccdd0a010500010000" + "0080",
    ]
    assert bench.feed("01800100aabbccde" + create(11)) == []
    assert bench.feed("81800100" + create(11)) == []
    assert bench.session.dropped == {"message of another session": 2}


@pytest.mark.parametrize("stream_id", [0, 1, 0x7F])
def test_create_elsewhere_gives_status_on_best_effort_and_no_acknack(stream_id: int) -> None:
    assert Bench().feed(head(stream_id) + create(10)) == [status(1, 0, 10)]


def test_any_reliable_stream_is_answered_on_0x80() -> None:
    assert Bench().feed(head(0x83) + create(10)) == [status(0x80, 0, 10), acknack(1, stream_id=0x83)]


def test_session_ids_from_0x80_on_are_not_compared() -> None:
    assert len(Bench(session_id=0x82).feed(head(0x80) + create(10))) == 2


def test_statuses_of_one_message_come_in_order_and_the_last_on_none() -> None:
    packet = head(0x80) + create(10) + create(11, 0x21) + "030104000002fffe"
    assert Bench().feed(packet) == [
        status(0x80, 0, 10),
        status(0x80, 1, 11, 0x21),
        status(0, 0, 2, 0xFFFE),
        acknack(1),
    ]


def test_unknown_submessages_are_skipped_by_their_length() -> None:
    assert Bench().feed(head(0x80) + "20010300aabbcc00" + create(10)) == [status(0x80, 0, 10), acknack(1)]


def test_an_error_of_a_read_goes_to_0x80() -> None:
    bench = Bench()
    bench.session.send_status(0x1D, 0x16, 0x84, 0x80)
    assert bench.pull() == ["8180000005010600001d00168400"]


# Reliable input.


def test_early_message_waits_for_the_one_before() -> None:
    bench = Bench()
    assert bench.feed(head(0x80, 1) + create(10)) == [acknack(0, 0b1)]
    assert bench.feed(head(0x80, 0) + create(11, 0x21)) == [
        status(0x80, 0, 11, 0x21),
        status(0x80, 1, 10),
        acknack(2),
    ]
    assert bench.feed(head(0x80, 0) + create(12, 0x31)) == [acknack(2)], "a repetition has no second effect"


def measured() -> Bench:
    """A session that has measured a round trip of 1 ms, and expects message 1."""
    bench = Bench()
    bench.feed(head(0x80, 0) + create(10))
    bench.now = 0.001
    assert bench.feed(acknack(1)) == []
    return bench


def test_a_gap_is_reported_again_ever_more_seldom_and_not_for_ever() -> None:
    bench = measured()
    report = acknack(1, 0b1)
    assert bench.feed(head(0x80, 2) + create(12)) == [report]
    for at in (0.003, 0.006, 0.009, 0.015, 0.027):
        assert bench.wait(0.001 + at - 0.0005 - bench.now) == []
        assert bench.wait(0.001) == [report]
    later = bench.wait(20.0)
    assert set(later) == {report}
    assert len(later) < 80, "as long as the link counts as lossy, and ever more rarely"
    assert bench.session.timer() is None
    assert bench.feed(heartbeat(1, 2)) == [report]
    assert bench.wait(0.004) == [report], "the peer is there: it begins anew"
    answers = bench.feed(head(0x80, 1) + create(11, 0x21))
    assert answers == [status(0x80, 1, 11, 0x21), status(0x80, 2, 12), acknack(3)]
    assert bench.feed(acknack(3)) == []
    later = bench.wait(20.0)
    assert set(later) == {acknack(3, 0b1)}, "on such a link, what came after it may be lost, too"
    assert len(later) == GUESSES_MAX
    assert bench.session.timer() is None


def test_a_gap_is_reported_once_while_the_round_trip_is_not_known() -> None:
    bench = Bench()
    assert bench.feed(head(0x80, 1) + create(10)) == [acknack(0, 0b1)]
    assert bench.session.timer() is None


def test_a_report_that_the_link_has_not_taken_is_not_repeated() -> None:
    bench = measured()
    bench.session.receive_packet(bytes.fromhex(head(0x80, 2) + create(12)), bench.now)
    assert bench.session.next_event() is None
    assert bench.session.timer() is None
    bench.session.handle_timer(bench.now + 1.0)
    assert bench.pull() == [acknack(1, 0b1)]
    assert bench.session.timer() is not None
    bench.session.reset()
    assert bench.session.timer() is None


def test_window_of_16_and_heartbeats_about_it() -> None:
    bench = Bench()
    bench.feed(head(0x80, 0) + create(10), head(0x80, 1) + create(11))
    assert bench.feed(head(0x80, 17) + create(12)) == [acknack(2, 0x7FFF)]
    assert bench.feed(head(0x80, 18) + create(13)) == [acknack(2, 0x7FFF)]
    assert bench.feed(heartbeat(2, 5)) == [acknack(2, 0x7FFF)]


@pytest.mark.parametrize(("first", "last", "answer"), [(2, 5, (2, 0b1111)), (4, 5, (4, 0b11)), (2, 1, (2, 0))])
def test_heartbeats_are_answered(first: int, last: int, answer: tuple[int, int]) -> None:
    bench = Bench()
    bench.feed(head(0x80, 0) + create(10), head(0x80, 1) + create(11))
    assert bench.feed(heartbeat(first, last)) == [acknack(*answer)]


def test_big_endian_reports_are_understood() -> None:
    bench = Bench()
    bench.feed(head(0x80) + create(10))
    assert bench.feed(head(0) + "0b000500" + "0001000480") == [acknack(1, 0b1111)]
    assert bench.session.timer() is not None
    bench.feed(head(0) + "0a000500" + "0001000080")
    assert bench.session.timer() is None


@pytest.mark.parametrize(
    "packet", [head(0) + "0b01050002000500", head(0) + "0a01050001000000", heartbeat(0, 3, stream_id=1)]
)
def test_truncated_reports_and_heartbeats_of_best_effort_streams_are_met_with_silence(packet: str) -> None:
    bench = Bench()
    assert bench.feed(packet) == []
    assert bench.feed(head(0x80) + create(10)) == [status(0x80, 0, 10), acknack(1)]


def test_heartbeats_inside_of_reliable_messages_are_not_followed() -> None:
    bench = Bench()
    assert bench.feed(head(0x80) + heartbeat(4, 5)[8:]) == [acknack(1)]
    assert list(bench.session.dropped.values()) == [1]


def test_heartbeat_that_gives_up_a_gap_releases_what_was_held() -> None:
    bench = Bench()
    bench.feed(head(0x80, 2) + write("02"), head(0x80, 4) + write("04"))
    assert bench.feed(heartbeat(3, 4)) == [acknack(3, 0b1)]
    assert bench.writes() == [b"\2"]
    assert bench.feed(head(0x80, 3) + write("03")) == [acknack(5)]
    assert bench.writes() == [b"\3", b"\4"]


# Reliable output.


def test_unacknowledged_status_is_announced_every_200_ms() -> None:
    bench = Bench()
    bench.feed(head(0x80) + create(10))
    assert bench.wait(0.65) == [heartbeat(0, 0)] * 3
    bench.feed(head(0x80, 1) + create(11))
    assert bench.wait(0.25) == [heartbeat(0, 1)]
    assert bench.feed(acknack(2)) == []
    assert bench.wait(10.0) == []
    assert bench.session.timer() is None


def test_acknack_bits_bring_exactly_the_stored_messages_again() -> None:
    bench = Bench()
    bench.feed(head(0x80, 0) + create(10), head(0x80, 1) + create(11))
    assert bench.feed(acknack(0, 0xFFFF)) == [status(0x80, 0, 10), status(0x80, 1, 11)]
    assert bench.feed(acknack(100, 0xFFFF)) == []
    assert bench.wait(0.21) == [heartbeat(0, 1)]


def test_statuses_beyond_the_window_wait_for_acknowledgement() -> None:
    bench = Bench()
    sent = bench.feed(*(head(0x80, nr) + create(10 + nr) for nr in range(20)))
    assert [packet for packet in sent if packet[9] == "5"] == [status(0x80, nr, 10 + nr) for nr in range(16)]
    assert bench.wait(0.2) == [heartbeat(0, 15)]
    assert bench.feed(acknack(16)) == [status(0x80, nr, 10 + nr) for nr in range(16, 20)]
    assert bench.session.dropped == {}


def test_the_backlog_of_statuses_is_bounded() -> None:
    bench = Bench(settings=AgentSessionSettings(backlog=2))
    for nr in range(20):
        bench.session.send_status(10 + nr, 0x11, 0, 0x80)
    assert bench.session.dropped == {"status: too many wait for the client's acknowledgement": 2}
    assert len(bench.pull()) == 16
    assert bench.feed(acknack(16)) == [status(0x80, nr, 10 + nr) for nr in (16, 17)]


def test_samples_are_refused_while_the_window_is_full_and_invited_when_it_opens() -> None:
    bench = Bench()
    taken = [bench.session.send_data(0x1D, 0x16, b"sample", 0x80) for _ in range(17)]
    assert taken == [True] * 16 + [False]
    assert not bench.session.has_room(0x80)
    assert bench.session.has_room(1)
    assert len(bench.pull()) == 16
    bench.feed(acknack(1))
    assert bench.events == [WindowOpened(0x80)]
    bench.feed(acknack(2))
    assert bench.events == [WindowOpened(0x80)], "nobody was refused since"
    assert bench.session.has_room(0x80)


def test_samples_for_a_stream_too_many_are_dropped() -> None:
    session = AgentSession(KEY, 0x81, MTU, epoch_ns=lambda: 0, settings=AgentSessionSettings(max_streams=1))
    assert session.send_data(1, 0x16, b"", 0x80)
    assert session.has_room(0x81)
    assert session.send_data(1, 0x16, b"", 0x81)
    assert session.dropped == {"too many streams": 2}


def test_one_acknack_speaks_for_everything_that_came_while_the_link_took_nothing() -> None:
    bench = Bench(settings=AgentSessionSettings(queue_limit=3))
    for nr in range(5):
        bench.session.receive_packet(bytes.fromhex(head(0x80, nr) + write("00")), 0.0)
        while bench.session.next_event() is not None:
            pass
    assert bench.pull() == [acknack(5)]


# Reset and login.


def test_reset_begins_all_streams_anew() -> None:
    bench = Bench()
    bench.feed(head(0x80) + create(10))
    bench.feed(head(1, 7) + write("00"), head(0x80, 2) + create(12))
    assert bench.feed(RESET) == []
    assert SessionReset() in bench.events
    assert bench.session.timer() is None
    assert bench.feed(head(0x80) + create(11)) == [status(0x80, 0, 11), acknack(1)]
    bench.writes()
    bench.feed(head(1, 0) + write("01"))
    assert bench.writes() == [b"\1"]


def test_acknowledgements_of_before_a_reset_in_the_same_message_are_not_sent() -> None:
    # So however many there are: the message costs what its length costs.
    question, report, anew = "02010800000afffd02000000", "0b0105000000050080000000", "0c010000"
    bench = Bench()
    answers = bench.feed("81000000" + question + report + anew + anew + report)
    assert answers[1:] == [acknack(0, 0b111111)]
    assert [type(event) for event in bench.events] == [InfoRequested, SessionReset, SessionReset]
    assert bench.feed("81000000" + question + report)[1:] == [acknack(0, 0b111111)]


def test_reset_inside_of_a_reliable_message_leaves_a_fresh_stream() -> None:
    bench = Bench()
    bench.feed(head(0x80, 1) + create(11))
    assert bench.feed(head(0x80) + RESET[8:] + create(10)) == [status(0x80, 0, 10), acknack(0)]


def test_reset_tells_who_was_refused_that_there_is_room() -> None:
    bench = Bench(settings=AgentSessionSettings(window=1))
    bench.session.send_data(0x1D, 0x16, b"1", 0x80)
    assert not bench.session.send_data(0x1D, 0x16, b"2", 0x80)
    bench.session.reset()
    bench.feed(RESET)
    assert bench.events == [WindowOpened(0x80), SessionReset()]


@pytest.mark.parametrize("way", ["reset", "login"])
def test_half_a_fragmented_message_does_not_spoil_the_next_session(way: str) -> None:
    bench = Bench()
    whole = write("aa" * 16)
    bench.feed(head(0x80) + fragment(whole[:20]))
    if way == "reset":
        bench.feed(RESET)
    else:
        bench.session.relogin()
    bench.feed(head(0x80, 0) + fragment(whole[:20]), head(0x80, 1) + fragment(whole[20:], last=True))
    assert bench.writes() == [b"\xaa" * 16]


def test_login_again_with_another_mtu() -> None:
    bench = Bench(mtu=64)
    bench.session.send_data(1, 0x16, bytes(50), 0x80)
    bench.session.relogin(512)
    bench.session.send_data(1, 0x16, bytes(400), 0x80)
    (packet,) = bench.pull()
    assert len(packet) // 2 == 412
    bench.session.relogin()
    assert bench.session.mtu == 512


def test_tiny_mtus_are_taken_for_24() -> None:
    bench = Bench(mtu=8)
    bench.session.send_data(1, 0x16, bytes(100), 0x80)
    assert bench.session.mtu == 24
    assert [len(packet) // 2 for packet in bench.pull()] == [24, 24, 24, 24, 24, 24, 20]


# Best effort and what breaks.


def test_best_effort_takes_newer_messages_only() -> None:
    bench = Bench()
    bench.feed(*(head(1, nr) + write(f"{index:02x}") for index, nr in enumerate((0, 0, 5, 3))))
    assert bench.writes() == [b"\0", b"\2"]
    assert bench.session.counters.repeated == 2


@pytest.mark.parametrize(("first", "taken"), [(0x7FFF, 0), (0x7FFE, 1)])
def test_first_best_effort_number(first: int, taken: int) -> None:
    bench = Bench()
    bench.feed(head(1, first) + write("00"))
    assert len(bench.writes()) == taken


@pytest.mark.parametrize(
    ("body", "payloads"),
    [
        (write("", length=3) + "00000000", []),
        (write(""), [b""]),
        (write("0102030405060708", length=0), [bytes(range(1, 9))]),
        (write("0102", length=200), []),
        (write("01020304", flags=3), []),
        (write("01020304", flags=3) + write("05"), []),
        (write("0102030405") + "000000" + write("06"), [bytes(range(1, 6)), b"\6"]),
        (write("01") + "00", [b"\1"]),
        ("0701", []),
    ],
)
def test_write_data_of_any_length(body: str, payloads: list[bytes]) -> None:
    bench = Bench()
    assert bench.feed(head(1) + body) == []
    assert bench.writes() == payloads
    bench.feed(head(1, 1) + write("aa"))
    assert bench.writes() == [b"\xaa"], "the session goes on"


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("01011000000a0011010300000200000000", "broken CREATE"),
        ("08010800001d001680000200", "broken READ_DATA"),
        ("02010400000afffd", "broken GET_INFO"),
        ("20018000", "broken submessage of an unknown kind"),
        ("0b010300000000", "broken HEARTBEAT"),
        ("00011000585243450100010faabbcc098100fc01", "CREATE_CLIENT inside of a session"),
        (fragment("00000000"), "FRAGMENT outside of a reliable stream"),
    ],
)
def test_what_makes_no_sense_is_counted_by_reason_and_the_session_lives(body: str, reason: str) -> None:
    bench = Bench()
    assert bench.feed(head(0) + body) == []
    assert bench.session.dropped == {reason: 1}
    assert bench.feed(head(0x80) + create(10)) == [status(0x80, 0, 10), acknack(1)]


def test_streams_are_limited() -> None:
    bench = Bench(settings=AgentSessionSettings(max_streams=2))
    for stream_id in (1, 2, 3, 0x80, 0x81, 0x82):
        bench.feed(head(stream_id) + write(f"{stream_id:02x}"))
    assert bench.writes() == [b"\1", b"\2", b"\x80", b"\x81"]
    assert bench.feed(heartbeat(0, 1, stream_id=0x83)) == []
    assert bench.session.dropped == {"too many streams": 3}


# Fragments.


def test_samples_larger_than_the_mtu_are_cut_into_messages_of_the_mtu() -> None:
    bench = Bench(mtu=64)
    bench.session.send_data(0x38, 0x16, bytes(range(128)), 0x80)
    first, second, last = bench.pull()
    assert first.startswith("818000000d013800" + "0901840000380016" + "000102")
    assert (len(first), len(second)) == (128, 128)
    assert last.startswith("818002000d031800")
    assert bytes.fromhex(first)[16:] + bytes.fromhex(second)[8:] + bytes.fromhex(last)[8:] == bytes(range(128))


@pytest.mark.parametrize("excess", [1, 8, 1000])
def test_unacknowledged_samples_larger_than_the_mtu_are_dropped_and_later_ones_come(excess: int) -> None:
    bench = Bench(mtu=64)
    for stream_id in (0, 1):
        assert bench.session.send_data(1, 0x16, bytes(52 + excess), stream_id)
        assert bench.session.send_data(1, 0x16, bytes(52), stream_id)
        (packet,) = bench.pull()
        assert len(packet) // 2 == 64
    assert list(bench.session.dropped.values()) == [2]


def test_data_on_stream_none_has_no_sequence_number() -> None:
    bench = Bench()
    bench.session.send_data(0x25, 0x16, b"\2\2\2\2", 0)
    assert bench.pull() == ["81000000090108000025001602020202"]


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (2, 1, 0)])
def test_pieces_are_joined_in_any_order_of_arrival(order: tuple[int, ...]) -> None:
    bench = Bench()
    whole = write("0102030405") + "000000" + write("0607")
    pieces = [fragment(whole[:20]), fragment(whole[20:40]), fragment(whole[40:], last=True)]
    for nr in order:
        bench.feed(head(0x80, nr) + pieces[nr])
    assert bench.writes() == [bytes(range(1, 6)), bytes((6, 7))]


def test_a_first_piece_may_follow_other_submessages() -> None:
    bench = Bench()
    whole = write("0607")
    bench.feed(
        head(0x80) + write("05") + "000000" + fragment(whole[:8]), head(0x80, 1) + fragment(whole[8:], last=True)
    )
    assert bench.writes() == [b"\5", bytes((6, 7))]


def test_fragments_inside_of_fragments_are_not_followed() -> None:
    bench = Bench()
    bench.feed(head(0x80) + fragment(fragment(write("01020304"), last=True) + write("02"), last=True))
    assert bench.session.dropped == {"FRAGMENT inside of fragments": 1}
    assert bench.writes() == [b"\2"]


def test_pieces_before_a_gap_that_is_given_up_are_forgotten() -> None:
    bench = Bench()
    bench.feed(head(0x80, 0) + fragment(write("aa")[:8]))
    bench.feed(heartbeat(2, 2))
    bench.feed(head(0x80, 2) + fragment(write("bb"), last=True))
    assert bench.writes() == [b"\xbb"]


def test_messages_larger_than_allowed_are_dropped_as_a_whole() -> None:
    bench = Bench(settings=AgentSessionSettings(max_message=100))
    whole = write("aa" * 200)
    for nr in range(10):
        assert bench.feed(head(0x80, nr) + fragment(whole[:60], last=nr == 9)) == [acknack(nr + 1)]
    assert bench.session.dropped == {"fragmented message larger than allowed": 1}
    bench.feed(head(0x80, 10) + fragment(write("bb"), last=True))
    assert bench.writes() == [b"\xbb"]


def test_more_than_64_kib_are_written_with_length_0() -> None:
    bench = Bench()
    payload = bytes(range(256)) * 300
    whole = bytes.fromhex(write("", length=0)) + payload
    pieces = [whole[at : at + 500] for at in range(0, len(whole), 500)]
    for nr, piece in enumerate(pieces):
        bench.feed(head(0x80, nr) + fragment(piece.hex(), last=piece is pieces[-1]))
    assert bench.writes() == [payload]


# Time, life.


def test_timestamps_are_answered_on_none_before_the_acknack() -> None:
    bench = Bench()
    reply, ack = bench.feed(head(0x80) + "0e010800163e016ba3948a32")
    assert ack == acknack(1)
    assert reply.startswith("810000000f011800")
    assert reply.endswith("163e016ba3948a32"), "the request's time, bit by bit"
    transmit, receive = (struct.unpack("<iI", bytes.fromhex(reply[at : at + 16])) for at in (16, 32))
    assert receive < transmit


def test_a_probe_and_the_headless_answer_of_c_clients() -> None:
    bench = Bench()
    bench.session.probe()
    assert bench.pull() == ["81000000020108000000fffe01000000"]
    bench.now = 7.0
    assert bench.feed("810000000000000000000000") == []
    assert bench.session.last_heard == 7.0
    assert bench.session.dropped == {}
    bench.now = 8.0
    assert bench.feed(head(0) + "060108000000fffe00000000") == []
    assert bench.session.last_heard == 8.0


def test_wire_settings_can_be_changed_while_open() -> None:
    session = Bench().session
    session.heartbeat_s = 1.5
    session.queue_limit = 7
    assert (session.heartbeat_s, session.queue_limit) == (1.5, 7)


def test_what_sessions_hold_of_incomplete_messages_is_bounded_together_and_given_back() -> None:
    shared = Memory(40)
    one, other = (AgentSession(key, 0x81, 508, epoch_ns=lambda: 0, memory=shared) for key in (1, 2))
    piece = bytes.fromhex("81800000 0d011000") + bytes(16)
    early = bytes.fromhex("81800200 0c010000")
    one.receive_packet(piece, 0.0)
    one.receive_packet(early, 0.0)
    other.receive_packet(piece, 0.0)
    assert shared.used == 40
    other.receive_packet(early, 0.0)
    assert other.dropped == {"early message: no memory to hold it": 1}
    one.release()
    assert shared.used == 16
    other.relogin()
    assert shared.used == 0


def test_samples_may_be_handed_over_at_once_but_never_before_what_came_earlier() -> None:
    taken: list[tuple[int, int, bytes]] = []
    bench = Bench(on_data=lambda object_id, request_id, payload: taken.append((object_id, request_id, payload)))
    assert bench.feed(head(0x80) + write("aabb")) == [acknack(1)]
    assert taken == [(0x0015, 0x001E, b"\xaa\xbb")]
    assert bench.writes() == []
    assert bench.feed(head(0x80, 1) + create(10) + write("cc")) == [status(0x80, 0, 10), acknack(2)]
    assert len(taken) == 1
    assert bench.writes() == [b"\xcc"]
