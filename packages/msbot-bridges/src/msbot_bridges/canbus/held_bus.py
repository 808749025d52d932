"""A simulated bus that is there before its simulated devices, and after them.

A bridge and its devices come and go one by one. Whoever is alone on a bus gets no acknowledgement, and its controller
says that something is wrong with the wiring. And the process that has opened a simulated bus first serves it: with a
device that is pulled out the bus would go. So the process that starts them all holds the bus, as one more controller
that acknowledges and says nothing.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Final

from msbot_bridges.canbus.bus import open_bus

if TYPE_CHECKING:
    import can

SIMULATED: Final = "msbot"
"""The interface of python-can that is a simulated bus."""
LOOK_S: Final = 0.2


@asynccontextmanager
async def held_bus(address: str) -> AsyncIterator[None]:
    """The bus is there as long as the block runs.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can; nothing is done unless the bus is a simulated one.

    Raises:
        LinkDown: it cannot be opened.
    """
    if address.partition(":")[0] != SIMULATED:
        yield
        return
    bus = await asyncio.to_thread(open_bus, address)
    ended = threading.Event()
    reading = threading.Thread(target=_read, args=(bus, ended), name=f"holds {address}", daemon=True)
    reading.start()
    try:
        yield
    finally:
        ended.set()
        await asyncio.to_thread(_close, bus, reading)


def _read(bus: can.BusABC, ended: threading.Event) -> None:
    """What is not read would fill the room for frames."""
    from can import CanError

    try:
        while not ended.is_set():
            bus.recv(LOOK_S)
    except CanError:
        return  # the bus has ended: its bridge says so


def _close(bus: can.BusABC, reading: threading.Thread) -> None:
    reading.join()
    bus.shutdown()
