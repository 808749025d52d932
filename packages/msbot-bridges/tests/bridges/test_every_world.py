"""Each world in a whole robot: its device is adopted, wired, recorded, stopped, lost; `why` explains the loss."""

from __future__ import annotations

import asyncio
import os
import shutil
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.config import SAMPLE_ROBOT_TOML, BridgeTable, open_blueprint
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import PartInfo, PartState
from msbot.recording.recorder.batch import Kind, RecordedChannel, Unpacker
from msbot.recording.recorder.recorder import Recorder
from msbot.registry import open_registry
from msbot_agent.link import InprocHub
from msbot_agent.space import MemorySpace
from msbot_bridges.bridge import BridgeLink, worlds
from msbot_bridges.cli.bridge_runner import RUNNER
from msbot_xrce.errors import ConfigError
from tests.bridges.mosquitto import mosquitto
from tests.e2e.test_processes import free_port

PUMP = Path(__file__).parents[4] / "examples" / "makers" / "pump.toml"
LONG_S = 120
SOFTWARE = {"canopen": "1.0", "cyphal": "1.0", "dronecan": "1.0", "mqtt": "1.0", "modbus": "1.0"}
"""Versions that the devices say; the simulator of Jacdac says none."""
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")


class Robot:
    """A robot with a recorder and bridges, in this process."""

    def __init__(self, master: Master, operations: InProcessOperations, recorder: Recorder) -> None:
        self.master, self.do = master, operations.do
        self._recorder, self._unpacker = recorder, Unpacker()
        self._channels = dict[int, str]()
        self.recorded = dict[str, int]()
        """How many samples the recording has of each topic."""

    def part(self, number: str) -> PartInfo | None:
        now = asyncio.get_running_loop().time()
        return next((one for one in self.master.inventory.view(now) if one.part_number == number), None)

    def is_in(self, number: str, *states: PartState) -> bool:
        found = self.part(number)
        return found is not None and found.state in states

    def has_recorded(self, topic: str) -> bool:
        for kind, channel, _, content in self._unpacker.feed(self._recorder.drain()):
            if kind == Kind.CHANNEL:
                self._channels[channel] = RecordedChannel.decode(content).topic
            elif kind == Kind.SAMPLE:
                name = self._channels[channel]
                self.recorded[name] = self.recorded.get(name, 0) + 1
        return any(topic in name for name in self.recorded)

    async def until(self, condition: Callable[[], object]) -> None:
        while not condition():  # noqa: ASYNC110 - devices in threads and processes change what is waited for, too
            await asyncio.sleep(0.02)


@asynccontextmanager
async def robot_with(folder: Path, bridges: Sequence[BridgeTable], more: str = "") -> AsyncIterator[Robot]:
    """The sample robot, and what else the blueprint has."""
    (folder / "robot.toml").write_text(SAMPLE_ROBOT_TOML + more)
    blueprint, library = await asyncio.to_thread(open_blueprint, folder / "robot.toml")
    registry = await asyncio.to_thread(open_registry, folder / "robot.db")
    loop = asyncio.get_running_loop()
    recorder = Recorder(loop.time, time.time_ns, library)
    with registry:
        record = registry.robots.apply_blueprint(blueprint, library)
        space = recorder.space(MemorySpace(clock=loop.time))
        master = Master(blueprint, registry.runs.begin(record), library=library, space=space)
        hub = InprocHub()
        master.add_link(hub.server)
        operations = InProcessOperations(master, registry, record, library=library)
        recorder.watch(master, operations)
        RUNNER.check(bridges)
        work = [master.run(), *RUNNER.coroutines(bridges, lambda _: hub.connect(), print)]
        tasks = [asyncio.create_task(one) for one in work]
        try:
            async with asyncio.timeout(LONG_S):
                yield Robot(master, operations, recorder)
        finally:
            for task in tasks[1:]:
                task.cancel()
            await asyncio.gather(*tasks[1:], return_exceptions=True)
            tasks[0].cancel()
            await asyncio.wait(tasks[:1])


