"""What both ends of a CAN link have in common: the queue before the controller, STOP, bus-off, and the timer.

An end (`CanMasterLink`, `CanPartLink`) owns a `CanPort` and is its `PortOwner`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from typing import Final, Protocol

from msbot_agent.link.can.controller import BusState, CanBus, FrameTap, SelectiveCanBus
from msbot_agent.link.can.protocol.frame_queue import QUEUE_FRAMES, FrameQueue
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.protocol.ids import CanIds, read_stop, stop_frame
from msbot_xrce.errors import LinkDown, LinkFull

PACKET_FRAMES: Final = 2
"""Frames of packets handed to the controller at a time; the rest of its three mailboxes is for urgent frames."""
STOP_TIMES: Final = 3
"""A STOP frame is sent this often, so that one lost frame does not matter."""
STOP_QUIET_S: Final = 0.1
"""STOP frames with one reason that follow each other within this time count as one STOP."""
FIRST_RESTART_S: Final = 0.1
LONGEST_RESTART_S: Final = 5.0
"""Pause before a return from bus-off; it doubles up to the longest until a frame gets through."""
OFF_THE_BUS: Final = (BusState.OFF, BusState.GONE)


class PortOwner(Protocol):
    """One end of a CAN link, as its port sees it."""

    def stopped(self, reason: int, now: float) -> None:
        """A STOP frame came."""

    def frame_received(self, frame: Frame, now: float) -> None:
        """A frame came that is not a STOP."""

    def room_again(self, peer: int) -> None:
        """The queue accepts packets for that peer again."""

    def drained(self, now: float) -> None:
        """All frames have left the controller."""

    def bus_up(self, now: float) -> None:
        """The controller takes part in the bus: after opening, and after each bus-off."""

    def bus_down(self, reason: str, lost_frames: int, now: float) -> None:
        """The controller has left the bus; this many waiting frames are lost."""

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called."""

    def handle_timer(self, now: float) -> None:
        """The timer is due."""


