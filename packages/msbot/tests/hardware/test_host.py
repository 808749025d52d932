"""Many parts in one process from one file: what the file may say, and that only what changed is started anew."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from msbot.config import Blueprint, PartType, RobotProfile, Slot
from msbot.hardware import HardwareParts, PartsHost, read_parts
from msbot.master import Master
from msbot.part import JoinState
from msbot.pnp import MemoryStore
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub
from msbot_xrce.errors import ConfigError
from tests.hardware.chips import Bus, bmp280
from tests.hardware.robot import machine_at
from tests.sim.robot import LIBRARY

TWO = """
[[part]]
type = "LED"
name = "lamp"
pins = { s = 17 }

[[part]]
type = "BMP280"
i2c = "1:0x76"

[[part]]
type = "BUTTON"
simulate = true
"""


def test_the_parts_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "parts.toml").write_text(TWO)
    lamp, barometer, button = read_parts(tmp_path / "parts.toml", LIBRARY)
    assert (lamp.name, lamp.number, dict(lamp.wiring.pins) if lamp.wiring else None) == ("lamp", "LED", {"s": 17})
    assert barometer.name == "BMP280"
    assert button.wiring is None


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[[part]]\n", "line 1, part[0].type: is missing"),
        ('[[part]]\ntype = "LAMP"\n', 'line 2, part[0].type: the library has no part number "LAMP"'),
        ('[[part]]\ntype = "LED"\npin = 3\n', "line 3, part[0].pin: there is no such key here"),
        ('[[part]]\ntype = "LED"\npins = { x = 3 }\n', 'has no wire to a GPIO pin "x"'),
        ('[[part]]\ntype = "LED"\n[[part]]\ntype = "LED"\n', 'there are two parts with the name "LED"'),
        ('[[part]]\ntype = "LED"\n[[part]]\ntype = "RELAY-1"\n', "GPIO 17 is taken by LED; wire one of them elsewhere"),
        ('[[part]]\ntype = "BMP280"\n[[part]]\ntype = "BMP280"\nname = "b"\n', "address 0x76 of I2C bus 1 is taken"),
        ('[[part]]\ntype = "ABCD"\n', "has no driver for hardware"),
        ("[[part]]\ntype = 'LED'\nsimulate = true\n" * 65, "there are 65 parts; 64 can be in one file"),
        ("[part]\n", "must begin with two brackets"),
    ],
)
def test_a_mistake_in_the_file_is_told_with_its_line(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "parts.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_parts(tmp_path / "parts.toml", LIBRARY)
    assert sentence in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        read_parts(tmp_path / "parts.toml", LIBRARY)


class Scene:
    """A robot with slots for the parts of the file, in virtual time."""

    def __init__(self, folder: Path, bus: Bus) -> None:
        self.path = folder / "parts.toml"
        self.folder = folder
        self.bus = bus
        self.host: PartsHost | None = None
        self.edits = 0
        self.master: Master | None = None

    def write(self, text: str) -> None:
        """Change the file; its time differs, whatever the clock of the file system resolves."""
        self.path.write_text(text)
        self.edits += 1
        os.utime(self.path, ns=(self.edits * 10**9, self.edits * 10**9))

    def active(self) -> dict[str, int]:
        """The parts in the robot, each with how it is told from one that was started anew."""
        assert self.host is not None
        return {part.local_name: id(part) for part in self.host.parts if part.state is JoinState.ACTIVE}

    def natures(self) -> dict[str, str]:
        """What the parts say is behind their ports, as the master knows it."""
        assert self.master is not None
        now = asyncio.get_running_loop().time()
        return {info.local_name: info.nature.label for info in self.master.inventory.view(now)}

    async def until(self, *names: str) -> dict[str, int]:
        """Wait until exactly these are in the robot."""
        async with asyncio.timeout(100):
            while set(self.active()) != set(names):  # noqa: ASYNC110 - in virtual time
                await asyncio.sleep(0.1)
        return self.active()

    def play(self, scene: Callable[[], Awaitable[None]]) -> None:
        """Run it."""
        numbers = ("LED", "BMP280", "BUTTON", "RELAY-1")
        store = MemoryStore(
            types=tuple(PartType(number, number) for number in numbers),
            slots=tuple(Slot(number.casefold(), number) for number in numbers),
        )
        blueprint = Blueprint(
            RobotProfile("R", "1", "2", "3", "4"), tuple(Slot(number.casefold(), number) for number in numbers)
        )

        async def main() -> None:
            master = Master(blueprint, store, random=Random(3), epoch_ns=lambda: 0)
            hub = InprocHub()
            master.add_link(hub.server)
            self.master = master
            bench = HardwareParts(machine_at(self.folder, self.bus))
            self.host = PartsHost(self.path, LIBRARY, lambda _: hub.connect(), bench=bench)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(master.run())
                await master.ready.wait()
                hosting = tasks.create_task(self.host.run())
                await scene()
                self.host.end()
                await hosting
                running.cancel()

        run_virtual(main())


def test_what_changed_in_the_file_is_started_anew_and_nothing_else(tmp_path: Path, pins: Any, caplog: Any) -> None:
    robot = Scene(tmp_path, Bus(at_76=bmp280()))
    robot.write(TWO)

    async def scene() -> None:
        first = await robot.until("lamp", "BMP280", "BUTTON")
        await asyncio.sleep(0.5)
        assert robot.natures() == {"lamp": "real", "BMP280": "real", "BUTTON": "simulated"}
        robot.write(TWO.replace("17", "27"))
        async with asyncio.timeout(50):
            while robot.active().get("lamp", first["lamp"]) == first["lamp"]:  # noqa: ASYNC110 - in virtual time
                await asyncio.sleep(0.1)
        second = await robot.until("lamp", "BMP280", "BUTTON")
        assert {name for name in first if first[name] != second[name]} == {"lamp"}
        assert pins.pin(17).function == "input"
        assert pins.pin(27).function == "output"
        robot.write("[[part]\n")
        await asyncio.sleep(3)
        assert robot.active() == second, "a mistake in the file changes nothing"
        assert "all parts run on as they are" in caplog.text
        robot.write(TWO.replace("17", "27") + '\n[[part]]\ntype = "RELAY-1"\n')
        third = await robot.until("lamp", "BMP280", "BUTTON", "RELAY-1")
        assert {name for name in second if second[name] != third[name]} == set()
        robot.write(TWO[TWO.index("[[part]]", 20) :])
        await robot.until("BMP280", "BUTTON")
        assert pins.pin(27).function == "input"

    robot.play(scene)


def test_a_real_part_is_swapped_for_a_simulated_one_and_back_while_all_runs(tmp_path: Path, pins: Any) -> None:
    robot = Scene(tmp_path, Bus(at_76=bmp280()))
    robot.write(TWO)

    async def scene() -> None:
        await robot.until("lamp", "BMP280", "BUTTON")
        for text, nature in ((TWO.replace("pins = { s = 17 }", "simulate = true"), "simulated"), (TWO, "real")):
            robot.write(text)
            async with asyncio.timeout(50):
                while robot.natures().get("lamp") != nature:  # noqa: ASYNC110 - in virtual time
                    await asyncio.sleep(0.1)
            await robot.until("lamp", "BMP280", "BUTTON")
            assert pins.pin(17).function == ("output" if nature == "real" else "input")

    robot.play(scene)


def test_one_part_without_its_hardware_does_not_hold_up_the_others(tmp_path: Path, pins: Any) -> None:
    robot = Scene(tmp_path, Bus())
    robot.write(TWO)

    async def scene() -> None:
        await robot.until("lamp", "BUTTON")
        robot.bus.chips[0x76] = bmp280()
        await robot.until("lamp", "BUTTON", "BMP280")

    robot.play(scene)
