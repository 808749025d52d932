"""Recorded clients against our agent: the same answers as the genuine agent's, unless said why not."""

from __future__ import annotations

import pytest

from msbot_agent.agent.discovery import discovery_answer
from msbot_xrce import References
from msbot_xrce.messages import decode_header, iter_submessages
from tests.agent.replay import (
    VECTORS,
    Answers,
    Place,
    agent_with,
    differences,
    load,
    recorded,
    replayed,
    samples_written,
)

EQUAL = [
    ["serial_big_loop_4k"],
    ["serial_bin_loop_ced"],
    ["serial_escape_bytes"],
    ["serial_ex_ping"],
    ["serial_ref_loop_ced"],
    ["serial_session"],
    ["serial_timesync"],
    ["serial_xml_loop_dds"],
    ["tcp_big_10k_pub", "tcp_big_10k_sub"],
    ["tcp_bin_loop_dds"],
    ["tcp_ex_ping"],
    ["tcp_ref_loop_ced"],
    ["tcp_session"],
    ["tcp_timesync"],
    ["tcp_xml_pubsub_pub", "tcp_xml_pubsub_sub"],
    ["udp_besteffort_ced_pub", "udp_besteffort_ced_sub"],
    ["udp_bigloop_10k_dds_pub", "udp_bigloop_10k_dds_sub"],
    ["udp_bin_loop_ced"],
    ["udp_bin_loop_dds"],
    ["udp_burst_ced"],
    ["udp_burst_keepall_dds"],
    ["udp_ex_binary_entities"],
    ["udp_ex_binary_entities_ced"],
    ["udp_ex_continuous_fragment"],
    ["udp_ex_deployment"],
    ["udp_ex_ping"],
    ["udp_ex_timesync"],
    ["udp_ex_timesync_cb"],
    ["udp_hardliveliness_alive"],
    ["udp_loop_drop15_ced"],
    ["udp_ping"],
    ["udp_ping_session"],
    ["udp_raw_bad_handshake"],
    ["udp_raw_get_info"],
    ["udp_raw_keyed_session"],
    ["udp_raw_malformed"],
    ["udp_raw_no_session"],
    ["udp_raw_reset"],
    ["udp_ref_loop_ced"],
    ["udp_ref_loop_dds"],
    ["udp_reqrep_rep", "udp_reqrep_req"],
    ["udp_session"],
    ["udp_session_twice"],
    ["udp_statuses_dds"],
    ["udp_timesync"],
    ["udp_xml_loop_dds"],
]
"""Groups of recordings with one clock whose answers must be equal in every word."""

LOSSLESS = {
    "udp_burst_default_qos_dds": ["udp_burst_default_qos_dds"],
    "udp_ex_adder": ["udp_ex_adder_request", "udp_ex_adder_reply"],
    "udp_ex_helloworld": ["udp_ex_helloworld_pub", "udp_ex_helloworld_sub"],
    "udp_ex_helloworld_besteffort": ["udp_ex_helloworld_besteffort_pub", "udp_ex_helloworld_besteffort_sub"],
    "udp_loop_drop15": ["udp_loop_drop15"],
}
"""The genuine agent loses samples here: while DDS still matches writer and reader, and for want of history in bursts.
Ours must deliver all of them in order, as far as the recorded acknowledgements (of fewer samples) let it."""

DISCOVERY = ["udp_ex_discovery_multicast", "udp_ex_discovery_unicast"]

CANCEL = "one sample that comes within 100 ms of the cancellation is still sent; here a cancelled read ends"
MEMORY = "the in-memory middleware takes any XML for a name, and refuses writers and readers by XML; here XML is read"
CUT = "the recording stops in mid-dialogue: compared as far as it goes"
LOST = "samples are lost while DDS matches writer and reader, or in bursts; here none is"
SPECIAL = {
    "udp_read_cancel_pub": CANCEL,
    "udp_read_cancel_sub": CANCEL,
    "udp_statuses_ced": MEMORY,
    "udp_xml_on_ced_fails": MEMORY,
    "udp_ex_big_pub": CUT,
    "udp_big_drop15_pub": CUT,
    "udp_big_drop15_sub": CUT,
}
"""What the genuine agent does in recordings whose answers are compared in a way of their own."""

OTHERWISE = SPECIAL | {name: LOST for group in LOSSLESS.values() for name in group}
"""Recordings that ours answers otherwise, and why."""


def test_every_recording_is_replayed_or_excused() -> None:
    names = {path.stem for path in VECTORS.glob("*.jsonl")}
    grouped = {name for group in [*EQUAL, *LOSSLESS.values()] for name in group}
    assert names == grouped | set(DISCOVERY) | set(SPECIAL)


@pytest.mark.parametrize("names", EQUAL, ids=lambda names: names[0])
def test_answers_are_those_of_the_genuine_agent(names: list[str]) -> None:
    lines = load(*names)
    genuine, ours = recorded(lines), replayed(lines)
    if "drop" in names[0]:
        genuine, ours = _each_once(genuine), _each_once(ours)
    assert not differences(genuine, ours)


