"""The example with a lamp on MQTT and a pump with Modbus runs: a knob drives the lamp, STOP is confirmed by both."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from msbot.part.description import describe
from msbot_bridges.bridge import BridgedPart, BridgeLink, ForeignDevice, worlds
from msbot_bridges.modbus.device_table import read_device_table
from tests.bridges.hosting import running as running_world
from tests.bridges.mosquitto import kept, mosquitto, wait_until_kept
from tests.e2e.processes import PATIENCE_S, run, running, wait_for_states
from tests.e2e.test_processes import free_port

pytest.importorskip("aiomqtt")
pytest.importorskip("pymodbus")
EXAMPLE = Path(__file__).parents[4] / "examples" / "makers"


def described(device: ForeignDevice) -> str:
    part = BridgedPart(device).part
    return describe(part.part_number, device.identity.words, part.program).rstrip() + "\n"


async def test_the_types_of_the_example_are_what_the_devices_say(tmp_path: Path) -> None:
    from msbot_bridges.bridge import DeviceIdentity
    from msbot_bridges.modbus.modbus_device import ModbusDevice
    from msbot_bridges.mqtt.simulated import SimulatedLamp

    with mosquitto(tmp_path) as port:
        link = BridgeLink(f"mqtt://127.0.0.1:{port}")
        lamp = asyncio.create_task(SimulatedLamp(link, {}).run())
        try:
            async with running_world(worlds()["mqtt"].open(link)) as host:
                assert described(await host.devices.get()) == (EXAMPLE / "adopted" / "lamp.toml").read_text()
        finally:
            lamp.cancel()
            await asyncio.wait([lamp])
    identity = DeviceIdentity("ACME", "pump", b"1", "Pump of ACME", "unit 1", software="1.0")
    table = read_device_table(EXAMPLE / "pump.toml")
    pump = ModbusDevice(identity, table, write=lambda _point, _value, _urgent: None, news=lambda _: None)
    assert described(pump) == (EXAMPLE / "adopted" / "pump.toml").read_text()


def test_the_example_runs(tmp_path: Path) -> None:
    folder = tmp_path / "makers"
    shutil.copytree(EXAMPLE, folder)
    link = ("--link", f"udp:127.0.0.1:{free_port()}")
    state = {"XDG_STATE_HOME": str(tmp_path / "state")}
    port, file = free_port(), folder / "robot.toml"
    file.write_text(file.read_text().replace(":1883", f":{port}").replace(":5020", f":{free_port()}"))
    with (
        running("master", "--no-page", *link, cwd=folder, env=state) as master,
        running("part", "POT-10K", "--set", "knob=60", *link, cwd=folder, env=state) as knob,
    ):
        master.wait_for("is up on")
        knob.wait_for("active: in slot knob")
        wait_for_states({"knob": "active", "lamp": "active", "pump": "active"}, cwd=folder, env=state)
        wait_until_kept(port, "msbot-lamp/1/state", '{"state": "ON", "brightness": 153}')
        assert run("publish", "pump.speed", "1000", "--seconds", "60", cwd=folder, env=state).returncode == 0
        assert run("stop", cwd=folder, env=state).returncode == 0
        wait_until_kept(port, "msbot-lamp/1/state", '{"state": "OFF", "brightness": 153}')
        until = time.monotonic() + PATIENCE_S
        while (report := json.loads(run("stop", "--json", cwd=folder, env=state).stdout)) and report.get("silent"):
            assert time.monotonic() < until, report
        assert json.loads(kept(port, "msbot-lamp/1/state"))["state"] == "OFF"
        master.end()


def test_a_simulated_device_ends_with_the_process_that_began_it_however_that_ends(tmp_path: Path) -> None:
    """A process that is killed cannot end others; but its end of their standard input is closed."""
    words = ("modbus", "--simulate", "devices", "--link", f"tcp:127.0.0.1:{free_port()}")
    table = ("--option", f"table={EXAMPLE / 'pump.toml'}")
    arguments = [sys.executable, "-m", "msbot", "bridge", *words, *table, "--end-with-stdin"]
    device = subprocess.Popen(arguments, cwd=tmp_path, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert device.stdin is not None
    assert device.stderr is not None
    while "Ctrl-C ends it" not in (line := device.stderr.readline()):
        assert line, "it runs"
    assert device.poll() is None
    device.stdin.close()
    assert device.wait(PATIENCE_S) == 0
    device.stderr.close()
