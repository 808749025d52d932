"""A `CanBus` over any real adapter: what all adapters have in common.

Theory of operation. An adapter (`socketcan`, `python_can`) opens a `Channel` and reports everything to its owner, this
driver. The driver keeps a bounded ring between the reader and the protocol, holds back the one frame for which a
channel had no room, and looks after the adapter: one that has gone, or whose interface is down, is opened again when it
is back, with a back-off. It reports its states to the port as the simulated bus does.

==============  ===========================  ======================================================
state           goes to                      when
==============  ===========================  ======================================================
GONE            ACTIVE (or OFF)              the adapter is open (again)
ACTIVE          PASSIVE, OFF                 the controller reports it
PASSIVE         ACTIVE, OFF                  the controller reports it
OFF             ACTIVE                       the controller reports that it is back (after `restart`)
any             GONE                         reading or sending says that the adapter has gone
==============  ===========================  ======================================================
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from typing import Final, Protocol

from msbot_agent.link.can.controller import BusState, CanBusInfo, FrameHandler, RoomHandler, StateHandler
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LinkDown, LinkFull

RING_FRAMES: Final = 4096
"""Frames that may wait for the protocol: half a second of a full 1 Mbit/s bus."""
FRAMES_PER_TURN: Final = 256
"""Frames handled before the event loop gets its turn again."""
FIRST_LOOK_S: Final = 0.1
LONGEST_LOOK_S: Final = 1.0
"""Pause between two attempts to open an adapter that has gone; it doubles up to the longest."""
STEADY_S: Final = 5.0
"""After an adapter was open for this long, the pauses begin with the shortest again."""
SAY_AGAIN_S: Final = 60.0
"""The same message about the bus is repeated after this time at the earliest."""
MOST_WORDS: Final = 256
"""How many such messages are remembered."""

RING_FULL: Final = "the computer is too slow for this bus: the receive ring was full"
NOT_OPEN: Final = "opening"

_log = logging.getLogger(__name__)


class Channel(Protocol):
    """An open adapter."""

    def send(self, frame: Frame) -> bool:
        """Hand over a frame; False = no room; the owner is told when there is room. Never blocks, never raises."""

    def pending(self) -> int:
        """Frames handed over that have not left yet; 0 where the adapter cannot tell."""

    def restart(self) -> None:
        """Return to the bus after bus-off; the owner is always told the resulting state."""

    async def close(self) -> None:
        """Release the adapter; the owner gets no further calls."""


class ChannelOwner(Protocol):
    """What a channel reports to; always called in the event loop's thread."""

    def free_slots(self) -> int:
        """How many frames can be taken now; a channel may leave the rest where they are."""

    def take(self, frames: list[Frame], now: float) -> None:
        """Take frames that came in."""

    def room_available(self, channel: Channel, now: float) -> None:
        """A frame has left, or there is room again after `send` said no."""

    def state(self, channel: Channel, state: BusState, words: str, now: float) -> None:
        """The controller is in that state; words say what it means and what to do."""

    def events(self, words: tuple[str, ...], now: float, *, times: int = 1) -> None:
        """Single errors happened on the bus or in the controller; they are counted."""

    def lost(self, channel: Channel, words: str) -> None:
        """The adapter has gone, or its interface is down."""


class Adapter(Protocol):
    """A way to a controller."""

    info: CanBusInfo

    async def open(self, owner: ChannelOwner) -> Channel:
        """Open it.

        Raises:
            LinkDown: it cannot be opened; the text says why, and gives the remedy.
        """