def test_references_come_from_the_profile_file_when_there_is_one() -> None:
    profiles = """<profiles>
        <participant profile_name="default_xrce_participant"><rtps><name>p</name></rtps></participant>
        <topic profile_name="HelloWorldTopic__t"><name>HelloWorldTopic</name><dataType>HelloWorld</dataType></topic>
        <data_writer profile_name="HelloWorldTopic__dw"><topic><kind>NO_KEY</kind><name>HelloWorldTopic</name>
            <dataType>HelloWorld</dataType></topic></data_writer>
        <data_reader profile_name="HelloWorldTopic__dr"><topic><kind>NO_KEY</kind><name>HelloWorldTopic</name>
            <dataType>HelloWorld</dataType></topic></data_reader>
    </profiles>"""
    lines = load("udp_ref_loop_dds")
    make_agent = agent_with(References.parse(profiles, "test"))
    assert not differences(recorded(lines), replayed(lines, make_agent))
    nothing_known = agent_with(References.parse("<profiles></profiles>", "test"))
    assert differences(recorded(lines), replayed(lines, nothing_known))


@pytest.mark.parametrize("names", LOSSLESS.values(), ids=LOSSLESS)
def test_nothing_is_lost_where_the_genuine_agent_loses_samples(names: list[str]) -> None:
    lines = load(*names)
    genuine, ours = _each_once(recorded(lines)), _each_once(replayed(lines))
    assert _without_samples(genuine) == _without_samples(ours)
    (place,) = (place for place, answers in ours.items() if answers.samples)
    delivered = list(ours[place].samples.values())
    assert delivered == samples_written(lines)[: len(delivered)]
    assert len(delivered) > len(genuine[place].samples)


def test_cancelled_read_delivers_nothing_more() -> None:
    # The genuine agent sends one sample that comes within 100 ms, on the stream of the cancellation.
    lines = load("udp_read_cancel_pub", "udp_read_cancel_sub")
    genuine, ours = recorded(lines), replayed(lines)
    (late,) = [words for words in genuine["udp_read_cancel_sub", 0].streams[0] if "Data(request_id=15" in words]
    genuine["udp_read_cancel_sub", 0].streams[0].remove(late)
    assert not differences(genuine, ours)


def test_statuses_do_not_depend_on_the_middleware() -> None:
    ours = replayed(load("udp_statuses_ced"))
    genuine = recorded(load("udp_statuses_dds"))
    assert ours["udp_statuses_ced", 0].streams == genuine["udp_statuses_dds", 0].streams


def test_xml_is_understood_in_memory_too() -> None:
    answers = replayed(load("udp_xml_on_ced_fails"))["udp_xml_on_ced_fails", 0]
    statuses = [words for words in answers.streams[0x80] if "StatusReply" in words]
    assert len(statuses) == 6
    assert all("status=0," in words for words in statuses)


def test_a_large_publication_is_acknowledged_as_far_as_it_was_recorded() -> None:
    lines = load("udp_ex_big_pub")
    genuine, ours = recorded(lines), replayed(lines)
    for place, answers in genuine.items():
        for stream_id, words in answers.streams.items():
            assert ours[place].streams[stream_id][: len(words)] == words


def test_a_large_publication_over_a_lossy_network_is_passed_on_as_far_as_it_was_recorded() -> None:
    # Messages beyond the window are asked for once more than by the genuine agent, so ACKNACKs are not compared.
    publisher, subscriber = ("udp_big_drop15_pub", 0), ("udp_big_drop15_sub", 0)
    lines = load(publisher[0], subscriber[0])
    genuine, ours = recorded(lines), replayed(lines)
    assert ours[subscriber].streams[0] == genuine[subscriber].streams[0]
    genuine, ours = _each_once(genuine), _each_once(ours)
    assert ours[publisher].streams[0x80] == genuine[publisher].streams[0x80]
    pieces = ours[subscriber].streams[0x80]
    assert len(pieces) >= 20
    assert pieces == genuine[subscriber].streams[0x80][: len(pieces)]


@pytest.mark.parametrize("name", DISCOVERY)
def test_discovery_answers_as_the_genuine_agent(name: str) -> None:
    lines = load(name)
    questions = [line.packet for line in lines if line.from_client]
    answers = [line.packet for line in lines if not line.from_client]
    header = decode_header(answers[0])
    (info,) = iter_submessages(answers[0], header.size)
    addresses = [locator.describe.split(":")[0] for locator in getattr(info, "locators", ())]
    assert addresses
    assert {discovery_answer(question, lambda: addresses, 3018) for question in questions} == set(answers)


def _each_once(answers: dict[Place, Answers]) -> dict[Place, Answers]:
    """Without repetitions on the reliable stream: what waits behind a STATUS where messages get lost is not repeated
    when that one is."""
    for one in answers.values():
        one.streams[0x80] = list(dict.fromkeys(one.streams[0x80]))
    return answers


def _without_samples(answers: dict[Place, Answers]) -> dict[tuple[Place, int], list[str]]:
    """Everything but samples."""
    return {
        (place, stream_id): [message for message in words if "Data(" not in message]
        for place in sorted(answers)
        for stream_id, words in answers[place].streams.items()
    }
