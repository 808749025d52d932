"""Simulated parts that stand in for those of a running robot: a slot is simulated, and given back, while it runs.

A stand-in is a simulated part in the master's own process, joined by a link in memory. It claims like any part and is
swapped into its slot; the part that had the slot stands by and gets it back. A second part claims a slot and is
not swapped in: it shows at a robot without hardware how a spare takes over. When the master ends, so do all of them.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
from dataclasses import field

from msbot.config import Library
from msbot.operations.operation import Outcome
from msbot.operations.placement import Placement
from msbot.operations.running_robot import RunningRobot, slot_of
from msbot.pnp import PartInfo, PartState
from msbot.sim import SimulatedPart, make_simulator
from msbot_agent.link import InprocEnd, InprocHub
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

JOIN_S = 5.0
"""Longest time until a stand-in has claimed."""
LOOK_S = 0.02
MOST = 256
"""Most stand-ins of one robot."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _SimulatedReplacement:
    uid: bytes
    library: Library
    number: str
    displaced: bytes = b""
    """The UID of the part that had the slot."""
    unit: SimulatedPart | None = None
    link: InprocEnd | None = None
    task: asyncio.Task[None] | None = field(default=None)


class StandIns:
    """The stand-ins of one robot, by slot."""

    def __init__(self, running: RunningRobot, placement: Placement) -> None:
        self._running = running
        self._placement = placement
        self._hub: InprocHub | None = None
        self._slots: dict[str, _SimulatedReplacement] = {}
        self._second: dict[str, _SimulatedReplacement] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The slots that are simulated."""
        return tuple(self._slots)

    @property
    def uids(self) -> frozenset[bytes]:
        """The UIDs of all simulated parts that run here, second ones too."""
        return frozenset(one.uid for one in (*self._slots.values(), *self._second.values()))

    async def simulate(self, slot: str, end: bool, who: str) -> Outcome:
        """Let a simulated part stand in for that of a slot; or end that, and give the slot back."""
        target = slot_of(self._running, slot)
        return await self._give_back(target, who) if end else await self._begin(target, who)

    async def _begin(self, target: str, who: str) -> Outcome:
        number = self._running.inventory.slots.number_of(target)
        if target in self._slots:
            raise ConfigError(
                said("slot {slot} is simulated already: `msbot simulate {slot} --end` ends it", slot=target)
            )
        library = self._library_with(number)
        holder = self._running.holder(target)
        uid = self._new_uid(b"MsBOT stand-in\0", target)
        stand_in = _SimulatedReplacement(uid, library, number, b"" if holder is None else holder.uid)
        self._slots[target] = stand_in
        try:
            self.plug(target)
            info = await self._claimed(stand_in)
            if info.slot != target or not info.state.is_registered:
                await self._placement.swap(target, stand_in.uid.hex(), who)
        except MsbotError:
            await self._end(target)
            raise
        return Outcome(said("slot {slot} is simulated: `msbot simulate {slot} --end` ends it", slot=target))

    async def _give_back(self, target: str, who: str) -> Outcome:
        stand_in = self._slots.get(target)
        if stand_in is None:
            raise ConfigError(said("slot {slot} is not simulated here", slot=target))
        back = self._running.present_part(stand_in.displaced) if stand_in.displaced else None
        holder = self._running.holder(target)
        if back is not None and holder is not None and holder.uid == stand_in.uid:
            await self._placement.swap(target, back.uid.hex(), who)
        await self._end(target)
        if back is None:
            return Outcome(said("slot {slot} is not simulated any more: plug its part in", slot=target))
        return Outcome(said("slot {slot} is given back to {part}", slot=target, part=back.part))

    # A second part of a slot.

    async def add_second(self, slot: str) -> None:
        """Start a simulated part that claims a slot as a plugged-in part does.

        It takes the slot if that is empty, and otherwise stands by. It is no stand-in: the slot can be simulated as
        well, and then this part waits for it. Nothing happens if the slot has one.

        Raises:
            ConfigError: there is no such slot, its part number is unknown, or the robot does not let the part in.
        """
        target = slot_of(self._running, slot)
        if target in self._second:
            return
        number = self._running.inventory.slots.number_of(target)
        library = self._library_with(number)
        second = _SimulatedReplacement(self._new_uid(b"MsBOT second part\0", target), library, number)
        self._second[target] = second
        try:
            self._start(second, target)
            await self._claimed(second)
        except MsbotError:
            await self.end_second(target)
            raise

    async def end_second(self, slot: str) -> None:
        """End the second part of a slot; nothing happens if there is none."""
        if (second := self._second.pop(slot, None)) is not None:
            await self._ended(second)

    def _library_with(self, number: str) -> Library:
        library = self._running.library
        if library is None or library.find(number) is None:
            raise ConfigError(said("the library does not know {number}: it cannot be simulated", number=number))
        if len(self._slots) + len(self._second) >= MOST:
            raise ConfigError(said("{most} parts are simulated already, which is the most", most=MOST))
        return library

    def _new_uid(self, kind: bytes, slot: str) -> bytes:
        return hashlib.sha256(kind + self._running.master.profile.name.encode() + slot.encode()).digest()[:8]

    # The simulated parts, to be played with.

    def is_plugged(self, slot: str) -> bool:
        """Whether the stand-in of a slot is running."""
        task = self._slots[slot].task
        return task is not None and not task.done()

    def uid(self, slot: str) -> bytes:
        """The UID of the stand-in of a slot, running or not."""
        return self._slots[slot].uid

    def plug(self, slot: str) -> None:
        """Start the stand-in of a slot; nothing happens if it runs."""
        if not self.is_plugged(slot):
            self._start(self._slots[slot], slot)

    def _start(self, stand_in: _SimulatedReplacement, slot: str) -> None:
        if self._hub is None:
            # Not the name of the link of the robot's own services, which may do everything.
            self._hub = InprocHub("simulated here")
            self._running.master.add_link(self._hub.server)
        unit = make_simulator(stand_in.number, uid=stand_in.uid, local_name=slot, library=stand_in.library)
        stand_in.unit = unit
        stand_in.link = self._hub.connect()
        stand_in.task = self._running.loop.create_task(self._run(slot, unit, stand_in.link))

    def unplug(self, slot: str) -> None:
        """Pull the stand-in of a slot out: it says no goodbye, and the robot finds its beats missing."""
        stand_in = self._slots[slot]
        if stand_in.link is not None:
            stand_in.link.pull()
        if stand_in.task is not None:
            stand_in.task.cancel()
        stand_in.unit = stand_in.link = stand_in.task = None

    def simulated(self, slot: str) -> SimulatedPart | None:
        """The stand-in of a slot; None while it is pulled out."""
        return self._slots[slot].unit

    async def _run(self, slot: str, unit: SimulatedPart, link: InprocEnd) -> None:
        try:
            await unit.part.run_async(link)
        except MsbotError as error:
            _log.warning("the stand-in of slot %s has ended: %s", slot, error)

    async def _end(self, slot: str) -> None:
        await self._ended(self._slots.pop(slot))

    async def _ended(self, stand_in: _SimulatedReplacement) -> None:
        if stand_in.unit is not None and stand_in.task is not None:
            stand_in.unit.part.end()
            _, late = await asyncio.wait([stand_in.task], timeout=JOIN_S)
            for task in late:
                task.cancel()

    async def _claimed(self, stand_in: _SimulatedReplacement) -> PartInfo:
        """The stand-in, once the robot has decided about it.

        Raises:
            ConfigError: it has not been let in.
        """
        end_at = self._running.now() + JOIN_S
        while self._running.now() < end_at:
            info = self._running.present_part(stand_in.uid)
            if info is not None and (info.state.is_registered or info.state is PartState.STANDBY):
                return info
            if info is not None and info.state is PartState.REFUSED:
                raise ConfigError(said("the robot does not let a simulated part in: {reason}", reason=info.reason))
            await asyncio.sleep(LOOK_S)
        raise ConfigError(said("the simulated part has not come in within {seconds:g} s", seconds=JOIN_S))
