"""Conformance cases 37 to 50: order, acknowledgement and repetition on streams (XRCE 1.0 §8.3.5.11, §8.4)."""

from __future__ import annotations

from tests.conformance.agent_rig import (
    PING_INSIDE,
    AgentRig,
    acknack,
    data,
    heartbeat,
    info,
    octets,
    packets,
    participant,
    read,
    reliable,
    status,
    write,
)


def create(number: int, *, stream: str = "80") -> str:
    """A message with P of an object of its own for every number."""
    head = f"81 {stream} {number & 0xFF:02x} {number >> 8:02x}"
    return participant(head, request=f"01 {number & 0xFF:02x}", object_id=f"{number & 0xFF:02x} 11")


def created(number: int, answer: int, *, stream: str = "80", code: str = "00") -> str:
    """The STATUS for `create(number)`, as message `answer` of the agent."""
    return status(f"81 {stream} {answer:02x} 00", f"01 {number:02x}", f"{number:02x} 11", code)


def handled_two(agent: AgentRig) -> None:
    """Log in and have messages 0 and 1 handled: last_handled is 1."""
    agent.log_in()
    agent.say(create(0), create(1))


def test_case_37_a_message_before_its_time_waits(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say(create(1)) == packets("81 00 00 00 0a 01 05 00 00 00 00 01 80")
    assert agent.say(create(0)) == packets(created(0, 0), created(1, 1), "81 00 00 00 0a 01 05 00 02 00 00 00 80")


def test_case_38_a_duplicate_has_no_effect_and_is_acknowledged(agent: AgentRig) -> None:
    handled_two(agent)
    assert agent.say(create(0)) == packets(acknack(2))
    assert agent.say(participant("81 80 00 00", request="00 0c", object_id="00 31")) == packets(acknack(2))


def test_case_39_the_window_reaches_16_messages_ahead(agent: AgentRig) -> None:
    handled_two(agent)
    assert agent.say(create(17)) == packets("81 00 00 00 0a 01 05 00 02 00 7f ff 80")
    assert agent.say(create(18)) == packets("81 00 00 00 0a 01 05 00 02 00 7f ff 80")
    answers = agent.say(*(create(number) for number in range(2, 17)))
    statuses = [answer for answer in answers if answer[2:4] == "80"]
    # Message 18 was not kept; 17 was, and comes in its turn (16 STATUS are unacknowledged then: the rest waits).
    assert statuses == packets(*(created(number, number) for number in range(2, 16)))
    assert answers[-1] == octets(acknack(18, "00 01")).hex()
    assert agent.say(acknack(16)) == packets(created(16, 16), created(17, 17))


def test_case_40_heartbeat_is_answered_with_what_is_missing(agent: AgentRig) -> None:
    handled_two(agent)
    assert agent.say(heartbeat(2, 5)) == packets("81 00 00 00 0a 01 05 00 02 00 00 0f 80")
    agent.say(create(17))
    assert agent.say(heartbeat(2, 5)) == packets("81 00 00 00 0a 01 05 00 02 00 7f ff 80")


def test_case_41_heartbeat_beyond_the_gap_gives_the_gap_up(agent: AgentRig) -> None:
    handled_two(agent)
    assert agent.say(heartbeat(4, 5)) == packets("81 00 00 00 0a 01 05 00 04 00 00 03 80")
    assert agent.say(create(4)) == packets(created(4, 2), acknack(5, "00 01"))


def test_case_42_truncated_heartbeat_and_acknack_are_met_with_silence(agent: AgentRig) -> None:
    handled_two(agent)
    for report in (heartbeat(2, 5), acknack(2)):
        for size in range(4, 13):
            assert agent.say(octets(report)[:size]) == []
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))
    assert agent.say(acknack(0, "00 03")) == packets(created(0, 0), created(1, 1))


def test_case_43_heartbeat_of_a_best_effort_stream_is_met_with_silence(agent: AgentRig) -> None:
    # The genuine agent answers with a garbage bitmap.
    handled_two(agent)
    assert agent.say(heartbeat(4, 5, stream="01")) == []
    assert agent.say(heartbeat(4, 5, stream="00")) == []
    assert agent.say(heartbeat(0, 3, stream="85")) == packets(acknack(0, "00 0f", stream="85"))


