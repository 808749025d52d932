"""Conformance cases 75 to 78 and 87 to 92: what a client sends, how it logs in and out, what it answers."""

from __future__ import annotations

import struct

import pytest

from msbot_xrce import ClientState
from msbot_xrce.messages import (
    STREAM_BEST_EFFORT,
    STREAM_RELIABLE,
    DeliveryControl,
    Format,
    ObjectKind,
    ObjectVariant,
)
from msbot_xrce.objects import (
    EndpointQos,
    participant_variant,
    publisher_variant,
    reader_variant,
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from msbot_xrce.sessions import Connected, ConnectFailed, SessionClosed, StatusReceived, TimeSynchronised
from tests.conformance.agent_rig import octets
from tests.xrce.client_bench import LOGIN, LOGOUT, SECOND, WELCOME, Bench, acknack, data, head, received, status

SERVICE = ("svc", "ReqT", "RepT", "rq/svc", "rr/svc")
SERVICE_BLOB = (
    "37 00 00 00 04 00 00 00 73 76 63 00 05 00 00 00 52 65 71 54 00 00 00 00 05 00 00 00 52 65 70 54 00 01 00 00"
    "07 00 00 00 72 71 2f 73 76 63 00 01 07 00 00 00 72 72 2f 73 76 63 00"
)
LATCHED = EndpointQos(reliable=True, transient_local=True, depth=10)
PLAIN = EndpointQos(reliable=False, transient_local=False, depth=None)

CREATES = {
    "participant by reference": (
        0x0011,
        ObjectVariant(ObjectKind.PARTICIPANT, Format.REFERENCE, text="default_xrce_participant"),
        "28 00 00 0a 00 11 01 01 00 00 19 00 00 00 64 65 66 61 75 6c 74 5f 78 72 63 65 5f 70 61 72 74 69 63 69 70 61"
        "6e 74 00 00 00 00",
    ),
    "participant": (
        0x0011,
        participant_variant("part", 5),
        "1c 00 00 0a 00 11 01 03 00 00 0d 00 00 00 00 01 00 00 05 00 00 00 70 61 72 74 00 00 05 00",
    ),
    "topic": (
        0x0012,
        topic_variant("ExampleTopic", "ExampleType", 0x0011),
        "32 00 00 0a 00 12 02 03 00 00 24 00 00 00 0d 00 00 00 45 78 61 6d 70 6c 65 54 6f 70 69 63 00 00 01 00"
        "0c 00 00 00 45 78 61 6d 70 6c 65 54 79 70 65 00 00 11 00 00",
    ),
    "publisher": (0x0013, publisher_variant(0x0011), "10 00 00 0a 00 13 03 03 00 00 02 00 00 00 00 00 00 11"),
    "subscriber": (0x0014, subscriber_variant(0x0011), "10 00 00 0a 00 14 04 03 00 00 02 00 00 00 00 00 00 11"),
    "data writer": (
        0x0015,
        writer_variant(0x0012, 0x0013, LATCHED),
        "1c 00 00 0a 00 15 05 03 00 00 0e 00 00 00 00 12 01 00 0b 00 01 00 0a 00 00 00 00 00 00 13",
    ),
    "data reader": (
        0x0016,
        reader_variant(0x0012, 0x0014, PLAIN),
        "1a 00 00 0a 00 16 06 03 00 00 0c 00 00 00 00 12 01 00 02 00 00 00 00 00 00 00 00 14 00 00",
    ),
    "requester": (
        0x0017,
        requester_variant(*SERVICE, 0x0011),
        f"45 00 00 0a 00 17 07 03 00 00 {SERVICE_BLOB} 00 11 00 00 00",
    ),
    "replier": (
        0x0018,
        replier_variant(*SERVICE, 0x0011),
        f"45 00 00 0a 00 18 08 03 00 00 {SERVICE_BLOB} 00 11 00 00 00",
    ),
}


def plain(text: str) -> list[str]:
    """One packet as the bench gives it back."""
    return [octets(text).hex()]


@pytest.mark.parametrize(("object_id", "variant", "body"), CREATES.values(), ids=CREATES)
def test_case_75_create_has_the_octets_of_the_c_client(object_id: int, variant: ObjectVariant, body: str) -> None:
    # Padding aside, which the C client fills with what its buffer held before.
    bench = Bench()
    assert bench.session.create(object_id, variant, reuse=False, replace=True) == 10
    assert bench.pull() == plain(f"81 80 00 00 01 05 {body}")


def test_case_75_create_client_delete_and_get_info_have_the_octets_of_the_c_client() -> None:
    bench = Bench(connected=False)
    bench.session.ping(0.0)
    assert bench.pull() == plain("80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00")
    bench.session.connect(0.0)
    assert bench.pull() == plain("80 00 00 00 00 01 10 00 58 52 43 45 01 00 01 0f aa bb cc dd 81 00 fc 01")
    bench.feed(WELCOME)
    bench.session.ping(0.0)
    assert bench.pull() == plain("81 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00")
    assert bench.session.delete(0x0012) == 10
    assert bench.pull() == plain("81 80 00 00 03 01 04 00 00 0a 00 12")
    bench.session.close(0.0)
    assert bench.pull() == plain("81 00 00 00 03 01 04 00 00 02 ff fe")


def test_case_75_login_with_the_key_in_every_header_has_the_octets_that_agents_take() -> None:
    bench = Bench(connected=False, session_id=0x01)
    bench.session.connect(0.0)
    assert bench.pull() == plain("00 00 00 00 aa bb cc dd 00 01 10 00 58 52 43 45 01 00 01 0f aa bb cc dd 01 00 fc 01")


def test_case_75_read_write_heartbeat_and_acknack_have_the_octets_of_the_c_client() -> None:
    bench = Bench()
    bench.session.read(0x0016, STREAM_RELIABLE, DeliveryControl(0xFFFF, 0, 0, 0))
    assert bench.pull() == plain("81 80 00 00 08 01 10 00 00 0a 00 16 80 00 00 01 ff ff 00 00 00 00 00 00")
    bench.session.read(0x0016, STREAM_BEST_EFFORT)
    assert bench.pull() == plain("81 80 01 00 08 01 08 00 00 0b 00 16 01 00 00 00")
    bench.session.read(0x0016, 0, DeliveryControl(0, 0, 0, 0))
    assert bench.pull() == plain("81 80 02 00 08 01 10 00 00 0c 00 16 00 00 00 01 00 00 00 00 00 00 00 00")
    bench.session.write(0x0015, bytes(range(8)), STREAM_RELIABLE)
    assert bench.pull() == plain("81 80 03 00 07 01 0c 00 00 0d 00 15 00 01 02 03 04 05 06 07")
    bench.session.write(0x0015, bytes(range(5)), STREAM_BEST_EFFORT)
    bench.session.write(0x0015, bytes(range(8)), STREAM_BEST_EFFORT)
    assert bench.pull() == plain(
        "81 01 00 00 07 01 09 00 00 0e 00 15 00 01 02 03 04 00 00 00 07 01 0c 00 00 0f 00 15 00 01 02 03 04 05 06 07"
    )
    bench.now = 0.1
    bench.session.handle_timer(0.1)
    assert bench.pull() == plain("81 00 00 00 0b 01 05 00 00 00 03 00 80")
    assert bench.feed(head(0x80) + data("00")) == plain("81 00 00 00 0a 01 05 00 01 00 00 00 80")


def test_case_76_login_is_repeated_every_1000_ms_and_fails_after_10_tries() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    sent_at = [bench.now for _ in bench.pull()]
    while (at := bench.session.timer()) is not None:
        bench.now = at
        bench.session.handle_timer(at)
        assert bench.session.next_event() is None or at == 10.0
        sent_at += [at for packet in bench.pull() if packet == LOGIN]
    assert sent_at == [float(second) for second in range(10)]
    assert bench.state() is ClientState.FAILED


def test_case_76_no_answer_at_all_is_told() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    assert len(bench.wait(100.0)) == 10
    assert bench.events() == [ConnectFailed(None)]


@pytest.mark.parametrize("code", [0x86, 0x83, 0x85, 0x87])
def test_case_77_login_that_is_refused_fails_at_once(code: int) -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    assert bench.pull() == [LOGIN]
    assert bench.feed(f"8100000004010b00{code:02x}0058524345" + "0100010f00") == []
    assert bench.events() == [ConnectFailed(code)]
    assert bench.wait(100.0) == []


def test_case_78_answer_to_another_session_is_ignored_and_the_login_goes_on() -> None:
    bench = Bench(connected=False)
    bench.session.connect(0.0)
    assert bench.pull() == [LOGIN]
    assert bench.feed("82" + WELCOME[2:]) == []
    assert bench.wait(1.0) == [LOGIN]
    assert bench.feed("82" + WELCOME[2:]) == []
    assert bench.events() == []
    assert bench.feed(WELCOME) == []
    assert bench.events() == [Connected()]


def test_case_87_the_agents_question_is_answered_at_once() -> None:
    bench = Bench()
    assert bench.feed("8100000002010800" + "0000fffe01000000") == plain(
        "81 00 00 00 06 01 08 00 00 00 ff fe 00 00 00 00"
    )
    assert bench.feed("8100000002010800" + "1234fffe01000000") == plain(
        "81 00 00 00 06 01 08 00 12 34 ff fe 00 00 00 00"
    )


def test_case_88_unknown_submessage_is_skipped_by_its_length() -> None:
    # The C client reads its contents as the next submessage.
    bench = Bench()
    assert bench.feed("81010600 20010400 aabbccdd" + data("b6b6b6b6")) == []
    assert bench.feed("81010700 20010500 0901080000 000000" + data("b7")) == []
    assert bench.events() == [received("b6b6b6b6", 1), received("b7", 1)]


def test_case_89_best_effort_takes_newer_messages_only() -> None:
    bench = Bench()
    assert bench.feed(*(head(1, number) + data(f"{number:02x}") for number in (0, 5, 3))) == []
    assert bench.events() == [received("00", 1), received("05", 1)]


def test_case_90_message_of_another_session_is_ignored() -> None:
    bench = Bench()
    assert bench.feed("82010700" + data("b7b7b7b7"), "82800000" + data("b7b7b7b7")) == []
    assert bench.events() == []
    assert bench.session.dropped == {"message of another session": 2}


def test_case_91_logout_is_tried_10_times_and_confirmed_by_request_2() -> None:
    bench = Bench()
    bench.session.close(0.0)
    assert bench.wait(9.9) == [LOGOUT] * 10
    assert bench.state() is ClientState.CLOSING
    bench.wait(0.1)
    assert bench.events() == [SessionClosed(confirmed=False)]
    bench = Bench()
    bench.session.close(0.0)
    assert bench.feed(status(0, 0, 3, object_id=0xFFFE)) == [LOGOUT]
    assert bench.state() is ClientState.CLOSING
    assert bench.feed(status(0, 0, 2, object_id=0xFFFE)) == []
    assert bench.events() == [SessionClosed(confirmed=True)]


@pytest.mark.parametrize("round_trip_ns", [0, 4_000_000, 900_000_000])
def test_case_92_time_against_an_agent_5_s_ahead(round_trip_ns: int) -> None:
    bench = Bench()
    bench.session.sync_time()
    assert bench.pull() == plain("81 00 00 00 0e 01 08 00 64 00 00 00 00 00 00 00")
    there_ns = 105 * SECOND + round_trip_ns // 2
    bench.clock_ns += round_trip_ns
    there = struct.pack("<iI", *divmod(there_ns, SECOND)).hex()
    bench.feed(f"81000000 0f011800 {there} {there} 6400000000000000")
    (event,) = bench.events()
    assert isinstance(event, TimeSynchronised)
    assert event.offset_ns == -5 * SECOND
    assert event.round_trip_ns == round_trip_ns


def test_statuses_come_on_every_stream_but_none() -> None:
    bench = Bench()
    assert bench.feed("81010900 05010600 0077 0015 8400", "81000000 05010600 0078 0015 8400") == []
    assert bench.events() == [StatusReceived(0x77, 0x0015, 0x84)]
    assert bench.feed(status(0x80, 0, 10)) == [acknack(1)]
    assert bench.events() == [StatusReceived(10, 0x11, 0)]
