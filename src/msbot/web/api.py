"""The JSON API: every page's twin, under `/api`, described by `/openapi.json` on the same port.

A browser shows its cookie, and for changes the CSRF word of `GET /api/me` in the header `X-CSRF-Token`. A program
shows an API token: `Authorization: Bearer msbot_...`. Who may do what is decided in `Service`.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import Response

from msbot.web.accounts import Session, SignedOut
from msbot.web.models import (
    BlueprintDiff,
    BlueprintText,
    BusState,
    Done,
    EditLine,
    FrameLine,
    Health,
    JournalLine,
    Lane,
    Me,
    PartLine,
    Problem,
    Robot,
    RobotTile,
    Simulated,
    SlotCard,
    TopicLine,
    TypeLine,
    Value,
    Wish,
    Words,
)
from msbot.web.service import Service

PROBLEMS: dict[int | str, dict[str, object]] = {
    400: {"model": Problem, "description": "It cannot be done; the sentence says why and what would be right."},
    401: {"model": Problem, "description": "Nobody is signed in."},
    403: {"model": Problem, "description": "The role does not allow it."},
    404: {"model": Problem, "description": "There is no such thing."},
    409: {"model": Problem, "description": "The database does not take it at the moment."},
    413: {"model": Problem, "description": "The body is too large."},
    422: {"model": Problem, "description": "The request does not fit the schema."},
}
"""What every call can answer besides its result."""

Name = Annotated[str, Path(max_length=254, description="Name of the slot or part")]


def session_of(request: Request) -> Session:
    """The session that the guard has found.

    Raises:
        SignedOut: there is none.
    """
    session = request.scope.get("state", {}).get("session")
    if not isinstance(session, Session):
        raise SignedOut("sign in first")
    return session


SignedIn = Annotated[Session, Depends(session_of)]


def make_api(service: Service) -> APIRouter:
    """All calls of the API for one robot."""
    router = APIRouter(prefix="/api", responses=PROBLEMS)
    _add_reads(router, service)
    _add_slots(router, service)
    _add_parts(router, service)
    _add_robot(router, service)
    return router


def _add_reads(router: APIRouter, service: Service) -> None:
    views = service.views

    @router.get("/health", responses={})
    async def health() -> Health:
        """Whether the server runs; needs no session."""
        return Health()

    @router.get("/me")
    async def me(session: SignedIn) -> Me:
        """Who is signed in, and the CSRF word."""
        return service.me(session)

    @router.get("/robot")
    async def robot(session: SignedIn) -> Robot:  # noqa: ARG001 - being signed in is the point
        """The robot with all its slots."""
        return service.robot()

    @router.get("/parts")
    async def parts(session: SignedIn) -> list[PartLine]:  # noqa: ARG001
        """All parts that are there or were there lately."""
        return views.parts()

    @router.get("/arrivals")
    async def arrivals(session: SignedIn) -> list[PartLine]:  # noqa: ARG001
        """Parts that wait for a slot, or were refused."""
        return views.arrivals()

    @router.get("/why/{part}")
    async def why(session: SignedIn, part: Name) -> list[str]:  # noqa: ARG001
        """In sentences: how a part stands and which rules led there."""
        return views.why(part)

    @router.get("/topics")
    async def topics(session: SignedIn) -> list[TopicLine]:  # noqa: ARG001
        """All bound topics with their latest values."""
        return views.topics()

    @router.get("/topics/{topic}/series")
    async def series(
        session: SignedIn,  # noqa: ARG001
        topic: Name,
        field: Annotated[str, Query(max_length=254)],
    ) -> list[tuple[float, float]]:
        """(seconds, value) of a numeric field, oldest first."""
        return views.live.series(topic, field)

    @router.get("/timeline")
    async def timeline(session: SignedIn) -> list[Lane]:  # noqa: ARG001
        """The states of every slot over time."""
        return views.timeline()

    @router.get("/journal")
    async def journal(
        session: SignedIn,  # noqa: ARG001
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
        part: Annotated[str | None, Query(max_length=254)] = None,
    ) -> list[JournalLine]:
        """The newest lines of the journal, newest first."""
        return service.journal(limit, part)

    @router.get("/bus")
    async def bus(session: SignedIn) -> BusState:  # noqa: ARG001
        """How busy the CAN bus is."""
        return views.bus()

    @router.get("/bus/frames")
    async def frames(
        session: SignedIn,  # noqa: ARG001
        after: Annotated[int, Query(ge=0, le=2**53)] = 0,
        limit: Annotated[int, Query(ge=1, le=1000)] = 200,
    ) -> list[FrameLine]:
        """The newest frames with a number above `after`, oldest first."""
        return views.frame_lines(after, limit)

    @router.get("/library")
    async def library(
        session: SignedIn,  # noqa: ARG001
        search: Annotated[str, Query(max_length=254)] = "",
    ) -> list[TypeLine]:
        """The part library."""
        return views.types(search)

    @router.get("/robots")
    async def robots(session: SignedIn) -> list[RobotTile]:  # noqa: ARG001
        """All robots of the database."""
        return service.robots()


def _add_slots(router: APIRouter, service: Service) -> None:
    @router.get("/slots/{slot}")
    async def slot(session: SignedIn, slot: Name) -> SlotCard:  # noqa: ARG001
        """One slot with its part and its values."""
        return service.views.slot(slot)

    @router.get("/slots/{slot}/values")
    async def values(session: SignedIn, slot: Name) -> list[Value]:  # noqa: ARG001
        """The parameters of a slot with origin, range and unit."""
        return service.values(slot)

    @router.put("/slots/{slot}/values/{name}")
    async def set_value(session: SignedIn, slot: Name, name: Name, wish: Wish) -> Done:
        """Set a parameter by hand; without a value: forget what was set by hand."""
        if wish.value is None:
            return service.reset_value(session, slot, name)
        return service.set_value(session, slot, name, wish.value)

    @router.post("/slots/{slot}/swap")
    async def swap(session: SignedIn, slot: Name, wish: Wish) -> Done:
        """Give the slot to another part (`to`)."""
        return service.swap(session, slot, wish.to or "")

    @router.post("/slots/{slot}/release")
    async def release(session: SignedIn, slot: Name) -> Done:
        """Take the slot from its part."""
        return service.release(session, slot)

    @router.get("/sim/{slot}")
    async def simulated(session: SignedIn, slot: Name) -> Simulated:  # noqa: ARG001
        """A simulated part: its controls and what one would see."""
        return service.views.simulated(slot)

    @router.put("/sim/{slot}/{control}")
    async def operate(session: SignedIn, slot: Name, control: Name, wish: Wish) -> Done:
        """Do something to a simulated part (`value`); the control `plugged` takes true or false."""
        if control == "plugged":
            return service.plug(session, slot, plugged=bool(wish.value))
        return service.operate(session, slot, control, "" if wish.value is None else wish.value)


def _add_parts(router: APIRouter, service: Service) -> None:
    @router.post("/parts/{part}/adopt")
    async def adopt(session: SignedIn, part: Name, wish: Wish) -> Done:
        """Let an unknown or waiting part into a slot."""
        return service.adopt(session, part, wish.slot)

    @router.post("/parts/{part}/ignore")
    async def ignore(session: SignedIn, part: Name) -> Done:
        """Show a part among the arrivals no more."""
        return service.ignore(session, part)

    @router.post("/parts/{part}/identify")
    async def identify(session: SignedIn, part: Name) -> Done:
        """Have a part show itself."""
        return service.identify(session, part)

    @router.post("/parts/{part}/block")
    async def block(session: SignedIn, part: Name, words: Words) -> Done:
        """Let a part, or a part number, in no more."""
        return service.block(session, part, words.words)

    @router.post("/parts/{part}/unblock")
    async def unblock(session: SignedIn, part: Name) -> Done:
        """Let it in again."""
        return service.unblock(session, part)


def _add_robot(router: APIRouter, service: Service) -> None:
    @router.post("/stop")
    async def stop(session: SignedIn, words: Words) -> Done:
        """STOP: every part goes to its safe state."""
        return service.stop(session, words.words)

    @router.post("/go")
    async def go_on(session: SignedIn) -> Done:
        """End STOP."""
        return service.go_on(session)

    @router.post("/window")
    async def open_window(session: SignedIn, wish: Wish) -> Done:
        """Open the adoption window for `seconds`, 60 unless said otherwise."""
        return service.open_window(session, 60.0 if wish.seconds is None else wish.seconds)

    @router.delete("/window")
    async def close_window(session: SignedIn) -> Done:
        """Close the adoption window."""
        return service.close_window(session)

    @router.get("/edits")
    async def edits(session: SignedIn, limit: Annotated[int, Query(ge=1, le=1000)] = 100) -> list[EditLine]:  # noqa: ARG001
        """What people changed, newest first."""
        return service.edits(limit)

    @router.post("/undo")
    async def undo(session: SignedIn, wish: Wish) -> Done:
        """Take a change back (`edit`), or the latest one."""
        return service.undo(session, wish.edit)

    @router.get("/blueprint")
    async def blueprint(session: SignedIn) -> Response:  # noqa: ARG001
        """The present blueprint as `robot.toml`."""
        return Response(
            service.blueprint(),
            media_type="application/toml",
            headers={"content-disposition": 'attachment; filename="robot.toml"'},
        )

    @router.post("/blueprint/diff")
    async def diff(session: SignedIn, text: BlueprintText) -> BlueprintDiff:  # noqa: ARG001
        """What applying another blueprint would change; nothing is changed."""
        return service.blueprint_diff(text.toml)

    @router.put("/blueprint")
    async def apply(session: SignedIn, text: BlueprintText) -> Done:
        """Make the robot what another blueprint says."""
        return service.apply_blueprint(session, text.toml)
