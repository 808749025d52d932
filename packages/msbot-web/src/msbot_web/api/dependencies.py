"""What calls of the API take: who is signed in, and names in the path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from fastapi import Depends, Path, Request

from msbot.operations.rights import Right
from msbot_agent.text.sentence import said, without
from msbot_web.access.accounts import SignedOut
from msbot_web.access.sessions import Session
from msbot_web.api.uid_redactor import UidRedactor, without_uids
from msbot_web.models.robot_models import ChangeResult, EditLine, JournalLine, PartLine, Robot, SlotCard, TimelineLane

if TYPE_CHECKING:
    from msbot_web.service import Service

PRIVATE = frozenset({"address", "addresses"})
"""Values of sentences that only teachers read."""
ELSEWHERE = said("an address that your teacher can see")
NEWCOMER = said("newcomer")
"""What a part is called that has not said its name."""

Name = Annotated[str, Path(max_length=254, description="Name of the slot or part")]


def session_of(request: Request) -> Session:
    """The session that the guard has found.

    Raises:
        SignedOut: there is none.
    """
    session = request.scope.get("state", {}).get("session")
    if not isinstance(session, Session):
        raise SignedOut(said("sign in first"))
    return session


def words_for(session: Session, text: str) -> str:
    """What the robot says, without addresses and UIDs of parts, unless a teacher asks: who knows them can pretend."""
    return text if session.may(Right.ARRANGE) else public_words(text)


def public_words(text: str) -> str:
    """What the robot says, without addresses and UIDs of parts."""
    return without_uids(without(text, PRIVATE, ELSEWHERE))


def octets_for(session: Session, service: Service, robot: Robot | None = None) -> UidRedactor:
    """What is left out of frames for somebody: what tells parts apart, of the robot now and of one of the past."""
    if session.may(Right.ARRANGE):
        return UidRedactor(())
    slots = () if robot is None else robot.slots
    parts = (*service.views.parts(), *(card.part for card in slots if card.part is not None))
    return UidRedactor({part.uid for part in parts})


def done_for(session: Session, done: ChangeResult) -> ChangeResult:
    """What was done, in words for whoever asked for it."""
    return done.model_copy(update={"words": words_for(session, done.words)})


def edits_for(session: Session, lines: Sequence[EditLine]) -> list[EditLine]:
    """The same for what people have changed."""
    return [line.model_copy(update={"words": words_for(session, line.words)}) for line in lines]


def parts_for(session: Session, parts: Sequence[PartLine]) -> list[PartLine]:
    """The parts without what lets somebody pretend to be one of them, unless a teacher asks."""
    if session.may(Right.ARRANGE):
        return list(parts)
    return [
        part.model_copy(
            update={
                "part": NEWCOMER if part.part == part.address else part.part,
                "client_key": "",
                "uid": "",
                "address": "",
                "duplicates": [],
                "reason": words_for(session, part.reason),
            }
        )
        for part in parts
    ]


def journal_for(session: Session, lines: Sequence[JournalLine]) -> list[JournalLine]:
    """The same for lines of the journal."""
    return [
        line.model_copy(
            update={
                "reason": words_for(session, line.reason),
                "evidence": [(words_for(session, rule), words_for(session, fact)) for rule, fact in line.evidence],
            }
        )
        for line in lines
    ]


def lanes_for(session: Session, lanes: Sequence[TimelineLane]) -> list[TimelineLane]:
    """The same for the timeline."""
    return [
        lane.model_copy(
            update={
                "spans": [span.model_copy(update={"reason": words_for(session, span.reason)}) for span in lane.spans]
            }
        )
        for lane in lanes
    ]


def slots_for(session: Session, slots: Sequence[SlotCard]) -> list[SlotCard]:
    """The same for slots with their parts."""
    if session.may(Right.ARRANGE):
        return list(slots)
    return [
        card.model_copy(
            update={
                "reason": words_for(session, card.reason),
                "part": None if card.part is None else parts_for(session, [card.part])[0],
            }
        )
        for card in slots
    ]


SignedIn = Annotated[Session, Depends(session_of)]
