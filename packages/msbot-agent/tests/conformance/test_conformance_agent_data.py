"""Conformance cases 51 to 69: samples in, samples out, fragments (XRCE 1.0 §8.3.5.8 to §8.3.5.10, §8.3.5.14)."""

from __future__ import annotations

import pytest

from tests.conformance.agent_rig import (
    PING_INSIDE,
    AgentRig,
    acknack,
    data,
    fragment,
    info,
    octets,
    packets,
    participant,
    read,
    reliable,
    status,
    write,
)


@pytest.fixture
def flow(agent: AgentRig) -> AgentRig:
    """A client with writer 0015 and reader 0016 of one topic; the next message on 0x80 is number 6 both ways."""
    agent.log_in()
    agent.set_up()
    return agent


def say(flow: AgentRig, number: int, body: str) -> list[str]:
    """What the agent answers to a message of stream 0x80, its ACKNACK left out."""
    *answers, last = flow.say(reliable(number, body))
    assert last == octets(acknack(number + 1)).hex()
    return answers


def test_case_51_write_to_an_unknown_writer_is_not_answered(flow: AgentRig) -> None:
    # The genuine agent drops the rest of the message; ours goes on behind it.
    assert say(flow, 6, write("00 00 00 00", object_id="09 95") + participant("", object_id="00 91")) == packets(
        status("81 80 06 00", "00 0a", "00 91")
    )
    (view,) = flow.agent.clients()
    assert view.dropped == {"WRITE_DATA for an unknown object": 1}


@pytest.mark.parametrize("form", ["03", "09", "0b", "0f"])
def test_case_52_write_in_another_format_than_data_is_dropped(flow: AgentRig, form: str) -> None:
    say(flow, 6, read())
    assert say(flow, 7, f"07 {form} 08 00 00 10 00 15 00 00 00 00") == []
    assert say(flow, 8, write("01")) == packets(reliable(6, data("01")))


@pytest.mark.parametrize("contents", ["00", "00 10", "00 10 09"])
def test_case_53_write_of_length_1_to_3_is_dropped(flow: AgentRig, contents: str) -> None:
    # The genuine agent aborts.
    say(flow, 6, read())
    assert say(flow, 7, f"07 01 0{len(octets(contents))} 00 {contents}") == []
    assert flow.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))


def test_case_54_write_of_length_4_is_an_empty_sample(flow: AgentRig) -> None:
    say(flow, 6, read())
    assert say(flow, 7, "07 01 04 00 00 36 00 15") == packets("81 80 06 00 09 01 04 00 00 21 00 16")


def test_case_55_write_of_length_0_takes_the_rest_of_the_message(flow: AgentRig) -> None:
    say(flow, 6, read())
    rest = "01 02 03 04 05 06 07 08 09"
    assert say(flow, 7, f"07 01 00 00 00 36 00 15 {rest}") == packets(reliable(6, data(rest)))
    assert say(flow, 8, "07 01 00 00 00 36 00 15") == packets(reliable(7, data("")))


def test_case_56_write_longer_than_its_message_is_dropped(flow: AgentRig) -> None:
    say(flow, 6, read())
    assert say(flow, 7, "07 01 ff 00 00 10 00 15 01 02 03 04") == []
    assert say(flow, 8, write("01")) == packets(reliable(6, data("01")))


def test_case_57_read_of_one_sample_gets_the_one_that_waits_and_no_more(flow: AgentRig) -> None:
    assert say(flow, 6, write("00 01 02 03")) == []
    assert say(flow, 7, "08 01 10 00 00 21 00 16 80 00 00 01 01 00 00 00 00 00 00 00") == packets(
        "81 80 06 00 09 01 08 00 00 21 00 16 00 01 02 03"
    )
    assert say(flow, 8, write("01 01 01 01")) == []
    assert say(flow, 9, write("02 02 02 02")) == []
    assert say(flow, 10, read(request="00 24", stream="01", max_samples="01 00")) == packets(
        "81 01 00 00 09 01 08 00 00 24 00 16 01 01 01 01"
    )


