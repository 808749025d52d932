"""What bridges to MQTT and Modbus cost: from plug-in to active, until a loss is noticed, STOP, processor time at 10 Hz.

python -m bench.bridges_ip [--write]

A lamp on MQTT, and a pump with Modbus by TCP, each in a process of its own; so are the broker (mosquitto) and whoever
has the lamp report ten times a second. A robot's master and its bridge are in this process. After that, in the same
run, the native way in this process: the libraries `aiomqtt` and `pymodbus` alone, which hear and poll the same devices
ten times a second, decode what they report, and notice a loss by the last will, or by a request that fails.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import aiomqtt
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException

from bench.machine import describe_machine
from bench.result import write_result
from msbot.config import SAMPLES, Blueprint, BridgeTable, Library, Slot, load_library, parse_blueprint
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import PartState
from msbot.registry import open_registry
from msbot_agent.link import InprocHub
from msbot_bridges.cli.bridge_runner import RUNNER

EXAMPLE = Path(__file__).parents[1] / "examples" / "makers"
PUMP = EXAMPLE / "pump.toml"
TIMES = 3
REST_S = 5.0
LOOK_S = 0.002
PERIOD_S = 0.1
LAMP = "msbot-lamp/1"


@dataclass
class Figures:
    """What was measured, seconds."""

    active: list[float] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)
    stop: list[float] = field(default_factory=list)
    idle: float = 0.0
    busy: list[float] = field(default_factory=list)


def free_port() -> int:
    """A port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


