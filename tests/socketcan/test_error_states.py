"""Error frames of the kernel, from an adapter that we play ourselves: the states in words, and the way back (R39).

slcan is the kernel's driver for serial adapters. The far end of its terminal is ours, so the "adapter" can report any
error counters; what the driver makes of them are the error frames that every real controller gives.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import struct
import subprocess
import termios
import tty
from collections.abc import Iterator
from dataclasses import replace

import pytest

from msbot_agent.link import Signal, open_link
from msbot_agent.link.can import BusState, CanMasterLink
from msbot_agent.link.can.protocol import Frame
from tests.socketcan.bus import SETTINGS, ip, listening, running, until

N_SLCAN = 17
SIOCGIFNAME = 0x8910
WARNING, PASSIVE, BUS_OFF, ACTIVE = b"sw100096\r", b"sp000130\r", b"sb000255\r", b"sa000000\r"
"""State lines of an adapter: the state, transmit errors, receive errors."""


class Adapter:
    """A serial CAN adapter."""

    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        tty.setraw(self._ours)
        fcntl.ioctl(self._theirs, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        self.name = fcntl.ioctl(self._theirs, SIOCGIFNAME, bytes(32)).split(b"\0")[0].decode()
        self.lines: list[bytes] = []
        self._rest = b""

    async def open(self) -> None:
        """Bring the interface up; the driver waits until the adapter has read its commands."""
        asyncio.get_running_loop().add_reader(self._ours, self._read)
        await self.set("up type can bitrate 250000")

    async def set(self, words: str) -> None:
        """Change the interface as `ip link set` does.

        The driver gives the adapter, which is in this process, a second to take each command. Where the computer stood
        still for longer, it is asked again.
        """
        for _ in range(4):
            with contextlib.suppress(subprocess.CalledProcessError):
                return await asyncio.to_thread(ip, f"set {self.name} {words}")
        return await asyncio.to_thread(ip, f"set {self.name} {words}")

    def say(self, line: bytes) -> None:
        """Report something to the driver."""
        os.write(self._ours, line)

    def pull(self) -> None:
        """Pull it out."""
        asyncio.get_running_loop().remove_reader(self._ours)
        os.close(self._ours)
        self._ours = -1

    def close(self) -> None:
        """Take it away for good."""
        if self._ours >= 0:
            os.close(self._ours)
        os.close(self._theirs)

    def _read(self) -> None:
        *lines, self._rest = (self._rest + os.read(self._ours, 4096)).split(b"\r")
        for line in lines:
            self.lines.append(line)
            if line[:1] in b"tT":
                os.write(self._ours, b"z\r" if line[:1] == b"t" else b"Z\r")


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    made = Adapter()
    yield made
    made.close()


async def test_frames_travel_over_a_serial_adapter_whose_bit_rate_the_kernel_knows(adapter: Adapter) -> None:
    await adapter.open()
    async with listening(f"can:{adapter.name}?bitrate=250000") as ear:
        assert ear.bus.info.bits_per_second == 250_000
        await ear.send(Frame(0x123, b"\xab"))
        await until(lambda: b"t1231AB" in adapter.lines)
        adapter.say(b"t32125A5A\r")
        assert await ear.heard(1) == [Frame(0x321, b"\x5a\x5a")]


async def test_a_bit_rate_other_than_the_interface_has_is_refused_with_the_command(adapter: Adapter) -> None:
    await adapter.open()
    with pytest.raises(Exception, match=f"runs at a bit rate of 250000, the address says 500000.*{adapter.name} up"):
        async with listening(f"can:{adapter.name}?bitrate=500000"):
            pass


async def test_the_states_of_the_controller_are_told_in_words(adapter: Adapter) -> None:
    await adapter.open()
    async with listening(f"can:{adapter.name}") as ear:
        for line, state, words in (
            (WARNING, BusState.ACTIVE, "some frames go wrong"),
            (PASSIVE, BusState.PASSIVE, "many frames go wrong"),
            (ACTIVE, BusState.ACTIVE, "well again"),
            (PASSIVE, BusState.PASSIVE, "terminators"),
            (BUS_OFF, BusState.OFF, "short circuit"),
        ):
            before = len(ear.states)
            adapter.say(line)
            await until(lambda before=before: len(ear.states) > before)  # type: ignore[misc]
            assert ear.states[-1][0] is state
            assert words in ear.states[-1][1]
        assert ear.frames == []  # reports are no frames of the bus


async def test_error_frames_are_shown_to_tools_that_ask_for_them(adapter: Adapter) -> None:
    await adapter.open()
    async with listening(f"can:{adapter.name}", error_frames=True) as ear:
        adapter.say(PASSIVE)
        (frame,) = await ear.heard(1)
        assert frame.error


async def test_a_link_leaves_the_bus_at_bus_off_and_comes_back_when_the_user_restarts_it(
    adapter: Adapter, caplog: pytest.LogCaptureFixture
) -> None:
    """The driver of serial adapters cannot restart by itself: down and up does it, as the words say."""
    await adapter.open()
    part = open_link(f"can:{adapter.name}", can=replace(SETTINGS, uid=b"12345678"))
    master = open_link(f"can:{adapter.name}", serve=True, can=SETTINGS)
    async with running(master) as (end,):
        adapter.say(BUS_OFF)
        assert "bus-off" in await end.until_told(Signal.LINK_DOWN)
        advice = f"sudo ip link set {adapter.name} down && sudo ip link set {adapter.name} up"
        await until(lambda: any(advice in record.message for record in caplog.records))
        assert isinstance(master, CanMasterLink)
        assert master.bus_state is BusState.OFF
        await adapter.set("down")
        await adapter.set("up")
        await end.until_told(Signal.LINK_UP, 2)
        async with running(part) as (other,):
            await other.send_all([b"\x81 a message of a part"], 0)
            await end.until_packets(1)


async def test_an_adapter_that_is_pulled_out_is_gone_in_words(adapter: Adapter) -> None:
    await adapter.open()
    async with listening(f"can:{adapter.name}") as ear:
        adapter.pull()
        await until(lambda: ear.states[-1][0] is BusState.GONE)
        assert adapter.name in ear.states[-1][1]
