"""Chips on I2C of a real kernel: `i2c-stub` has the registers of the data sheets' worked examples, and `msbot part`
reads them through /dev/i2c as on a Raspberry Pi. What they say travels from one CAN controller (emulated, with the
kernel's driver) to another, where a partner hears it.

The commands are copies of this process, which has loaded what they need: to start Python and to import takes half a
minute where Python is emulated. The controllers are those for CAN FD, because an emulated frame takes no time on the
bus: an SJA1000, whose receive buffer holds five frames, loses some of each configuration, and its part has to log in a
second time."""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.context import ForkProcess
from pathlib import Path
from random import Random

import pytest

from msbot.master import Master
from msbot.part import JoinState, Message, Part
from msbot.sim import message_class
from msbot_agent.link import open_link
from tests.e2e.prepared import Wish, become
from tests.hardware import chips
from tests.sim.robot import LIBRARY, blueprint_for, store_for
from tests.socketcan.bus import SETTINGS, until
from tests.socketcan.kernel_modules import load, unload
from tests.socketcan.test_drivers import FD, FD_ON, both_up

pytestmark = pytest.mark.controllers
ALL = {0x23: chips.bh1750, 0x29: chips.tcs34725, 0x40: chips.ina219, 0x68: chips.mpu6050, 0x76: chips.bmp280}


def plug(*addresses: int) -> int:
    """Chips with the registers of their worked examples; the number of their bus."""
    from smbus2 import SMBus

    load("i2c-stub", f"chip_addr={','.join(map(str, addresses))}")
    number = next(
        int(path.name.removeprefix("i2c-"))
        for path in Path("/sys/bus/i2c/devices").glob("i2c-*")
        if "stub" in (path / "name").read_text()
    )
    with SMBus(number) as bus:
        for address in addresses:
            for register, value in ALL[address]().registers.items() if address in ALL else ():
                bus.write_word_data(address, register, value)
    return number


@pytest.fixture
def i2c() -> Iterator[None]:
    """The driver of /dev/i2c; afterwards there is no chip."""
    if not Path("/sys/class/i2c-dev").exists():
        load("i2c-dev")
    yield
    unload("i2c-stub")


def msbot(output: Path, *arguments: str) -> ForkProcess:
    """A command that runs beside; what it says is in the file."""
    environment = os.environ | {"XDG_STATE_HOME": str(output.parent)}
    with output.open("wb") as file:
        wish: Wish = (list(arguments), str(output.parent), environment, None)
        process = get_context("fork").Process(target=_command, args=(wish, [file.fileno(), file.fileno()]))
        process.start()
    return process


def _command(wish: Wish, files: list[int]) -> None:
    logging.getLogger().handlers.clear()  # those of pytest: the command has its own
    become(wish, files)


@asynccontextmanager
async def robot(number: str) -> AsyncIterator[tuple[Master, dict[str, list[Message]]]]:
    """A robot on the controller can2 with a slot for the part, and a desk; what the desk has heard, by port."""
    part_type = LIBRARY.require(number)
    master = Master(blueprint_for(part_type), store_for(part_type, {}), random=Random(3))
    can = replace(SETTINGS, profile_hash=master.profile.profile_hash())
    master.add_link(open_link("can:can2?fd=1", serve=True, can=can))
    desk = Part("DESK", uid=b"the desk", random=Random(2))
    heard: dict[str, list[Message]] = {}
    for port in part_type.ports:
        assert port.message is not None
        desk.on(port.name, message_class(port.message))(heard.setdefault(port.name, []).append)
    tasks = [
        asyncio.create_task(master.run()),
        asyncio.create_task(desk.run_async(open_link("can:can2?fd=1", can=replace(SETTINGS, uid=b"the desk")))),
    ]
    try:
        await until(lambda: desk.state is JoinState.ACTIVE)
        yield master, heard
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def unplugged() -> None:
    """Pull the chips out: as soon as nobody has their bus open."""
    await until(lambda: unload("i2c-stub"))


async def test_the_data_sheets_example_reaches_a_partner_over_can_and_the_chip_can_be_pulled_out(
    i2c: None, tmp_path: Path
) -> None:
    from smbus2 import SMBus

    number = plug(0x76)
    said = tmp_path / "said"
    part = msbot(said, "part", "BMP280", "--i2c", f"{number}:0x76", "--link", "can:can3?fd=1")
    try:
        async with both_up(FD, FD_ON), robot("BMP280") as (master, heard):
            await until(lambda: bool(heard["pressure"] and heard["temperature"]))
            assert getattr(heard["temperature"][-1], "celsius") == pytest.approx(25.08)  # noqa: B009
            assert getattr(heard["pressure"][-1], "hectopascal") == pytest.approx(1006.53, abs=0.001)  # noqa: B009
            # It loses its power: its registers are as at the start. Then it is taken out, and the bus has another chip.
            with SMBus(number) as bus:
                for register, value in ((0xF7, 0x80), (0xFA, 0x80), (0xF8, 0), (0xF9, 0), (0xFB, 0), (0xFC, 0)):
                    bus.write_byte_data(0x76, register, value)
            await until(lambda: "it had no power in between" in said.read_text())
            await unplugged()
            assert plug(0x68) == number
            await until(lambda: f"no BMP280 answers at 0x76 on I2C bus {number}" in said.read_text())
            assert f"`i2cdetect -y {number}` shows who answers" in said.read_text()
            assert "it had no power in between" in master.why("BMP280")[0], "the robot knows why it has gone"
            before = len(heard["pressure"])
            await unplugged()
            assert plug(0x76) == number
            await until(lambda: len(heard["pressure"]) > before)
            assert "its hardware answers again" in said.read_text()
    finally:
        part.terminate()
        await asyncio.to_thread(part.join, 60)
    assert part.exitcode == 0


def test_a_scan_and_every_chip_by_the_kernels_i2c(i2c: None, tmp_path: Path) -> None:
    from msbot.hardware import Machine, Mount, driver_class, make_wiring

    number = plug(*ALL)
    scan = msbot(tmp_path / "scan", "hardware", "scan", "--json")
    scan.join(200)
    assert scan.exitcode == 0
    things = json.loads((tmp_path / "scan").read_text())["found"]
    found = {thing["where"]: thing["lines"] for thing in things if thing["kind"] == "i2c"}
    assert found[f"I2C bus {number}, address 0x76"] == [f"msbot part BMP280 --i2c {number}:0x76"]
    assert len(found) == len(ALL)
    expected: dict[str, dict[str, float]] = {
        "BH1750": {"brightness": 28066.67},
        "TCS34725": {"red": 85, "green": 85, "blue": 85},
        "INA219": {"voltage": 11.98, "current": 10.0},
        "MPU-6050": {"up": 9.80665, "turn": 1.0},
        "BMP280": {"air": 25.08, "weather": 1006.53},
    }
    for name, values in expected.items():
        part_type = LIBRARY.require(name)
        options = ["shunt_ohm=0.002"] if name == "INA219" else []
        wiring = make_wiring(part_type, i2c=f"{number}:0x{part_type.driver.addresses[0]:02x}", options=options)
        driver = driver_class(part_type)(Mount(part_type, wiring, Machine(keeper=[])))
        driver.open()
        try:
            measured = driver.sample({})
        finally:
            driver.close()
        assert measured is not None
        for source, value in values.items():
            assert measured[source] == pytest.approx(value, abs=0.01), (name, source)
