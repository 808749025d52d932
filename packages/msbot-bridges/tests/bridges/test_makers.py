"""The sample robot of several makers: a drive is pulled, a servo of another world takes over; STOP is confirmed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from msbot.cli.run.bridges_beside import PluggableDevice
from msbot.config import Blueprint, BridgeTable, Library, load_library, open_blueprint, read_description
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.part.description import describe
from msbot.pnp import PartInfo, PartState
from msbot.registry import open_registry
from msbot_agent.link import InprocHub
from msbot_bridges.bridge import BridgedPart, BridgeLink, worlds
from msbot_bridges.cli.bridge_runner import RUNNER
from msbot_bridges.makers import write_sample
from msbot_xrce.errors import ConfigError
from tests.bridges.hosting import PATIENCE_S
from tests.bridges.hosts import in_thread, running
from tests.e2e.processes import running as running_command

pytest.importorskip("aiomqtt")
pytest.importorskip("canopen")
pytest.importorskip("dronecan")
pytest.importorskip("pycyphal")

import canopen
import dronecan

from msbot_bridges.canopen.drive_states import DriveState
from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.canopen.simulated.io_module import SimulatedIo
from msbot_bridges.cyphal.data_types import load_types
from msbot_bridges.dronecan.simulated_servo import SimulatedServo

DRIVE, IO, SERVO = "vendor-0x4d53:SimDrive", "vendor-0x4d53:SimIO", "org.msbot:simservo"
LAMP, EYE = "simulated:lamp", "org.msbot:simrange"


class Robot:
    """The robot, its master and bridges in this process."""

    def __init__(
        self, master: Master, operations: InProcessOperations, bus: str, devices: Sequence[PluggableDevice]
    ) -> None:
        self.master, self.do, self.bus, self.devices = master, operations.do, bus, devices

    def part(self, number: str) -> PartInfo | None:
        now = asyncio.get_running_loop().time()
        return next((one for one in self.master.inventory.view(now) if one.part_number == number), None)

    def has(self, number: str, state: PartState, slot: str | None = None) -> bool:
        found = self.part(number)
        return found is not None and (found.state, found.slot) == (state, slot)

    async def until(self, condition: Callable[[], object]) -> None:
        while not condition():  # noqa: ASYNC110 - devices in threads change what is waited for, too
            await asyncio.sleep(0.02)


def opened(folder: Path) -> tuple[Blueprint, Library, str]:
    write_sample(folder / "robot.toml")
    blueprint, library = open_blueprint(folder / "robot.toml")
    bus = f"msbot:{uuid4().hex[:12]}"
    names = {"canopen": bus, "dronecan": bus, "cyphal": f"{bus}-cyphal"}
    bridges = tuple(
        replace(one, link=names[one.world], simulate=()) if one.world in names else one for one in blueprint.bridges
    )
    return replace(blueprint, bridges=bridges), library, bus


@asynccontextmanager
async def makers(folder: Path) -> AsyncIterator[Robot]:
    blueprint, library, bus = await asyncio.to_thread(opened, folder)
    registry = await asyncio.to_thread(open_registry, folder / "robot.db")
    with registry:
        record = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(record), library=library)
        hub = InprocHub()
        master.add_link(hub.server)
        operations = InProcessOperations(master, registry, record, library=library)
        devices = RUNNER.devices(blueprint.bridges)
        work = [master.run(), *RUNNER.coroutines(blueprint.bridges, lambda _: hub.connect(), print, devices)]
        tasks = [asyncio.create_task(one) for one in work]
        try:
            async with asyncio.timeout(PATIENCE_S):
                yield Robot(master, operations, bus, devices)
        finally:
            for task in tasks[1:]:
                task.cancel()
            await asyncio.wait(tasks[1:])
            tasks[0].cancel()
            await asyncio.wait(tasks[:1])


@asynccontextmanager
async def range_finder(bus: str) -> AsyncIterator[Any]:
    """A simulated Cyphal range finder in this event loop."""
    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange

    node = SimulatedRange(bus, 43)
    living = asyncio.create_task(node.run())
    try:
        yield node
    finally:
        living.cancel()
        await asyncio.wait([living])


async def test_a_servo_of_another_world_takes_the_slot_of_a_drive_that_is_pulled(tmp_path: Path) -> None:
    async with makers(tmp_path) as robot, AsyncExitStack() as plugged:
        drive, module, servo = SimulatedDrive(robot.bus), SimulatedIo(robot.bus), SimulatedServo(robot.bus)
        pull = AsyncExitStack()
        await pull.enter_async_context(in_thread(drive.run_in_thread, drive.end))
        await plugged.enter_async_context(in_thread(module.run_in_thread, module.end))
        await plugged.enter_async_context(in_thread(servo.run_in_thread, servo.end))
        await robot.until(lambda: robot.has(DRIVE, PartState.ACTIVE, "joint"))
        await robot.until(lambda: robot.has(IO, PartState.ACTIVE, "switches"))
        await robot.until(lambda: robot.has(SERVO, PartState.STANDBY))
        await robot.until(lambda: robot.has(LAMP, PartState.ACTIVE, "lamp"))
        eye = await plugged.enter_async_context(range_finder(f"{robot.bus}-cyphal"))
        assert isinstance(drive.node, canopen.LocalNode)
        assert isinstance(servo._node, dronecan.node.Node)
        # With its data types loaded: without, the import compiles some into the user's home, and no bridge takes those.
        from pycyphal.application import Node

        await robot.until(lambda: isinstance(eye.node, Node))
        await robot.until(lambda: eye.restarts and robot.has(EYE, PartState.ACTIVE, "eye"))

        await robot.do("publish", who="ann", port="joint.angle", values=["36"], seconds=60.0)
        await robot.until(lambda: abs(drive.turns - 0.1) < 0.01)

        await robot.do("publish", who="ann", port="lamp.lamp", values=["40"], seconds=60.0)
        drive.is_stuck = True
        drive.rpm = 50
        await robot.do("stop", who="ann", reason="")
        await robot.until(lambda: len(robot.master.stop.confirmed) == 3)
        assert {one.part for one in robot.master.stop.confirmed} == {EYE, IO, LAMP}
        assert all(one.ms > 0 for one in robot.master.stop.confirmed)
        assert list(robot.master.stop.silent) == [DRIVE], "the drive has not reported that it stands"
        drive.is_stuck = False
        await robot.until(lambda: not robot.master.stop.silent)
        assert (drive.state, drive.rpm) == (DriveState.SWITCH_ON_DISABLED, 0)
        assert drive.node.nmt.state == "PRE-OPERATIONAL"
        await robot.do("go", who="ann", stop=None)

        await pull.aclose()
        await robot.until(lambda: robot.has(SERVO, PartState.ACTIVE, "joint"))
        await robot.until(lambda: servo.speed == 90)  # the slot's setting, by name
        await robot.do("publish", who="ann", port="joint.angle", values=["20"], seconds=60.0)
        await robot.until(lambda: abs(servo.position - 0.349) < 0.01)
        await robot.do("stop", who="ann", reason="")
        await robot.until(lambda: len(robot.master.stop.confirmed) == 4)
        assert {one.part for one in robot.master.stop.confirmed} == {EYE, IO, LAMP, SERVO}
        assert all(one.ms > 0 for one in robot.master.stop.confirmed), "each was measured"
        assert not robot.master.stop.silent
        assert abs(servo.position) < 0.06
        why = robot.master.why(DRIVE)
        assert any("has sent no heartbeat" in line for line in why), why


async def test_a_device_in_a_process_is_pulled_out_and_plugged_in_again(tmp_path: Path) -> None:
    async with makers(tmp_path) as robot:
        (lamp,) = robot.devices
        assert (lamp.name, lamp.part_number, lamp.plug()) == ("lamp", LAMP, False)
        await robot.until(lambda: robot.has(LAMP, PartState.ACTIVE, "lamp"))
        assert lamp.unplug()
        await robot.until(lambda: not robot.has(LAMP, PartState.ACTIVE, "lamp"))
        assert not lamp.is_plugged
        assert any("is no longer available" in line for line in robot.master.why(LAMP))
        assert lamp.plug()
        await robot.until(lambda: robot.has(LAMP, PartState.ACTIVE, "lamp"))


@pytest.mark.parametrize(
    ("world", "device"),
    [("canopen", "drive"), ("canopen", "io"), ("cyphal", "range"), ("dronecan", "servo"), ("mqtt", "lamp")],
)
async def test_the_library_of_the_sample_is_what_the_devices_say(world: str, device: str) -> None:
    kind = worlds()[world]
    own = BridgeLink("broker:0" if world == "mqtt" else f"msbot:{uuid4().hex[:12]}")
    async with kind.reached(own) as address, running(kind.open(address)) as host:
        simulating = asyncio.create_task(kind.simulated[device](address, {}).run())
        found = BridgedPart(await host.devices.get())
        text = describe(found.part.part_number, found.device.identity.words, found.part.program)
        said = read_description(text, found.part.part_number, load_library()).part_type
        kept = load_library(Path(__file__).parents[2] / "src/msbot_bridges/makers/adopted").require(said.number)
        assert (said.ports, said.parameters, said.name) == (kept.ports, kept.parameters, kept.name)
        simulating.cancel()
        await asyncio.wait([simulating])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (BridgeTable("canbus", "msbot:x"), 'there is no bridge for "canbus"; there are canopen'),
        (BridgeTable("canopen", "can0"), "write INTERFACE:CHANNEL"),
        (BridgeTable("canopen", "msbot:x", {"esd": "x"}), "has no such option; it has eds"),
        (BridgeTable("canopen", "msbot:x", simulate=("lamp",)), '"lamp" cannot be simulated; there can be: drive, io'),
        (BridgeTable("canopen", "msbot:x", simulate=("drive 5",)), "behind the name write NAME=VALUE"),
        (BridgeTable("canopen", "msbot:x", simulate=("drive node=0",)), "from 1 to 126"),
    ],
)
def test_a_bad_bridge_of_a_blueprint_is_refused(table: BridgeTable, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        RUNNER.check([table])


def test_two_bridges_of_one_world_on_one_bus_are_refused() -> None:
    table = BridgeTable("canopen", "msbot:x")
    RUNNER.check([table, BridgeTable("dronecan", "msbot:x")])
    with pytest.raises(ConfigError, match="msbot:x has two bridges for canopen"):
        RUNNER.check([table, table])


def test_the_demo_shows_the_parts_that_bridges_bring(tmp_path: Path) -> None:
    state = {"XDG_STATE_HOME": str(tmp_path / "state")}
    with running_command("demo", "--robot", "makers", "--port", "0", cwd=tmp_path, env=state) as demo:
        demo.wait_for("joint active", "switches active", "button active", "lamp active", "eye active")
        demo.end()
    assert not [line for line in demo.lines if "error-passive" in line], "no device is alone on its bus"
