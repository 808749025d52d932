"""Who is asked what it is, and whose answer is taken: after the proof, once, whatever the octets are."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.join import part_keys, pnp_messages
from msbot.pnp import Keys, Refusal, SelfDescription
from msbot.pnp.requests import RequestHandler
from msbot_xrce.errors import RemoteProtocolError
from tests.pnp.robot import Rig, sample_store, uid

KEY, OTHER = 0xAAAAAAAA, bytes(range(16))
SECRET = bytes(range(16, 32))
STRANGER = pnp_messages.ClaimMessage(part_number="NEW-1", local_name="eye", uid=uid(1), session_nonce=7)
WORDS = "number = 'NEW-1'".ljust(pnp_messages.LEAST_DESCRIPTION)


class Desk:
    """A rig with requests in front of it, and what checkers were handed."""

    def __init__(self, *, explain: bool = True, with_keys: bool = False) -> None:
        store = sample_store()
        store.keys[uid(1)] = SECRET
        self.rig = Rig(store)
        self.rig.join(KEY)
        self.requests = RequestHandler(
            self.rig.inventory, explain=explain, keys=Keys(store, Random(1)) if with_keys else None
        )
        self.handed: list[tuple[int, str, SelfDescription]] = []
        self.rig.inventory.descriptions.on_described(lambda *what: self.handed.append(what))

    def ask(self, request: pnp_messages.Request) -> pnp_messages.Reply | None:
        return self.requests.answer(request, KEY, self.rig.now, b"asker")

    def is_asked(self, request: pnp_messages.Request) -> bool:
        self.ask(request)
        return self.requests.asks_what(request, KEY)

    def says(self, text: str = WORDS) -> SelfDescription | None:
        octets = pnp_messages.DescriptionMessage(text=text).encode()
        assert self.requests.compact(octets, KEY, self.rig.now) is None
        return self.rig.part(KEY).says


def test_a_stranger_is_asked_three_times_and_its_first_answer_is_kept() -> None:
    desk = Desk()
    assert [desk.is_asked(STRANGER) for _ in range(5)] == [True, True, True, False, False]
    says = desk.says()
    assert says == SelfDescription(WORDS)
    assert desk.handed == [(KEY, "NEW-1", says)]
    desk.says("another".ljust(pnp_messages.LEAST_DESCRIPTION))
    assert desk.rig.part(KEY).says is says
    assert desk.rig.inventory.dropped == {"description that nobody asked for": 1}


def test_what_was_checked_counts_for_the_same_words_only() -> None:
    desk = Desk()
    desk.is_asked(STRANGER)
    says = desk.says()
    assert says is not None
    checked = SelfDescription(says.text, fault="no ports")
    desk.rig.inventory.descriptions.checked(KEY, SelfDescription("others"), checked, desk.rig.now)
    assert desk.rig.part(KEY).says is says
    desk.rig.inventory.descriptions.checked(KEY, says, checked, desk.rig.now)
    assert desk.rig.part(KEY).says is checked
    assert any("what it says of itself is refused: no ports" in line for line in desk.rig.inventory.why("eye", 0.0))
    desk.rig.join(KEY)  # another session: it may be another program
    desk.ask(STRANGER)
    assert desk.rig.part(KEY).says is None


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        (len(WORDS) * 40, "it is longer than 4096 bytes"),
        (b"\xff\xff" + bytes(600), "its bytes cannot be read: "),
        (b"\x1d\x02\0\0" + b"\xfe" * 540 + b"\0", "its bytes cannot be read: "),
        (b"number = 'NEW-1'\n" * 9, "its bytes cannot be read: "),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_reason_in_why(octets: int | bytes, words: str) -> None:
    desk = Desk()
    if isinstance(octets, int):
        octets = (octets + 1).to_bytes(4, "little") + b"x" * octets + b"\0"
    desk.requests.compact(octets, KEY, desk.rig.now)
    desk.is_asked(STRANGER)
    before = desk.rig.inventory.why("eye", 0.0)
    assert not any("refused: it" in line for line in before), "it was not asked then"
    for _ in range(2):  # said once
        assert desk.requests.compact(octets, KEY, desk.rig.now) is None
    refused = f"what it says of itself is refused: {words}"
    assert sum(refused in line for line in desk.rig.inventory.why("eye", 0.0)) == 1
    says = desk.says()
    assert says is not None
    assert says.fault.startswith(words), "and the part is not asked for another"
    assert not desk.is_asked(STRANGER)
    assert desk.handed == []


def test_a_part_of_a_known_number_or_another_refusal_is_not_asked() -> None:
    desk = Desk()
    known = pnp_messages.ClaimMessage(part_number="ABCD", local_name="", uid=uid(1), session_nonce=7)
    assert not desk.is_asked(known)
    assert desk.says() is None
    assert desk.handed == []


def test_a_silent_robot_asks_nobody() -> None:
    assert not Desk(explain=False).is_asked(STRANGER)


def test_with_keys_it_counts_only_after_the_proof() -> None:
    desk = Desk(explain=False, with_keys=True)
    challenge = desk.ask(STRANGER)
    assert isinstance(challenge, pnp_messages.Challenge)
    assert not desk.requests.asks_what(STRANGER, KEY)
    assert desk.says() is None
    wrong = part_keys.prove(OTHER, challenge.nonce, uid(1), part_number="NEW-1", local_name="eye", session_key=KEY)
    assert not desk.is_asked(pnp_messages.Proof(proof=wrong))
    assert desk.rig.part(KEY).refusal is Refusal.WRONG_KEY
    assert desk.says() is None
    challenge = desk.ask(STRANGER)
    assert isinstance(challenge, pnp_messages.Challenge)
    right = part_keys.prove(SECRET, challenge.nonce, uid(1), part_number="NEW-1", local_name="eye", session_key=KEY)
    assert desk.is_asked(pnp_messages.Proof(proof=right))
    assert desk.says() == SelfDescription(WORDS)


def test_a_part_that_claims_another_number_has_said_nothing() -> None:
    desk = Desk()
    desk.is_asked(STRANGER)
    assert desk.says() is not None
    desk.is_asked(pnp_messages.ClaimMessage(part_number="NEW-2", local_name="eye", uid=uid(1), session_nonce=7))
    assert desk.rig.part(KEY).says is None


def test_no_claim_is_as_long_as_a_description() -> None:
    text = "x" * pnp_messages.TEXT_OCTETS
    longest = pnp_messages.ClaimMessage(part_number=text, local_name=text, uid=uid(1), session_nonce=1).encode()
    assert len(longest) + 3 == pnp_messages.LONGEST_CLAIM_OCTETS
    shortest = pnp_messages.DescriptionMessage(text="x" * pnp_messages.LEAST_DESCRIPTION).encode()
    assert len(shortest) > pnp_messages.LONGEST_CLAIM_OCTETS
    assert isinstance(pnp_messages.decode_request(longest), pnp_messages.ClaimMessage)
    assert isinstance(pnp_messages.decode_request(shortest), pnp_messages.DescriptionMessage)


def test_a_description_that_is_too_large_is_counted() -> None:
    desk = Desk()
    desk.is_asked(STRANGER)
    octets = (5001).to_bytes(4, "little") + b"x" * 5000 + b"\0"
    assert desk.requests.compact(octets, KEY, desk.rig.now) is None
    assert any("4096" in reason for reason in desk.requests.dropped)


@given(st.binary(max_size=64).map(lambda octets: octets.ljust(600, b"\0")) | st.binary(min_size=530, max_size=5000))
def test_any_long_octets_are_a_description_or_refused(octets: bytes) -> None:
    try:
        request = pnp_messages.decode_request(octets)
    except RemoteProtocolError:
        return
    assert isinstance(request, pnp_messages.DescriptionMessage | pnp_messages.ClaimMessage)
    assert (
        not isinstance(request, pnp_messages.DescriptionMessage)
        or len(request.text.encode()) <= pnp_messages.MOST_DESCRIPTION
    )


@pytest.mark.parametrize("octets", [4, 5, 6, 8, 16, 24, 28, 535, 536, 4101])
def test_what_is_sealed_follows_from_the_length(octets: int) -> None:
    assert pnp_messages.is_sealed_request(octets) == (octets in (4, 5, 6, 8, 16) or octets >= 536)


def test_what_nobody_asked_for_is_counted_by_reason_and_noted_once() -> None:
    desk = Desk()
    inventory = desk.rig.inventory
    noted: list[str] = []
    inventory.on_event(lambda event: noted.append(event.reason) if event.from_state is event.to_state else None)
    no_claim, unasked = "description of a client that has not claimed", "description that nobody asked for"
    note = "it says what it is, and was not asked: the library's entry of its number counts"
    inventory.descriptions.receive_description(KEY + 1, WORDS, desk.rig.now)  # no session
    desk.says()  # nothing claimed
    assert (inventory.dropped, noted) == ({no_claim: 2}, [])
    inventory.profile_asked(KEY, desk.rig.now)
    desk.says()
    assert (inventory.dropped, noted) == ({no_claim: 3}, [])
    desk.ask(pnp_messages.ClaimMessage(part_number="ABCD", local_name="", uid=uid(1), session_nonce=7))
    for _ in range(3):
        desk.says()
    assert (inventory.dropped, noted) == ({no_claim: 3, unasked: 3}, [note])
    assert desk.handed == []


def test_a_stranger_that_was_not_asked_is_not_noted() -> None:
    desk = Desk()
    noted: list[str] = []
    desk.rig.inventory.on_event(
        lambda event: noted.append(event.reason) if event.from_state is event.to_state else None
    )
    desk.ask(STRANGER)
    desk.says()
    assert (desk.rig.inventory.dropped, noted) == ({"description that nobody asked for": 1}, [])


@pytest.mark.parametrize("more", [0, 1])
def test_what_is_refused_or_checked_is_announced_at_once(more: int) -> None:
    desk = Desk()
    announced: list[str] = []
    desk.rig.inventory.on_event(lambda event: announced.append(event.reason))
    desk.is_asked(STRANGER)
    announced.clear()
    desk.rig.inventory.descriptions.unreadable(KEY, pnp_messages.MOST_DESCRIPTION + more, "a fault", desk.rig.now)
    fault = "it is longer than 4096 bytes" if more else "its bytes cannot be read: a fault"
    assert announced == [f"what it says of itself is refused: {fault}"]
    says = desk.rig.part(KEY).says
    assert says == SelfDescription("", fault=fault)
    announced.clear()
    desk.rig.inventory.descriptions.checked(KEY, says, SelfDescription("", fault="another"), desk.rig.now)
    assert announced == ["what it says of itself is refused: another"]
