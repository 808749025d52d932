"""Key mode: every claim must prove the key of its UID before anything else is decided. Pure.

Theory of operation. A claim is answered with a question: a nonce drawn for it and never used again. It is bound to the
claimant (the GUID of the writer of its requests, which no later session has) and to its claim; a claim that is repeated
because an answer is slow gets the same question again. Any proof ends the question, good or bad. Good proofs are
remembered, so that a replayed one is recognised as such.

========================================  ===============================================
what comes                                what is decided
========================================  ===============================================
a claim of the thesis' own programs       `KEY_NEEDED`: they know no keys (downgrade)
a claim with a UID without a key          `NO_KEY`, and no question
a claim that keeps being repeated,        `KEY_NEEDED` (downgrade), and the question again
without a proof
a proof of the open question              the claim goes on to the rules of matching
a proof with another key                  `WRONG_KEY`
an old proof, or one without a question   `REPLAYED`
========================================  ===============================================
"""

from __future__ import annotations

from random import Random
from typing import TypeVar

from msbot.part.join import part_keys, pnp_messages
from msbot.part.join.refusal import Refusal
from msbot.pnp.model import Claim, PartStore
from msbot.pnp.part_events import Evidence, PartState
from msbot.pnp.slot_matching import NO_UID, Match
from msbot_agent.text.sentence import said
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

GOOD_FOR_S = 10.0
"""A question older than this can no longer be answered."""
UNANSWERED_S = 5.0
"""A part that still repeats its claim this long after the question does not know how to answer it."""
MOST_QUESTIONS = 4096
"""Most open questions; the oldest is dropped first."""
MOST_PROOFS = 4096
"""Most proofs that are remembered, to tell a repeated one from a wrong one."""


_V = TypeVar("_V")


@dataclass(slots=True)
class _Question:
    nonce: bytes
    claim: Claim
    asked_at: float
    complained: bool = False


@dataclass(frozen=True, slots=True)
class Asked:
    """The answer to a claim."""

    nonce: bytes | None
    """The question; None: nothing is asked, the claim is refused."""
    refused: Match | None = None
    """Why the claim is refused, or what to report about earlier ones."""


@dataclass(frozen=True, slots=True)
class Answered:
    """The result of checking a proof."""

    claim: Claim | None
    """What is claimed; None: unknown, there was no question."""
    refused: Match | None = None
    """Why the proof is not accepted; None: it is good."""
    secret: bytes = b""
    """The secret for the seals of samples, after a good proof in a robot with sealed samples."""
    is_repeated: bool = False
    """The same asker has shown this proof before, and it was good: the answer may have been lost."""