class CanDriver:
    """A real controller. Satisfies `CanBus`."""

    def __init__(self, adapter: Adapter, *, ring_frames: int = RING_FRAMES) -> None:
        """Make the driver; `run` opens the adapter."""
        self.info = adapter.info
        self.dropped = Tally()
        """Frames lost and errors reported, by reason in words; a link shares its own counters here."""
        self._adapter = adapter
        self._channel: Channel | None = None
        self._bus_state = BusState.GONE
        self._held: Frame | None = None
        self._ring: deque[tuple[Frame, float]] = deque()
        self._ring_frames = ring_frames
        self._gone: asyncio.Future[str] | None = None
        self._said: dict[str, float] = {}
        self._frame_handler: FrameHandler = _ignore_frame
        self._room_handler: RoomHandler = _ignore_room
        self._state_handler: StateHandler = _ignore_state
        self._hear_again = False
        self._was_open = False
        self._first_state = (BusState.ACTIVE, "open")

    def attach(
        self,
        *,
        frame: FrameHandler | None = None,
        room: RoomHandler | None = None,
        state: StateHandler | None = None,
    ) -> None:
        """See `CanBus`."""
        self._frame_handler = frame or self._frame_handler
        self._room_handler = room or self._room_handler
        self._state_handler = state or self._state_handler

    def has_room(self) -> bool:
        """See `CanBus`."""
        return self._held is None and self._channel is not None and self._bus_state is not BusState.OFF

    def pending(self) -> int:
        """See `CanBus`."""
        channel = self._channel
        return 0 if channel is None else channel.pending() + (self._held is not None)

    def send(self, frame: Frame) -> None:
        """See `CanBus`.

        Raises:
            LinkFull: the controller has no room.
            LinkDown: the controller is off the bus.
        """
        channel = self._channel
        if channel is None or self._bus_state is BusState.OFF:
            raise LinkDown(f"{self.info.name}: the controller is {self._bus_state.value}")
        if self._held is not None:
            raise LinkFull(f"{self.info.name}: the controller has no room")
        if not channel.send(frame):
            self._held = frame

    def restart(self) -> None:
        """See `CanBus`."""
        if self._channel is not None and self._bus_state is BusState.OFF:
            self._channel.restart()

    async def run(self) -> None:
        """See `CanBus`; an adapter that has gone is opened again when it is back."""
        loop = asyncio.get_running_loop()
        self._bus_state = BusState.GONE
        self._was_open = False
        self._state_handler(BusState.GONE, NOT_OPEN, loop.time())
        try:
            await self._open()
            pause = FIRST_LOOK_S
            while True:
                assert self._gone is not None
                opened_at = loop.time()
                words = await self._gone
                if loop.time() - opened_at >= STEADY_S:
                    pause = FIRST_LOOK_S
                await self._close()
                self._tell(BusState.GONE, words, loop.time())
                pause = await self._reopen(pause)
        finally:
            await self._close()

    async def _reopen(self, pause: float) -> float:
        """Wait until the adapter is back; returns the pause for the next time."""
        while True:
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_LOOK_S)
            try:
                await self._open()
            except LinkDown as error:
                self._say(logging.WARNING, str(error), asyncio.get_running_loop().time())
            else:
                return pause

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        self._gone = loop.create_future()
        self._first_state = (BusState.ACTIVE, "back" if self._was_open else "open")
        self._channel = await self._adapter.open(self)
        self._tell(*self._first_state, loop.time())

    async def _close(self) -> None:
        channel, self._channel = self._channel, None
        self._held = None
        self._ring.clear()
        if channel is not None:
            await channel.close()

    def _tell(self, state: BusState, words: str, now: float) -> None:
        former, self._bus_state = self._bus_state, state
        if BusState.GONE in (former, state):
            self._said.pop(f"{self.info.name}: {words}", None)  # a plug pulled twice is reported twice
        fine = state is BusState.ACTIVE and not self._was_open
        self._was_open = True
        named = f"{state.value}: {words}" if state in (BusState.PASSIVE, BusState.OFF) else words
        self._say(logging.INFO if fine else logging.WARNING, f"{self.info.name}: {named}", now)
        self._state_handler(state, words, now)

    def _say(self, level: int, words: str, now: float) -> None:
        said_at = self._said.get(words)
        if said_at is None or now - said_at >= SAY_AGAIN_S:
            if len(self._said) >= MOST_WORDS:  # an adapter's library may put numbers into its words
                self._said.clear()
            self._said[words] = now
            _log.log(level, "%s", words)

    # What the channel calls (`ChannelOwner`).

    def free_slots(self) -> int:
        """See `ChannelOwner`."""
        return self._ring_frames - len(self._ring)

    def take(self, frames: list[Frame], now: float) -> None:
        """See `ChannelOwner`; frames that do not fit into the ring are counted."""
        if self._hear_again:
            self._hear_again = False
            self._room_handler(now)  # the bus works again, so the port's next pause is a short one
        if not self._ring and len(frames) <= FRAMES_PER_TURN:
            handler = self._frame_handler
            for frame in frames:
                handler(frame, now)
            return
        if not self._ring:
            asyncio.get_running_loop().call_soon(self._work)
        free = self.free_slots()
        if len(frames) > free:
            self.dropped.count(RING_FULL, len(frames) - free)
            frames = frames[:free]
        self._ring.extend([(frame, now) for frame in frames])

    def room_available(self, channel: Channel, now: float) -> None:
        """See `ChannelOwner`."""
        if channel is not self._channel:
            return
        held = self._held
        if held is not None:
            if not channel.send(held):
                return
            self._held = None
        self._room_handler(now)

    def state(self, channel: Channel, state: BusState, words: str, now: float) -> None:
        """See `ChannelOwner`; the first state may come while the channel is being opened."""
        if self._channel is None:
            self._first_state = (state, words)
            return
        if channel is not self._channel:
            return
        if state is BusState.OFF:
            self._held = None
        self._hear_again = self._hear_again or (self._bus_state is BusState.OFF and state is not BusState.OFF)
        self._tell(state, words, now)

    def events(self, words: tuple[str, ...], now: float, *, times: int = 1) -> None:
        """See `ChannelOwner`."""
        for event in words:
            self.dropped.count(event, times)
            self._say(logging.INFO, f"{self.info.name}: {event}", now)

    def lost(self, channel: Channel, words: str) -> None:
        """See `ChannelOwner`."""
        gone = self._gone
        if channel is self._channel and gone is not None and not gone.done():
            gone.set_result(words)

    def _work(self) -> None:
        ring, handler = self._ring, self._frame_handler
        for _ in range(min(FRAMES_PER_TURN, len(ring))):
            frame, at = ring.popleft()
            handler(frame, at)
        if ring:
            asyncio.get_running_loop().call_soon(self._work)


def _ignore_frame(frame: Frame, now: float) -> None:
    """Default handler: frames are ignored."""


def _ignore_room(now: float) -> None:
    """Default handler: nobody waits for room."""


def _ignore_state(state: BusState, words: str, now: float) -> None:
    """Default handler: the state is ignored."""
