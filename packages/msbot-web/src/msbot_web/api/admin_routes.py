"""The API for administrators: users, API tokens, backups."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import Response, StreamingResponse

from msbot.metrics.metrics_server import exposition
from msbot_agent.text.sentence import said
from msbot_web.api.dependencies import SignedIn
from msbot_web.models.common_models import PROBLEMS
from msbot_web.models.robot_models import ChangeResult, NewToken, NewUser, RelayTicket, TextBody, UserChange, UserLine
from msbot_web.sd_card import CardChange, CardState
from msbot_web.service import Service

UserName = Annotated[str, Path(max_length=64, description="Name of the user")]
Purpose = Annotated[str, Path(max_length=64, description="What the token is for")]


def make_admin_api(service: Service) -> APIRouter:
    """The calls of one robot that administrators need; users reach their own tokens and password, too."""
    router = APIRouter(prefix="/api", responses=PROBLEMS)

    @router.get("/users")
    async def users(session: SignedIn) -> list[UserLine]:
        """Everybody who may sign in."""
        return service.users(session)

    @router.post("/users")
    async def add_user(session: SignedIn, user: NewUser) -> ChangeResult:
        """Let a person sign in."""
        return await service.add_user(session, user.name, user.role, user.password)

    @router.patch("/users/{name}")
    async def change_user(session: SignedIn, name: UserName, change: UserChange) -> ChangeResult:
        """Give a user another role or password; one's own password only with the old one."""
        done = ChangeResult(words=said("nothing about {name} is to be changed", name=name))
        if change.role is not None:
            done = await service.change_role(session, name, change.role)
        if change.password is not None:
            done = await service.change_password(session, name, change.password, change.old_password)
        return done

    @router.delete("/users/{name}")
    async def remove_user(session: SignedIn, name: UserName) -> ChangeResult:
        """Remove a person, who can no longer sign in."""
        return await service.remove_user(session, name)

    @router.post("/users/{name}/tokens")
    async def new_token(session: SignedIn, name: UserName, purpose: TextBody) -> NewToken:
        """Make an API token; it is shown this once."""
        return NewToken(token=await service.new_token(session, name, purpose.words))

    @router.get("/tickets")
    async def tickets(session: SignedIn) -> list[RelayTicket]:
        """The tickets for relays and agents: one's own, and all for an administrator."""
        return service.tickets(session)

    @router.post("/users/{name}/tickets")
    async def new_ticket(session: SignedIn, name: UserName, purpose: TextBody) -> NewToken:
        """Make a ticket for the relay or agent of that name; it is shown this once."""
        return NewToken(token=await service.new_ticket(session, name, purpose.words))

    @router.delete("/users/{name}/tokens/{purpose}")
    async def remove_token(session: SignedIn, name: UserName, purpose: Purpose) -> ChangeResult:
        """Make an API token worthless."""
        return await service.remove_token(session, name, purpose)

    @router.get("/backup")
    async def backup(session: SignedIn) -> Response:
        """The whole database in one file."""
        made = await service.backup(session)
        return StreamingResponse(
            made.octets,
            media_type="application/octet-stream",
            headers={"content-disposition": 'attachment; filename="msbot-backup.db"', "content-length": str(made.size)},
        )

    @router.post("/restore")
    async def restore(session: SignedIn, request: Request) -> ChangeResult:
        """Go back to a backup: its octets are the body."""
        return await service.restore(session, request.stream())

    _add_card(router, service)
    return router


def _add_card(router: APIRouter, service: Service) -> None:
    """The calls of a Raspberry Pi that runs from a card of MsBOT."""

    @router.get("/card")
    async def card(session: SignedIn) -> CardState:
        """The card as it is."""
        return await service.card(session)

    @router.patch("/card")
    async def change_card(session: SignedIn, change: CardChange) -> ChangeResult:
        """Set the computer's name, its Wi-Fi, what is plugged onto its pins."""
        return await service.change_card(session, change)

    @router.post("/card/update")
    async def update_card(session: SignedIn, request: Request) -> ChangeResult:
        """Take in a version of MsBOT, whose Debian package is the body, for the next start."""
        return await service.update_card(session, request.stream())

    @router.post("/card/back")
    async def card_back(session: SignedIn) -> ChangeResult:
        """Go back to the former version with the next start."""
        return await service.card_back(session)

    @router.post("/card/restart")
    async def restart(session: SignedIn) -> ChangeResult:
        """Start the computer again."""
        return await service.restart_computer(session)


# `/metrics`: the robot's figures for Prometheus, for everybody who may see the robot.


def make_metrics(service: Service) -> APIRouter:
    """The one call."""
    router = APIRouter()

    @router.get("/metrics", include_in_schema=False)
    async def metrics(session: SignedIn) -> Response:
        """The figures: read here, in the robot's loop, and written down in a thread."""
        figures = service.figures(session)
        text, content_type = await asyncio.to_thread(exposition, lambda: figures)
        return Response(text, media_type=content_type)

    return router
