"""Seals of samples: what they are, and that nothing but the next good one opens (issue 11, point 17)."""

from __future__ import annotations

import hashlib
import hmac
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.join import pnp_messages
from msbot.part.join.part_keys import prove, prove_sealed
from msbot.part.join.part_seals import PartSeals
from msbot.part.join.seal import OLD_COUNTER, SEAL_OCTETS, TOO_SHORT, WRONG_TAG, Seal
from tests import ROOT

SECRET = bytes(range(32))
WRITER, OTHER = 0x0015, 0x0025
samples = st.binary(max_size=40)


def ends(secret: bytes = SECRET) -> tuple[Seal, Seal]:
    """The part's and the master's."""
    return Seal(secret, is_part=True), Seal(secret, is_part=False)


def test_a_seal_is_a_counter_and_six_octets_of_an_hmac() -> None:
    part, _ = ends()
    up = hmac.new(SECRET, b"MsBOT from the part\0", hashlib.sha256).digest()
    for number, sample in ((1, b"one"), (2, b"")):
        counter = number.to_bytes(4, "little")
        tag = hmac.new(up, b"\x00\x15" + counter + sample, hashlib.sha256).digest()[:6]
        assert part.seal(WRITER, sample) == sample + counter + tag


@given(st.lists(st.tuples(st.sampled_from([0, 1, WRITER, OTHER]), samples), max_size=20), st.booleans())
def test_what_one_end_seals_the_other_opens(said: list[tuple[int, bytes]], upwards: bool) -> None:
    part, master = ends()
    sender, receiver = (part, master) if upwards else (master, part)
    assert [receiver.open(channel, sender.seal(channel, sample)) for channel, sample in said] == [s for _, s in said]
    assert receiver.refused == 0