def test_case_44_unacknowledged_statuses_are_announced_every_200_ms(agent: AgentRig) -> None:
    handled_two(agent)
    beat = "810000000b0105000000010080"
    assert agent.wait(0.7) == [(0.2, beat), (0.4, beat), (0.6, beat)]
    assert agent.say(acknack(2)) == []
    assert agent.wait(2.0) == []


def test_case_44_the_heartbeat_tells_what_is_left(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(create(0), create(1), create(2), acknack(1))
    assert {packet for _, packet in agent.wait(1.0)} == {octets(heartbeat(1, 2)).hex()}
    assert agent.say(acknack(3)) == []
    assert agent.wait(2.0) == []


def test_case_44_a_client_that_takes_its_time_is_asked_less_often(agent: AgentRig) -> None:
    # DEVIATION: the genuine agent asks every 200 ms; ours waits for two round trips as measured, at most 1 s.
    handled_two(agent)
    agent.wait(0.25)
    assert agent.say(acknack(1)) == []
    beat = octets(heartbeat(1, 1)).hex()
    assert agent.wait(1.0) == [(0.5, beat), (1.0, beat)]


def test_case_45_acknack_bits_bring_exactly_the_stored_messages_again(agent: AgentRig) -> None:
    handled_two(agent)
    assert agent.say("81 00 00 00 0a 01 05 00 00 00 ff ff 80") == packets(created(0, 0), created(1, 1))
    assert agent.say(acknack(1)) == []
    assert agent.say(acknack(100)) == []
    # The one beyond was not believed: message 1 is still there.
    assert {packet for _, packet in agent.wait(0.3)} == {octets(heartbeat(1, 1)).hex()}
    assert agent.say(acknack(1, "00 01")) == packets(created(1, 1))


def test_case_46_statuses_beyond_the_window_of_16_wait(agent: AgentRig) -> None:
    # The genuine agent loses the last four; ours sends them as soon as there is room.
    agent.log_in()
    answers = agent.say(*(create(number) for number in range(20)))
    statuses = [answer for answer in answers if answer[2:4] == "80"]
    assert statuses == packets(*(created(number, number) for number in range(16)))
    assert agent.wait(0.3) == [(0.2, octets(heartbeat(0, 15)).hex())]
    assert agent.say(acknack(16)) == packets(*(created(number, number) for number in range(16, 20)))
    assert agent.say(acknack(20)) == []
    assert agent.say(create(20)) == packets(created(20, 20), acknack(21))


def test_case_47_reset_begins_the_streams_anew_and_keeps_the_objects(agent: AgentRig) -> None:
    handled_two(agent)
    assert agent.say("81 00 00 00 0c 01 00 00") == []
    assert agent.wait(1.0) == []
    assert agent.say(create(0)) == packets(created(0, 0, code="82"), acknack(1))
    assert agent.say(participant("81 01 00 00", object_id="00 41")) == packets(status("81 01 00 00", "00 0a", "00 41"))


def test_case_48_best_effort_takes_newer_messages_only(agent: AgentRig) -> None:
    agent.log_in()
    came = [agent.say(create(number, stream="01")) for number in (0, 0, 5, 3)]
    assert came == [packets(created(0, 0, stream="01")), [], packets(created(5, 1, stream="01")), []]


def test_case_49_the_first_best_effort_number_is_in_the_half_ahead(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say(create(0x7FFF, stream="01")) == []
    assert len(agent.say(create(0x7FFE, stream="01"))) == 1
    assert agent.say(create(0xFFFF, stream="01")) == []


def test_case_50_65552_reliable_messages_pass_the_wrap_both_ways_without_loss(agent: AgentRig) -> None:
    agent.set_up_two()
    agent.say(reliable(6, read()))
    agent.take("writer")
    for first in range(6, 6 + 65_552, 16):
        numbers = range(first, first + 16)
        batch = [octets(reliable(number, write(f"{number:08x}"))) for number in numbers]
        # DEVIATION: the genuine agent sends 16 ACKNACKs; here the last of them speaks for all that came at once.
        assert agent.say_at_once(batch, peer="writer") == packets(acknack(first + 16))
        assert agent.take() == packets(*(reliable(number, data(f"{number:08x}")) for number in numbers))
        assert agent.say_at_once([octets(acknack(first + 16))]) == []
    assert agent.say(reliable(7, ""), peer="writer") == packets(acknack(6 + 65_552))
    assert agent.wait(1.0) == []
