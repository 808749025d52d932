"""New software for nodes of the genuine library, which read it by the library's own file client."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.part.messages.standard import Text
from msbot.pnp import PartState
from msbot_bridges.bridge import BridgeLink, ForeignDevice
from msbot_bridges.cyphal.world import WORLD
from msbot_xrce.errors import CallError
from tests.bridges.hosts import Host, running
from tests.bridges.test_cyphal import in_the_robot, living
from tests.bridges.test_every_world import robot_with

pytest.importorskip("pycyphal")

GOOD = b"SIMULATED 1.1 " + bytes(range(256)) * 4
NUMBER = "org.msbot:simrange"


def images(folder: Path) -> Path:
    for name, octets in (("good.bin", GOOD), ("bad.bin", b"of something else" + bytes(512)), ("empty.bin", b"")):
        (folder / name).write_bytes(octets)
    return folder


@asynccontextmanager
async def plugged(folder: Path) -> AsyncIterator[tuple[Any, ForeignDevice, Host]]:
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange

    bus = f"msbot:{uuid4().hex[:12]}"
    node = SimulatedRange(bus, 42)
    async with running(WORLD.open(BridgeLink(bus, {"software": str(images(folder))}))) as host, living(node) as pull:
        node.pull = pull  # type: ignore[attr-defined]  # for tests
        device, _ = await in_the_robot(await host.devices.get(), host)
        while not host.said.empty():
            host.said.get_nowait()
        yield node, device, host


async def has_run(node: Any) -> None:
    """A restart is seen by the time since the start, in whole seconds."""
    while node.node.heartbeat_publisher.uptime < 2:  # noqa: ASYNC110 - the library counts it
        await asyncio.sleep(0.05)


async def test_a_node_takes_new_software_and_says_which_it_has_then(tmp_path: Path) -> None:
    async with plugged(tmp_path) as (node, device, host):
        assert [one.name for one in device.services] == ["restart", "update"]
        await has_run(node)
        device.serve("update", Text(text="good.bin"))
        await host.until(lambda: device.fault)
        assert device.fault == "node 42 takes new software (good.bin)", "it leaves its robot"
        assert host.said.empty(), "it is told when it has left"
        device.end()
        assert await host.said.get() == f"node 42 takes good.bin, {len(GOOD):,} octets; it runs software 1.0"
        assert await host.lost_why.get() == "node 42 takes new software (good.bin)"
        outcome = await host.said.get()
        assert outcome == "node 42 runs software 1.1 from good.bin; it ran 1.0"
        again = await host.devices.get()
        assert (again.identity.software, again.remark, again.fault) == ("1.1", outcome, "")
        assert node.software == (1, 1)


async def test_a_wrong_image_or_a_refusal_ends_with_a_reason(tmp_path: Path) -> None:
    async with plugged(tmp_path) as (node, device, host):
        with pytest.raises(CallError, match=r'there is no image "../x"; there are: bad.bin, empty.bin, good.bin'):
            device.serve("update", Text(text="../x"))
        device.serve("update", Text(text="empty.bin"))
        device.end()
        assert "has no octets" in await host.said.get()
        await host.until(lambda: not device.fault)
        assert "has no octets" in device.remark
        taken, node._updating = node._updating, object()
        device.serve("update", Text(text="good.bin"))
        device.end()
        await host.said.get()
        assert await host.said.get() == "node 42 refuses good.bin: it cannot in the state that it is in"
        node._updating = taken
        await has_run(node)
        device.serve("update", Text(text="bad.bin"))
        device.end()
        await host.said.get()
        outcome = await host.said.get()
        assert outcome.startswith("node 42 has read bad.bin, and still runs software 1.0: it has not taken it")
        assert (await host.devices.get()).remark == outcome


async def test_in_a_robot_why_says_what_became_of_a_node_that_dies_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from msbot_bridges.canbus import software_update
    from msbot_bridges.cyphal.data_types import load_types

    await load_types()
    from msbot_bridges.cyphal.simulated.range_finder import SimulatedRange

    class Dying(SimulatedRange):
        async def _take_image(self, server: int, path: str) -> None:
            pull()

    monkeypatch.setattr(software_update, "QUIET_S", 4.0)
    (tmp_path / "images").mkdir()
    bridge = BridgeTable("cyphal", f"msbot:{uuid4().hex[:12]}", {"software": str(images(tmp_path / "images"))})
    async with robot_with(tmp_path, [bridge]) as robot, living(Dying(bridge.link, 42)) as pull:
        await robot.until(lambda: (found := robot.part(NUMBER)) is not None and found.says is not None)
        await robot.do("adopt", who="ann", part=NUMBER, slot="guest")
        await robot.until(lambda: robot.is_in(NUMBER, PartState.ACTIVE))
        wire = {"topic": "software", "type": "Text -> Text", "from": "guest.update", "to": []}
        await robot.do("bind", who="ann", **wire)
        await robot.do("call", who="ann", port="guest.update", values=["good.bin"])
        await robot.until(lambda: not robot.is_in(NUMBER, PartState.ACTIVE))
        words = "node 42 has read nothing of good.bin for 4 s, at 0 %"
        await robot.until(lambda: any(words in line for line in robot.master.why(NUMBER)))
        assert not robot.is_in(NUMBER, PartState.ACTIVE)
