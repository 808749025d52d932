"""A bridge's process stands still or is killed between STOP and its confirmation, and while its part is adopted."""

from __future__ import annotations

import os
import signal
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from msbot.pnp import PartState
from msbot_agent.link import open_link
from tests.bridges.test_every_world import Plug, robot_with
from tests.e2e.processes import Process
from tests.e2e.test_processes import free_port

WORLDS = [
    ("mqtt", "lamp", "simulated:lamp"),
    ("canopen", "drive", "vendor-0x4d53:SimDrive"),
    ("cyphal", "servo", "org.msbot:simcyphalservo"),
    ("dronecan", "servo", "org.msbot:simservo"),
    ("modbus", "devices", "ACME:pump"),
]
GONE = (PartState.LOST, PartState.LEFT)


@pytest.mark.promise("Only a part itself confirms STOP")
@pytest.mark.parametrize(
    ("world", "device", "number"),
    WORLDS if os.environ.get("MSBOT_THOROUGH") else WORLDS[:2],
)
async def test_a_bridge_that_is_killed_before_its_device_has_stopped_leaves_it_named(
    world: str, device: str, number: str, tmp_path: Path
) -> None:
    pytest.importorskip({"cyphal": "pycyphal", "mqtt": "aiomqtt", "modbus": "pymodbus"}.get(world, world))
    async with AsyncExitStack() as stack:
        plug = Plug(world, device, tmp_path, stack)
        robot = await stack.enter_async_context(robot_with(tmp_path, []))
        address = f"udp:127.0.0.1:{free_port()}"
        robot.master.add_link(open_link(address, serve=True))
        words = ["bridge", world, "--link", plug.bridge.link, "--robot-link", address]
        words += [word for pair in plug.bridge.options.items() for word in ("--option", "=".join(pair))]

        def start() -> Process:
            return Process(*words, cwd=tmp_path)

        await plug.put_in()
        stack.push_async_callback(plug.pull_out)
        bridge = start()
        try:
            await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
            bridge.send(signal.SIGSTOP)  # while a person adopts its device
            await robot.do("adopt", who="ann", part=number, slot="guest")
            bridge.end(signal.SIGKILL)
            await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
            bridge = start()
            await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))

            bridge.send(signal.SIGSTOP)
            await robot.do("stop", who="ann", reason="")
            assert robot.master.stop.silent == (number,)
            await robot.until(lambda: robot.is_in(number, *GONE))
            assert robot.master.stop.silent == (number,)
            bridge.end(signal.SIGKILL)
            bridge = start()
            await robot.until(lambda: {one.part for one in robot.master.stop.confirmed} == {number})
            await robot.until(lambda: not robot.master.stop.silent)
        except BaseException:
            print("\n".join(bridge.lines), robot.master.why(number))
            raise
        finally:
            bridge.end(signal.SIGKILL)
