"""Who listens to a robot with sealed samples reads what is said, and nothing that is not."""

from __future__ import annotations

import asyncio
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part import HelloWorld
from msbot.part.join import pnp_messages
from msbot.part.join.refusal import Refusal
from msbot.part.join.seal import SEAL_OCTETS, Seal
from msbot.pnp import SessionListener
from msbot.pnp.session_seals import AMBIGUOUS, ObservedSeals
from msbot_xrce.errors import RemoteProtocolError
from tests.pnp.test_sealed_robot import Story, tell

HELLO = HelloWorld(index=3, message="turn-on 2")
OF_A_PART = Seal(b"secret", is_part=True)
OF_THE_ROBOT = Seal(b"secret", is_part=False)


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize("heard", ["from the beginning", "from the middle"])
def test_every_sample_of_a_robot_is_read(sealed: bool, heard: str) -> None:
    async def story(scene: Story) -> None:
        wire, beginning = scene.wires[0], len(scene.wires[0].both)
        scene.robot.service.stop_all("ann", "", 0)
        await asyncio.sleep(2.5)
        scene.robot.service.go_all("ann")
        await asyncio.sleep(2.5)
        listener = SessionListener()
        lines: list[str] = []
        sentences: list[str] = []
        for place, (up, packet) in enumerate(wire.both):
            if heard == "from the middle" and place == beginning:
                lines.clear()
                _forget_how_it_began(listener)
            said = listener.explain_packet(packet, 1, up=up)
            sentences += said.plain
            lines += said.protocol
        text = "\n".join(lines)
        assert "makes no sense" not in text
        assert "StoppedBeat(lease=" in text
        assert ("seal " in text) is sealed
        values = [int(found) for found in re.findall(r"AA says out index (\d+), message AA", "\n".join(sentences))]
        assert values == list(range(values[0], values[-1] + 1))
        assert len(values) >= 10

    tell(story, sealed=sealed)


def _forget_how_it_began(listener: SessionListener) -> None:
    """As if nobody had heard the session's beginning; whose its topics are is known from elsewhere."""
    (session,) = listener._sessions.values()
    session._seals = ObservedSeals()


def test_what_could_be_two_messages_is_not_taken_for_either() -> None:
    beat = OF_A_PART.seal(0, pnp_messages.StoppedBeat(lease=7, number=1).encode())
    seals = ObservedSeals()
    with pytest.raises(RemoteProtocolError, match=AMBIGUOUS):
        seals.request(beat)
    seals.request(OF_A_PART.seal(0, pnp_messages.Beat(lease=7).encode()))
    assert seals.request(beat) == (pnp_messages.StoppedBeat(lease=7, number=1), 1)
    seals.begin()
    proof = pnp_messages.Proof(proof=bytes(16))
    assert seals.request(proof.encode()) == (proof, None)


def test_claims_challenges_proofs_and_refusals_have_no_seal() -> None:
    seals = ObservedSeals()
    seals.begin()
    refusal = pnp_messages.VerdictMessage(lease=0, reason=Refusal.NO_KEY, beat_period_ms=0, configuration_version=0)
    for reply in (pnp_messages.SealedChallenge(nonce=bytes(16)), refusal):
        assert seals.reply(reply.encode()) == (reply, None)
    proof = pnp_messages.SealedProof(proof=bytes(24))
    assert seals.request(proof.encode()) == (proof, None)
    notice = pnp_messages.BeatReply(configuration_version=2)
    assert seals.reply(OF_THE_ROBOT.seal(0, notice.encode())) == (notice, 1)


def test_what_makes_no_sense_with_and_without_a_seal_is_said_as_it_is() -> None:
    with pytest.raises(RemoteProtocolError, match="left over after HelloWorld"):
        ObservedSeals().sample(HELLO.encode() + bytes(SEAL_OCTETS + 8), HelloWorld.decode)


@given(st.lists(st.tuples(st.booleans(), st.binary(max_size=60)), max_size=8))
def test_whatever_is_heard_ends_in_a_message_or_in_no_sense(heard: list[tuple[bool, bytes]]) -> None:
    seals = ObservedSeals()
    for up, octets in heard:
        try:
            seals.request(octets) if up else seals.reply(octets)
            seals.sample(octets, HelloWorld.decode)
        except RemoteProtocolError:
            continue


def test_a_challenge_for_sealed_samples_tells_what_the_next_16_octets_are() -> None:
    beat = pnp_messages.StoppedBeat(lease=7, number=1)
    for challenge, is_sealed in (
        (pnp_messages.SealedChallenge(nonce=bytes(16)), True),
        (pnp_messages.Challenge(nonce=bytes(16)), False),
    ):
        seals = ObservedSeals()
        seals.begin()
        assert seals.reply(challenge.encode()) == (challenge, None)
        octets = OF_A_PART.seal(0, beat.encode())
        read, number = seals.request(octets)
        assert (read == beat, number is not None) == (is_sealed, is_sealed)


@pytest.mark.parametrize("octets", range(1, SEAL_OCTETS))
def test_what_is_shorter_than_a_seal_has_none(octets: int) -> None:
    seals = ObservedSeals()
    for read in (seals.request, seals.reply):
        try:
            _, number = read(bytes(octets))
        except RemoteProtocolError:
            continue
        assert number is None
    with pytest.raises(RemoteProtocolError):
        seals.request(bytes(9))
