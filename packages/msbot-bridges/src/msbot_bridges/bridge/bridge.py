"""Runs one world: a part for each device that is there."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping

from msbot.part import Message, Part
from msbot.part.join.pnp_messages import Nature
from msbot_agent.link import Link
from msbot_bridges.bridge.bridged_part import BridgedPart
from msbot_bridges.bridge.contract import MOST_DEVICES, ForeignDevice, World
from msbot_bridges.bridge.leaving import LEAVE_S
from msbot_xrce.lazy import dataclass

END_S = LEAVE_S + 8.0
"""Longest wait for parts to end: longer than one waits for its device, and then until its trouble is acknowledged."""

_log = logging.getLogger("msbot.part")


@dataclass(slots=True)
class _Running:
    bridged: BridgedPart
    task: asyncio.Task[None]


class Bridge:
    """Brings the devices of a world into a robot; is the `WorldHost` of that world.

    Args:
        world: finds the devices.
        connect: makes a link to the master for a part.
        prepare: gives a part its key before it runs.
        nature: what is behind the parts: hardware, unless all devices are simulated.
        unsafe: devices that were driven when they got out of reach, by UID, with the safe values of their ports; it is
            kept for the next bridge to the same world.
    """

    def __init__(
        self,
        world: World,
        connect: Callable[[Part], Link],
        prepare: Callable[[Part], None] = lambda _: None,
        nature: Nature = Nature.REAL,
        unsafe: dict[bytes, Mapping[str, Message]] | None = None,
    ) -> None:
        self._unsafe = {} if unsafe is None else unsafe
        self._world = world
        self._connect = connect
        self._prepare = prepare
        self._nature = nature
        self._running: dict[bytes, _Running] = {}
        self._leaving: set[asyncio.Task[None]] = set()
        self._explaining: dict[bytes, asyncio.Task[None]] = {}
        """Of devices that are gone."""
        self._ended = asyncio.Event()
        self._told_full = False

    @property
    def parts(self) -> list[BridgedPart]:
        """The parts that run now, in the order in which their devices were found."""
        return [one.bridged for one in self._running.values()]

    def end(self) -> None:
        """End cleanly."""
        self._ended.set()

    async def run(self) -> None:
        """Run until `end`; raises what the world raises.

        Raises:
            ConfigError: the network cannot be used.
            LinkDown: the network has ended.
        """
        finding = asyncio.create_task(self._world.run(self))
        ending = asyncio.create_task(self._ended.wait())
        try:
            await asyncio.wait([finding, ending], return_when=asyncio.FIRST_COMPLETED)
        finally:
            # The parts end first: they make their devices safe, for which the world must still run.
            why = _why_ended(finding)
            for one in list(self._running.values()):
                self._leave(one, why)
            if self._leaving:
                _, late = await asyncio.wait(self._leaving, timeout=END_S)
                for task in late:
                    task.cancel()
            for task in self._explaining.values():
                task.cancel()
            ending.cancel()
            finding.cancel()
            await asyncio.wait([finding, ending])
        if not finding.cancelled() and (error := finding.exception()) is not None:
            raise error

    # What the world tells

    def found(self, device: ForeignDevice) -> None:
        """See `WorldHost`."""
        uid = device.identity.uid
        other = self._running.pop(uid, None)
        if other is not None:
            self._leave(other, "the device has started anew")
        if len(self._running) >= MOST_DEVICES:
            if not self._told_full:
                self._told_full = True
                _log.warning("there are more than %d devices; further ones become no parts", MOST_DEVICES)
            return
        bridged = BridgedPart(device, self._prepare, self._nature)
        _log.info("%s: %s", bridged.name, device.identity.description)
        if bridged.left_out:
            names = ", ".join(bridged.left_out[:5]) + (", ..." if len(bridged.left_out) > 5 else "")
            _log.warning("%s: %d settings left out for want of room: %s", bridged.name, len(bridged.left_out), names)
        before = self._explaining.get(uid) if other is None else other.task
        self._running[uid] = _Running(bridged, asyncio.create_task(self._run(bridged, before), name=uid.hex()))

    def lost(self, device: ForeignDevice, why: str) -> None:
        """See `WorldHost`."""
        one = self._running.get(device.identity.uid)
        if one is not None and one.bridged.device is device:
            del self._running[device.identity.uid]
            _log.warning("%s: %s", one.bridged.name, why)
            self._leave(one, why)

    def explain(self, device: ForeignDevice, why: str) -> None:
        """See `WorldHost`."""
        uid = device.identity.uid
        if uid in self._running or uid in self._explaining:
            return  # it is there again

        async def tell() -> None:
            # What is left of the part that was lost leaves first.
            if leaving := [task for task in self._leaving if task.get_name() == uid.hex()]:
                await asyncio.wait(leaving)
            await BridgedPart(device, self._prepare, self._nature).explain(self._connect, why)

        task = self._explaining[uid] = asyncio.create_task(tell())
        task.add_done_callback(lambda _: self._explaining.pop(uid, None))

    def news(self, device: ForeignDevice) -> None:
        """See `WorldHost`."""
        one = self._running.get(device.identity.uid)
        if one is not None and one.bridged.device is device:
            one.bridged.news()

    def warn(self, device: ForeignDevice, words: str) -> None:
        """See `WorldHost`."""
        one = self._running.get(device.identity.uid)
        if one is not None and one.bridged.device is device:
            _log.warning("%s: %s", one.bridged.name, words)
            one.bridged.part.log(words, level="warning")

    def say(self, words: str) -> None:
        """See `WorldHost`."""
        _log.info("%s", words)

    def _leave(self, one: _Running, why: str) -> None:
        self._leaving.add(one.task)
        one.task.add_done_callback(self._leaving.discard)
        one.bridged.end(why)
        self._keep_unsafe(one.bridged)

    def _keep_unsafe(self, bridged: BridgedPart) -> None:
        """Its device may be found again before the part has said goodbye."""
        unsafe, bridged.unsafe = bridged.unsafe, None
        if unsafe is not None:
            self._unsafe[bridged.device.identity.uid] = unsafe
            while len(self._unsafe) > MOST_DEVICES:
                del self._unsafe[next(iter(self._unsafe))]

    async def _run(self, bridged: BridgedPart, before: asyncio.Task[None] | None) -> None:
        bridged.unsafe = self._unsafe.pop(bridged.device.identity.uid, None)
        try:
            await bridged.run(self._connect, before)
        finally:
            self._keep_unsafe(bridged)
            self._world.left(bridged.device)


def _why_ended(finding: asyncio.Task[None]) -> str:
    """Why no device can be reached any more; empty: they can."""
    if not finding.done() or finding.cancelled():
        return ""
    error = finding.exception()
    return "the bridge to it has ended" if error is None else f"the bridge to it has ended: {error}"