def test_case_58_read_without_delivery_control_gets_one_sample(flow: AgentRig) -> None:
    assert say(flow, 6, "08 01 08 00 00 24 00 16 01 00 00 00") == []
    assert say(flow, 7, write("00 01 02 03")) == packets("81 01 00 00 09 01 08 00 00 24 00 16 00 01 02 03")
    assert say(flow, 8, write("00 01 02 03")) == []


def test_case_59_data_on_stream_none(flow: AgentRig) -> None:
    say(flow, 6, read(request="00 25", stream="00", max_samples="02 00"))
    assert say(flow, 7, write("02 02 02 02")) == packets("81 00 00 00 09 01 08 00 00 25 00 16 02 02 02 02")
    assert say(flow, 8, write("03 03 03 03")) == packets("81 00 00 00 09 01 08 00 00 25 00 16 03 03 03 03")
    assert say(flow, 9, write("04 04 04 04")) == []


def test_case_60_a_read_of_1_s_ends_after_1_s_and_the_sample_waits_for_the_next(flow: AgentRig) -> None:
    say(flow, 6, read(request="00 28", stream="01", elapsed="01 00"))
    assert flow.wait(0.9) == []
    assert say(flow, 7, write("04 04 04 04")) == packets("81 01 00 00 09 01 08 00 00 28 00 16 04 04 04 04")
    assert flow.wait(0.2) == []
    assert say(flow, 8, write("05 05 05 05")) == []
    assert flow.wait(5.0) == []
    assert say(flow, 9, read(request="00 2a", stream="01")) == packets(
        "81 01 01 00 09 01 08 00 00 2a 00 16 05 05 05 05"
    )


def test_case_61_a_second_read_takes_the_place_of_the_first(flow: AgentRig) -> None:
    say(flow, 6, read(request="00 2a", stream="01"))
    assert say(flow, 7, write("05")) == packets("81 01 00 00" + data("05", request="00 2a"))
    assert say(flow, 8, read(request="00 2b", stream="01")) == []
    assert say(flow, 9, write("06")) == packets("81 01 01 00" + data("06", request="00 2b"))


def test_case_62_a_cancelled_read_delivers_nothing_more(flow: AgentRig) -> None:
    # The genuine agent goes on when a sample comes within 100 ms.
    say(flow, 6, read(stream="01"))
    assert say(flow, 7, "08 01 10 00 00 26 00 16 00 00 00 01 00 00 00 00 00 00 00 00") == []
    assert say(flow, 8, write("07 07 07 07")) == []
    assert flow.wait(0.3) == []
    assert say(flow, 9, write("08 08 08 08")) == []
    assert say(flow, 10, read(request="00 2c", stream="01")) == packets(
        "81 01 00 00" + data("07 07 07 07", request="00 2c"), "81 01 01 00" + data("08 08 08 08", request="00 2c")
    )


@pytest.mark.parametrize("object_id", ["00 26", "00 15", "00 12", "ff fd"])
def test_case_63_read_of_what_cannot_be_read_is_refused_on_0x80(flow: AgentRig, object_id: str) -> None:
    refusal = status("81 80 06 00", "00 21", object_id, "84")
    assert flow.say("81 01 00 00" + read(object_id=object_id, stream="01")) == packets(refusal)


def test_case_64_content_filter_is_accepted_and_ignored(flow: AgentRig) -> None:
    filtered = "08 01 1a 00 00 32 00 16 01 00 01 00 04 00 00 00 61 62 3e 00 01 00 01 00 00 00 00 00 00 00 00 00"
    assert say(flow, 6, filtered) == []
    assert say(flow, 7, write("0a")) == packets("81 01 00 00" + data("0a", request="00 32"))


LARGE = octets("07 01 84 00 00 39 00 15") + bytes(range(128))
PIECES = [
    octets("81 80 06 00 0d 01 38 00 09 01 84 00 00 38 00 16") + bytes(range(0x30)),
    octets("81 80 07 00 0d 01 38 00") + bytes(range(0x30, 0x68)),
    octets("81 80 08 00 0d 03 18 00") + bytes(range(0x68, 0x80)),
]


