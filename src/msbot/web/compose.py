"""Puts the web room onto a running robot: what is seen, what is done, who may, and where it is served."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass

from msbot.config import Blueprint, Library
from msbot.errors import RegistryError
from msbot.master import Master
from msbot.operations import Operations
from msbot.part import Message
from msbot.registry import Registry, RobotRecord
from msbot.sim import message_class
from msbot.web.accounts import Accounts, MemoryUsers, UserStore
from msbot.web.bench import Bench, NoBench
from msbot.web.frames import FrameRing
from msbot.web.live import Live
from msbot.web.models import Robot
from msbot.web.records import RegistryUsers, registry_records
from msbot.web.server import WebServer, WebSettings
from msbot.web.service import Service, no_records
from msbot.web.timeline import Timeline
from msbot.web.views import BusMeter, Views

BLUEPRINT_S = 1.0
"""So long after a change by hand the pages show the wires as they are now."""
LOOK_S = 0.25
"""The robot is looked at that often, whether or not a page is open: for beat intervals and newly bound topics."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What of a robot is there to be seen besides the master itself."""

    frames: FrameRing
    """Fed by the bus, or never."""
    bus: BusMeter | None = None
    bench: Bench | None = None


@dataclass(frozen=True, slots=True)
class Database:
    """Where a robot is kept."""

    registry: Registry
    robot: RobotRecord
    address: str
    """As it was opened."""


class _Present:
    """The blueprint as it holds now, with what people changed by hand; read anew once in a while."""

    def __init__(self, master: Master, database: Database | None, clock: Callable[[], float]) -> None:
        self._master = master
        self._database = database
        self._clock = clock
        self._read_at = -BLUEPRINT_S
        self._blueprint = master.blueprint

    def __call__(self) -> Blueprint:
        now = self._clock()
        if self._database is not None and now - self._read_at >= BLUEPRINT_S:
            self._read_at = now
            # While the database cannot be read, what is known from before still holds.
            with contextlib.suppress(RegistryError):
                self._blueprint = self._database.registry.blueprint(self._database.robot)
        return self._blueprint


class WebRoom:
    """The pages of one robot, ready to run.

    Args:
        master: the robot.
        operations: what can be done to it.
        library: what part numbers are.
        database: its database; None: neither journal nor users last.
        seen: its bus and its simulated parts.
        settings: where the pages are served.
        entry_link: a link signs people in as administrator, without a password: for the demo.

    Raises:
        ConfigError: the port cannot be had, or the certificate cannot be used.
    """

    def __init__(
        self, master: Master, operations: Operations, library: Library, *,
        database: Database | None, seen: Seen, settings: WebSettings, entry_link: bool = False,
    ) -> None:  # fmt: skip
        self._master = master
        clock = asyncio.get_running_loop().time
        seen.frames.know(message_class(message) for message in library.messages.values())
        timeline = Timeline()
        master.inventory.on_event(timeline.note)
        self._views = Views(
            master,
            blueprint=_Present(master, database, clock),
            library=library,
            live=Live(master.space, _classes_of(library), clock),
            frames=seen.frames,
            timeline=timeline,
            bench=seen.bench or NoBench(),
            clock=clock,
            ignored=operations.is_ignored,
            bus=seen.bus,
        )
        users: UserStore = MemoryUsers() if database is None else RegistryUsers(database.registry)
        accounts = Accounts(users, clock=clock)
        if entry_link:
            accounts.entry_token()
        describe = _describer(master, operations)
        records = (
            no_records(describe)
            if database is None
            else registry_records(database.registry, database.robot, operations, library, address=database.address)
        )
        self.service = Service(
            views=self._views, operations=operations, accounts=accounts, records=records, robot=describe, clock=clock
        )
        self.server = WebServer(self.service, settings)

    async def run(self) -> None:
        """Serve until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._keep_looking())
            tasks.create_task(self.server.run())

    async def _keep_looking(self) -> None:
        while True:
            self._views.look()
            await asyncio.sleep(LOOK_S)


def _classes_of(library: Library) -> Callable[[str], type[Message] | None]:
    def class_of(type_name: str) -> type[Message] | None:
        message = library.messages.get(type_name)
        return None if message is None else message_class(message)

    return class_of


def _describer(master: Master, operations: Operations) -> Callable[[], Robot]:
    def describe() -> Robot:
        profile, timing = master.profile, master.inventory.timing
        return Robot(
            name=profile.name,
            version=profile.version,
            serial_number=profile.serial_number,
            released=profile.released,
            manufacturer=profile.manufacturer,
            links=[link.info.name for link in master.links],
            beat_s=timing.beat_s,
            tick_s=timing.tick_s,
            life=timing.life,
            stopped=operations.stop_report is not None,
            window_s=operations.window_s,
            trouble="",
            slots=[],
            arrivals=0,
        )

    return describe
