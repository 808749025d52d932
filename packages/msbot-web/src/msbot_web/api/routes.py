"""The JSON API: every page's twin, under `/api`, described by `/openapi.json` on the same port.

A browser shows its cookie, and for changes the CSRF word of `GET /api/me` in the header `X-CSRF-Token`. A program
shows an API token: `Authorization: Bearer msbot_...`. Who may do what is decided in `Service`.
"""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import Response

from msbot.operations.rights import Right
from msbot_school.missions.recorded_missions import grade_json, played_from_json
from msbot_web.api.dependencies import (
    Name,
    SignedIn,
    edits_for,
    journal_for,
    lanes_for,
    octets_for,
    parts_for,
    slots_for,
    words_for,
)
from msbot_web.api.gallery_routes import add_gallery
from msbot_web.api.hand_in_routes import add_hand_ins
from msbot_web.api.inspection_routes import add_inspection
from msbot_web.api.operation_routes import PREFIX, add_operations
from msbot_web.api.program_routes import add_programs
from msbot_web.models.bus_models import BusFigures, FrameLine
from msbot_web.models.class_models import ExaminationState, MissionMarks, MissionState, RobotStatus, RobotTile
from msbot_web.models.common_models import PROBLEMS
from msbot_web.models.robot_models import (
    BlueprintDiff,
    BlueprintText,
    ChangeResult,
    EditLine,
    JournalLine,
    Me,
    PartLine,
    Robot,
    Simulated,
    SimulatedPartControlValue,
    SlotCard,
    TimelineLane,
    TopicLine,
    TypeLine,
    Value,
)
from msbot_web.service import Service


def make_api(service: Service) -> APIRouter:
    """All calls of the API for one robot."""
    router = APIRouter(prefix=PREFIX, responses=PROBLEMS)
    _add_reads(router, service)
    _add_slots(router, service)
    add_operations(router, service)
    _add_robot(router, service)
    add_programs(router, service)
    add_gallery(router, service)
    add_hand_ins(router, service)
    add_inspection(router, service)
    return router


def _add_reads(router: APIRouter, service: Service) -> None:
    views = service.views

    @router.get("/me")
    async def me(session: SignedIn) -> Me:
        """Who is signed in, and the CSRF word."""
        return service.me(session)

    @router.get("/robot")
    async def robot(session: SignedIn) -> Robot:
        """The robot with all its slots."""
        robot = service.robot()
        return robot.model_copy(update={"slots": slots_for(session, robot.slots)})

    @router.get("/status")
    async def status(session: SignedIn) -> RobotStatus:  # noqa: ARG001
        """The robot in short, for the class that it is in."""
        return service.whole_class.status()

    @router.get("/parts")
    async def parts(session: SignedIn) -> list[PartLine]:
        """All parts that are there or were there lately."""
        return parts_for(session, views.parts())

    @router.get("/arrivals")
    async def arrivals(session: SignedIn) -> list[PartLine]:
        """Parts that wait for a slot, or were refused."""
        return parts_for(session, views.arrivals())

    @router.get("/why/{part}")
    async def why(session: SignedIn, part: Name) -> list[str]:
        """In sentences: how a part stands and which rules led there."""
        return [words_for(session, line) for line in views.why(part, by_name=not session.may(Right.ARRANGE))]

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
    async def timeline(session: SignedIn) -> list[TimelineLane]:
        """The states of every slot over time."""
        return lanes_for(session, views.timeline())

    @router.get("/doctor")
    async def doctor(session: SignedIn, anew: bool = False) -> ExaminationState:
        """What keeps the robot from working, and what mends it; `anew`: not what was found a moment ago."""
        found = await service.examine(session, anew=anew)
        return ExaminationState.model_validate(found.as_json())

    @router.get("/mission")
    async def mission(session: SignedIn) -> MissionState:  # noqa: ARG001
        """The mission that runs, without its answers."""
        return MissionState.model_validate(service.operations.missions.state())

    @router.get("/mission/report")
    async def mission_report(
        session: SignedIn,  # noqa: ARG001
        number: Annotated[int | None, Query(ge=1, le=2**53)] = None,
    ) -> MissionMarks:
        """Marks, times and wrong acts of a mission that is over; without `number` the latest."""
        return MissionMarks.model_validate(await asyncio.to_thread(_marks, service, number))

    @router.get("/journal")
    async def journal(
        session: SignedIn,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
        part: Annotated[str | None, Query(max_length=254)] = None,
    ) -> list[JournalLine]:
        """The newest lines of the journal, newest first."""
        return journal_for(session, await service.journal(session, limit, part))

    @router.get("/bus")
    async def bus(session: SignedIn) -> BusFigures:  # noqa: ARG001
        """How busy the CAN bus is."""
        return views.bus()

    @router.get("/bus/frames")
    async def frames(
        session: SignedIn,
        after: Annotated[int, Query(ge=0, le=2**53)] = 0,
        limit: Annotated[int, Query(ge=1, le=1000)] = 200,
    ) -> list[FrameLine]:
        """The newest frames with a number above `after`, oldest first."""
        return octets_for(session, service).frames(views.frame_lines(after, limit))

    @router.get("/library")
    async def library(
        session: SignedIn,  # noqa: ARG001
        search: Annotated[str, Query(max_length=254)] = "",
    ) -> list[TypeLine]:
        """The part library."""
        return views.types(search)

    @router.get("/robots")
    async def robots(session: SignedIn) -> list[RobotTile]:
        """All robots of the class: of the database, of this computer, and elsewhere with an access."""
        tiles = await service.whole_class.robots()
        return [tile.model_copy(update={"last_event": words_for(session, tile.last_event)}) for tile in tiles]