class CanPort:
    """Queue, STOP, bus-off and timer of one end of a CAN link."""

    def __init__(self, bus: CanBus, owner: PortOwner, *, ids: CanIds, queue_frames: int = QUEUE_FRAMES) -> None:
        """Connect an end with its controller."""
        self.bus = bus
        self.queue = FrameQueue(queue_frames)
        self.is_up = False
        """The port runs and the controller takes part in the bus."""
        self.state = BusState.ACTIVE
        """State of the controller, as last reported."""
        self.frame_tap: FrameTap | None = None
        """If set, called with every frame that is handed over or comes in; None costs nothing."""
        self._ignored: Collection[int] = ()
        self._owner = owner
        self._ids = ids
        self._stop_id = ids.stop
        self._ended: asyncio.Future[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._timer_at: float | None = None
        self._restart_pause = FIRST_RESTART_S
        self._restart: asyncio.TimerHandle | None = None
        self._last_stop: tuple[int, float] | None = None
        bus.attach(frame=self._frame, room=self._room, state=self._state)

    def tap(self, tap: FrameTap) -> None:
        """Set `frame_tap`; from now on every frame is wanted."""
        self.frame_tap = tap
        self.ignore(self._ignored)

    def ignore(self, ids: Collection[int]) -> None:
        """The owner does nothing with data frames of these 11-bit identifiers: they need not be passed on."""
        self._ignored = ids
        if isinstance(self.bus, SelectiveCanBus):
            self.bus.ignore(ids if self.frame_tap is None else ())

    def pump(self, now: float) -> None:
        """Hand frames to the controller as long as it has room."""
        bus, queue = self.bus, self.queue
        while self.is_up and not queue.is_empty and bus.has_room():
            frame = queue.next(urgent_only=bus.pending() >= PACKET_FRAMES)
            if frame is None:
                break
            bus.send(frame)
            if self.frame_tap is not None:
                self.frame_tap(now, "here", frame)
        if self.is_up and queue.is_empty and not bus.pending():
            self._owner.drained(now)
        self.tell_room()

    def tell_room(self) -> None:
        """Tell who has room again; off the bus, where nothing can be sent, this waits until it is up."""
        queue = self.queue
        if queue.roomy and self.is_up:
            roomy, queue.roomy = queue.roomy, []
            for peer in roomy:
                self._owner.room_again(peer)

    def send_urgent(self, frames: list[Frame], now: float) -> int:
        """Queue frames before all packets and set the timer again; returns how many found no room."""
        refused = sum(not self.queue.put_urgent(frame) for frame in frames)
        self.pump(now)
        self.arm()
        return refused

    def send_stop(self, reason: int) -> None:
        """Send STOP to every node on the bus.

        Raises:
            LinkDown: the link is not running.
        """
        self.check_up()
        self.queue.put_stop(stop_frame(reason, self._ids), STOP_TIMES)
        self.pump(self.now())

    def check_up(self) -> None:
        """Make sure that the link can send.

        Raises:
            LinkDown: it cannot.
        """
        if not self.is_up:
            state = "is not on the bus" if self._ended is not None else "does not run"
            raise LinkDown(f"link {self.bus.info.name} {state}: nothing can be sent")

    def check_room(self, peer: int, words: str) -> None:
        """Make sure that there is room for a packet to that peer.

        Raises:
            LinkFull: it is not.
        """
        if not self.queue.has_room(peer):
            raise LinkFull(f"the queue to {words} is full: wait for on_room")

    def fail(self, error: LinkDown) -> None:
        """End `run` with this error."""
        if self._ended is not None and not self._ended.done():
            self._ended.set_exception(error)

    def now(self) -> float:
        """The clock of the loop."""
        return asyncio.get_running_loop().time()

    def arm(self) -> None:
        """Set the timer to the time that the owner asks for."""
        at = self._owner.timer() if self.is_up else None
        if at == self._timer_at:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_at = at
        self._timer = None if at is None else asyncio.get_running_loop().call_at(at, self._wake)

    async def run(self) -> None:
        """Serve the controller until cancelled; closes it on the way out.

        Raises:
            LinkDown: the controller cannot be opened or has gone, or the owner has called `fail`.
        """
        loop = asyncio.get_running_loop()
        self._ended = loop.create_future()
        self.state = BusState.ACTIVE
        serving = loop.create_task(self.bus.run())
        try:
            await asyncio.sleep(0)  # let the controller open, or report that it needs longer, before anything is sent
            if not serving.done() and self.state not in OFF_THE_BUS:
                self._go_up(loop.time())
            await asyncio.wait((serving, self._ended), return_when=asyncio.FIRST_COMPLETED)
            for ended in (self._ended, serving):
                if ended.done():
                    ended.result()
            raise LinkDown(f"link {self.bus.info.name}: the controller has closed")
        finally:
            self._forget_restart()
            self._go_down("the link was closed", loop.time())
            ended, self._ended = self._ended, None
            ended.cancel()
            serving.cancel()
            await asyncio.gather(ended, serving, return_exceptions=True)

    def _go_up(self, now: float) -> None:
        if not self.is_up:
            self.is_up = True
            self._owner.bus_up(now)
            self.tell_room()
            self.arm()

    def _go_down(self, reason: str, now: float) -> None:
        if self.is_up:
            self.is_up = False
            lost = self.queue.clear_all()
            self.arm()
            self._owner.bus_down(reason, lost, now)

    def _wake(self) -> None:
        now = self.now() if self._timer_at is None else max(self.now(), self._timer_at)
        self._timer = self._timer_at = None
        self._owner.handle_timer(now)
        self.arm()

    def _frame(self, frame: Frame, now: float) -> None:
        if self.frame_tap is not None:
            self.frame_tap(now, "bus", frame)
        if frame.can_id == self._stop_id:
            reason = read_stop(frame, self._ids)
            if reason is not None:
                self._stop(reason, now)
                return
        self._owner.frame_received(frame, now)

    def _stop(self, reason: int, now: float) -> None:
        last, self._last_stop = self._last_stop, (reason, now)
        if last is None or last[0] != reason or now - last[1] > STOP_QUIET_S:
            self._owner.stopped(reason, now)

    def _room(self, now: float) -> None:
        self._restart_pause = FIRST_RESTART_S
        self.pump(now)

    def _state(self, state: BusState, words: str, now: float) -> None:
        self.state = state
        if self._ended is None:
            return
        if state in OFF_THE_BUS:
            self._go_down(f"{state.value}: {words}", now)
            if state is BusState.OFF:
                self._restart_later()
        else:
            self._forget_restart()
            self._go_up(now)

    def _restart_later(self) -> None:
        if self._restart is None:
            pause, self._restart_pause = self._restart_pause, min(2 * self._restart_pause, LONGEST_RESTART_S)
            self._restart = asyncio.get_running_loop().call_later(pause, self._restart_now)

    def _restart_now(self) -> None:
        self._restart = None
        self.bus.restart()

    def _forget_restart(self) -> None:
        if self._restart is not None:
            self._restart.cancel()
            self._restart = None
