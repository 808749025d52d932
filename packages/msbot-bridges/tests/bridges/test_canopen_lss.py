"""Node ids by LSS: the rules, the simulated device at the library's own master, and a bridge that gives ids."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from uuid import uuid4

import pytest

from msbot_bridges.bridge import BridgeLink
from msbot_bridges.canopen.lss import LAST, LssAddress, LssFailure, LssNodeIds, Numbered, number_one
from msbot_bridges.canopen.world import WORLD
from msbot_xrce.errors import ConfigError
from tests.bridges.hosts import Reports, in_thread, running

pytest.importorskip("canopen")

from msbot.part.messages.standard import Switch
from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen.canopen_bus import BridgeNetwork
from msbot_bridges.canopen.simulated.drive import SimulatedDrive
from msbot_bridges.canopen.simulated.lss_slave import LssSlave
from msbot_bridges.canopen.simulated.unnumbered_device import UnnumberedDevice

ONE, OTHER = LssAddress(0x4D53, 0x402, 0x10000, 7), LssAddress(0x4D53, 0x402, 0x10000, 0xFFFFFFFF)


def ask(slaves: Sequence[LssSlave], ids: LssNodeIds, taken: Sequence[int] = ()) -> tuple[Numbered | None, int]:
    """Let a master number one of these devices; what comes of it, and how many questions that took."""
    questions, asked = number_one(ids, taken), 1
    question = next(questions)
    while True:
        answers = [answer for slave in slaves if (answer := slave.received(question.data)) is not None]
        try:
            question = questions.send(answers[0] if answers and question.is_answered else None)
        except StopIteration as end:
            return end.value, asked
        asked += 1


def test_of_several_devices_without_ids_each_gets_one() -> None:
    slaves, ids = [LssSlave(OTHER), LssSlave(ONE), LssSlave(LssAddress(0, 0, 0, 0))], LssNodeIds()
    numbered = [ask(slaves, ids, [126])[0] for _ in slaves]
    assert numbered == [
        Numbered(LssAddress(0, 0, 0, 0), 125, is_kept=True),
        Numbered(ONE, 124, is_kept=True),
        Numbered(OTHER, 123, is_kept=True),
    ]
    assert [one.node_id for one in slaves] == [123, 124, 125]
    assert all(one.is_started and one.is_stored for one in slaves)
    assert ask(slaves, ids) == (None, 1), "one question is enough where there is nobody"


def test_a_device_that_has_not_kept_its_id_gets_it_again_and_one_that_is_gone_is_forgotten_when_ids_are_needed() -> (
    None
):
    ids = LssNodeIds()
    assert ids.choose(ONE, []) == LAST
    assert ids.choose(OTHER, [LAST]) == LAST - 1
    assert ids.choose(ONE, []) == LAST
    assert ids.choose(ONE, [LAST]) == LAST - 2, "another one has it meanwhile"
    full = [one for one in range(1, LAST) if one not in (LAST - 1, LAST - 2)]
    third = LssAddress(9, 9, 9, 9)
    assert ids.choose(third, full) == LAST
    fourth = LssAddress(8, 8, 8, 8)
    assert ids.choose(fourth, [*full, LAST]) == LAST - 1, "the one that came first is forgotten first"
    with pytest.raises(LssFailure, match="there is no free node id for a device"):
        ids.choose(LssAddress(7, 7, 7, 7), range(1, LAST + 1))


class Stubborn(LssSlave):
    def received(self, data: bytes) -> bytes | None:
        return bytes([0x11, 1, 0, 0, 0, 0, 0, 0]) if data[0] == 0x11 else super().received(data)


class Vanishing(LssSlave):
    def received(self, data: bytes) -> bytes | None:
        return None if data[0] == 0x51 and data[6] == 3 else super().received(data)


@pytest.mark.parametrize(
    ("slave", "words"),
    [
        (Stubborn(ONE), r"serial number 7\) does not take the node id 126: error 1"),
        (Vanishing(ONE), "not found to its end"),
    ],
)
def test_a_device_that_does_not_take_its_id_is_told_and_left(slave: LssSlave, words: str) -> None:
    with pytest.raises(LssFailure, match=words):
        ask([slave], LssNodeIds())


async def test_the_simulated_device_is_found_and_configured_by_the_genuine_master() -> None:
    address = f"msbot:{uuid4().hex[:12]}"
    device = UnnumberedDevice(address, ONE, lambda node_id: SimulatedDrive(address, node_id, 7))

    def configure() -> tuple[object, object]:
        network = BridgeNetwork(open_bus(address), lambda _id, _data: None)
        network.connect()
        try:
            network.lss.RESPONSE_TIMEOUT = 0.1  # most questions of a scan have no answer
            found = network.lss.fast_scan()
            while not found[0]:  # on a busy computer an answer may be late
                found = network.lss.fast_scan()
            network.lss.RESPONSE_TIMEOUT = 10.0
            network.lss.configure_node_id(33)
            network.lss.store_configuration()
            node_id = network.lss.inquire_node_id()
            network.lss.send_switch_state_global(network.lss.WAITING_STATE)
            return found, node_id
        finally:
            network.disconnect()

    async with asyncio.timeout(60), in_thread(device.run_in_thread, device.end):
        found, node_id = await asyncio.to_thread(configure)
        assert found == (True, list(ONE))
        assert node_id == 33
        while device.device is None:  # noqa: ASYNC110 - it is another thread's
            await asyncio.sleep(0.02)
        assert device.slave.is_stored


async def test_a_bridge_gives_an_id_to_a_device_that_has_none() -> None:
    link = BridgeLink(f"msbot:{uuid4().hex[:12]}")
    async with running(WORLD.open(link)) as host:
        simulated = WORLD.simulated["io"](link, {"node": "none", "serial": "9"})
        task = asyncio.create_task(simulated.run())
        words = "a device (vendor 0x4d53, product 0x401, serial number 9) has got the node id 126, and keeps it"
        while await host.said.get() != words:
            pass  # on a busy computer an answer may be late: it is searched for again
        device = await host.devices.get()
        assert (device.identity.where, device.identity.unique) == ("node 126", b"1025 9")
        reports = Reports()
        device.begin(reports)
        device.act("out_1", Switch(on=True))
        await reports.until(lambda last: last.get("in_1") == Switch(on=True))
        task.cancel()
        await asyncio.wait([task])


@pytest.mark.parametrize("options", [{"node": "all"}, {"serial": "x"}, {"speed": "1"}])
def test_wrong_options_of_a_simulated_node_are_refused(options: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match="from 1 to 126, or none for one without a node id"):
        WORLD.simulated["io"](BridgeLink("msbot:x"), options)


def test_lss_is_yes_or_no() -> None:
    with pytest.raises(ConfigError, match="write yes or no"):
        WORLD.open(BridgeLink("msbot:x", {"lss": "off"}))
