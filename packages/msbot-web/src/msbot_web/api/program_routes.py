"""The programs that people write on the page Program, for other editors: each person reaches their own."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query
from pydantic import Field

from msbot.registry import ProgramSource
from msbot_agent.text.sentence import said
from msbot_web.access.guest_tickets import MOST_GUESTS, TICKET_S
from msbot_web.api.dependencies import SignedIn
from msbot_web.models.robot_models import ChangeResult, Model
from msbot_web.programs.programs import MAX_BLOCKS, MAX_PROGRAM
from msbot_web.service import Service

FileName = Annotated[str, Path(max_length=60, description="File name of the program, such as `lamp.py`")]


class ProgramLine(Model):
    """One program of the person."""

    name: str
    shared: bool
    """Whether others may read it by its link."""
    changed_ms: int
    """When its newest version was kept, milliseconds since 1970."""


class ProgramVersionLine(Model):
    """A version that is kept."""

    number: int
    saved_ms: int
    size: int
    """Characters."""


class ProgramText(Model):
    """A program."""

    text: str = Field(max_length=MAX_PROGRAM)
    blocks: str = Field(default="", max_length=MAX_BLOCKS)
    """The blocks it was made of, as JSON; empty: none."""


class Shared(Model):
    """Where others open a copy."""

    path: str
    """Behind the page's address."""


class Invitation(Model):
    """A ticket by which devices join without an account."""

    path: str
    """Behind the page's address; for a QR code."""
    valid_s: float
    """Seconds that it can be used."""
    guests: int
    """Devices that it lets in."""


class Guests(Model):
    """For how many devices a ticket is."""

    guests: int = Field(default=1, ge=1, le=MOST_GUESTS)


def add_programs(router: APIRouter, service: Service) -> None:
    """Add the calls."""
    programs = service.programs

    @router.get("/programs")
    async def mine(session: SignedIn) -> list[ProgramLine]:
        """The person's programs, the one changed last first."""
        return [
            ProgramLine(name=one.name, shared=bool(one.share), changed_ms=one.changed_ns // 1_000_000)
            for one in await programs.mine(session)
        ]

    @router.get("/programs/{name}")
    async def text(
        session: SignedIn, name: FileName, version: Annotated[int | None, Query(ge=1, le=2**53)] = None
    ) -> ProgramText:
        """A program, or an earlier version of it; examples have names, too."""
        source = await programs.source(session, name, version)
        return ProgramText.model_construct(text=source.text, blocks=source.blocks)

    @router.get("/programs/{name}/versions")
    async def versions(session: SignedIn, name: FileName) -> list[ProgramVersionLine]:
        """The versions that are kept, the newest first."""
        return [
            ProgramVersionLine(number=one.number, saved_ms=one.saved_ns // 1_000_000, size=one.size)
            for one in await programs.versions(session, name)
        ]

    @router.put("/programs/{name}")
    async def keep(session: SignedIn, name: FileName, program: ProgramText) -> ChangeResult:
        """Keep a program, as a new version if it has changed."""
        number = await programs.store(session, name, ProgramSource(program.text, program.blocks))
        return ChangeResult(words=said("{name} is saved, version {number}.", name=name, number=number))

    @router.delete("/programs/{name}")
    async def remove(session: SignedIn, name: FileName) -> ChangeResult:
        """Remove a program with all its versions."""
        await programs.remove(session, name)
        return ChangeResult(words=said("{name} is removed.", name=name))

    @router.post("/programs/{name}/share")
    async def share(session: SignedIn, name: FileName) -> Shared:
        """Let everybody who can sign in open a copy; the link is the same each time."""
        return Shared(path=f"/program?shared={await programs.share(session, name)}")

    @router.post("/programs/{name}/invite")
    async def invite(session: SignedIn, name: FileName, wanted: Guests) -> Invitation:
        """Make a ticket by which devices run a copy without an account; more than one: teachers."""
        path, ticket = await programs.invite(session, name, wanted.guests)
        return Invitation(path=path, valid_s=TICKET_S, guests=ticket.left)
