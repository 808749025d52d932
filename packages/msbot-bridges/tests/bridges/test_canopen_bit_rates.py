"""Bit rates by LSS: a simulated device at the library's own master, and the command that changes a whole bus."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from uuid import uuid4

import pytest
from click.testing import CliRunner

from msbot_bridges.bridge import BridgeLink
from msbot_bridges.canopen.lss import LssAddress, LssFailure
from msbot_bridges.canopen.world import WORLD
from msbot_bridges.cli.bridge_command import command
from msbot_xrce.errors import ConfigError
from tests.bridges.hosts import in_thread

pytest.importorskip("canopen")

import can
from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen import bit_rate_change
from msbot_bridges.canopen.bit_rate_change import BitRateChange
from msbot_bridges.canopen.canopen_bus import BridgeNetwork
from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.canopen.simulated.io_module import SimulatedIo
from msbot_bridges.canopen.simulated.lss_slave import LssSlave
from msbot_bridges.canopen.simulated.unnumbered_device import UnnumberedDevice

WHO = LssAddress(0x4D53, 0x402, 0x10000, 77)


class NoLss(LssSlave):
    """Of a device that has none."""

    def received(self, data: bytes) -> bytes | None:
        return None


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bit_rate_change, "LISTEN_S", 1.0)
    monkeypatch.setattr(bit_rate_change, "ANSWER_S", 1.0)  # on a busy computer an answer may be late


@asynccontextmanager
async def two_devices() -> AsyncIterator[tuple[str, SimulatedDrive, SimulatedIo]]:
    address = f"msbot:{uuid4().hex[:12]}?bitrate=500000"
    drive, module = SimulatedDrive(address, 5, 77), SimulatedIo(address, 6, 78)
    async with (
        asyncio.timeout(120),
        in_thread(drive.run_in_thread, drive.end),
        in_thread(module.run_in_thread, module.end),
    ):
        while {drive.node.nmt.state, module.node.nmt.state} != {"PRE-OPERATIONAL"}:  # noqa: ASYNC110 - in threads
            await asyncio.sleep(0.02)
        yield address, drive, module


async def test_the_simulated_device_changes_and_keeps_its_bit_rate_as_the_genuine_master_says() -> None:
    path = f"msbot:{uuid4().hex[:12]}"
    drive = SimulatedDrive(f"{path}?bitrate=500000", 5, 77)

    def tell() -> None:
        network = BridgeNetwork(open_bus(f"{path}?bitrate=500000"), lambda _id, _data: None)
        network.connect()
        network.lss.RESPONSE_TIMEOUT = 10.0
        try:
            assert network.lss.send_switch_state_selective(*WHO)
            network.lss.configure_bit_timing(3)
            network.lss.activate_bit_timing(100)
        finally:
            network.disconnect()

    def ask() -> int:
        network = BridgeNetwork(open_bus(f"{path}?bitrate=250000"), lambda _id, _data: None)
        network.connect()
        network.lss.RESPONSE_TIMEOUT = 10.0
        try:
            network.lss.store_configuration()
            return int(network.lss.inquire_node_id())
        finally:
            network.disconnect()

    async with asyncio.timeout(60), in_thread(drive.run_in_thread, drive.end):
        while drive.node.nmt.state != "PRE-OPERATIONAL":  # noqa: ASYNC110 - it is in a thread
            await asyncio.sleep(0.02)
        await asyncio.to_thread(tell)
        while not drive._address.endswith("?bitrate=250000"):  # noqa: ASYNC110
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.3)  # it opens the bus anew
        assert await asyncio.to_thread(ask) == 5
        assert drive.slave.is_stored


async def test_all_devices_of_a_bus_get_another_bit_rate_and_keep_it_when_they_are_there() -> None:
    async with two_devices() as (address, drive, module):
        change = BitRateChange(address, 125_000)
        question = await asyncio.to_thread(change.prepare)
        assert question.startswith("nodes 5, 6 are to have 125000 bit/s instead of 500000, and to keep it.")
        assert drive._address == address, "nothing has changed yet"
        said = list[str]()
        await asyncio.to_thread(change.carry_out, said.append)
        assert said == [
            f"node {number} (vendor 0x4d53, product 0x{product:x}, serial number {serial}) "
            "has 125000 bit/s, and keeps it"
            for number, product, serial in ((5, 0x402, 77), (6, 0x401, 78))
        ]
        for device in (drive, module):
            assert device._address == address.replace("500000", "125000")
            assert device.slave.is_stored
            assert not device.slave._is_configured


@pytest.mark.promise("A bus gets no bit rate that one of its devices cannot have")
async def test_a_device_that_cannot_have_the_bit_rate_keeps_the_others_at_theirs() -> None:
    async with two_devices() as (address, drive, module):
        module.slave._bit_rates = (500_000,)
        with pytest.raises(LssFailure, match=r"node 6 .* cannot have 250000 bit/s; with it on the bus, the others"):
            await asyncio.to_thread(BitRateChange(address, 250_000).prepare)
        assert (drive.slave.bit_rate, drive._address) == (500_000, address)
        module.slave = NoLss(WHO)
        with pytest.raises(LssFailure, match=r"node 6 .* does not answer to LSS; with it"):
            await asyncio.to_thread(BitRateChange(address, 250_000).prepare)


async def test_who_is_no_device_of_canopen_keeps_all_at_their_bit_rate() -> None:
    def say(address: str, message: can.Message, ended: threading.Event) -> None:
        with open_bus(address) as bus:
            while not ended.wait(0.1):
                bus.send(message, timeout=5)

    async with two_devices() as (address, _, _):
        for message, words in (
            (can.Message(arbitration_id=0x1001552A, data=bytes(8)), "frames with 29 bits are on this bus"),
            (can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False), "a bridge is on this bus: end it"),
        ):
            ended = threading.Event()
            async with in_thread(lambda m=message, e=ended: say(address, m, e), ended.set):  # type: ignore[misc]
                with pytest.raises(LssFailure, match=words):
                    await asyncio.to_thread(BitRateChange(address, 250_000).prepare)
        new = UnnumberedDevice(address, WHO._replace(serial=9), lambda node_id: SimulatedDrive(address, node_id, 9))
        async with in_thread(new.run_in_thread, new.end):
            with pytest.raises(LssFailure, match="a device without a node id is on this bus"):
                await asyncio.to_thread(BitRateChange(address, 250_000).prepare)


async def test_a_device_that_does_not_come_back_is_named_and_none_keeps_the_bit_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bit_rate_change, "RETURN_S", 1.0)
    monkeypatch.setattr(bit_rate_change, "ANSWER_S", 0.3)
    async with two_devices() as (address, drive, module):
        change = BitRateChange(address, 250_000)
        await asyncio.to_thread(change.prepare)
        module.end()  # it is switched off
        with pytest.raises(LssFailure, match="switch all off and on, and they have 500000 again"):
            await asyncio.to_thread(change.carry_out, print)
        assert not drive.slave.is_stored


async def test_a_person_is_asked_and_may_refuse() -> None:
    async with two_devices() as (address, drive, module):

        def run(answer: str) -> str:
            words = ["canopen", "--link", address, "--set-bitrate", "250000"]
            return CliRunner().invoke(command, words, input=answer, catch_exceptions=False).output

        output = await asyncio.to_thread(run, "n\n")
        assert "nodes 5, 6 are to have 250000 bit/s instead of 500000" in output
        assert output.endswith("Nothing has changed.\n")
        assert (drive.slave.bit_rate, module.slave.bit_rate) == (500_000, 500_000)
        output = await asyncio.to_thread(run, "y\n")
        assert "node 6 (vendor 0x4d53, product 0x401, serial number 78) has 250000 bit/s, and keeps it" in output
        assert drive._address.endswith("?bitrate=250000")


@pytest.mark.parametrize(
    ("address", "rate", "words"),
    [
        ("socketcan:can0", 250_000, "say which bit rate the bus has now: socketcan:can0[?]bitrate=500000"),
        ("socketcan:can0?bitrate=500000", 300_000, "devices of CANopen have no 300000 bit/s, but one of 1000000, "),
        ("socketcan:can0?bitrate=500000", 500_000, "the bus has 500000 bit/s already"),
    ],
)
def test_a_bit_rate_that_makes_no_sense_is_refused(address: str, rate: int, words: str) -> None:
    assert WORLD.change_bit_rate is not None
    with pytest.raises(ConfigError, match=words):
        WORLD.change_bit_rate(BridgeLink(address), rate)


async def test_nobody_on_the_bus_is_said() -> None:
    with pytest.raises(LssFailure, match="nobody answers on msbot:"):
        await asyncio.to_thread(BitRateChange(f"msbot:{uuid4().hex[:12]}?bitrate=500000", 250_000).prepare)


def test_a_slave_refuses_a_bit_rate_that_it_cannot_have() -> None:
    slave = LssSlave(WHO, (500_000,))
    slave.received(bytes([0x04, 1, 0, 0, 0, 0, 0, 0]))
    for table, place, error in ((0, 2, 0), (0, 3, 1), (1, 2, 1), (0, 20, 1)):
        assert slave.received(bytes([0x13, table, place, 0, 0, 0, 0, 0])) == bytes([0x13, error, 0, 0, 0, 0, 0, 0])
    assert slave.bit_rate == 500_000
