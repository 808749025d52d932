"""What calls of the API take: who is signed in, and names in the path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from fastapi import Depends, Path, Request

from msbot.operations.rights import Right
from msbot.runtime.sentence import said
from msbot.web.access.accounts import SignedOut
from msbot.web.access.sessions import Session
from msbot.web.api.models import PartLine, SlotCard

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


def parts_for(session: Session, parts: Sequence[PartLine]) -> list[PartLine]:
    """The parts without what lets somebody pretend to be one of them, unless a teacher asks."""
    if session.may(Right.ARRANGE):
        return list(parts)
    return [part.model_copy(update={"client_key": "", "address": "", "duplicates": []}) for part in parts]


def slots_for(session: Session, slots: Sequence[SlotCard]) -> list[SlotCard]:
    """The same for slots with their parts."""
    if session.may(Right.ARRANGE):
        return list(slots)
    return [
        card if card.part is None else card.model_copy(update={"part": parts_for(session, [card.part])[0]})
        for card in slots
    ]


SignedIn = Annotated[Session, Depends(session_of)]
