"""Runs a simulated bus on the event loop's clock, in real or virtual time.

Theory of operation. One timer waits for the bus' next event. When it fires, everything due by now happens in order,
each with its own logical time: a node that answers inside its handler answers at that logical time, so a timer that
fires 2 ms late delays no node on the bus. A frame submitted outside a handler carries the time of the clock.

A bus all of whose nodes are in this process may run a little ahead of the clock: a message, its answer and the
acknowledgement are then one stretch of work, not one after each sleep of the process.
"""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from typing import Final

from msbot_agent.link.can.controller import BusState, CanBusInfo, FrameHandler, FrameTap, RoomHandler, StateHandler
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.events import BusCounters, BusEvent, Delivered, Sent
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
from msbot_xrce.errors import LinkDown

EVENTS_PER_TURN: Final = 256
"""Bus events handled before the event loop gets its turn again, when the bus has fallen behind the clock."""

_STATE_WORDS: Final = {
    BusState.ACTIVE: "the controller is error-active again",
    BusState.PASSIVE: "many frames went wrong: check the wiring, the terminators and the bit rates",
    BusState.OFF: "too many frames went wrong, the controller left the bus: look for a short circuit, "
    "a wrong bit rate or two nodes with one identifier",
    BusState.GONE: "the controller was removed",
}


class SimBusDriver:
    """Runs a `SimBus`, which from now on belongs to this event loop alone."""

    def __init__(self, bus: SimBus, *, name: str = "", ahead_s: float = 0.0) -> None:
        """Take over a bus; the loop is the one that runs when something is first sent.

        Args:
            bus: the bus.
            name: what its nodes call it, as in `sim:NAME`; its bit rate if empty.
            ahead_s: how far the bus may be ahead of the clock. Nodes elsewhere would get frames from the future.
        """
        self.bus = bus
        self._name = name
        self._ahead_s = ahead_s
        self.tap: FrameTap | None = None
        """If set, called with every frame; None costs nothing."""
        self.listeners: list[FrameTap] = []
        """Also called with every frame: for listeners that come and go."""
        self._ports: dict[int, SimCanBus] = {}
        self._by_name: dict[str, SimCanBus] = {}
        self._timer: asyncio.Handle | None = None
        self._timer_at: float | None = None
        self._is_booked = False
        """Whether the timer is due in the next turn of the loop."""
        self._logical: float | None = None
        self._ears: dict[int, list[SimCanBus]] = {}
        """Who takes data frames of an 11-bit identifier, in the order in which they were attached."""

    def attach(self, name: str, *, fd: bool | None = None) -> SimCanBus:
        """Add a controller to the bus, plugged in.

        Args:
            name: unique on this bus, for `plug` and `unplug`.
            fd: whether it supports CAN FD; None = as the bus.

        Raises:
            LinkDown: the name is taken.
        """
        if name in self._by_name:
            raise LinkDown(f"there is a node {name!r} on the simulated bus already")
        bus = self.bus
        node = bus.attach(name, fd=fd)
        with_fd = bus.fd if fd is None else fd
        fast = bus.data_bitrate if with_fd else None
        info = CanBusInfo(f"sim:{self._name or bus.bitrate}", bus.bitrate, fast, with_fd)
        port = self._ports[node] = self._by_name[name] = SimCanBus(self, node, name, info)
        self.forget_ears()
        return port

    def detach(self, name: str) -> None:
        """Silently remove a controller, and its unsent frames; no effect if there is none.

        Its owner can no longer send or hear anything; the name is free for another controller.
        """
        port = self._by_name.get(name)
        if port is not None:
            self.remove(port)

    def remove(self, port: SimCanBus) -> None:
        """Remove this particular controller; no effect if it was removed before."""
        if self._ports.pop(port.node, None) is not None:
            del self._by_name[port.name]
            port.is_attached = False
            self.forget_ears()
            self.bus.detach(port.node, self.now())
            self.arm()

    def unplug(self, name: str) -> None:
        """Cut a node off: it neither hears nor sends.

        Raises:
            KeyError: there is no such node.
        """
        self.bus.unplug(self._by_name[name].node, self.now())
        self.arm()

    def plug(self, name: str) -> None:
        """Connect a node again.

        Raises:
            KeyError: there is no such node.
        """
        self.bus.plug(self._by_name[name].node, self.now())
        self.arm()

    def is_plugged(self, name: str) -> bool:
        """Whether a node is connected.

        Raises:
            KeyError: there is no such node.
        """
        return self.bus.is_plugged(self._by_name[name].node)

    @property
    def counters(self) -> BusCounters:
        """Frames, bits and errors so far."""
        return self.bus.counters

    def load(self) -> float:
        """Busy part of the last second, 0 to 1."""
        return self.bus.load(self.now())

    def short_circuit(self) -> None:
        """Let no node see a dominant bit from now on."""
        self.bus.short_circuit(self.now())
        self.arm()

    def repair(self) -> None:
        """End the short circuit."""
        self.bus.repair(self.now())
        self.arm()

    def break_sender(self, name: str, *, broken: bool) -> None:
        """Let a node send broken frames; no effect if there is none of that name."""
        if name in self._by_name:
            self.bus.break_sender(self._by_name[name].node, broken=broken)

    def now(self) -> float:
        """The logical time inside a handler, else the clock of the loop."""
        return asyncio.get_running_loop().time() if self._logical is None else self._logical

    def arm(self) -> None:
        """Set the timer to the bus' next event; to be called after anything that may have changed it."""
        if self._logical is not None or self._is_booked:
            return  # it is set once everything due has happened
        at = self.bus.next_event_at()
        if at == self._timer_at:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer_at, self._timer = at, None
        if at is None:
            return
        loop = asyncio.get_running_loop()
        if self._ahead_s and at <= loop.time() + self._ahead_s:
            self._is_booked = True
            self._timer = loop.call_soon(self._wake, at)
        else:
            self._timer = loop.call_at(at, self._wake, at)

    def forget_ears(self) -> None:
        """Somebody listens to other frames than before, or in another way."""
        self._ears.clear()

    def _deliver(self, event: Delivered) -> None:
        nodes, frame, at, ports = event.nodes, event.frame, event.at, self._ports
        if frame.extended or frame.remote or frame.error:
            for node in nodes:
                if node in ports:  # otherwise the handler of another node has removed it
                    ports[node].frame_handler(frame, at)
            return
        ears = self._ears.get(frame.can_id)
        if ears is None:
            ears = self._ears[frame.can_id] = [
                port
                for port in ports.values()
                if port.frame_handler is not _ignore_frame and frame.can_id not in port.ignored
            ]
        for port in ears:
            if port.node in nodes and port.is_attached:
                port.frame_handler(frame, at)

    def _wake(self, at: float) -> None:
        due = max(asyncio.get_running_loop().time() + self._ahead_s, at)
        self._timer, self._timer_at, self._is_booked = None, None, False
        bus = self.bus
        turns = EVENTS_PER_TURN
        try:
            while turns and (next_at := bus.next_event_at()) is not None and next_at <= due:
                turns -= 1
                self._logical = next_at
                for event in bus.advance(next_at):
                    self._tell(event)
        finally:
            self._logical = None
            self.arm()

    def _tell(self, event: BusEvent) -> None:
        if isinstance(event, Delivered):
            self._deliver(event)
            return
        sender = self._ports.get(event.node)
        if sender is None:
            return
        if isinstance(event, Sent):
            if self.tap is not None:
                self.tap(event.at, sender.name, event.frame)
            for listener in self.listeners:
                listener(event.at, sender.name, event.frame)
            sender.sent_handler(event.frame, event.at)
            sender.room_handler(event.at)
        else:
            sender.state_handler(event.state, _STATE_WORDS[event.state], event.at)