@contextlib.contextmanager
def broker(folder: Path) -> Iterator[int]:
    """Mosquitto in a process of its own; gives its port."""
    program = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if program is None:
        raise SystemExit("mosquitto is missing: apt install mosquitto")
    port = free_port()
    (folder / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    process = subprocess.Popen([program, "-c", str(folder / "mosquitto.conf")], stderr=subprocess.DEVNULL)
    try:
        while not _answers(port):
            time.sleep(0.02)
        yield port
    finally:
        process.terminate()
        process.wait()


def _answers(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


class Device:
    """A simulated device in a process of its own, and perhaps another one that has it report."""

    def __init__(self, *words: str, reporter: tuple[str, ...] = ()) -> None:
        lines = [[sys.executable, "-m", "msbot", "bridge", *words, "--quiet"]]
        lines += [[sys.executable, "-c", *reporter]] if reporter else []
        self._processes = [subprocess.Popen(line) for line in lines]

    def kill(self) -> None:
        """Pull it out."""
        for process in self._processes:
            process.kill()

    def wait(self) -> None:
        """Until it is gone."""
        for process in self._processes:
            process.wait()


async def busy(seconds: float) -> float:
    """Processor time of this process for a second."""
    begun, at = time.process_time(), time.monotonic()
    await asyncio.sleep(seconds)
    return (time.process_time() - begun) / (time.monotonic() - at)


# With a bridge


class Bench:
    """A robot with one slot and one bridge, whose device comes and goes."""

    def __init__(self, master: Master, operations: InProcessOperations) -> None:
        self.master, self.operations = master, operations

    async def until_active(self, count: int) -> float:
        """When so many parts are active."""
        loop = asyncio.get_running_loop()
        while sum(one.state is PartState.ACTIVE for one in self.master.inventory.view(loop.time())) != count:  # noqa: ASYNC110
            await asyncio.sleep(LOOK_S)
        return time.monotonic()


@contextlib.asynccontextmanager
async def bridged(folder: Path, slot: Slot, table: BridgeTable, library: Library) -> AsyncIterator[Bench]:
    """The robot runs as long as the block."""
    sample = parse_blueprint(SAMPLES["thesis"], load_library())
    blueprint = Blueprint(sample.robot, (slot,), bridges=(table,))
    with open_registry(folder / f"{table.world}.db") as registry:
        record = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(record), library=library)
        hub = InprocHub()
        master.add_link(hub.server)
        operations = InProcessOperations(master, registry, record, library=library)
        works = (master.run(), *RUNNER.coroutines([table], lambda _: hub.connect(), print))
        tasks = [asyncio.create_task(one) for one in works]
        try:
            yield Bench(master, operations)
        finally:
            for task in reversed(tasks):
                task.cancel()
            await asyncio.wait(tasks)


async def measure(
    bench: Bench,
    start: Callable[[], Device],
    there: Callable[[], Coroutine[Any, Any, float]],
    port: str,
) -> Figures:
    """Plug a device in and out several times.

    Args:
        bench: the robot.
        start: begins the process of the device.
        there: gives the moment at which the device is there.
        port: one that is driven, `pump.speed`.
    """
    figures = Figures()
    await asyncio.sleep(2)
    figures.idle = await busy(REST_S)
    for _ in range(TIMES):
        being = asyncio.create_task(there())
        process = start()
        at = await bench.until_active(1)
        figures.active.append(max(0.0, at - await being))
        await asyncio.sleep(1)
        figures.busy.append(await busy(REST_S))
        await bench.operations.do("publish", who="bench", port=port, values=["50"], seconds=60.0)
        await asyncio.sleep(0.5)
        await bench.operations.do("stop", who="bench", reason="")
        while bench.master.stop.silent:  # noqa: ASYNC110 - it is a measurement
            await asyncio.sleep(LOOK_S)
        figures.stop += [one.ms / 1000 for one in bench.master.stop.confirmed]
        await bench.operations.do("go", who="bench", stop=None)
        process.kill()
        begun = time.monotonic()
        figures.lost.append(await bench.until_active(0) - begun)
        process.wait()
        await asyncio.sleep(0.5)
    return figures


async def accepts(port: int) -> float:
    """When somebody listens at a port."""
    while not await asyncio.to_thread(_answers, port):  # noqa: ASYNC110
        await asyncio.sleep(LOOK_S)
    return time.monotonic()


async def says_it_is_there(port: int) -> float:
    """When the lamp has said that it is available."""
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe(f"{LAMP}/available")
        async for message in client.messages:
            if message.payload == b"online" and not message.retain:
                return time.monotonic()
    raise AssertionError


REPORTER = """
import json, sys, time
import paho.mqtt.client as mqtt
client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
client.connect("127.0.0.1", int(sys.argv[1]))
client.loop_start()
for number in range(10**9):
    client.publish("msbot-lamp/1/state", json.dumps({"state": "ON", "brightness": number % 255 + 1}))
    time.sleep(0.1)
"""


# The libraries alone


async def native_mqtt(port: int, start: Callable[[], Device]) -> Figures:
    """Hear discovery, availability and state, and decode the state."""
    figures = Figures()
    known = dict[str, object]()
    changed = asyncio.Event()

    async def hear(client: aiomqtt.Client) -> None:
        async for message in client.messages:
            assert isinstance(message.payload, bytes)
            topic = message.topic.value
            text = message.payload.decode()
            known[topic] = json.loads(text) if text.startswith("{") else text
            changed.set()

    async def until(value: str) -> float:
        while known.get(f"{LAMP}/available") != value or (value == "online" and f"{LAMP}/state" not in known):
            changed.clear()
            await changed.wait()
        return time.monotonic()

    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe([("homeassistant/+/+/+/config", 1), (f"{LAMP}/+", 1)])
        hearing = asyncio.create_task(hear(client))
        await asyncio.sleep(2)
        figures.idle = await busy(REST_S)
        for _ in range(TIMES):
            known.clear()
            being = asyncio.create_task(says_it_is_there(port))
            process = start()
            at = await until("online")
            figures.active.append(max(0.0, at - await being))
            figures.busy.append(await busy(REST_S))
            process.kill()
            begun = time.monotonic()
            figures.lost.append(await until("offline") - begun)
            process.wait()
        hearing.cancel()
        await asyncio.wait([hearing])
    return figures


async def native_modbus(port: int, start: Callable[[], Device]) -> Figures:
    """Read all registers of the pump ten times a second."""
    figures = Figures()
    for _ in range(TIMES):
        process = start()
        begun = await accepts(port)
        client = AsyncModbusTcpClient("127.0.0.1", port=port, retries=0, reconnect_delay=0)
        await client.connect()
        await read_pump(client)
        figures.active.append(time.monotonic() - begun)
        polling = asyncio.create_task(poll_pump(client))
        figures.busy.append(await busy(REST_S))
        process.kill()
        begun = time.monotonic()
        figures.lost.append(await polling - begun)
        process.wait()
        client.close()
    return figures


async def read_pump(client: AsyncModbusTcpClient) -> float:
    """All of its points, with as few requests as the table of the bridge takes."""
    inputs = await client.read_input_registers(0, count=3)
    held = await client.read_holding_registers(16, count=1)
    await client.read_holding_registers(40, count=1)
    await client.read_coils(3, count=1)
    await client.read_discrete_inputs(0, count=1)
    words = inputs.registers
    turns = client.convert_from_registers(words[1::-1], client.DATATYPE.FLOAT32)
    assert isinstance(turns, float)
    return turns + words[2] * 0.1 + held.registers[0] * 0.5


async def poll_pump(client: AsyncModbusTcpClient) -> float:
    """Until a request fails."""
    while True:
        try:
            await read_pump(client)
        except (ModbusException, OSError):
            return time.monotonic()
        await asyncio.sleep(PERIOD_S)


# All of it


async def run(folder: Path) -> dict[str, tuple[Figures, Figures]]:
    """Both worlds, each with the bridge and natively."""
    library = load_library(EXAMPLE / "adopted")
    found = {}
    with broker(folder) as port:
        link = f"mqtt://127.0.0.1:{port}"

        def lamp() -> Device:
            return Device("mqtt", "--simulate", "lamp", "--link", link, reporter=(REPORTER, str(port)))

        slot = Slot("lamp", "simulated:lamp")
        async with bridged(folder, slot, BridgeTable("mqtt", link), library) as bench:
            with_bridge = await measure(bench, lamp, lambda: says_it_is_there(port), "lamp.lamp")
        found["MQTT lamp"] = with_bridge, await native_mqtt(port, lamp)
    port = free_port()
    link = f"tcp:127.0.0.1:{port}"

    def pump() -> Device:
        return Device("modbus", "--simulate", "devices", "--link", link, "--option", f"table={PUMP}")

    table = BridgeTable("modbus", link, {"table": str(PUMP)})
    async with bridged(folder, Slot("pump", "ACME:pump"), table, library) as bench:
        with_bridge = await measure(bench, pump, lambda: accepts(port), "pump.speed")
    found["Modbus pump"] = with_bridge, await native_modbus(port, pump)
    return found


def lines_of(found: dict[str, tuple[Figures, Figures]]) -> list[str]:
    """The table."""
    names = {"MQTT lamp": "`aiomqtt` alone", "Modbus pump": "`pymodbus` alone"}
    heads = [head for name in found for head in (f"{name}, bridge", names[name])]
    columns = [figures for pair in found.values() for figures in pair]

    def row(words: str, cell: Callable[[Figures], str]) -> str:
        return f"| {words} | {' | '.join(cell(one) for one in columns)} |"

    return [
        f"| ten reports a second | {' | '.join(heads)} |",
        f"|---|{'---|' * len(heads)}",
        row(
            "from being there to active; natively: to all its values", lambda one: f"{1000 * median(one.active):.0f} ms"
        ),
        row("from the end of its process to lost", lambda one: f"{1000 * median(one.lost):.0f} ms"),
        row("STOP, until it is confirmed", lambda one: f"{1000 * median(one.stop):.0f} ms" if one.stop else "-"),
        row("processor time for a device, in a second", lambda one: f"{1000 * (median(one.busy) - one.idle):.1f} ms"),
        "",
        f"Medians of {TIMES}. The broker has kept what the lamp says it is; the first time it is complete "
        "when nothing about it has come for 1 s. Processor time is "
        "that of master and bridge, or of the library's user, above what the same process takes without the device. "
        f"{describe_machine()}",
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    wishes = parser.parse_args()
    with TemporaryDirectory() as folder:
        found = asyncio.run(run(Path(folder)))
    lines = lines_of(found)
    print("\n".join(lines))
    if wishes.write:
        write_result(
            "bridges_ip", "What bridges to MQTT and Modbus cost", lines, made_by="python -m bench.bridges_ip --write"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