class Keys:
    """Asks the questions and checks the proofs of one robot.

    Args:
        store: knows the keys.
        random: source of the nonces; must be unguessable in a real robot.
        sealed: samples are sealed, so only proofs of parts that can seal are accepted.
    """

    def __init__(self, store: PartStore, random: Random, *, sealed: bool = False) -> None:
        self.sealed = sealed
        self._store = store
        self._random = random
        self._questions: dict[bytes, _Question] = {}
        """By asker, the oldest first."""
        self._proofs: dict[bytes, bytes] = {}
        """Good proofs -> who showed them, the oldest first."""

    def ask(self, claim: Claim, asker: bytes, now: float) -> Asked:
        """Answer a claim with a question, or refuse it at once."""
        if claim.layout == "compat":
            return _refused(claim, Refusal.KEY_NEEDED, said("the programs of the thesis know no keys"))
        if claim.uid in (b"", NO_UID):
            return _refused(claim, Refusal.NO_KEY, said("the part has no UID, so it can have no key"))
        try:
            key = self._store.key_of(claim.uid)
        except RegistryError as error:
            return _refused(claim, Refusal.NOT_READY, str(error))
        if key is None:
            words = said("none is on file for UID {uid}: `msbot key new` makes one", uid=claim.uid.hex())
            return _refused(claim, Refusal.NO_KEY, words)
        question = self._questions.get(asker)
        if question is None or question.claim != claim or now - question.asked_at > GOOD_FOR_S:
            complaint = self._unanswered(question, claim, now)
            return Asked(self._new_question(asker, claim, now), complaint)
        return Asked(question.nonce, self._unanswered(question, claim, now))

    def answer(self, proof: bytes, asker: bytes, session_key: int, now: float) -> Answered:
        """Check a proof; the question is over, whether the proof is good or not, unless it is an old one of this asker.

        On a slow way a part claims twice and so proves twice: the second copy must not end the question after it.

        Args:
            proof: 16 octets, or 24 where samples are sealed.
            asker: who shows it, as in `ask`.
            session_key: the client key of its session.
            now: the present time.
        """
        if self._proofs.get(proof) == asker:
            question = self._questions.get(asker)
            words = said("nothing was asked") if question is None else said("it was good once, for another question")
            claim = None if question is None else question.claim
            return Answered(claim, _match(Refusal.REPLAYED, words), is_repeated=True)
        question = self._questions.pop(asker, None)
        if question is None or now - question.asked_at > GOOD_FOR_S:
            claim = None if question is None else question.claim
            words = said("nothing was asked")
            if question is not None:
                words = said("it was asked {seconds:.1f} s ago", seconds=now - question.asked_at)
            return Answered(claim, _match(Refusal.REPLAYED, words))
        claim = question.claim
        try:
            key = self._store.key_of(claim.uid)
        except RegistryError as error:
            return Answered(claim, _match(Refusal.NOT_READY, str(error)))
        if key is None:
            return Answered(claim, _match(Refusal.NO_KEY, said("it was removed in this moment")))
        expected, secret = self._expected(key, question, session_key)
        if part_keys.is_same(proof, expected):
            _keep(self._proofs, proof, asker, MOST_PROOFS)
            return Answered(claim, secret=secret)
        if proof in self._proofs:
            return Answered(claim, _match(Refusal.REPLAYED, said("it was good once, for another question")))
        return Answered(claim, _match(Refusal.WRONG_KEY, said("the proof does not fit the question")))

    def _expected(self, key: bytes, question: _Question, session_key: int) -> tuple[bytes, bytes]:
        claim = question.claim
        names = {"part_number": claim.part_number, "local_name": claim.local_name}
        if self.sealed:
            return part_keys.prove_sealed(
                key, question.nonce, claim.uid, **names, session_key=session_key, session_nonce=claim.nonce
            )
        return part_keys.prove(key, question.nonce, claim.uid, **names, session_key=session_key), b""

    def _new_question(self, asker: bytes, claim: Claim, now: float) -> bytes:
        nonce = self._random.randbytes(pnp_messages.NONCE_OCTETS)
        self._questions.pop(asker, None)
        _keep(self._questions, asker, _Question(nonce, claim, now), MOST_QUESTIONS)
        return nonce

    def _unanswered(self, question: _Question | None, claim: Claim, now: float) -> Match | None:
        """What to report about a part that keeps claiming and does not answer; once for each question."""
        if question is None or question.claim != claim or question.complained:
            return None
        waited = now - question.asked_at
        if waited < UNANSWERED_S:
            return None
        question.complained = True
        words = said("asked {waited:.1f} s ago, it claims again and proves nothing", waited=waited)
        if self.sealed:
            sealed = said("this robot seals its samples (key+data), and the part may not know how")
            words = said("{words}; {sealed}", words=words, sealed=sealed)
        return _match(Refusal.KEY_NEEDED, words)


def _keep(table: dict[bytes, _V], key: bytes, value: _V, most: int) -> None:
    if len(table) >= most:
        del table[next(iter(table))]
    table[key] = value


def _match(refusal: Refusal, words: str) -> Match:
    return Match(
        PartState.REFUSED,
        said("{refusal} ({words})", refusal=said(refusal.describe), words=words),
        ((said("key"), words),),
        refusal=refusal,
    )


def _refused(claim: Claim, refusal: Refusal, words: str) -> Asked:
    match = _match(refusal, words)
    evidence: Evidence = (
        (
            said("claim"),
            said("part number {part_number}, layout {layout}", part_number=claim.part_number, layout=claim.layout),
        ),
        *match.evidence,
    )
    return Asked(None, Match(match.outcome, match.reason, evidence, refusal=refusal))
