"""Puts the web room onto a running robot: what is seen, what is done, who may, and where it is served."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from urllib.parse import urlsplit

from msbot.config import Library
from msbot.doctor.finding import PAGE_PORT, Examined
from msbot.master import Master
from msbot.metrics import DatabaseFigures, MetricsCollector, MetricsSampler, MomentFigures, PageFigures
from msbot.operations.blocking import known_object
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.message_classes import MessageClasses
from msbot.registry import Registry, RobotRecord, RobotStore
from msbot.sim import message_class
from msbot.sim.arena.running_arena import RunningArena
from msbot_agent.agent import read_statuses
from msbot_agent.link import bound_name
from msbot_agent.space import SpaceAddress
from msbot_school.lessons.lesson_controller import LessonController
from msbot_web.access.accounts import Accounts
from msbot_web.access.clocks import since_boot_s
from msbot_web.access.session_file import session_file
from msbot_web.access.users import MemoryUsers, UserStore
from msbot_web.doctor_service import DoctorService
from msbot_web.frame_ring import FrameRing
from msbot_web.gallery import RunningDemo
from msbot_web.lessons_view import LessonsView
from msbot_web.live_values import LiveValues
from msbot_web.local_masters import LocalMasters
from msbot_web.model_builder import BusMeter, ModelBuilder
from msbot_web.models.robot_models import Robot
from msbot_web.programs.programs import RegistryProgramStore
from msbot_web.server import WebServer, WebSettings
from msbot_web.service import Service
from msbot_web.simulated.controls import SimulatedControls
from msbot_web.simulated.simulated_part_controls import SimulatedPartControls
from msbot_web.slot_cards import stop_state
from msbot_web.stored_data import RegistryUsers, no_stored_data, registry_data
from msbot_web.timeline import Timeline
from msbot_xrce.lazy import dataclass

SESSIONS_S = 1.0
"""Period in which to check who may still be signed in."""
LOOK_S, LONGEST_LOOK_S = 0.25, 0.5
"""Period in which the robot is observed, even if no page is open: for beat intervals and newly bound topics."""


@dataclass(frozen=True, slots=True)
class PageSources:
    """What can be shown of a robot in addition to its master."""

    frames: FrameRing
    """Fed by the bus, or never."""
    bus: BusMeter | None = None
    bench: SimulatedControls | None = None
    arena: RunningArena | None = None
    """The world that its simulated parts are in."""


@dataclass(frozen=True, slots=True)
class Database:
    """Where a robot is kept."""

    registry: Registry
    robot: RobotRecord
    address: str
    """As it was opened."""

    @property
    def memory(self) -> RobotStore:
        """The robot as its database has it, without asking the database."""
        return self.registry.runs.store(self.robot)


class RobotPages:
    """The pages of one robot, ready to run.

    Args:
        master: the robot.
        operations: what can be done to it.
        library: where part numbers are looked up.
        database: its database; None: neither journal nor users are stored.
        seen: its bus and its simulated parts.
        settings: where the pages are served.
        lessons: its lesson desk.
        space: where its topics are, for the doctor.
        demo: the demo whose robot this is, where a link signs people in as administrator, without a password; None: a
            robot that stays what it is.

    Raises:
        ConfigError: the port cannot be had, or the certificate cannot be used.
    """

    def __init__(
        self,
        master: Master,
        operations: InProcessOperations,
        library: Library,
        *,
        database: Database | None,
        seen: PageSources,
        settings: WebSettings,
        demo: RunningDemo | None = None,
        lessons: LessonController | None = None,
        space: SpaceAddress | None = None,
    ) -> None:
        self._master = master
        self._space = space or SpaceAddress()
        self._frames = seen.frames
        clock = asyncio.get_running_loop().time
        timeline = Timeline()
        master.inventory.on_event(timeline.note)
        self._views = ModelBuilder(
            master,
            blueprint=lambda: master.blueprint if database is None else database.memory.blueprint,
            library=library,
            live=LiveValues(master.space, MessageClasses(lambda: self._views.library), clock),
            frames=seen.frames,
            timeline=timeline,
            bench=seen.bench or SimulatedPartControls(operations.stand_ins),
            clock=clock,
            ignored=operations.showing.is_ignored,
            by_hand=operations.by_hand.sent_values,
            planted=operations.faults.visible_faults,
            bus=seen.bus,
            stop=lambda: stop_state(master.stop),
        )
        self._noting = MetricsSampler(master.agent, master)
        self._is_noting = asyncio.Event()
        self._collecting = MetricsCollector(
            master.agent,
            master=master,
            page=self.figures,
            noting=self._noting,
            database=None if database is None else partial(_database_figures, database.registry),
        )
        self._use_library(library)
        operations.on_library(self._use_library)
        self._users: UserStore = MemoryUsers() if database is None else RegistryUsers(database.registry, database.robot)
        self._accounts = accounts = Accounts(self._users, clock=since_boot_s)
        if demo is not None:
            accounts.entry_token()
        describe = _describer(master, operations)
        records = (
            no_stored_data(describe)
            if database is None
            else registry_data(
                database.registry, database.robot, operations, lambda: self._views.library, address=database.address
            )
        )
        self.service = Service(
            views=self._views,
            operations=operations,
            accounts=accounts,
            records=records,
            robot=describe,
            clock=clock,
            programs=None if database is None else RegistryProgramStore(database.registry),
            doctor=DoctorService(partial(self._patient, master, database), clock),
            figures=self._read_figures,
            arena=seen.arena,
            neighbours=LocalMasters.of_group(lambda: master.stop_group),
            learning=LessonsView(lessons, None if database is None else database.registry, accounts),
            demo=demo,
        )
        self.server = WebServer(self.service, settings)
        master.add_link(self.server.parts)
        self._sessions = session_file(accounts, self.server.page_id)

    def _patient(self, master: Master, database: Database | None) -> Examined:
        """Whom the doctor of the page examines; it asks the running masters, so it belongs in a thread."""
        return Examined(
            database=None if database is None else database.address,
            robot=master.profile.name,
            links=tuple(map(bound_name, master.links)),
            space=self._space,
            page_port=urlsplit(self.server.own_address).port or PAGE_PORT,
            masters=tuple(read_statuses()),
        )

    def _use_library(self, library: Library) -> None:
        """Look part numbers and messages up in this library from now on."""
        self._views.use_library(library)
        classes = (message_class(message) for message in library.messages.values())
        self._frames.learn(classes, partial(known_object, self._master), library.units)

    def _read_figures(self) -> MomentFigures:
        self._is_noting.set()  # from the first question on
        return self._collecting()

    async def _note_figures(self) -> None:
        await self._is_noting.wait()
        await self._noting.run()

    def figures(self) -> PageFigures:
        """How the page and its bus are, for Prometheus."""
        bus = self._views.bus()
        return PageFigures(
            sessions=self._accounts.sessions.count,
            connections=len(self.server.connections),
            bus=bus.name,
            bus_load=bus.load_percent / 100,
            bus_bitrate=bus.bitrate,
        )

    async def run(self) -> None:
        """Serve until cancelled."""
        self._sessions.bring_back()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._keep_looking())
                tasks.create_task(self._keep_sessions())
                tasks.create_task(self._note_figures())
                tasks.create_task(self._views.curves.measure())
                tasks.create_task(self.server.run())
        finally:
            await asyncio.shield(self._sessions.save())

    async def _keep_sessions(self) -> None:
        """Follow what other programs change about people, and keep the sessions."""
        await self._sessions.tidy_up()
        while True:
            await asyncio.sleep(SESSIONS_S)
            self._accounts.load(self._users.users())
            self._accounts.sessions.end_old()
            await self._sessions.save()

    async def _keep_looking(self) -> None:
        while True:
            self._views.poll()
            # Twice in a period of beats, so that the time between two of them is seen.
            await asyncio.sleep(max(LOOK_S, min(LONGEST_LOOK_S, self._master.inventory.timing.beat_s / 2)))


def _database_figures(registry: Registry) -> DatabaseFigures:
    health = registry.storage.health
    return DatabaseFigures(health.waiting, health.lost, health.is_well)


def _describer(master: Master, operations: InProcessOperations) -> Callable[[], Robot]:
    def describe() -> Robot:
        profile, timing = master.profile, master.inventory.timing
        return Robot(
            name=profile.name,
            version=profile.version,
            serial_number=profile.serial_number,
            released=profile.released,
            manufacturer=profile.manufacturer,
            links=[bound_name(link) for link in master.links],
            beat_s=timing.beat_s,
            tick_s=timing.tick_s,
            life=timing.life,
            stopped=master.stop.stopped,
            stop=stop_state(master.stop),
            window_s=operations.placement.window_s,
            trouble="",
            slots=[],
            arrivals=0,
            faults=list(operations.faults.visible_faults("")),
        )

    return describe
