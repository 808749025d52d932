"""CANopen devices that answer wholly wrong: bounded, said, and the others go on."""

from __future__ import annotations

import asyncio
import threading
import time
from random import Random
from typing import Any
from uuid import uuid4

import pytest

from msbot.part.messages.standard import Switch
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.canopen.world import WORLD
from tests.bridges.hosts import Reports, in_thread, running

pytest.importorskip("canopen")

import canopen

import can
from msbot_bridges.canbus import open_bus
from msbot_bridges.canopen import sdo_requests
from msbot_bridges.canopen.canopen_bus import MOST_ANSWERS, BridgeNetwork
from msbot_bridges.canopen.canopen_world import MOST_TOLD
from msbot_bridges.canopen.simulated.io_module import OUTPUTS, SimulatedIo
from msbot_bridges.canopen.simulated.local_device import MOST_OCTETS

LIAR = 9


def lie(bus: str, kind: str, ended: threading.Event) -> None:
    """Be node 9: send heartbeats, and answer each question by SDO wrongly."""
    random, beat_at = Random(kind), 0.0
    with open_bus(bus) as own:

        def send(identifier: int, data: bytes) -> None:
            own.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=10)

        while not ended.is_set():
            if time.monotonic() >= beat_at:
                beat_at = time.monotonic() + 0.1
                send(0x700 + LIAR, b"\x05")
                if kind == "unasked":
                    for _ in range(5):
                        send(0x580 + LIAR, random.randbytes(8))
            asked = own.recv(0.02)
            if asked is None or asked.is_extended_id or asked.arbitration_id != 0x600 + LIAR:
                continue
            match kind, asked.data[0] & 0xE0:
                case "lengths", _:
                    send(0x580 + LIAR, random.randbytes(random.randrange(9)))
                case "aborts", _:
                    send(0x580 + LIAR, b"\x80" + random.randbytes(7))
                case "segments", 0x40:  # so much that it never ends
                    send(0x580 + LIAR, b"\x41" + bytes(asked.data[1:4]) + b"\xff\xff\xff\x7f")
                case "segments", _:
                    send(0x580 + LIAR, bytes([asked.data[0] & 0x10]) + random.randbytes(7))
                case _:
                    send(0x580 + LIAR, random.randbytes(8))


@pytest.mark.timeout(300)
@pytest.mark.parametrize("kind", ["lengths", "aborts", "segments", "unasked"])
@pytest.mark.promise("A CANopen device that answers wrongly keeps no other device from STOP")
async def test_a_device_that_answers_wrongly_is_named_and_the_others_go_on(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sdo_requests, "SET_UP_S", 5.0)
    bus, ended = f"msbot:{uuid4().hex[:12]}", threading.Event()
    world = WORLD.open(BridgeLink(bus))
    async with running(world) as host, in_thread(lambda: lie(bus, kind, ended), ended.set):
        assert f"node {LIAR}" in await host.said.get()
        module = SimulatedIo(bus, 6)
        async with in_thread(module.run_in_thread, module.end):
            device = await host.devices.get()
            assert device.identity.where == "node 6"
            reports = Reports()
            device.begin(reports)
            device.act("out_1", Switch(on=True))
            await reports.until(lambda last: last.get("in_1") == Switch(on=True))
            device.stop()
            await host.until(lambda: not device.not_stopped)
            assert module.get(OUTPUTS) == 0
        said = [host.said.get_nowait() for _ in range(host.said.qsize())]
        assert sum(f"node {LIAR} " in words for words in said) < MOST_TOLD
        network: Any = world._bus._network  # type: ignore[attr-defined]  # of this world
        assert network.nodes[LIAR].sdo.responses.qsize() <= MOST_ANSWERS


@pytest.mark.timeout(300)
async def test_a_device_in_the_robot_that_answers_without_end_holds_up_no_stop() -> None:
    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(WORLD.open(BridgeLink(bus))) as host:
        liar, module = SimulatedIo(bus, 7), SimulatedIo(bus, 6)
        async with in_thread(liar.run_in_thread, liar.end), in_thread(module.run_in_thread, module.end):
            found = {device.identity.where: device for device in [await host.devices.get() for _ in range(2)]}
            device, other = found["node 6"], found["node 7"]
            for each in (device, other):
                reports = Reports()
                each.begin(reports)
                each.act("out_1", Switch(on=True))
                await reports.until(lambda last: last.get("in_1") == Switch(on=True))

            def upload(request: bytes) -> None:
                liar.node.sdo.send_response(b"\x41" + bytes(request[1:4]) + b"\xff\xff\xff\x7f")

            def segment(command: int) -> None:
                time.sleep(0.2)  # as late as is still an answer
                liar.node.sdo.send_response(bytes([command & 0x10]) + b"x" * 7)

            liar.node.sdo.init_upload, liar.node.sdo.segmented_upload = upload, segment
            other.stop()
            device.stop()
            await host.until(lambda: not device.not_stopped)
            assert other.not_stopped == "node 7 has not reported that its outputs have their safe values"
            assert liar.get(OUTPUTS) == 0, "it has the order all the same"


def test_answers_that_nobody_has_asked_for_are_counted_and_left_out() -> None:
    network = BridgeNetwork(None, lambda _id, _data: None)  # type: ignore[arg-type]  # it sends nothing
    node = network.add_node(canopen.RemoteNode(LIAR, canopen.ObjectDictionary()))
    for _ in range(3 * MOST_ANSWERS):
        network.listeners[0].on_message_received(
            can.Message(arbitration_id=0x580 + LIAR, data=bytes(8), is_extended_id=False)
        )
    assert node.sdo.responses.qsize() == MOST_ANSWERS
    assert network.unasked == 2 * MOST_ANSWERS


async def test_whatever_is_written_into_a_simulated_device_does_not_end_it() -> None:
    bus = f"msbot:{uuid4().hex[:12]}"
    module = SimulatedIo(bus, 6)

    def write() -> None:
        random = Random(1)
        with open_bus(bus) as own:

            def send(identifier: int, data: bytes) -> None:
                own.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=10)

            send(0x606, bytes.fromhex("2f001a00c8000000"))  # a PDO with 200 entries
            send(0x606, bytes.fromhex("2300180106020040"))
            send(0x606, bytes.fromhex("2f00160040000000"))
            send(0x606, bytes.fromhex("2300140106020000"))
            send(0x000, b"\x01\x06")
            send(0x606, bytes.fromhex("2000620100000000"))  # a value in pieces that never end
            for number in range(3 * MOST_OCTETS // 7):
                send(0x606, bytes([number % 2 << 4]) + bytes(7))
            for _ in range(300):
                send(random.choice((0x000, 0x606, 0x206, 0x306, 0x7E5)), random.randbytes(random.randrange(9)))
            send(0x000, b"\x80\x06")

    async with asyncio.timeout(120), in_thread(module.run_in_thread, module.end):
        while module.node.nmt.state != "PRE-OPERATIONAL":  # noqa: ASYNC110 - it is in a thread
            await asyncio.sleep(0.02)
        await asyncio.to_thread(write)
        async with running(WORLD.open(BridgeLink(bus))) as host:
            assert (await host.devices.get()).identity.where == "node 6"
        assert len(module.node.sdo._buffer or b"") <= MOST_OCTETS + 7
