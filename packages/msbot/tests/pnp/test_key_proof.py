"""Key mode: who is asked, what an answer is worth, and what the journal says (design PNP 2, R86)."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.part_keys import prove
from msbot.pnp import Claim, PartState, Refusal
from msbot.pnp.key_proof import GOOD_FOR_S, MOST_PROOFS, UNANSWERED_S, Keys
from msbot.pnp.requests import RequestHandler
from msbot_xrce.errors import RegistryError
from tests.effort import tries
from tests.pnp.robot import Rig, sample_store, uid

KEY, OTHER_KEY = bytes(range(16)), bytes(16)
SESSION = 0xAAAAAAAA


class Counter:
    """A robot with keys; the part with UID 1 has one."""

    def __init__(self, *, explain: bool = False) -> None:
        self.rig = Rig(sample_store())
        self.rig.store.keys[uid(1)] = KEY
        self.rig.join(SESSION)
        self.requests = RequestHandler(self.rig.inventory, explain=explain, keys=Keys(self.rig.store, Random(5)))

    def claim(self, number: str = "ABCD", serial: int = 1, key: int = SESSION, asker: bytes = b"") -> bytes | None:
        message = pnp_messages.ClaimMessage(part_number=number, local_name="eye", uid=uid(serial), session_nonce=7)
        return self.requests.compact(message.encode(), key, self.rig.now, asker or key.to_bytes(16, "big"))

    def question(self, number: str = "ABCD", serial: int = 1, key: int = SESSION, asker: bytes = b"") -> bytes:
        answer = self.claim(number, serial, key, asker)
        assert answer is not None
        return pnp_messages.Challenge.decode(answer).nonce

    def show(self, proof: bytes, key: int = SESSION, asker: bytes = b"") -> bytes | None:
        message = pnp_messages.Proof(proof=proof)
        return self.requests.compact(message.encode(), key, self.rig.now, asker or key.to_bytes(16, "big"))

    def join(self) -> bytes:
        """Let the part in; returns its proof."""
        proof = answer_to(self.question())
        assert self.show(proof) is not None
        return proof

    @property
    def last(self) -> str:
        return self.rig.events[-1].reason

    def why(self, part: str = "eye") -> str:
        return "\n".join(self.rig.inventory.why(part, self.rig.now))


def answer_to(
    nonce: bytes, *, key: bytes = KEY, session: int = SESSION, serial: int = 1, number: str = "ABCD"
) -> bytes:
    return prove(key, nonce, uid(serial), part_number=number, local_name="eye", session_key=session)


def test_a_part_that_proves_its_key_is_let_in() -> None:
    counter = Counter()
    nonce = counter.question()
    assert len(nonce) == 16
    assert counter.rig.state(SESSION) is PartState.NEW
    verdict = counter.show(answer_to(nonce))
    assert verdict is not None
    assert pnp_messages.VerdictMessage.decode(verdict).lease
    part = counter.rig.part(SESSION)
    assert (part.state, part.slot, part.local_name, part.uid) == (PartState.ACTIVE, "AA", "eye", uid(1))


def test_every_question_is_new_but_a_repeated_claim_gets_the_same_one() -> None:
    counter = Counter()
    first = counter.question()
    assert counter.question() == first
    counter.rig.now += GOOD_FOR_S + 0.1
    second = counter.question()
    assert second != first
    counter.show(answer_to(second, key=OTHER_KEY))
    assert counter.question() not in (first, second)
    assert counter.question("EFGH") not in (first, second)


@pytest.mark.parametrize("explain", [False, True])
def test_a_wrong_key_is_refused_and_journalled(explain: bool) -> None:
    counter = Counter(explain=explain)
    answer = counter.show(answer_to(counter.question(), key=OTHER_KEY))
    if explain:
        assert answer is not None
        assert pnp_messages.VerdictMessage.decode(answer).reason == Refusal.WRONG_KEY
    else:
        assert answer is None
    assert counter.rig.state(SESSION) is PartState.REFUSED
    assert Refusal.WRONG_KEY.describe in counter.why()
    assert counter.rig.store.events[-1].reason == f"{Refusal.WRONG_KEY.describe} (the proof does not fit the question)"


def test_the_right_key_after_a_wrong_one_is_let_in() -> None:
    counter = Counter()
    counter.show(answer_to(counter.question(), key=OTHER_KEY))
    counter.join()
    assert counter.rig.state(SESSION) is PartState.ACTIVE


@pytest.mark.parametrize(
    "change",
    [{"session": 1}, {"serial": 2}, {"number": "EFGH"}],
    ids=["another session", "another UID", "another part"],
)
def test_a_proof_that_was_made_for_something_else_is_worth_nothing(change: dict[str, object]) -> None:
    counter = Counter()
    nonce = counter.question()
    assert counter.show(answer_to(nonce, **change)) is None  # type: ignore[arg-type]
    assert counter.rig.state(SESSION) is PartState.REFUSED


def test_a_recorded_proof_is_refused_as_replayed_in_another_session() -> None:
    counter = Counter()
    recorded = counter.join()
    thief = 0xBBBBBBBB
    counter.rig.join(thief)
    counter.question(key=thief)
    assert counter.show(recorded, thief) is None
    assert counter.rig.state(thief) is PartState.REFUSED
    assert counter.last == f"{Refusal.REPLAYED.describe} (it was good once, for another question)"
    assert counter.rig.state(SESSION) is PartState.ACTIVE
    assert counter.rig.part(SESSION).slot == "AA"


def test_a_proof_without_a_question_is_refused_as_replayed() -> None:
    counter = Counter()
    assert counter.show(bytes(16)) is None
    assert counter.rig.state(SESSION) is PartState.REFUSED
    assert counter.last == f"{Refusal.REPLAYED.describe} (nothing was asked)"


def test_a_proof_that_comes_too_late_is_refused() -> None:
    counter = Counter()
    nonce = counter.question()
    counter.rig.now += GOOD_FOR_S + 0.5
    assert counter.show(answer_to(nonce)) is None
    assert counter.last == f"{Refusal.REPLAYED.describe} (it was asked 10.5 s ago)"


def test_a_proof_that_is_repeated_gets_the_same_lease_and_disturbs_nobody() -> None:
    counter = Counter()
    nonce = counter.question()
    first, again = counter.show(answer_to(nonce)), counter.show(answer_to(nonce))
    assert first == again
    assert counter.rig.changes(SESSION)[-1] == "active"


def test_a_proof_that_is_repeated_does_not_move_a_part_that_stands_by() -> None:
    counter = Counter()
    counter.join()
    second = 0xBBBBBBBB
    counter.rig.store.keys[uid(2)] = KEY
    counter.rig.join(second)
    proof = answer_to(counter.question(serial=2, key=second), serial=2, session=second)
    counter.show(proof, second)
    assert counter.rig.state(second) is PartState.STANDBY
    events = len(counter.rig.events)
    assert counter.show(proof, second) is None
    assert counter.rig.state(second) is PartState.STANDBY
    assert len(counter.rig.events) == events


def test_a_late_copy_of_an_old_proof_does_not_end_the_question_that_is_open() -> None:
    """The way is so slow that a part claims twice and proves twice: the second claim must not lead nowhere."""
    counter = Counter()
    old = counter.join()
    nonce = counter.question()
    counter.show(old)
    assert counter.show(answer_to(nonce)) is not None
    assert counter.rig.changes(SESSION)[-1] == "active"


def test_a_session_that_was_opened_anew_cannot_use_the_proof_of_the_one_before() -> None:
    counter = Counter()
    recorded = counter.join()
    counter.rig.join(SESSION)
    assert counter.show(recorded, asker=b"a later session.") is None
    assert counter.show(recorded) is None
    assert counter.rig.part(SESSION).state is not PartState.ACTIVE


def test_a_question_that_is_open_cannot_be_answered_by_a_later_session() -> None:
    counter = Counter()
    nonce = counter.question()
    counter.rig.join(SESSION)
    assert counter.show(answer_to(nonce), asker=b"a later session.") is None
    assert counter.rig.state(SESSION) is PartState.REFUSED


def test_replays_against_a_part_that_is_in_are_noted_and_it_stays_in() -> None:
    counter = Counter()
    counter.join()
    for _ in range(3):
        assert counter.show(bytes(16)) is None
    notes = [event for event in counter.rig.events if Refusal.REPLAYED.describe in event.reason]
    assert [(event.from_state, event.to_state) for event in notes] == [(PartState.ACTIVE, PartState.ACTIVE)]
    assert counter.rig.part(SESSION).slot == "AA"
    assert Refusal.REPLAYED.describe in counter.why()


def test_a_part_without_a_key_on_file_is_refused_without_a_question() -> None:
    counter = Counter()
    assert counter.claim(serial=2) is None
    assert counter.rig.state(SESSION) is PartState.REFUSED
    assert counter.last.startswith(f"{Refusal.NO_KEY.describe} (none is on file for UID 0000000000000002")
    counter.rig.join(5)
    assert counter.claim(serial=0, key=5) is None
    assert counter.last == f"{Refusal.NO_KEY.describe} (the part has no UID, so it can have no key)"


def test_the_claim_of_open_mode_is_a_downgrade_and_refused_after_a_while() -> None:
    counter = Counter()
    counter.question()
    counter.rig.now += UNANSWERED_S
    counter.question()
    assert counter.rig.state(SESSION) is PartState.REFUSED
    assert counter.last == f"{Refusal.KEY_NEEDED.describe} (asked 5.0 s ago, it claims again and proves nothing)"
    before = len(counter.rig.events)
    counter.question()
    assert len(counter.rig.events) == before
    counter.join()
    assert counter.rig.state(SESSION) is PartState.ACTIVE


def test_the_programs_of_the_thesis_are_refused_in_a_robot_with_keys() -> None:
    counter = Counter()
    assert counter.requests.compat(thesis_messages.encode_request("ABCD", "eye"), SESSION, counter.rig.now) is None
    assert counter.rig.state(SESSION) is PartState.REFUSED
    assert counter.last == f"{Refusal.KEY_NEEDED.describe} (the programs of the thesis know no keys)"


def test_nobody_is_pushed_out_by_a_claim_that_is_not_proved() -> None:
    counter = Counter()
    counter.join()
    thief = 0xBBBBBBBB
    counter.rig.join(thief)
    counter.question(key=thief)
    counter.show(bytes(16), thief)
    counter.rig.now += 10.0
    counter.question(key=thief)
    assert counter.rig.part(SESSION).slot == "AA"
    assert counter.rig.part(SESSION).state is PartState.ACTIVE
    # The same through the part's own session, opened anew by somebody else: the slot is kept until its life ends.
    counter.rig.join(SESSION)
    counter.claim(serial=2)
    counter.show(bytes(16))
    assert counter.rig.part(SESSION).slot == "AA"


def test_a_proved_claim_still_has_to_match() -> None:
    counter = Counter(explain=True)
    answer = counter.show(answer_to(counter.question("NOPE"), number="NOPE"))
    assert answer is not None
    assert pnp_messages.VerdictMessage.decode(answer).reason == Refusal.UNKNOWN_PART


def test_a_registry_that_cannot_be_read_or_a_key_that_is_removed_lets_nobody_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(_uid: bytes) -> bytes:
        raise RegistryError("the disk is gone")

    counter = Counter()
    nonce = counter.question()
    del counter.rig.store.keys[uid(1)]
    assert counter.show(answer_to(nonce)) is None
    assert counter.last.startswith(Refusal.NO_KEY.describe)
    counter.rig.store.keys[uid(1)] = KEY
    nonce = counter.question()
    monkeypatch.setattr(counter.rig.store, "key_of", broken)
    assert counter.show(answer_to(nonce)) is None
    assert counter.last == f"{Refusal.NOT_READY.describe} (the disk is gone)"
    assert counter.claim() is None
    assert counter.rig.state(SESSION) is PartState.REFUSED


def test_an_open_robot_takes_no_proofs() -> None:
    counter = Counter()
    handler = RequestHandler(counter.rig.inventory)
    assert handler.compact(pnp_messages.Proof(proof=bytes(16)).encode(), SESSION, counter.rig.now) is None
    assert handler.dropped == {"request: a proof that nobody asked for": 1}


def test_what_is_remembered_is_bounded() -> None:
    rig = Rig(sample_store())
    rig.store.keys[uid(1)] = KEY
    keys = Keys(rig.store, Random(1))
    claim = Claim("ABCD", "eye", uid(1))
    for number in range(MOST_PROOFS + 10):
        asker = number.to_bytes(16, "big")
        asked = keys.ask(claim, asker, 0.0)
        assert asked.nonce is not None
        keys.ask(claim, b"idle" + asker, 0.0)
        assert keys.answer(answer_to(asked.nonce), asker, SESSION, 0.0).refused is None
    assert len(keys._proofs) == MOST_PROOFS
    assert len(keys._questions) <= 4096


@given(
    st.lists(st.tuples(st.sampled_from(["claim", "proof", "wrong", "old", "leave"]), st.integers(0, 2)), max_size=40)
)
@settings(max_examples=tries(100, 2000), deadline=None)
def test_whatever_is_said_in_whatever_order_only_who_proved_it_holds_a_slot(steps: list[tuple[str, int]]) -> None:
    counter = Counter()
    counter.rig.store.keys[uid(2)] = OTHER_KEY
    nonces: dict[int, bytes] = {}
    old: list[bytes] = []
    proved: set[int] = set()
    for step, place in steps:
        session = 0xA0 + place
        if step == "leave":
            counter.rig.join(session)
            nonces.pop(place, None)
            proved.discard(session)
        elif step == "claim":
            if session not in counter.rig._open:
                counter.rig.join(session)
            answer = counter.claim(serial=1, key=session)
            if answer is not None and len(answer) == 16:
                nonces[place] = pnp_messages.Challenge.decode(answer).nonce
        elif place in nonces:
            nonce = nonces.pop(place)
            proof = (
                answer_to(nonce, session=session)
                if step == "proof"
                else old[-1]
                if old and step == "old"
                else bytes(16)
            )
            counter.show(proof, session)
            if step == "proof":
                old.append(proof)
                proved.add(session)
        holders = {part.client_key for part in counter.rig.inventory.view(counter.rig.now) if part.state.is_registered}
        assert holders <= proved
        counter.rig.now += 0.3


@pytest.mark.parametrize("late", [0.0, 0.125])
def test_a_question_is_good_up_to_its_last_moment(late: float) -> None:
    counter = Counter()
    counter.rig.store.events.clear()
    nonce = counter.question()
    counter.rig.now += GOOD_FOR_S + late
    assert (counter.question() == nonce) is not bool(late), "the same one as long as it is good"
    counter = Counter()
    nonce = counter.question()
    counter.rig.now += GOOD_FOR_S + late
    assert (counter.show(answer_to(nonce)) is None) is bool(late)
    if late:
        assert f"it was asked {GOOD_FOR_S + late:.1f} s ago" in counter.last


def test_a_proof_that_was_good_once_is_told_from_one_that_nobody_asked_for() -> None:
    counter = Counter()
    proof = counter.join()
    asker = SESSION.to_bytes(16, "big")
    keys = counter.requests._keys
    assert keys is not None
    again = keys.answer(proof, asker, SESSION, counter.rig.now)
    assert (again.claim, again.is_repeated) == (None, True)
    assert again.refused is not None
    assert "nothing was asked" in again.refused.reason
    counter.question()
    again = keys.answer(proof, asker, SESSION, counter.rig.now)
    assert again.claim is not None
    assert again.claim.local_name == "eye"
    assert again.refused is not None
    assert "it was good once, for another question" in again.refused.reason


def test_a_part_that_claims_and_proves_nothing_is_complained_of_once_for_each_question() -> None:
    counter = Counter()
    keys = counter.requests._keys
    assert keys is not None
    claim = Claim("ABCD", "eye", uid(1), 7)
    complaints: list[str | None] = []
    nonces: set[bytes | None] = set()
    for at in (0.0, UNANSWERED_S, UNANSWERED_S + 0.5, UNANSWERED_S + 1.0):
        asked = keys.ask(claim, b"asker", at)
        complaints.append(None if asked.refused is None else asked.refused.reason)
        nonces.add(asked.nonce)
    assert len(nonces) == 1
    assert [words is not None for words in complaints] == [False, True, False, False]
    assert f"asked {UNANSWERED_S:.1f} s ago, it claims again and proves nothing" in str(complaints[1])
