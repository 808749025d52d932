"""Serial ports without hardware: pseudo terminals behind names that appear and vanish."""

from __future__ import annotations

import asyncio
import os
import tty
from pathlib import Path

from msbot_agent.link.byte_frames import SerialReceiver, encode_serial


class Board:
    """What sits at the far end of a port: it is plugged in and pulled out, and speaks frames."""

    def __init__(self, port: Path, *, address: int = 1) -> None:
        self.port = str(port)
        self.address = address
        self._receiver = SerialReceiver(address)
        self._heard: list[bytes] = []
        self._ours: int | None = None
        self._wire = -1

    def plug(self) -> None:
        """The port appears."""
        self._ours, self._wire = os.openpty()
        tty.setraw(self._wire)
        os.set_blocking(self._ours, False)
        os.symlink(os.ttyname(self._wire), self.port)

    def pull(self) -> None:
        """The port vanishes."""
        if self._ours is not None:
            os.unlink(self.port)
            os.close(self._wire)
            os.close(self._ours)
            self._ours = None
            self._heard.clear()
            self._receiver = SerialReceiver(self.address)

    def write(self, octets: bytes) -> None:
        """Put octets on the wire."""
        assert self._ours is not None
        os.write(self._ours, octets)

    def say(self, packet: bytes, *, source: int | None = None, destination: int = 0) -> None:
        """Put a frame on the wire."""
        self.write(encode_serial(packet, self.address if source is None else source, destination))

    async def hear(self) -> bytes:
        """The next packet for the board."""
        assert self._ours is not None
        while not self._heard:
            self._heard += [packet for _, packet in self._receiver.receive(await readable(self._ours))]
        return self._heard.pop(0)

    async def read(self) -> bytes:
        """The next octets, whatever they are."""
        assert self._ours is not None
        return await readable(self._ours)


async def readable(descriptor: int) -> bytes:
    """The octets that come next at a descriptor."""
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()
    loop.add_reader(descriptor, ready.set)
    try:
        await ready.wait()
    finally:
        loop.remove_reader(descriptor)
    return os.read(descriptor, 4096)
