"""Runs a relay: a link of parts, a link to the master, and the state between them (`forwarder.py`)."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable
from typing import Final, Protocol, runtime_checkable

from msbot_agent.link.contract import Link, Peer, Signal
from msbot_agent.link.relay.forwarder import (
    Forwarder,
    ForwarderEvent,
    MasterBack,
    MasterSilent,
    StopSaid,
    Welcomed,
)
from msbot_agent.link.relay.relay_messages import BOOT_SIZE, Refused, RelayEventKind
from msbot_agent.process.end_signals import ungrouped
from msbot_xrce.errors import ConfigError, LinkDown, LinkError, LinkFull

SMALLEST_WAY: Final = 256
"""Octets that a packet to the master must be able to have."""
AGAIN_S: Final = 1.0
"""Pause before a way to the master that could not be opened is tried again."""
TOO_LONG: Final = "packet longer than the way to the master carries"
NOT_SENT: Final = "packet that a link did not take"

_HAPPENED: Final = {
    Signal.PEER_JOINED: RelayEventKind.CAME,
    Signal.PEER_GONE: RelayEventKind.GONE,
    Signal.PEER_BACK: RelayEventKind.BACK,
}


@runtime_checkable
class _StoppableLink(Protocol):
    def send_stop(self, reason: int = 0) -> None:
        """Say STOP to all parts at once."""


class PartsRelay:
    """Carries the parts of one link to a master on another.

    Args:
        open_parts: makes the link of the parts for a robot with that profile hash.
        way: the link to the master.
        name: what people call the relay, where it stands for example.
        say: called with what people should know, in words.
    """

    def __init__(self, open_parts: Callable[[int], Link], way: Link, *, name: str, say: Callable[[str], None]) -> None:
        if way.info.mtu < SMALLEST_WAY:
            raise ConfigError(
                f"link {way.info.name}: its packets have {way.info.mtu} bytes, and a relay needs {SMALLEST_WAY} "
                "towards the master: take another kind of link"
            )
        self._open_parts = open_parts
        self._parts = open_parts(0)
        self._way = way
        self._say = say
        self._profile_hash: int | None = None
        self._reopen = asyncio.Event()
        self._parts_are_up = False
        self._pumping = False
        self._refused = ""
        self._unreachable = ""
        self._loop = asyncio.get_running_loop()
        self._alarm: asyncio.TimerHandle | None = None
        self.forwarder = Forwarder(
            boot=os.urandom(BOOT_SIZE),
            name=name,
            carried=self._parts.info,
            describe=self._describe,
            on_event=self._happened,
        )
        way.attach(packet=self._from_master, signal=self._way_signalled, room=lambda _: self._pump())

    async def run(self) -> None:
        """Carry until cancelled.

        Raises:
            LinkDown: the link of the parts cannot be opened; the text names the remedy.
        """
        self.forwarder.start(self._loop.time())
        self._tick()
        try:
            with ungrouped(LinkDown):
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._keep_way())
                    tasks.create_task(self._serve_parts())
                    try:
                        await self._loop.create_future()
                    finally:
                        with contextlib.suppress(LinkError):
                            self._way.send(self.forwarder.end(), self._way.remote)
        finally:
            if self._alarm is not None:
                self._alarm.cancel()

    async def _keep_way(self) -> None:
        """A way that cannot be opened is no reason to end: a relay may start before its network is there."""
        while True:
            try:
                await self._way.run()
            except LinkDown as error:
                if str(error) != self._unreachable:
                    self._unreachable = str(error)
                    self._say(f"no way to the master yet: {error}")
            await asyncio.sleep(AGAIN_S)

    async def _serve_parts(self) -> None:
        """A bus is opened when the robot is known, and again for another robot."""
        while True:
            await self._reopen.wait()
            self._reopen.clear()
            parts = self._parts = self._open_parts(self._profile_hash or 0)
            parts.attach(packet=self._from_part, signal=self._parts_signalled, room=lambda _: self._pump())
            serving = asyncio.ensure_future(parts.run())
            again = asyncio.ensure_future(self._reopen.wait())
            try:
                await asyncio.wait({serving, again}, return_when=asyncio.FIRST_COMPLETED)
                if serving.done():
                    serving.result()
                    raise LinkDown(f"link {parts.info.name} has ended")
            finally:
                self._parts_are_up = False
                self.forwarder.forget_down()
                again.cancel()
                serving.cancel()
                await asyncio.gather(serving, again, return_exceptions=True)

    def _describe(self, peer: Peer) -> str:
        return self._parts.describe(peer)

    # What the links call.

    def _from_part(self, packet: bytes, peer: Peer, now: float) -> None:  # noqa: ARG002 - the handler's signature
        self.forwarder.from_part(packet, peer)
        self._pump()

    def _from_master(self, packet: bytes, _: Peer, now: float) -> None:
        self.forwarder.from_master(packet, now)
        self._pump()
        self._set_alarm()

    def _parts_signalled(self, signal: Signal, peer: Peer | None, words: str, now: float) -> None:
        if signal is Signal.LINK_UP:
            if not self._parts_are_up:
                self._say(f"{self._parts.info.name} is up, {words}")
            self._parts_are_up = True
        elif signal is Signal.LINK_DOWN:
            self._parts_are_up = False
            self._say(f"{self._parts.info.name} is down: {words}")
        elif signal is Signal.STOP:
            self._say(f"STOP was said on {self._parts.info.name}: {words}")
            self.forwarder.stop_heard(words, now)
        elif peer is not None:
            self.forwarder.part_event(peer, _HAPPENED[signal], words, now)
        self._pump()
        self._set_alarm()

    def _way_signalled(self, signal: Signal, peer: Peer | None, words: str, now: float) -> None:  # noqa: ARG002
        if signal is Signal.LINK_UP:
            self._unreachable = ""
            self.forwarder.way_is_new(now)
            self._tick()

    # What the forwarder calls.

    def _happened(self, event: ForwarderEvent) -> None:
        way = self._way.info.name
        match event:
            case Welcomed(profile_hash):
                self._refused = ""
                if profile_hash != self._profile_hash:
                    self._say(f"the master on {way} takes the parts of {self._parts.info.name}")
                    self._profile_hash = profile_hash
                    self._reopen.set()
            case StopSaid(reason):
                if isinstance(self._parts, _StoppableLink):
                    # A bus that is down carries no orders to move either.
                    with contextlib.suppress(LinkDown):
                        self._parts.send_stop(reason)
                self._say("the master says STOP")
            case MasterSilent(was_there=False):
                self._say(f"nobody answers on {way} yet; is `msbot master` running there, and open to this computer?")
            case MasterSilent():
                self._say(f"the master on {way} is silent: the parts go to their safe state until it is heard again")
            case MasterBack(after_s):
                self._say(f"the master on {way} is heard again after {after_s:.1f} s")
            case Refused(words):
                if words != self._refused:
                    self._refused = words
                    self._say(f"the master on {way} does not take this relay: {words}")

    # Sending.

    def _pump(self) -> None:
        """Send what waits, as far as the links take it."""
        if self._pumping:
            return
        self._pumping = True
        try:
            self._pump_down()
            self._pump_up()
        finally:
            self._pumping = False

    def _pump_up(self) -> None:
        way = self._way
        remote = way.remote
        while remote is not None and way.has_room(remote):
            packet = self.forwarder.to_master()
            if packet is None:
                return
            if len(packet) > way.info.mtu:
                self.forwarder.dropped.count(TOO_LONG)
                continue
            try:
                way.send(packet, remote)
            except (LinkDown, LinkFull):
                self.forwarder.dropped.count(NOT_SENT)

    def _pump_down(self) -> None:
        parts = self._parts
        while self._parts_are_up and (found := self.forwarder.to_part(parts.has_room)) is not None:
            peer, packet = found
            if len(packet) > parts.info.mtu:
                self.forwarder.dropped.count(TOO_LONG)
                continue
            try:
                parts.send(packet, peer)
            except (LinkDown, LinkFull):
                self.forwarder.dropped.count(NOT_SENT)

    def _tick(self) -> None:
        self.forwarder.handle_timer(self._loop.time())
        self._pump()
        self._set_alarm()

    def _set_alarm(self) -> None:
        when = self.forwarder.timer()
        if self._alarm is not None:
            if self._alarm.when() == when and not self._alarm.cancelled():
                return
            self._alarm.cancel()
        self._alarm = self._loop.call_at(when, self._tick)
