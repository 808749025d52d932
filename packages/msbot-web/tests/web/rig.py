"""What tests of the web room share: its views and its service on a robot that runs in virtual time."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from pathlib import Path

from msbot.config import load_library
from msbot.operations.operation import Outcome
from msbot.operations.rights import Role
from msbot.part import HelloWorld
from msbot_school.classroom.class_robots import ClassRobot
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers
from msbot_web.frame_ring import FrameRing
from msbot_web.live_values import LiveValues
from msbot_web.local_masters import LocalMaster, LocalMasters
from msbot_web.model_builder import ModelBuilder
from msbot_web.models.robot_models import Robot, Scalar, SimulatedPartControl
from msbot_web.remote_robots import RemoteRobots, RemoteStop
from msbot_web.service import Service
from msbot_web.simulated.controls import SimulatedControls
from msbot_web.stored_data import registry_data
from msbot_web.timeline import Timeline
from msbot_xrce.errors import ConfigError, MsbotError
from tests.operations.stage import Stage, play
from tests.web.access.test_accounts import PlainHasher, user

PASSWORD = "correct horse"


class ToyBench:
    """Simulated parts that are nothing but a switch and a knob."""

    def __init__(self, *slots: str) -> None:
        self.plugged = dict.fromkeys(slots, True)
        self.turned: dict[str, Scalar] = dict.fromkeys(slots, 0)
        self.uids: dict[str, bytes] = {}

    def slots(self) -> tuple[str, ...]:
        return tuple(self.plugged)

    def is_plugged(self, slot: str) -> bool:
        return self.plugged[slot]

    def uid(self, slot: str) -> bytes:
        return self.uids.get(slot, b"")

    def plug(self, slot: str) -> None:
        self.plugged[slot] = True

    def unplug(self, slot: str) -> None:
        self.plugged[slot] = False

    def controls(self, slot: str) -> tuple[SimulatedPartControl, ...]:
        return (SimulatedPartControl(name="turn", kind="number", value=self.turned[slot]),)

    def operate(self, slot: str, control: str, value: Scalar) -> None:
        if control != "turn":
            raise ConfigError(f"{slot} has no control {control!r}")
        self.turned[slot] = value

    def rest_value(self, slot: str, control: str) -> Scalar | None:
        return 0

    def readings(self, slot: str) -> Mapping[str, Scalar]:
        return {"turned": self.turned[slot]}

    def reading_words(self, slot: str) -> Mapping[str, tuple[str, str]]:
        return {"turned": ("Where its axle points", "deg")}


class Alone(LocalMasters):
    """No other master is on this computer; a thread that looks for them would know nothing of virtual time."""

    async def find(self) -> Sequence[LocalMaster]:
        return ()


class NobodyElsewhere(RemoteRobots):
    """There is no access to a robot elsewhere."""

    async def snapshot(self) -> Sequence[ClassRobot]:
        return ()

    async def stop_all(self, reason: str, group: str = "") -> list[RemoteStop]:
        return []


class Rig:
    """The web room around a robot on its stage, without a server."""

    def __init__(self, stage: Stage, folder: Path, bench: SimulatedControls) -> None:
        clock = asyncio.get_running_loop().time
        self.stage = stage
        self.frames = FrameRing()
        timeline = Timeline()
        stage.master.inventory.on_event(timeline.note)
        library = load_library(folder / "library")
        (record,) = stage.registry.robots.all()
        self.views = ModelBuilder(
            stage.master,
            blueprint=lambda: stage.registry.robots.blueprint(record),
            library=library,
            live=LiveValues(stage.master.space, {"HelloWorld": HelloWorld}.get, clock),
            frames=self.frames,
            timeline=timeline,
            bench=bench,
            clock=clock,
            ignored=stage.operations.showing.is_ignored,
            by_hand=stage.operations.by_hand.sent_values,
        )
        people = [user(role.word, role, PASSWORD) for role in (Role.VIEWER, Role.STUDENT, Role.TEACHER)]
        users = MemoryUsers(user("ada", Role.ADMINISTRATOR, PASSWORD), *people)
        self.accounts = Accounts(users, clock=clock, hasher=PlainHasher())
        self.service = Service(
            views=self.views,
            operations=stage.operations,
            accounts=self.accounts,
            records=registry_data(
                stage.registry, record, stage.operations, lambda: library, address=str(folder / "robot.db")
            ),
            robot=self._describe,
            clock=clock,
            neighbours=Alone(),
            far=NobodyElsewhere(clock),
        )

    def _describe(self) -> Robot:
        return Robot(
            name="R",
            version="1",
            serial_number="2",
            released="",
            manufacturer="",
            links=[],
            beat_s=1.0,
            tick_s=2.0,
            life=3,
            stopped=self.stage.operations.stopping.status.stopped,
            window_s=self.stage.operations.placement.window_s,
            trouble="",
            slots=[],
            arrivals=0,
        )

    def session(self, role: Role) -> Session:
        """Somebody who has signed in."""
        name = "ada" if role is Role.ADMINISTRATOR else role.word
        return self.accounts.sessions.begin(name, role)

    async def act(self, session: Session, operation: str, **arguments: object) -> Outcome:
        """Have an operation done for somebody who has signed in."""
        return await self.stage.operations.do(operation, who=self.service.asker(session), **arguments)

    async def look(self, seconds: float) -> None:
        """Let time pass while the room looks at the robot."""
        for _ in range(round(seconds / 0.25)):
            self.views.poll()
            await asyncio.sleep(0.25)
        self.views.poll()


def show(
    folder: Path,
    scene: Callable[[Rig], Awaitable[None]],
    *changes: tuple[str, str],
    parts: tuple[str, ...] = ("AA=ABCD", "BB=EFGH", "CC=WXYZ"),
    bench: SimulatedControls | None = None,
) -> None:
    """Run a scene in the web room of the sample robot."""

    async def on_stage(stage: Stage) -> None:
        rig = Rig(stage, folder, bench or ToyBench())
        rig.views.poll()
        await scene(rig)

    play(folder, on_stage, *changes, parts=parts)


def belongs_to(rig: Rig, slot: str, pupil: str) -> None:
    """The part in a slot is the program of a pupil, in a browser."""
    inventory = rig.stage.master.inventory
    holder = inventory.holder(slot, asyncio.get_running_loop().time())
    assert holder is not None
    inventory._index.sessions[holder.client_key].pupil = pupil


async def refusal(deed: Callable[[], object]) -> MsbotError:
    """The error that a deed is refused with."""
    try:
        done = deed()
        if inspect.isawaitable(done):
            done = await done
    except MsbotError as error:
        return error
    raise AssertionError(f"it was done: {done}")


async def chunks(content: bytes) -> AsyncIterator[bytes]:
    """An upload, as it comes in."""
    for begin in range(0, len(content), 65536):
        yield content[begin : begin + 65536]
