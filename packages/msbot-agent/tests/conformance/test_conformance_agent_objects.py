"""Conformance cases 23 to 36: CREATE and DELETE, and the statuses that answer them (XRCE 1.0 §8.3.5.2, §8.3.5.4)."""

from __future__ import annotations

import pytest

from tests.conformance.agent_rig import (
    DELETE_CLIENT,
    DELETED,
    ENTITIES,
    PING_INSIDE,
    AgentRig,
    acknack,
    info,
    octets,
    packets,
    participant,
    reliable,
    status,
)


def test_case_23_create_on_a_reliable_stream_gives_status_then_acknack(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say("81 80 00 00 01 01 10 00 00 0a 00 11 01 03 00 00 02 00 00 00 00 00 00 00") == packets(
        "81 80 00 00 05 01 06 00 00 0a 00 11 00 00", "81 00 00 00 0a 01 05 00 01 00 00 00 80"
    )


def test_case_24_create_on_best_effort_or_none_gives_status_on_best_effort(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say(participant("81 01 00 00")) == packets(status("81 01 00 00"))
    assert agent.say(participant("81 00 00 00", object_id="00 21")) == packets(status("81 01 01 00", "00 0a", "00 21"))


def test_case_25_the_kind_of_the_description_counts(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say(participant("81 01 00 00", object_id="00 55")) == packets(status("81 01 00 00", "00 0a", "00 55"))
    (view,) = agent.agent.clients()
    assert [item.object_id for item in view.objects] == [0x0051]
    assert agent.say("81 01 01 00 03 01 04 00 00 0b 00 51") == packets(status("81 01 01 00", "00 0b", "00 51"))


def test_case_26_reuse_and_replace_of_a_different_object(agent: AgentRig) -> None:
    agent.log_in()
    agent.say(participant("81 01 00 00"))
    assert agent.say(participant("81 01 01 00", flags="03", domain="05 00")) == packets(
        status("81 01 01 00", code="81")
    )
    assert agent.say(participant("81 01 02 00", flags="07", domain="05 00")) == packets(status("81 01 02 00"))
    assert agent.say(participant("81 01 03 00", flags="03", domain="05 00")) == packets(
        status("81 01 03 00", code="01")
    )
    assert agent.say(participant("81 01 04 00", flags="05", domain="05 00")) == packets(status("81 01 04 00"))


def test_case_27_topic_of_an_unknown_participant(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say(reliable(0, f"01 01 16 00 {ENTITIES[1]}")) == packets(
        status("81 80 00 00", "00 0b", "00 12", "84"), acknack(1)
    )


def test_case_28_delete_of_an_unknown_object(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say("81 80 00 00 03 01 04 00 00 0c 00 12") == packets(
        status("81 80 00 00", "00 0c", "00 12", "84"), acknack(1)
    )


def test_case_29_delete_of_the_agent(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say("81 01 00 00 03 01 04 00 00 03 ff fd") == packets(status("81 01 00 00", "00 03", "ff fd", "84"))
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))


def test_case_30_publisher_by_reference_is_an_error_and_the_rest_of_the_message_counts(agent: AgentRig) -> None:
    # The genuine agent reads on in the middle of the description.
    agent.log_in()
    agent.say(participant("81 01 00 00"))
    by_reference = "01 01 10 00 00 0f 00 23 03 01 00 00 02 00 00 00 78 00 00 11"
    first, second = agent.say("81 01 01 00" + by_reference + participant("", request="00 10", object_id="00 21"))
    assert first in packets(*(status("81 01 01 00", "00 0f", "00 23", code) for code in ("80", "84")))
    assert second == octets(status("81 01 02 00", "00 10", "00 21")).hex()


def test_case_31_unknown_form_of_description(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say("81 01 00 00 01 01 08 00 00 0d 00 71 01 09 00 00") == packets(
        status("81 01 00 00", "00 0d", "00 71", "80")
    )


@pytest.mark.parametrize("kind", ["0a", "0b", "0c"])
def test_case_32_types_profiles_and_applications_are_ok_without_effect(agent: AgentRig, kind: str) -> None:
    agent.log_in()
    object_id = f"00 6{kind[1]}"
    assert agent.say(f"81 01 00 00 01 01 10 00 00 0c {object_id} {kind} 02 00 00 02 00 00 00 78 00 00 00") == packets(
        status("81 01 00 00", "00 0c", object_id)
    )
    (view,) = agent.agent.clients()
    assert view.objects == ()


def test_case_33_text_longer_than_the_message_is_not_answered(agent: AgentRig) -> None:
    agent.log_in()
    assert agent.say("81 01 00 00 01 01 10 00 00 0e 00 81 01 02 00 00 ff 00 00 00 61 62 00 00") == []
    assert agent.say(participant("81 01 01 00")) == packets(status("81 01 00 00"))


def test_case_34_binary_description_shorter_than_its_contents(agent: AgentRig) -> None:
    # The genuine agent aborts on the first.
    agent.log_in()
    assert agent.say("81 01 00 00 01 01 10 00 00 0a 00 11 01 03 00 00 01 00 00 00 01 00 00 00") == packets(
        status("81 01 00 00", code="80")
    )
    agent.say(participant("81 01 01 00"))
    short_text = "01 01 18 00 00 0a 00 12 02 03 00 00 0a 00 00 00 ff 00 00 00 61 62 00 00 00 00 00 11 00 00"
    assert agent.say("81 01 02 00" + short_text) == packets(status("81 01 02 00", "00 0a", "00 12", "80"))


@pytest.mark.parametrize("stream", ["01", "80"])
def test_case_35_two_creates_and_the_end_of_the_session_in_one_message(agent: AgentRig, stream: str) -> None:
    agent.log_in()
    both = participant("") + participant("", request="00 0b", object_id="00 21")
    answers = agent.say(f"81 {stream} 00 00 {both} {DELETE_CLIENT}")
    assert answers[:3] == packets(status(f"81 {stream} 00 00"), status(f"81 {stream} 01 00", "00 0b", "00 21"), DELETED)
    assert answers[3:] == (packets(acknack(1)) if stream == "80" else [])
    assert agent.agent.clients() == []


def test_case_36_unknown_submessage_is_skipped_by_its_length(agent: AgentRig) -> None:
    # The genuine agent drops the rest of the message.
    agent.log_in()
    assert agent.say("81 01 00 00 20 01 00 00" + participant("")) == packets(status("81 01 00 00"))
    assert agent.say("81 01 01 00 20 01 05 00 01 02 03 04 05 00 00 00" + participant("", flags="03")) == packets(
        status("81 01 01 00", code="01")
    )
    # So is one that only an agent sends.
    assert agent.say("81 01 02 00 05 01 06 00 00 0a 00 11 00 00 00 00" + participant("", object_id="00 21")) == packets(
        status("81 01 02 00", "00 0a", "00 21")
    )
