"""Devices that send no heartbeat (node guarding), and PDOs that wait for SYNC: with the genuine library's nodes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Level
from msbot_bridges.bridge import BridgeLink, ForeignDevice
from msbot_bridges.canopen.world import WORLD
from tests.bridges.hosts import Host, Reports, in_thread, running

pytest.importorskip("canopen")

import canopen
from canopen.objectdictionary import ObjectDictionary
from canopen.objectdictionary.eds import export_eds

from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.canopen_bus import SYNC_ID, BridgeNetwork
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.simulated.local_device import LocalDevice, add, add_pdos

FLOW, VALVE = Entry(0x6130, 1, 16, signed=True), Entry(0x6140, 1, 16, signed=True)


class Valve(LocalDevice):
    """It sends no heartbeat; its PDOs are as they are, and wait for SYNC."""

    def __init__(self, bus: str, folder: Path) -> None:
        made = ObjectDictionary()
        for name, entry, value in (
            ("Device type", objects.DEVICE_TYPE, 404),
            ("Error register", objects.ERROR_REGISTER, 0),
            ("COB-ID SYNC", objects.SYNC_COB_ID, 0x81),
            ("Guard time", objects.GUARD_TIME, 0),
            ("Life time factor", objects.LIFE_FACTOR, 0),
            ("Identity vendor", objects.VENDOR, 0x77),
            ("Identity product", objects.PRODUCT, 10),
            ("Flow", FLOW, 12),
            ("Valve", VALVE, 0),
        ):
            add(made, name, entry, value)
        # The library's node needs this object; one that cannot be written is as good as none.
        add(made, "Producer heartbeat", objects.PRODUCER_HEARTBEAT, 0, is_writable=False)
        add_pdos(made, 9, (1,), (1,))
        for index in (FLOW.index, VALVE.index):
            made[index][1].unit, made[index][1].factor, made[index][1].pdo_mappable = "%", 1, True
        made.device_information.vendor_name, made.device_information.vendor_number = "ACME", 0x77
        made.device_information.product_name, made.device_information.product_number = "Valve", 10
        with (folder / "valve.eds").open("w", encoding="utf-8") as file:
            export_eds(made, file)
        super().__init__(bus, 9, made)
        for communication, mapping, cob_id, entry, kind in (
            (0x1800, 0x1A00, 0x189, FLOW, 2),
            (0x1400, 0x1600, 0x209, VALVE, 1),
        ):
            self.put(Entry(mapping, 1, 32), entry.mapping)
            self.put(Entry(mapping, 0, 8), 1)
            self.put(Entry(communication, 2, 8), kind)
            self.put(Entry(communication, 1, 32), cob_id)

    def received(self, values: Mapping[tuple[int, int], int]) -> None:
        self.put(VALVE, values[VALVE.index, VALVE.subindex])

    def step(self, seconds: float) -> None:
        self.put(FLOW, self.get(VALVE))


@asynccontextmanager
async def valve(folder: Path) -> AsyncIterator[tuple[str, Valve, ForeignDevice, Host]]:
    (folder / "eds").mkdir()
    address = f"msbot:{uuid4().hex[:12]}"
    simulated = Valve(address, folder / "eds")
    async with running(WORLD.open(BridgeLink(address, {"eds": str(folder / "eds")}))) as host:
        async with in_thread(simulated.run_in_thread, simulated.end):
            yield address, simulated, await host.devices.get(), host
        assert await host.lost_why.get() in (
            "node 9 has sent no answer for 3 s",
            "node 9 has sent no answer for 1.5 s",
        )


async def test_a_device_without_a_heartbeat_is_guarded_and_confirms_stop(tmp_path: Path) -> None:
    async with valve(tmp_path) as (_, simulated, device, _):
        assert simulated.get(objects.GUARD_TIME) == 0, "nothing was told to a device that is in no robot"
        reports = Reports()
        device.begin(reports)
        device.act("valve", Level(percent=40))
        await reports.until(lambda last: last.get("flow") == Level(percent=40))
        assert (simulated.get(objects.GUARD_TIME), simulated.get(objects.LIFE_FACTOR)) == (500, 3)
        assert simulated.get(objects.SYNC_COB_ID) == SYNC_ID
        device.stop()
        assert device.not_stopped
        while device.not_stopped:
            await asyncio.sleep(0.2)  # as its part does
            device.stop()
        assert simulated.node.nmt.state == "PRE-OPERATIONAL"
        assert simulated.get(VALVE) == 0


async def test_the_bridge_leaves_sync_to_whoever_sends_it(tmp_path: Path) -> None:
    async with valve(tmp_path) as (address, _, device, _):
        with listening(address) as (network, heard):
            device.begin(Reports())
            while len(heard) < 3:  # noqa: ASYNC110 - another thread hears
                await asyncio.sleep(0.05)
            network.sync.start(0.3)  # the genuine producer
            await asyncio.sleep(1.0)
            heard.clear()
            reports = Reports()
            device.end()
            device.begin(reports)
            await reports.until(lambda last: last)
            assert not heard, "its own are not heard"
            network.sync.stop()
            while not heard:  # noqa: ASYNC110
                await asyncio.sleep(0.05)


async def test_the_genuine_master_guards_the_simulated_device(tmp_path: Path) -> None:
    address = f"msbot:{uuid4().hex[:12]}"
    simulated = Valve(address, tmp_path)

    def guard(network: canopen.Network) -> str:
        node = network.add_node(9, ObjectDictionary())
        node.nmt.start_node_guarding(0.05)
        try:
            node.nmt.wait_for_heartbeat(30)
            return str(node.nmt.state)
        finally:
            node.nmt.stop_node_guarding()

    async with in_thread(simulated.run_in_thread, simulated.end):
        while simulated.node.nmt.state != "PRE-OPERATIONAL":  # noqa: ASYNC110 - it is another thread's
            await asyncio.sleep(0.02)
        with listening(address) as (network, _):
            assert await asyncio.to_thread(guard, network) == "PRE-OPERATIONAL"


@contextmanager
def listening(address: str) -> Iterator[tuple[BridgeNetwork, list[int]]]:
    """The library's network at a bus, and the SYNCs of others."""
    heard: list[int] = []
    network = BridgeNetwork(open_bus(address), lambda can_id, _: heard.append(can_id) if can_id == SYNC_ID else None)
    network.connect()
    try:
        yield network, heard
    finally:
        network.disconnect()
