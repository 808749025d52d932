"""Restart and new software of nodes: of the library's own on a simulated bus, and the rules without one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from msbot.config import BridgeTable
from msbot.part.messages.standard import Text, Trigger
from msbot.pnp import PartState
from msbot_bridges.bridge import BridgeLink, ForeignDevice
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.canbus.software_update import MOST_S, PIECE, QUIET_S, SoftwareUpdate, SoftwareVersion
from msbot_bridges.dronecan.world import WORLD
from msbot_xrce.errors import CallError, ConfigError
from tests.bridges.hosts import Host, Reports, in_thread, running
from tests.bridges.test_every_world import robot_with

pytest.importorskip("dronecan")

from msbot_bridges.dronecan.simulated_servo import SimulatedServo

GOOD = b"SIMSERVO 1.1 " + bytes(range(256)) * 4
BAD = b"of something else" + bytes(2 * PIECE)


@asynccontextmanager
async def servo(folder: Path) -> AsyncIterator[tuple[SimulatedServo, ForeignDevice, Host]]:
    for name, octets in (("good.bin", GOOD), ("bad.bin", BAD), ("empty.bin", b"")):
        (folder / name).write_bytes(octets)
    bus = f"msbot:{uuid4().hex[:12]}"
    async with running(WORLD.open(BridgeLink(bus, {"software": str(folder)}))) as host:
        simulated = SimulatedServo(bus)
        async with in_thread(simulated.run_in_thread, simulated.end):
            device = await host.devices.get()
            device.begin(Reports())
            yield simulated, device, host


async def test_a_node_is_restarted(tmp_path: Path) -> None:
    async with servo(tmp_path) as (_, device, host):
        assert [one.name for one in device.services] == ["restart", "update"]
        assert device.serve("restart", Trigger(index=1)) == Text(text="node 42 was told to restart")
        assert await host.lost_why.get() == "node 42 has started anew"
        again = await host.devices.get()
        assert again.identity.uid == device.identity.uid


async def test_a_node_takes_new_software_and_says_which_it_has_then(tmp_path: Path) -> None:
    async with servo(tmp_path) as (_, device, host):
        assert device.identity.software == "1.0"
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


async def test_in_a_robot_the_part_says_that_it_is_updated_and_the_log_what_came_of_it(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "good.bin").write_bytes(GOOD)
    bridge = BridgeTable("dronecan", f"msbot:{uuid4().hex[:12]}", {"software": str(tmp_path / "images")})
    number, simulated = "org.msbot:simservo", SimulatedServo(bridge.link)
    async with robot_with(tmp_path, [bridge]) as robot, in_thread(simulated.run_in_thread, simulated.end):
        await robot.until(lambda: (found := robot.part(number)) is not None and found.says is not None)
        await robot.do("adopt", who="ann", part=number, slot="guest")
        await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
        wire = {"topic": "software", "type": "Text -> Text", "from": "guest.update", "to": []}
        await robot.do("bind", who="ann", **wire)
        reply = await robot.do("call", who="ann", port="guest.update", values=["good.bin"])
        assert "node 42 takes new software (good.bin)" in str(reply)
        await robot.until(lambda: not robot.is_in(number, PartState.ACTIVE))
        assert any("node 42 takes new software (good.bin)" in line for line in robot.master.why(number))
        await robot.until(lambda: robot.is_in(number, PartState.ACTIVE))
        lines: list[str] = []
        while not any("node 42 runs software 1.1 from good.bin; it ran 1.0" in line for line in lines):
            outcome = await robot.do("log_lines", who="ann", after=None, last=50, wait=0.0)
            answer: Any = outcome.answer
            lines = [str(line["words"]) for line in answer["lines"]]
            await asyncio.sleep(0.05)
        assert any("software 1.0), node 42" in line for line in lines), "what it had before"
        await robot.until(lambda: (found := robot.part(number)) is not None and found.software == "1.1")
        assert any("its software is 1.1; it was 1.0" in line for line in robot.master.why(number))


async def test_a_wrong_image_ends_with_a_reason(tmp_path: Path) -> None:
    async with servo(tmp_path) as (_, device, host):
        with pytest.raises(CallError, match=r'there is no image "../x"; there are: bad.bin, empty.bin, good.bin'):
            device.serve("update", Text(text="../x"))
        assert device.fault == ""
        device.serve("update", Text(text="empty.bin"))
        device.end()
        assert "has no octets" in await host.said.get()
        await host.until(lambda: "has no octets" in device.remark)
        assert not device.fault
        device.begin(Reports())
        device.serve("update", Text(text="bad.bin"))
        device.end()
        await host.said.get()
        outcome = await host.said.get()
        assert outcome.startswith("node 42 has read bad.bin, and still runs software 1.0: it has not taken it")
        assert (await host.devices.get()).remark == outcome


OLD, NEW = SoftwareVersion(1, 0), SoftwareVersion(1, 0, 0xBEEF)


def update() -> SoftwareUpdate:
    return SoftwareUpdate("node 7", b"u", "x.bin", bytes(2 * PIECE), before=OLD, now=0.0)


def test_an_image_is_read_to_its_end() -> None:
    one = update()
    one.answered(0, "", 1.0)
    assert [len(one.read(at, 2.0)) for at in (0, PIECE, 2 * PIECE)] == [PIECE, PIECE, 0]
    one.runs(NEW)
    assert one.outcome == "node 7 runs software 1.0 (0000beef) from x.bin; it ran 1.0"
    one.runs(OLD)
    assert "0000beef" in one.outcome, "it has ended once"


@pytest.mark.parametrize(
    ("error", "words", "outcome"),
    [
        (None, "", "node 7 has not answered that it takes x.bin"),
        (1, "", "node 7 refuses x.bin: it cannot take it in the state that it is in"),
        (2, "", "node 7 refuses x.bin: it takes another one"),
        (9, "", "node 7 refuses x.bin: error 9"),
        (255, "armed", "node 7 refuses x.bin: armed"),
    ],
)
def test_a_node_may_refuse(error: int | None, words: str, outcome: str) -> None:
    one = update()
    one.answered(error, words, 1.0)
    assert one.outcome == outcome


def test_a_node_that_is_lost_ends_it() -> None:
    one = update()
    one.answered(0, "", 1.0)
    one.read(0, 2.0)
    one.look(2.0 + QUIET_S)
    assert one.outcome == ""
    one.look(2.1 + QUIET_S)
    assert one.outcome == "node 7 has read nothing more of x.bin for 30 s, at 50 %"
    slow = update()
    for second in range(int(MOST_S) + 1):
        slow.read(0, float(second))
    slow.look(MOST_S + 1)
    assert slow.outcome == "node 7 is not done with x.bin after 900 s, at 50 %"


def test_a_node_that_starts_before_it_has_read_all_and_a_boot_loader_with_an_error_end_it() -> None:
    early = update()
    early.read(0, 1.0)
    early.reports(is_ill=True)
    assert early.outcome == "", "it may be ill because it has no software"
    early.runs(OLD)
    assert early.outcome == "node 7 has started again after 50 % of x.bin: it runs software 1.0"
    ill = update()
    ill.read(2 * PIECE, 1.0)
    ill.reports(is_ill=True)
    assert ill.outcome == "node 7 has read x.bin, and does not take it: its boot loader reports an error"


async def test_images_are_those_seen_last_and_reading_one_looks_again(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    images = ImageFolder(folder)
    async with images.watched():
        with pytest.raises(ConfigError, match=r'no image "a\.bin"; there are: none'):
            images.check("a.bin")
        (folder / "a.bin").write_bytes(b"x")
        (folder / ".hidden").write_bytes(b"x")
        with pytest.raises(ConfigError, match=r'no image "a\.bin"'):
            images.check("a.bin")  # it does not wait for the disk
        assert await asyncio.to_thread(images.read, "a.bin") == b"x"
        images.check("a.bin")
        (folder / "b.bin").write_bytes(b"y")
        while True:  # it is looked at again by itself
            try:
                images.check("b.bin")
                break
            except ConfigError as error:
                assert "there are: a.bin" in str(error)  # noqa: PT017 - until it is seen
                await asyncio.sleep(0.05)
    folder.rename(tmp_path / "gone")
    with pytest.raises(ConfigError, match="cannot be read"):
        images.read("a.bin")


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such folder"):
        ImageFolder(tmp_path / "none")
