"""What pupils hand in of lessons, for programs: pupils reach their own, teachers all."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Response
from pydantic import Field

from msbot.registry.hand_ins import HandIn
from msbot_agent.text.sentence import said
from msbot_web.api.dependencies import SignedIn
from msbot_web.hand_ins import MOST_NOTE
from msbot_web.models.robot_models import ChangeResult, Model
from msbot_web.service import Service

Number = Annotated[int, Path(ge=1, le=2**53, description="Number of the hand-in")]


class HandInLine(Model):
    """Something that was handed in."""

    number: int
    person: str
    lesson: str
    at_ms: int
    """When, milliseconds since 1970."""
    from_ms: int
    """When the person began: the recording from there belongs to it."""
    program: str
    """Name of the program; empty: none."""
    note: str
    answers: dict[str, str]
    """The last answer to each question, by its check."""
    recording_octets: int
    """How large the copy of the robot's recording is; 0: there is none."""
    returned_ms: int
    """0: not returned yet."""
    returned_by: str
    comment: str


class HandInText(HandInLine):
    """The same with the program."""

    text: str


class HandInWish(Model):
    """What is handed in."""

    program: str = Field(default="", max_length=60)
    """Name of an own program; empty: none."""
    note: str = Field(default="", max_length=MOST_NOTE)


class Comment(Model):
    """What a teacher says of it."""

    comment: str = Field(default="", max_length=MOST_NOTE)


def add_hand_ins(router: APIRouter, service: Service) -> None:
    """Add the calls."""
    hand_ins = service.hand_ins

    @router.get("/lesson/hand_ins")
    async def listed(session: SignedIn) -> list[HandInLine]:
        """What was handed in, what was not returned yet first: one's own; for teachers everybody's."""
        return [HandInLine.model_construct(**_line(one)) for one in await hand_ins.listed(session)]

    @router.get("/lesson/hand_ins/{number}")
    async def opened(session: SignedIn, number: Number) -> HandInText:
        """One of them with its program."""
        found = await hand_ins.opened(session, number)
        return HandInText.model_construct(**_line(found), text=found.text)

    @router.get("/lesson/hand_ins/{number}/recording", response_class=Response)
    async def recording(session: SignedIn, number: Number) -> Response:
        """The copy of the robot's recording that belongs to it, an MCAP file; for teachers."""
        octets = await hand_ins.recording(session, number)
        name = f'attachment; filename="hand-in-{number}.mcap"'
        return Response(octets, media_type="application/octet-stream", headers={"content-disposition": name})

    @router.post("/lesson/hand_ins")
    async def hand_in(session: SignedIn, wish: HandInWish) -> ChangeResult:
        """Hand in what one has of the lesson that runs: a program, and the answers."""
        number = await hand_ins.hand_in(session, wish.program, wish.note)
        return ChangeResult(words=said("handed in, number {number}", number=number))

    @router.post("/lesson/hand_ins/{number}/return")
    async def give_back(session: SignedIn, number: Number, wish: Comment) -> ChangeResult:
        """Return one with a comment."""
        found = await hand_ins.give_back(session, number, wish.comment)
        return ChangeResult(words=said("returned to {person}", person=found.person))


def _line(one: HandIn) -> dict[str, Any]:
    return {
        "number": one.number,
        "person": one.person,
        "lesson": one.lesson,
        "at_ms": one.at_ns // 1_000_000,
        "from_ms": one.from_ns // 1_000_000,
        "program": one.program,
        "note": one.note,
        "answers": dict(one.answers or {}),
        "recording_octets": one.recording_octets,
        "returned_ms": one.returned_ns // 1_000_000,
        "returned_by": one.returned_by,
        "comment": one.comment,
    }
