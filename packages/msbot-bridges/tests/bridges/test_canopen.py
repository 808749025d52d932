"""A drive and a module that the genuine library simulates, on a simulated bus."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Angle, Level, Speed, Switch, Temperature
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.canopen.world import WORLD
from tests.bridges.hosts import Host, Reports, in_thread, running

pytest.importorskip("canopen")

from canopen.objectdictionary import ObjectDictionary
from canopen.objectdictionary.eds import export_eds

import can
from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.drive_states import DriveState
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.canopen.simulated.io_module import OUTPUTS, POLARITY, SimulatedIo
from msbot_bridges.canopen.simulated.local_device import LocalDevice, add, add_pdos


@asynccontextmanager
async def world(**options: str) -> AsyncIterator[tuple[str, Host]]:
    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(WORLD.open(BridgeLink(bus, options))) as host:
        yield bus, host


async def test_a_drive_is_found_turns_stops_and_is_missed() -> None:
    async with world() as (bus, host):
        drive = SimulatedDrive(bus, 5, serial=77)
        async with in_thread(drive.run_in_thread, drive.end):
            device = await host.devices.get()
            assert device.identity.part_number == "vendor-0x4d53:SimDrive"
            assert device.identity.unique == b"1026 77"
            assert [one.name for one in device.outputs] == ["turns", "position"]
            assert [(one.name, one.safe) for one in device.inputs] == [("speed", Speed(rpm=0)), ("angle", None)]
            settings = {one.name: one for one in device.settings}
            assert settings["profile_velocity"].default == 60
            assert (settings["max_torque"].kind, settings["max_torque"].default) == (float, 100.0)
            assert drive.node.nmt.state == "PRE-OPERATIONAL", "nothing was told to a device that is in no robot"

            reports = Reports()
            device.set("profile_velocity", 120)
            device.begin(reports)
            device.act("speed", Speed(rpm=90))
            await reports.until(lambda last: last.get("turns") == Speed(rpm=90))
            assert drive.get(objects.DRIVE_SETTINGS[0].entry) == 120

            drive.is_stuck = True
            device.stop()
            assert device.not_stopped == "node 5 has not reported that its drive stands (it is in OPERATION ENABLED)"
            await reports.until(lambda last: drive.state is DriveState.QUICK_STOP)
            assert device.not_stopped
            assert drive.node.nmt.state == "OPERATIONAL"
            drive.is_stuck = False
            await host.until(lambda: not device.not_stopped)
            assert drive.rpm == 0
            assert drive.node.nmt.state == "PRE-OPERATIONAL"

            device.go()
            device.act("angle", Angle(degrees=30))
            await reports.until(lambda last: abs(last["position"].degrees - 30) < 0.5)  # type: ignore[attr-defined]
            device.act("angle", Angle(degrees=-45))
            await reports.until(lambda last: abs(last["position"].degrees + 45) < 0.5)  # type: ignore[attr-defined]
            device.rest()
            await reports.until(lambda last: drive.state is DriveState.SWITCH_ON_DISABLED)
            device.act("speed", Speed(rpm=-30))
            await reports.until(lambda last: last["turns"] == Speed(rpm=-30))
        assert await host.lost_why.get() == "node 5 has sent no heartbeat for 1 s"


async def test_a_drive_is_driven_by_its_torque() -> None:
    async with world() as (bus, host):
        drive = SimulatedDrive(bus, has_torque=True)
        async with in_thread(drive.run_in_thread, drive.end):
            device = await host.devices.get()
            torque = next(one for one in device.inputs if one.name == "torque")
            assert (torque.safe, torque.ranges) == (Level(percent=0), {"percent": (-100.0, 100.0)})
            assert "torque_slope" in {one.name for one in device.settings}
            reports = Reports()
            device.begin(reports)
            device.act("torque", Level(percent=5))
            await reports.until(lambda last: last.get("load") == Level(percent=5))
            assert drive.get(objects.MODE) == objects.PROFILE_TORQUE
            await reports.until(lambda last: last.get("turns") == Speed(rpm=50))
            device.stop()
            await host.until(lambda: not device.not_stopped)
            assert (drive.rpm, drive.get(objects.TORQUE)) == (0, 0)
            device.go()
            device.act("speed", Speed(rpm=20))
            await reports.until(lambda last: last["turns"] == Speed(rpm=20))


async def test_nodes_that_only_seem_to_be_there_hold_up_nobody() -> None:
    async with world() as (bus, host):
        ended = threading.Event()

        def seem() -> None:
            """Heartbeats of a hundred nodes, of which none answers; some send what no answer is."""
            with open_bus(bus) as phantom:
                while not ended.wait(0.3):
                    for node in range(20, 120):
                        ids = (0x700, 0x580) if node % 10 == 0 else (0x700,)
                        for identifier in ids:
                            message = can.Message(arbitration_id=identifier + node, is_extended_id=False, data=b"\x05")
                            phantom.send(message, timeout=5)

        async with in_thread(seem, ended.set):
            assert "cannot be asked who it is" in await host.said.get()
            drive = SimulatedDrive(bus, 5)
            async with in_thread(drive.run_in_thread, drive.end):
                device = await host.devices.get()
                assert device.identity.where == "node 5"
                device.begin(Reports())
                device.stop()
                await host.until(lambda: not device.not_stopped)
        assert host.said.qsize() < 200, "each is named once"


async def test_an_emergency_is_a_fault_in_words_until_it_is_reset() -> None:
    async with world() as (bus, host):
        drive = SimulatedDrive(bus)
        async with in_thread(drive.run_in_thread, drive.end):
            device = await host.devices.get()
            device.begin(Reports())
            device.act("speed", Speed(rpm=10))
            drive.fail(0x3210, 0x05)
            await host.until(lambda: device.fault)
            assert device.fault == (
                "node 5 reports emergency 0x3210: over-voltage of the DC link (error register: generic, voltage)"
            )
            drive.put(objects.CONTROLWORD, 0x80)  # a person resets the fault
            drive.put(objects.ERROR_REGISTER, 0)
            drive.node.emcy.reset()
            await host.until(lambda: not device.fault)


async def test_a_device_with_a_fault_is_found_with_it() -> None:
    async with world() as (bus, host):
        drive = SimulatedDrive(bus)
        drive.put(objects.ERROR_REGISTER, 8)
        async with in_thread(drive.run_in_thread, drive.end):
            device = await host.devices.get()
            assert device.fault == "node 5 reports emergency 0x1000: generic error (error register: temperature)"


async def test_a_device_that_starts_anew_is_found_anew() -> None:
    async with world() as (bus, host):
        drive = SimulatedDrive(bus)
        async with in_thread(drive.run_in_thread, drive.end):
            first = await host.devices.get()
            drive.node.nmt.state = "INITIALISING"
            assert await host.lost_why.get() == "node 5 has started anew"
            second = await host.devices.get()
            assert second is not first
            assert second.identity.uid == first.identity.uid


async def test_an_io_module_switches_and_goes_to_its_safe_values() -> None:
    async with world() as (bus, host):
        module = SimulatedIo(bus)
        async with in_thread(module.run_in_thread, module.end):
            device = await host.devices.get()
            assert [one.name for one in device.outputs] == [*(f"in_{one}" for one in range(1, 9)), "level_in_1"]
            assert [one.safe for one in device.inputs] == [Switch(on=False)] * 8 + [Level(percent=0)]
            reports = Reports()
            device.set("polarity_in", 0x80)
            device.begin(reports)
            device.act("out_1", Switch(on=True))
            device.act("out_3", Switch(on=True))
            device.act("level_out_1", Level(percent=-50))
            await reports.until(
                lambda last: (
                    [number for number in range(1, 9) if last.get(f"in_{number}") == Switch(on=True)] == [1, 3, 8]
                    and abs(last.get("level_in_1", Level(percent=0)).percent + 50) < 0.01  # type: ignore[attr-defined]
                )
            )
            assert module.get(POLARITY) == 0x80
            device.stop()
            assert device.not_stopped == "node 6 has not reported that its outputs have their safe values"
            await host.until(lambda: not device.not_stopped)
            assert module.get(OUTPUTS) == 0
            assert module.node.nmt.state == "PRE-OPERATIONAL"
            device.go()
            device.act("out_2", Switch(on=True))
            await reports.until(lambda last: last["in_2"] == Switch(on=True))
            assert module.get(objects.PRODUCER_HEARTBEAT) == 500, "it sent none, and was told to when it was taken in"


class Thermometer(LocalDevice):
    """A device of a profile that is not known; its PDO is mapped when it is switched on."""

    OIL, FILTER = Entry(0x6130, 1, 16, signed=True), Entry(0x2001, 0, 16)

    def __init__(self, bus: str, folder: Path) -> None:
        made = ObjectDictionary()
        for name, entry, value in (
            ("Device type", objects.DEVICE_TYPE, 404),
            ("Producer heartbeat", objects.PRODUCER_HEARTBEAT, 100),
            ("Identity vendor", objects.VENDOR, 0x77),
            ("Identity product", objects.PRODUCT, 9),
            ("Oil temperature", self.OIL, 215),
            ("Filter time", self.FILTER, 10),
        ):
            add(made, name, entry, value)
        add_pdos(made, 9, (1,), ())
        oil = made[0x6130][1]
        oil.unit, oil.factor, oil.pdo_mappable = "°C", 0.1, True
        made.device_information.vendor_name, made.device_information.vendor_number = "ACME", 0x77
        made.device_information.product_name, made.device_information.product_number = "Thermo", 9
        with (folder / "thermo.eds").open("w", encoding="utf-8") as file:
            export_eds(made, file)
        super().__init__(bus, 9, made)
        self.put(Entry(0x1A00, 1, 32), self.OIL.mapping)
        self.put(Entry(0x1A00, 0, 8), 1)
        self.put(Entry(0x1800, 1, 32), 0x189)

    def received(self, values: Mapping[tuple[int, int], int]) -> None:
        raise AssertionError

    def step(self, seconds: float) -> None:
        pass


async def test_an_eds_makes_ports_and_settings_of_a_device_of_an_unknown_profile(tmp_path: Path) -> None:
    (tmp_path / "eds").mkdir()
    device = Thermometer("msbot:" + uuid4().hex[:12], tmp_path / "eds")
    for folder in ("", str(tmp_path / "eds")):
        async with running(WORLD.open(BridgeLink(device._address, {"eds": folder} if folder else {}))) as host:
            thermometer = Thermometer(device._address, tmp_path / "eds")
            async with in_thread(thermometer.run_in_thread, thermometer.end):
                if not folder:
                    words = await host.said.get()
                    assert "has the profile 404, which is not known here: put its EDS (vendor 0x77, product" in words
                    continue
                found = await host.devices.get()
                assert found.identity.part_number == "ACME:Thermo"
                assert [(one.name, one.message) for one in found.outputs] == [("oil_temperature", Temperature)]
                assert [one.name for one in found.settings] == ["filter_time"]
                reports = Reports()
                found.begin(reports)
                await reports.until(lambda last: last)
                assert abs(reports.last["oil_temperature"].celsius - 21.5) < 0.01  # type: ignore[attr-defined]
                found.stop()
                assert found.not_stopped == "", "what moves nothing goes on reporting"
