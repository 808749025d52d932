"""What a user does to an interface: forgets it, takes it down, pulls the adapter out, and puts all of it right."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace
from pathlib import Path

import pytest

from msbot.part import JoinState
from msbot_agent.link import Link, Signal, open_link
from msbot_agent.link.can import BusState
from msbot_agent.link.can.protocol import Frame
from msbot_xrce.errors import LinkDown
from tests.socketcan.bus import SETTINGS, add_vcan, ip, listening, running, until
from tests.socketcan.test_robot import RING, robot_on

pytestmark = pytest.mark.usefixtures("vcan0")


def ends() -> tuple[Link, Link]:
    """A master and a part on vcan0."""
    return open_link("can:vcan0", serve=True, can=SETTINGS), open_link(
        "can:vcan0", can=replace(SETTINGS, uid=b"12345678")
    )


async def refusal(address: str) -> str:
    """Why that link does not open."""
    with pytest.raises(LinkDown) as refused:
        await open_link(address, serve=True, can=SETTINGS).run()
    return str(refused.value)


async def test_an_interface_that_is_not_there_is_told_with_the_commands_that_make_it() -> None:
    text = await refusal("can:vcan7")
    assert "there is no interface vcan7 (there are: vcan0, vcan1)" in text
    assert "`sudo ip link add dev vcan7 type vcan && sudo ip link set vcan7 mtu 72 up`" in text
    text = await refusal("can:can0?bitrate=250000")
    assert "`sudo ip link set can0 up type can bitrate 250000`" in text


async def test_the_commands_that_are_told_work(tmp_path: Path) -> None:
    """Word for word, up to the robot on the bus that they have made."""
    for text in (await refusal("can:vcan7"), ""):
        commands = text.partition("`")[2].partition("`")[0] or "sudo ip link delete vcan7"
        for command in commands.split(" && "):
            ip(command.removeprefix("sudo ip link "))
        if text:
            async with robot_on("can:vcan7?fd=1", tmp_path, "AA") as robot:
                await robot.until_active()


async def test_an_interface_that_is_down_is_told_with_the_command_that_brings_it_up() -> None:
    ip("set vcan0 down")
    text = await refusal("can:vcan0")
    assert "the interface vcan0 is down: `sudo ip link set vcan0 mtu 72 up` brings it up" in text
    ip("set vcan0 mtu 16")
    ip("set vcan0 up")
    assert "takes classic frames only (mtu 16)" in await refusal("can:vcan0?fd=1")
    assert "lo is no CAN interface" in await refusal("can:lo")


async def test_an_interface_that_goes_down_and_up_again_is_used_again(caplog: pytest.LogCaptureFixture) -> None:
    master, part = ends()
    with caplog.at_level(logging.WARNING):
        async with running(master, part) as (top, end):
            for times in (1, 2):
                ip("set vcan0 down")
                assert "the interface vcan0 is down" in await top.until_told(Signal.LINK_DOWN, times)
                await end.until_told(Signal.LINK_DOWN, times)
                ip("set vcan0 up")
                await end.until_told(Signal.LINK_UP, times + 1)
                await end.send_all([bytes(500)], 0)
                await top.until_packets(times)
    assert sum("sudo ip link set vcan0 mtu 72 up" in record.message for record in caplog.records) >= 2


async def test_an_adapter_that_is_pulled_out_and_plugged_in_again_is_used_again() -> None:
    """The kernel makes a new interface of the same name, as it does for a USB adapter."""
    master, part = ends()
    async with running(master, part) as (top, end):
        ip("delete vcan0")
        for one in (top, end):
            assert "vcan0" in await one.until_told(Signal.LINK_DOWN)
        add_vcan("vcan0")
        for one in (top, end):
            await one.until_told(Signal.LINK_UP, 2)
        await end.send_all([bytes(500)], 0)
        await top.until_packets(1)


async def test_a_robot_is_whole_again_after_its_interface_was_down(tmp_path: Path) -> None:
    async with robot_on("can:vcan0", tmp_path, *RING) as robot:
        await robot.until_active()
        ip("set vcan0 down")
        await until(lambda: all(part.state is not JoinState.ACTIVE for part in robot.parts.values()))
        ip("set vcan0 up")
        await robot.until_active()
        await robot.until_turning()


async def test_more_frames_than_a_socket_takes_at_once_arrive_in_order() -> None:
    """The send buffer fills (EAGAIN); what waits goes on by itself."""
    async with listening("can:vcan0") as ear, listening("can:vcan0") as mouth:
        frames = [Frame(0x123, number.to_bytes(4, "big")) for number in range(3000)]
        for frame in frames:
            await mouth.send(frame)
        assert await ear.heard(3000) == frames
        assert mouth.states[-1][0] is BusState.ACTIVE
        assert ear.bus.dropped == mouth.bus.dropped == {}


async def test_a_queue_of_the_interface_that_is_full_delays_frames_and_loses_none() -> None:
    """A slow bus with a queue of three frames: Linux refuses more (ENOBUFS), and tells nobody when there is room."""
    async with listening("can:vcan0") as ear, listening("can:vcan0") as mouth:
        tool = await asyncio.create_subprocess_shell("tc qdisc replace dev vcan0 root netem rate 500kbit limit 3")
        assert await tool.wait() == 0
        frames = [Frame(0x123, number.to_bytes(4, "big")) for number in range(300)]
        for frame in frames:
            await mouth.send(frame)
        assert await ear.heard(300) == frames
        assert mouth.states[-1][0] is BusState.ACTIVE
        assert ear.bus.dropped == mouth.bus.dropped == {}