def _marks(service: Service, number: int | None) -> dict[str, object]:
    return grade_json(played_from_json(service.operations.missions.report(number)))


def _add_slots(router: APIRouter, service: Service) -> None:
    @router.get("/slots/{slot}")
    async def slot(session: SignedIn, slot: Name) -> SlotCard:
        """One slot with its part and its values."""
        return slots_for(session, [service.views.slot(slot)])[0]

    @router.get("/slots/{slot}/values")
    async def values(session: SignedIn, slot: Name) -> list[Value]:  # noqa: ARG001
        """The parameters of a slot with origin, range and unit."""
        return await service.values(slot)

    @router.get("/sim/{slot}")
    async def simulated(session: SignedIn, slot: Name) -> Simulated:  # noqa: ARG001
        """A simulated part: its controls and what one would see."""
        return service.views.simulated(slot)

    @router.put("/sim/{slot}/{control}")
    async def operate(session: SignedIn, slot: Name, control: Name, wish: SimulatedPartControlValue) -> ChangeResult:
        """Do something to a simulated part (`value`); the control `plugged` takes true or false."""
        if control == "plugged":
            return service.plug(session, slot, plugged=bool(wish.value))
        return service.operate(session, slot, control, "" if wish.value is None else wish.value)


def _add_robot(router: APIRouter, service: Service) -> None:
    @router.get("/edits")
    async def edits(session: SignedIn, limit: Annotated[int, Query(ge=1, le=1000)] = 100) -> list[EditLine]:
        """What people changed, newest first."""
        return edits_for(session, await service.edits(limit))

    @router.get("/blueprint")
    async def blueprint(session: SignedIn) -> Response:  # noqa: ARG001
        """The present blueprint as `robot.toml`."""
        return Response(
            await service.blueprint(),
            media_type="application/toml",
            headers={"content-disposition": 'attachment; filename="robot.toml"'},
        )

    @router.post("/blueprint/diff")
    async def diff(session: SignedIn, text: BlueprintText) -> BlueprintDiff:
        """What applying another blueprint would change; nothing is changed."""
        return await service.blueprint_diff(session, text.toml)

    @router.put("/blueprint")
    async def apply(session: SignedIn, text: BlueprintText) -> ChangeResult:
        """Make the robot what another blueprint says."""
        return await service.apply_blueprint(session, text.toml)
