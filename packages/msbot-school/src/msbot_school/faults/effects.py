"""What planted faults do to a running robot, and how that is taken back."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from random import Random
from typing import Final, Protocol

from msbot.operations.running_robot import RunningRobot
from msbot.registry import Registry
from msbot.sim import Distortion, SimulatedPart
from msbot_agent.link import InprocHub, Link
from msbot_agent.link.can import BusState
from msbot_agent.link.can.protocol import Frame, frame_bits
from msbot_agent.link.can.sim import SimBusDriver, SimCanBus
from msbot_agent.text.sentence import said
from msbot_xrce.errors import MsbotError

_log = logging.getLogger(__name__)

BABBLER: Final = "babbler"
BABBLE_ID: Final = 0x010
"""After STOP, before everything else that parts and master say."""


class PartsHere(Protocol):
    """Simulated parts in the master's process, by the name of their slot."""

    @property
    def names(self) -> tuple[str, ...]:
        """Their slots."""

    def is_plugged(self, slot: str, /) -> bool:
        """Whether that part is on the wire."""

    def uid(self, slot: str, /) -> bytes:
        """The UID of that part, on the wire or not."""

    def plug(self, slot: str, /) -> object:
        """Plug it in."""

    def unplug(self, slot: str, /) -> object:
        """Pull it out."""

    def simulated(self, slot: str, /) -> SimulatedPart | None:
        """The part; None: it is pulled out, or is one of the thesis' programs."""


class Effect(ABC):
    """What one fault does."""

    @abstractmethod
    def begin(self) -> None:
        """Do it."""

    def sustain(self) -> str:
        """Keep it up, a few times a second; why it is over, if somebody has mended it, else empty."""
        return ""

    @abstractmethod
    def end(self) -> None:
        """Take it back."""


class UnpluggedPart(Effect):
    """A simulated part is pulled out; whoever plugs it in again has mended it."""

    def __init__(self, parts: PartsHere, slot: str) -> None:
        self._parts = parts
        self._slot = slot

    def begin(self) -> None:
        """See `Effect`."""
        self._parts.unplug(self._slot)

    def sustain(self) -> str:
        """See `Effect`."""
        return said("somebody has plugged it in again") if self._parts.is_plugged(self._slot) else ""

    def end(self) -> None:
        """See `Effect`."""
        if self._slot in self._parts.names:
            self._parts.plug(self._slot)


class CombinedEffect(Effect):
    """Several effects as one."""

    def __init__(self, *effects: Effect) -> None:
        self._effects = effects

    def begin(self) -> None:
        """See `Effect`."""
        for effect in self._effects:
            effect.begin()

    def sustain(self) -> str:
        """See `Effect`; what is mended is the whole."""
        return next((words for effect in self._effects if (words := effect.sustain())), "")

    def end(self) -> None:
        """See `Effect`."""
        for effect in reversed(self._effects):
            effect.end()


class GuestPartHub:
    """The link in memory by which parts come in that the fault lab plugs in itself.

    Args:
        running: the robot.
    """

    def __init__(self, running: RunningRobot) -> None:
        self.loop = running.loop
        self._running = running
        self._hub: InprocHub | None = None

    def connect(self) -> Link:
        """A link for one more."""
        if self._hub is None:
            self._hub = InprocHub("memory")  # a plain name: who is to find the fault may read it
            self._running.master.add_link(self._hub.server)
        return self._hub.connect()


class UnexpectedPart(Effect):
    """A simulated part that should not be there.

    Args:
        guests: where it comes in.
        unit: the part.
    """

    def __init__(self, guests: GuestPartHub, unit: SimulatedPart) -> None:
        self._guests = guests
        self._unit = unit
        self._task: asyncio.Task[None] | None = None

    def begin(self) -> None:
        """See `Effect`."""
        self._task = self._guests.loop.create_task(self._run())

    def end(self) -> None:
        """See `Effect`."""
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        try:
            await self._unit.part.run_async(self._guests.connect())
        except MsbotError as error:
            _log.warning("a part that the fault lab has plugged in has ended: %s", error)


class DistortedReadings(Effect):
    """A simulated part says something else than its sensor shows.

    Args:
        parts: the simulated parts.
        slot: the slot of the part.
        distortion: what it says instead.
    """

    def __init__(self, parts: PartsHere, slot: str, distortion: Distortion) -> None:
        self._parts = parts
        self._slot = slot
        self._distortion = distortion

    def begin(self) -> None:
        """See `Effect`."""
        self.sustain()

    def sustain(self) -> str:
        """Follow the part: it is another object after it was plugged in again."""
        unit = self._parts.simulated(self._slot) if self._slot in self._parts.names else None
        if unit is not None:
            unit.distort = self._distortion
        return ""

    def end(self) -> None:
        """See `Effect`."""
        unit = self._parts.simulated(self._slot) if self._slot in self._parts.names else None
        if unit is not None and unit.distort is self._distortion:
            unit.distort = None


class BitErrors(Effect):
    """Bits of a simulated bus are inverted, for all nodes."""

    def __init__(self, driver: SimBusDriver, rate: float, random: Random) -> None:
        self._driver = driver
        self._rate = rate
        self._random = random

    def begin(self) -> None:
        """See `Effect`."""
        self._driver.bus.set_bit_error_rate(self._rate, self._random)

    def end(self) -> None:
        """See `Effect`."""
        self._driver.bus.set_bit_error_rate(0.0)


class BrokenSender(Effect):
    """A node of a simulated bus sends broken frames; its own controller takes it off the bus for that."""

    def __init__(self, driver: SimBusDriver, node: str) -> None:
        self._driver = driver
        self._node = node

    def begin(self) -> None:
        """See `Effect`."""
        self.sustain()

    def sustain(self) -> str:
        """Follow the node: it is another controller after it was plugged in again."""
        self._driver.break_sender(self._node, broken=True)
        return ""

    def end(self) -> None:
        """See `Effect`."""
        self._driver.break_sender(self._node, broken=False)


class BabblingNode(Effect):
    """One more node on a simulated bus sends and sends.

    Args:
        driver: the bus.
        share: part of the bus time that its frames take, 0 to 1.
    """

    def __init__(self, driver: SimBusDriver, share: float) -> None:
        self._driver = driver
        self._share = share
        self._frame = Frame(BABBLE_ID, b"\x55" * 8)
        self._pause_s = 0.0
        self._port: SimCanBus | None = None

    def begin(self) -> None:
        """See `Effect`."""
        bits = frame_bits(self._frame)
        self._pause_s = bits.seconds(self._driver.bus.bitrate) * (1 / self._share - 1)
        self._port = self._driver.attach(BABBLER)
        self._port.attach(sent=self._sent, state=self._state)
        self._port.send(self._frame)

    def end(self) -> None:
        """See `Effect`."""
        self._port = None
        self._driver.detach(BABBLER)

    def _sent(self, frame: Frame, now: float) -> None:
        if self._port is not None:
            self._port.send_at(frame, now + self._pause_s)

    def _state(self, state: BusState, words: str, now: float) -> None:  # noqa: ARG002 - what every controller is told
        """Errors take it off the bus, too; it comes back, and has lost the frame that it was sending."""
        if self._port is None:
            return
        if state is BusState.OFF:
            self._port.restart()
        elif state is BusState.ACTIVE and not self._port.pending():
            self._port.send(self._frame)


class DatabaseUnavailable(Effect):
    """The database answers nobody."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry

    def begin(self) -> None:
        """See `Effect`."""
        self._registry.storage.break_off(broken=True)

    def end(self) -> None:
        """See `Effect`."""
        self._registry.storage.break_off(broken=False)