class Plug:
    """One device of a world, and where it is."""

    def __init__(self, world: str, device: str, folder: Path, stack: AsyncExitStack) -> None:
        self.bridge = BridgeTable(world, *self._place(world, folder, stack))
        self._device = device
        self._running: asyncio.Task[None] | None = None
        self._stack = stack

    @staticmethod
    def _place(world: str, folder: Path, stack: AsyncExitStack) -> tuple[str, dict[str, str]]:
        match world:
            case "mqtt":
                return f"mqtt://127.0.0.1:{stack.enter_context(mosquitto(folder))}", {}
            case "modbus":
                return f"tcp:127.0.0.1:{free_port()}", {"table": str(PUMP)}
            case "jacdac":
                return f"page:{free_port()}", {}
        return f"msbot:{uuid4().hex[:12]}", {}

    async def put_in(self) -> None:
        if self.bridge.world == "jacdac":
            await self._open_page()
            return
        link = BridgeLink(self.bridge.link, self.bridge.options)
        device = worlds()[self.bridge.world].simulated[self._device](link, {})
        self._running = asyncio.create_task(device.run())

    async def pull_out(self) -> None:
        if self._running is None:
            await self._page.close()
            return
        self._running.cancel()
        await asyncio.wait([self._running])

    async def _open_page(self) -> None:
        from playwright.async_api import async_playwright

        path = next(filter(None, map(shutil.which, BROWSERS)), None)
        if path is None:
            (pytest.fail if os.environ.get("MSBOT_NEED_BROWSER") else pytest.skip)("no Chromium on this machine")
        playwright = await self._stack.enter_async_context(async_playwright())
        browser = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        self._stack.push_async_callback(browser.close)
        self._page = await browser.new_page()
        await self._page.goto(f"http://127.0.0.1:{self.bridge.link.partition(':')[2]}/")
        await self._page.get_by_text("Connected to the bridge").wait_for(timeout=LONG_S * 1000)
        await self.add()

    async def add(self) -> None:
        """Of Jacdac: one more module on the page."""
        await self._page.get_by_label("Simulate a module").select_option(self._device)
        await self._page.get_by_role("button", name="Add").click()

    async def remove(self) -> None:
        """Of Jacdac: its first module is gone."""
        await self._page.evaluate("bus.removeServiceProvider(bus.serviceProviders()[0])")

    async def until(self, words: str, value: float) -> None:
        """Of Jacdac: until an expression in the page has this value."""
        while not await self._page.evaluate(f"Math.abs({words} - {value}) < 0.01"):
            await self._page.wait_for_timeout(20)


@pytest.mark.parametrize(
    ("world", "device", "number", "port", "message", "why"),
    [
        ("canopen", "drive", "vendor-0x4d53:SimDrive", "position", "Angle", "has sent no heartbeat"),
        ("cyphal", "range", "org.msbot:simrange", "distance", "Distance", "has sent no heartbeat"),
        ("dronecan", "servo", "org.msbot:simservo", "position", "Angle", "has sent no NodeStatus"),
        ("mqtt", "lamp", "simulated:lamp", "lamp_state", "Level", "is no longer available"),
        ("modbus", "devices", "ACME:pump", "turns", "Speed", "is gone"),
        ("jacdac", "slider (potentiometer)", "jacdac:slider", "slider", "Level", "it has sent nothing"),
    ],
)
async def test_a_device_is_adopted_recorded_stopped_and_its_loss_explained(
    world: str, device: str, number: str, port: str, message: str, why: str, tmp_path: Path
) -> None:
    pytest.importorskip(
        {"cyphal": "pycyphal", "mqtt": "aiomqtt", "modbus": "pymodbus", "jacdac": "websockets"}.get(world, world)
    )
    async with AsyncExitStack() as stack:
        plug = Plug(world, device, tmp_path, stack)
        async with robot_with(tmp_path, [plug.bridge]) as robot:
            await plug.put_in()
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            await robot.do("adopt", who="ann", part=number, slot="guest")
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            if version := SOFTWARE.get(world):
                await robot.until(lambda: (found := robot.part(number)) is not None and found.software == version)
                told = robot.master.why(number)
                assert any(f"software {version}" in line for line in told), told
            wire = {"topic": "seen", "type": message, "from": f"guest.{port}", "to": []}
            await robot.do("bind", who="ann", **wire)
            if world == "mqtt":  # a lamp reports when something has changed
                await robot.do("publish", who="ann", port="guest.lamp", values=["40"], seconds=60.0)
            await robot.until(lambda: robot.has_recorded("seen"))
            if too_much := {"mqtt": ("lamp", "140"), "modbus": ("speed", "3001")}.get(world):
                with pytest.raises(ConfigError, match="must be from 0 to"):
                    await robot.do(
                        "publish", who="ann", port=f"guest.{too_much[0]}", values=[too_much[1]], seconds=60.0
                    )
            if world == "dronecan":
                wire = {"topic": "again", "type": "Trigger -> Text", "from": "guest.restart", "to": []}
                await robot.do("bind", who="ann", **wire)
                reply = await robot.do("call", who="ann", port="guest.restart", values=["1"])
                assert "node 42 was told to restart" in str(reply)
                await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
                await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
            await robot.do("stop", who="ann", reason="")
            await robot.until(lambda: number in {one.part for one in robot.master.stop.confirmed})
            await plug.pull_out()
            await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
            told = robot.master.why(number)
            assert any(why in line for line in told), told