def test_case_65_reliable_data_larger_than_the_mtu_is_cut(agent: AgentRig) -> None:
    agent.log_in(mtu="40 00")
    agent.set_up()
    say(agent, 6, read(request="00 38"))
    assert say(agent, 7, LARGE.hex()) == [piece.hex() for piece in PIECES]
    assert [len(piece) for piece in PIECES] == [64, 64, 32]


def test_case_66_best_effort_data_larger_than_the_mtu_is_dropped_and_later_samples_come(agent: AgentRig) -> None:
    # With MTU + 1 to MTU + 8 octets the genuine agent is stuck for ever.
    agent.log_in(mtu="40 00")
    agent.set_up()
    say(agent, 6, read(request="00 35", stream="01"))
    header = 4 + 8
    for number, excess in enumerate((1, 2, 3, 4, 5, 6, 7, 8, 9, 64)):
        assert say(agent, 7 + number, write("11" * (64 - header + excess))) == []
    assert say(agent, 17, write("22" * (64 - header))) == packets(
        "81 01 00 00" + data("22" * (64 - header), request="00 35")
    )


def test_case_67_fragments_are_joined(flow: AgentRig) -> None:
    say(flow, 6, read(request="00 38"))
    sample = "00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f"
    assert say(flow, 7, fragment("07 01 14 00 00 40 00 15 00 01")) == []
    assert say(flow, 8, fragment("02 03 04 05 06 07 08 09 0a 0b")) == []
    assert say(flow, 9, fragment("0c 0d 0e 0f", last=True)) == packets(reliable(6, data(sample, request="00 38")))


def test_case_67_swapped_fragments_are_joined(flow: AgentRig) -> None:
    say(flow, 6, read(request="00 38"))
    second = reliable(8, fragment("04 05 06 07 08 09 0a 0b 0c 0d 0e 0f", last=True))
    assert flow.say(second) == packets(acknack(7, "00 01"))
    sample = "00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f"
    assert flow.say(reliable(7, fragment("07 01 14 00 00 40 00 15 00 01 02 03"))) == packets(
        reliable(6, data(sample, request="00 38")), acknack(9)
    )


def test_case_67_fragments_may_hold_two_submessages(flow: AgentRig) -> None:
    say(flow, 6, read(request="00 38"))
    assert say(flow, 7, fragment("07 01 08 00 00 41")) == []
    rest = "00 15 aa aa aa aa 07 01 08 00 00 42 00 15 bb bb bb bb"
    assert say(flow, 8, fragment(rest, last=True)) == packets(
        reliable(6, data("aa aa aa aa", request="00 38")), reliable(7, data("bb bb bb bb", request="00 38"))
    )


@pytest.mark.parametrize("anew", ["reset", "login"])
def test_case_68_half_a_fragmented_message_does_not_spoil_the_next_one(flow: AgentRig, anew: str) -> None:
    # The genuine agent loses the next one.
    say(flow, 6, read(stream="01"))
    say(flow, 7, fragment("07 01 14 00 00 40"))
    if anew == "reset":
        assert flow.say("81 00 00 00 0c 01 00 00") == []
    else:
        flow.log_in()
    assert say(flow, 0, fragment("07 01 14 00 00 40 00 15 00 01 02 03")) == []
    sample = "00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f"
    assert say(flow, 1, fragment("04 05 06 07 08 09 0a 0b 0c 0d 0e 0f", last=True)) == packets(
        "81 01 00 00" + data(sample)
    )


@pytest.mark.parametrize("stream", ["00", "01"])
def test_case_69_fragment_outside_of_a_reliable_stream_is_ignored(flow: AgentRig, stream: str) -> None:
    assert flow.say(f"81 {stream} 00 00" + fragment("de ad be ef", last=True)) == []
    # A last piece alone is read as a message of its own.
    assert say(flow, 6, fragment("de ad be ef", last=True)) == []
    assert flow.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))