@given(samples, st.data())
def test_a_flipped_bit_is_refused_and_changes_nothing(sample: bytes, data: st.DataObject) -> None:
    part, master = ends()
    sealed = part.seal(WRITER, sample)
    bit = data.draw(st.integers(0, 8 * len(sealed) - 1))
    spoiled = bytearray(sealed)
    spoiled[bit // 8] ^= 1 << bit % 8
    assert master.open(WRITER, bytes(spoiled)) is None
    assert (master.refused, master.reason) == (1, WRONG_TAG)
    assert master.open(WRITER, sealed) == sample


@given(st.lists(samples, min_size=1, max_size=8), st.data())
def test_in_whatever_order_and_however_often_each_is_taken_at_most_once_and_none_after_a_newer(
    said: list[bytes], data: st.DataObject
) -> None:
    part, master = ends()
    sealed = [part.seal(WRITER, sample) for sample in said]
    arriving = data.draw(st.lists(st.integers(0, len(said) - 1), max_size=24))
    newest = -1
    for number in arriving:
        opened = master.open(WRITER, sealed[number])
        assert opened == (said[number] if number > newest else None)
        newest = max(newest, number)
    assert master.refused == len(arriving) - len(
        {n for i, n in enumerate(arriving) if n > max(arriving[:i], default=-1)}
    )


@given(samples)
def test_it_opens_nowhere_else(sample: bytes) -> None:
    part, master = ends()
    stranger, elsewhere = ends(bytes(32))
    sealed = part.seal(WRITER, sample)
    assert master.open(OTHER, sealed) is None
    assert part.open(WRITER, sealed) is None
    assert elsewhere.open(WRITER, sealed) is None
    assert master.open(WRITER, stranger.seal(WRITER, sample)) is None
    assert (master.refused, part.refused, elsewhere.refused) == (2, 1, 1)
    assert master.open(WRITER, sealed) == sample


@given(st.binary(max_size=60))
def test_invented_octets_are_refused(octets: bytes) -> None:
    _, master = ends()
    assert master.open(WRITER, octets) is None
    assert master.reason == (TOO_SHORT if len(octets) < SEAL_OCTETS else WRONG_TAG)


def test_a_repeated_one_is_called_so() -> None:
    part, master = ends()
    sealed = part.seal(WRITER, b"on")
    assert (master.open(WRITER, sealed), master.open(WRITER, sealed)) == (b"on", None)
    assert master.reason == OLD_COUNTER


def test_proof_and_secret_have_nothing_in_common_with_each_other_or_with_the_plain_proof() -> None:
    who = {"part_number": "ABCD", "local_name": "eye", "session_key": 7}
    proof, secret = prove_sealed(bytes(16), bytes(16), bytes(8), **who, session_nonce=9)  # type: ignore[arg-type]
    plain = prove(bytes(16), bytes(16), bytes(8), **who)  # type: ignore[arg-type]
    assert (len(proof), len(secret)) == (24, 32)
    assert len({proof[:16], secret[:16], plain}) == 3
    assert (proof, secret) != prove_sealed(bytes(16), bytes(16), bytes(8), **who, session_nonce=10)  # type: ignore[arg-type]


def test_the_example_of_the_page_is_right() -> None:
    page = (ROOT / "docs/reference/messages.md").read_text()
    rows = dict(
        re.findall(r"^\| ([^|]+) \| `([^`]+)`", page.partition("### Seals")[2].partition("###")[0], re.MULTILINE)
    )
    claim = {"part_number": "ABCD", "local_name": "eye", "session_key": 0xAABBCCDD, "session_nonce": 7}
    key, nonce, part_uid = bytes(range(16)), bytes(range(16, 32)), bytes.fromhex("0011223344556677")
    proof, secret = prove_sealed(key, nonce, part_uid, **claim)  # type: ignore[arg-type]
    assert (proof.hex(), secret.hex()) == (rows["proof"], rows["secret"])
    part, master = ends(secret)
    assert (
        part.seal(0, pnp_messages.Beat(lease=0x01020304).encode()).hex() == rows["first beat with the lease `01020304`"]
    )
    answer = pnp_messages.BeatReply(configuration_version=1).encode()
    assert master.seal(0, answer).hex() == rows["first answer to it, version 1"]


# The part's own rules.

BEAT_REPLY = pnp_messages.BeatReply(configuration_version=1).encode()
REFUSAL = pnp_messages.VerdictMessage(lease=0, configuration_version=0, beat_period_ms=0, reason=9).encode()
LEASE = pnp_messages.VerdictMessage(lease=5, configuration_version=1, beat_period_ms=1000).encode()


def test_before_any_proof_all_is_as_it_was() -> None:
    seals = PartSeals()
    assert seals.open_reply(BEAT_REPLY) == BEAT_REPLY
    assert seals.seal(WRITER, b"x") == seals.open(WRITER, b"x") == b"x"
    assert seals.seal_request(b"beat") == b"beat"


def test_a_proof_counts_from_the_first_reply_that_it_opens() -> None:
    seals, master = PartSeals(), Seal(SECRET, is_part=False)
    seals.proved(SECRET)
    assert seals.open_reply(LEASE) is None
    assert seals.open_reply(REFUSAL) == REFUSAL
    assert seals.seal_request(b"beat") == b"beat"
    assert seals.open_reply(master.seal(0, LEASE)) == LEASE
    assert master.open(0, seals.seal_request(b"beat")) == b"beat"
    assert master.open(WRITER, seals.seal(WRITER, b"x")) == b"x"
    for spoofed in (LEASE, REFUSAL, BEAT_REPLY, bytes(16)):
        assert seals.open_reply(spoofed) is None
    assert seals.open(WRITER, b"anything at all") is None
    assert seals.refused == 6


def test_a_new_proof_in_the_same_session_takes_over_without_a_gap() -> None:
    seals, master, later = PartSeals(), Seal(SECRET, is_part=False), Seal(bytes(32), is_part=False)
    seals.proved(SECRET)
    assert seals.open_reply(master.seal(0, LEASE)) == LEASE
    seals.proved(bytes(32))
    assert seals.open_reply(master.seal(0, BEAT_REPLY)) == BEAT_REPLY
    assert seals.open_reply(later.seal(0, LEASE)) == LEASE
    assert seals.open_reply(master.seal(0, BEAT_REPLY)) is None


def test_an_invented_challenge_keeps_nobody_out_of_a_robot_without_seals() -> None:
    seals = PartSeals()
    seals.proved(SECRET)
    challenge = pnp_messages.Challenge(nonce=bytes(16)).encode()
    assert seals.open_reply(challenge) == challenge
    assert seals.open_reply(LEASE) == LEASE


@pytest.mark.parametrize("octets", [LEASE, BEAT_REPLY, bytes(16)])
def test_whoever_was_in_a_sealed_robot_joins_no_unsealed_one(octets: bytes) -> None:
    seals, master = PartSeals(), Seal(SECRET, is_part=False)
    seals.proved(SECRET)
    assert seals.open_reply(master.seal(0, LEASE)) == LEASE
    seals.session_lost()
    assert seals.open_reply(octets) is None
    challenge = pnp_messages.SealedChallenge(nonce=bytes(16)).encode()
    assert seals.open_reply(challenge) == challenge


def test_lengths_tell_what_is_sealed() -> None:
    sealed = [
        len(message.encode()) + SEAL_OCTETS
        for message in (
            pnp_messages.Beat(lease=1),
            pnp_messages.StoppedBeat(lease=1, number=1),
            pnp_messages.ConfigurationRequest(lease=1, have_version=1),
            pnp_messages.NatureMessage(lease=1, nature=1),
        )
    ]
    assert all(pnp_messages.is_sealed_request(octets) for octets in sealed)
    claim = pnp_messages.ClaimMessage(part_number="", local_name="", uid=bytes(8), session_nonce=1)
    assert len(claim.encode()) == pnp_messages.SHORTEST_CLAIM_OCTETS
    assert not pnp_messages.is_sealed_request(len(claim.encode()))
    assert not pnp_messages.is_sealed_request(len(pnp_messages.SealedProof(proof=bytes(24)).encode()))
    assert not pnp_messages.is_sealed_reply(len(pnp_messages.SealedChallenge(nonce=bytes(16)).encode()))