class SimCanBus:
    """A controller on a simulated bus: a `CanBus`."""

    def __init__(self, driver: SimBusDriver, node: int, name: str, info: CanBusInfo) -> None:
        """Made by `SimBusDriver.attach`."""
        self.info = info
        self.node = node
        self.name = name
        self.is_attached = True
        self.ignored: Collection[int] = ()
        """11-bit identifiers of the frames that its owner does not want."""
        self.frame_handler: FrameHandler = _ignore_frame
        self.sent_handler: FrameHandler = _ignore_frame
        self.room_handler: RoomHandler = _ignore_room
        self.state_handler: StateHandler = _ignore_state
        self._driver = driver

    def attach(
        self,
        *,
        frame: FrameHandler | None = None,
        room: RoomHandler | None = None,
        state: StateHandler | None = None,
        sent: FrameHandler | None = None,
    ) -> None:
        """See `CanBus`; `sent` gets each of its frames that has left the controller, before `room` is called."""
        self.frame_handler = frame or self.frame_handler
        self.room_handler = room or self.room_handler
        self.state_handler = state or self.state_handler
        self.sent_handler = sent or self.sent_handler
        self._driver.forget_ears()

    def ignore(self, ids: Collection[int]) -> None:
        """See `SelectiveCanBus`."""
        self.ignored = ids
        self._driver.forget_ears()

    def has_room(self) -> bool:
        """See `CanBus`."""
        if not self.is_attached:
            return False
        bus = self._driver.bus
        return bus.pending(self.node) < MAILBOXES and bus.state(self.node) is not BusState.OFF

    def pending(self) -> int:
        """See `CanBus`."""
        return self._driver.bus.pending(self.node) if self.is_attached else 0

    def error_counters(self) -> tuple[int, int]:
        """Transmit and receive error counter."""
        return self._driver.bus.error_counters(self.node) if self.is_attached else (0, 0)

    def send(self, frame: Frame) -> None:
        """See `CanBus`."""
        self.send_at(frame, self._driver.now())

    def send_at(self, frame: Frame, at: float) -> None:
        """As `send`, but the frame takes part in arbitration only from that time on, exact to the bit.

        Raises:
            LinkDown, LinkFull: see `send`.
        """
        if not self.is_attached:
            raise LinkDown(f"the controller {self.name!r} was removed from the simulated bus")
        self._driver.bus.submit(self.node, frame, at)
        self._driver.arm()

    def restart(self) -> None:
        """See `CanBus`."""
        if self.is_attached:
            self._driver.bus.restart(self.node, self._driver.now())
            self._driver.arm()

    async def run(self) -> None:
        """Stay on the bus until cancelled; then the controller is removed from it."""
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self._driver.remove(self)


def _ignore_frame(frame: Frame, now: float) -> None:
    """Default handler: frames are ignored."""


def _ignore_room(now: float) -> None:
    """Default handler: nobody waits for room."""


def _ignore_state(state: BusState, words: str, now: float) -> None:
    """Default handler: the state is ignored."""
