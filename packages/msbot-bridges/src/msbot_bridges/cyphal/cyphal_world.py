"""The bridge's own node on a Cyphal bus: finds nodes, reads their registers, gives node ids and subjects.

Everything is in the event loop, where the library `pycyphal` is at home; only the bus has threads.
"""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from functools import partial
from typing import Final

from msbot_bridges.bridge import World, WorldHost
from msbot_bridges.canbus import open_bus
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.cyphal.data_types import load_types
from msbot_xrce.errors import ConfigError, LinkDown

OWN_ID: Final = 125
"""The two above are left to programs that watch the bus."""


class CyphalWorld(World):
    """All nodes of one bus.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        images: new software for nodes; None: there is none.
    """

    def __init__(self, address: str, images: ImageFolder | None = None) -> None:
        self._address, self._images = address, images

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        try:
            await load_types()
        except ConfigError as error:  # a robot goes on without these devices, and tries again
            raise LinkDown(str(error)) from error
        from msbot_bridges.cyphal.cyphal_bus import CyphalBus

        bus = await asyncio.to_thread(open_bus, self._address)
        ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        node = CyphalBus(bus, self._address, OWN_ID, host, partial(_end, ended), images=self._images)
        try:
            async with nullcontext() if self._images is None else self._images.watched():
                await ended
        except Exception as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            await node.close()


def _end(ended: asyncio.Future[None], error: Exception) -> None:
    if not ended.done():
        ended.set_exception(error)
