"""A part that is made of a device of another world.

Theory of operation. The device says who it is and what it has; from that the part describes itself, so that a robot
that does not know the part number asks, and a person adopts it. The device is told something only after the inventory
has registered the part: its settings first, then what comes in at its ports. STOP is confirmed only when the device
itself has reported that it has stopped; until then it is told again. A part that leaves, or has lost its master, makes
its device safe in the same way (`leaving.py`): until then it obeys nothing else. A device with a fault leaves its robot
with that sentence, and comes back when the fault is gone.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Mapping

from msbot.part import JoinState, Message, NotSafeYet, Part
from msbot.part.beginner_hints import part_is_run
from msbot.part.description import describe
from msbot.part.join.home import Home
from msbot.part.join.pnp_messages import Nature
from msbot_agent.link import Link
from msbot_bridges.bridge.contract import DeviceSetting, ForeignDevice, Value
from msbot_bridges.bridge.leaving import AGAIN_S, LEAVE_S, MASTERLESS_S, Leaving
from msbot_xrce.errors import ConfigError, LinkError, MsbotError

LATE_S = 1.0
"""Time after which the robot's log says why STOP is not confirmed."""
EXPLAIN_S = 10.0
"""Longest time in which a robot is told why a device stays away."""
RESTART_S = 2.0
"""Time after which a part whose link has failed is started again."""

_log = logging.getLogger("msbot.part")


class BridgedPart:
    """The part of one device.

    Args:
        device: the device.
        part_made: gives the part its key, before it runs.
        nature: what is behind it.
    """

    def __init__(
        self, device: ForeignDevice, part_made: Callable[[Part], None] = lambda _: None, nature: Nature = Nature.REAL
    ) -> None:
        self.device = device
        self.left_out: list[str] = []
        """Settings for which the description has no room."""
        self.part = self._part(nature)
        part_made(self.part)
        self._was_in = False
        """The inventory has registered the device, so that it may be told something."""
        self._has_begun = self._is_gone = False
        """The device is commanded by its robot; it is out of reach for good."""
        self._leaving: Leaving | None = None
        """From the last order to a device until its `end`."""
        self.unsafe: Mapping[str, Message] | None = None
        """The device was driven last, and has not reported that its ports have these safe values; None: it is safe."""
        self._driven = set[str]()
        """Ports that got something else than their safe value last."""
        self._is_over = asyncio.Event()
        self._changed = asyncio.Event()
        self._again: asyncio.TimerHandle | None = None
        self._told_at: float | None = None
        """When the device was told to stop, of which it has not reported that it has."""
        self._is_late_said = False

    def _part(self, nature: Nature) -> Part:
        """The part with as many settings as its description has room for."""
        settings = list(self.device.settings)
        while True:
            part = self._part_with([setting.name for setting in settings])
            part.nature = nature
            try:
                describe(part.part_number, self.device.identity.words, part.program)
            except ConfigError:
                if not settings:
                    raise
                self.left_out.insert(0, settings.pop().name)
            else:
                return part

    def _part_with(self, settings: list[str]) -> Part:
        device, who = self.device, self.device.identity
        part = Part(who.part_number, uid=who.uid, describes=who.words)
        part.hardware, part.software, part.home = who.hardware, who.software, Home.BRIDGE
        part_is_run(part)  # or given up for one with fewer settings
        for output in device.outputs:
            part.publishes(output.name, output.message)
        for one in device.inputs:
            part.on(one.name, one.message, safe=one.safe, ranges=one.ranges, optional=True)(self._acting(one.name))
            if one.stops_by:
                part.program.stops_by[one.name] = one.stops_by
        for service in device.services:
            part.serves(service.name, service.request, service.reply, optional=True)(self._serving(service.name))
        for setting in device.settings:
            if setting.name in settings:
                part.on_setting(
                    setting.name,
                    setting.kind,
                    default=setting.default,
                    least=setting.least,
                    most=setting.most,
                    unit=setting.unit,
                )(self._setting(setting))
        part.on_join(self._joined)
        part.safe_state(self._be_safe)
        part.on_lost(self._left)
        part.on_end(self._left)
        part.on_go(self._go)
        part.on_identify(device.identify)
        return part

    # Life

    async def run(self, connect: Callable[[Part], Link], before: asyncio.Task[None] | None = None) -> None:
        """Run the part until `end`.

        Args:
            connect: makes a link to the master each time the part starts.
            before: runs the part with the same UID that leaves first; the device is not its own any more.
        """
        try:
            if self.unsafe is not None and not self._is_over.is_set():
                await self._make_safe(self.unsafe)
            if before is not None:
                await asyncio.wait([before])
            while not self._is_over.is_set():
                await self._run_once(connect)
            if self._leaving is not None:
                await self._leaving.over()
        finally:
            self._finish()

    async def _make_safe(self, values: Mapping[str, Message]) -> None:
        """The device was driven when it got out of reach, and may still do that; somebody else may have its slot."""
        _log.info("%s: it was driven when it was lost, and is made safe first", self.name)
        self._was_in = True

        def rest() -> None:
            for one in self.device.inputs:
                if (safe := values.get(one.name)) is not None:
                    self.device.rests_at(one.name, safe)

        leaving = self._leaving = Leaving(self.device, rest, self.device.leave, self._has_left)
        leaving.begin(LEAVE_S)
        await leaving.over()

    async def _run_once(self, connect: Callable[[Part], Link]) -> None:
        if fault := self.device.fault:
            _log.warning("%s: %s", self.name, fault)
            await self._until_changed()
            return
        try:
            await self.part.run_async(connect(self.part))
        except LinkError as error:
            _log.warning("%s: %s; tried again in %g s", self.name, error, RESTART_S)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(RESTART_S):
                    await self._is_over.wait()
        except MsbotError as error:
            _log.error("%s: %s", self.name, error)
            await self._until_changed()

    async def explain(self, connect: Callable[[Part], Link], why: str) -> None:
        """Tell the robot why the device is not there, and no more.

        Args:
            connect: makes a link to the master.
            why: a sentence.
        """
        try:
            async with asyncio.timeout(EXPLAIN_S):
                await self.part.run_async(connect(self.part), absent=why)
        except (TimeoutError, MsbotError) as error:
            _log.warning("%s: its robot was not told that %s: %s", self.name, why, error or "it does not answer")

    @property
    def name(self) -> str:
        """For people: what it is and where."""
        who = self.device.identity
        return f"{who.part_number} ({who.where})" if who.where else who.part_number

    def end(self, why: str = "") -> None:
        """End the part, once its device has reported that it is safe; within `LEAVE_S`.

        Args:
            why: what its robot shows: the device is out of reach, and not waited for. Empty: it is there.
        """
        self._is_over.set()
        self._changed.set()
        if why:
            self._is_gone = True
            if self._driven or (self._leaving is not None and not self._leaving.is_over):
                self.unsafe = self._safe_values()
            if self.device.is_reset:
                self.unsafe = None
            if self._leaving is not None:
                self._leaving.cancel()
        elif self._leaving is not None:
            self._leaving.end_within(LEAVE_S)
            return  # see `_has_left`
        elif self._has_begun and not self._is_gone:
            self._leave()
            return
        self._say_goodbye(why)

    def _say_goodbye(self, why: str) -> None:
        if not why and self.part.stopped:
            why = self.device.not_stopped
        if why:
            self.part.trouble(why)
        self.part.end()

    def news(self) -> None:
        """The device has reported something."""
        self._changed.set()
        if self._leaving is not None:
            if not self.device.not_stopped:
                self.part.is_safe_now()
            self._leaving.look()
            if self._is_over.is_set():
                return
        if fault := self.device.fault:
            self.part.trouble(fault)
            self.part.end()
        elif not self.device.not_stopped:
            self.part.is_safe_now()

    async def _until_changed(self) -> None:
        self._changed.clear()
        if not self._is_over.is_set():
            await self._changed.wait()

    # What the part's functions do

    def _acting(self, port: str) -> Callable[[Message], None]:
        def act(message: Message) -> None:
            if not self._may_be_told() or self._leaving is not None:
                return
            if self.part.stopped:  # during STOP nothing else comes than safe values
                self.device.safe_is(port, message)
            elif message is self.part.safe_value(port):  # the part itself hands it over: its partner or master is gone
                self._driven.discard(port)
                self.device.rests_at(port, message)
            else:
                self._driven.add(port)
                self.device.act(port, message)

        return act

    def _serving(self, name: str) -> Callable[[Message], Message]:
        def serve(request: Message) -> Message:
            return self.device.serve(name, request)

        return serve

    def _setting(self, setting: DeviceSetting) -> Callable[[Value], None]:
        def take(value: Value) -> None:
            if setting.choices and value not in setting.choices:
                words = f"setting {setting.name}: there is no {value!r}; there are {', '.join(setting.choices)}"
                self.part.log(words, level="error")
            elif self._may_be_told():
                self.device.set(setting.name, value)

        return take

    def _may_be_told(self) -> bool:
        self._was_in |= self.part.state in (JoinState.CONFIGURING, JoinState.ACTIVE)
        return self._was_in

    def _joined(self) -> None:
        if self._leaving is not None:
            self._finish()  # the master is back before the device has reported that it is safe
        self._was_in, self._has_begun, self.unsafe = True, True, None
        who = self.device.identity
        self.part.log(f"{who.description}, {who.where}" if who.where else who.description)  # which software it has
        if remark := self.device.remark:
            self.part.log(remark)
        self.device.begin(self._report)
        if self.part.stopped:  # STOP has held since before the master was lost
            for one in self.device.inputs:
                if (safe := self.part.safe_value(one.name)) is not None:
                    self.device.safe_is(one.name, safe)
            self.device.stop()

    def _report(self, port: str, message: Message) -> None:
        """Something goes out of a port; before the part is active nobody hears it."""
        if self.part.state is JoinState.ACTIVE:
            self.part.publish(port, message)

    def _be_safe(self) -> None:
        if not self._may_be_told():
            return
        if self._leaving is not None:
            if self.part.stopped and (why := self.device.not_stopped):
                raise NotSafeYet(why)
            return
        if self._has_begun and self.part.state is not JoinState.ACTIVE:
            self._leave()
        elif self.part.stopped:
            self.device.stop()
        else:
            self.device.rest()
        if not self.part.stopped:
            return
        if why := self.device.not_stopped:
            if self._again is None and self._leaving is None:
                self._again = asyncio.get_running_loop().call_later(AGAIN_S, self._stop_again)
            self._say_late(why)
            raise NotSafeYet(why)
        self._told_at, self._is_late_said = None, False

    def _say_late(self, why: str) -> None:
        """The robot's log says once with each STOP why it is not confirmed: the page and `msbot stop` only name it."""
        now = asyncio.get_running_loop().time()
        self._told_at = now if self._told_at is None else self._told_at
        if now - self._told_at >= LATE_S and not self._is_late_said:
            self._is_late_said = True
            self.part.log(f"STOP is not confirmed: {why}", level="warning")

    def _go(self) -> None:
        self._told_at, self._is_late_said = None, False
        if self._leaving is None:
            self.device.go()

    def _leave(self) -> None:
        """The device gets its last orders, and is told them until it has reported that it has obeyed."""
        first, tell = self._let_go, self.device.leave
        if self.part.stopped:
            first, tell = self._driven.clear, self.device.stop
        if self._again is not None:
            self._again.cancel()
            self._again = None
        if self._is_gone:
            first()
            tell()
            return
        self._leaving = Leaving(self.device, first, tell, self._has_left)
        is_ending = self._is_over.is_set() or self.part.state is JoinState.ENDED
        self._leaving.begin(LEAVE_S if is_ending else MASTERLESS_S)

    def _let_go(self) -> None:
        """Each port has its safe value; also one that a person drove without a wire, of which the robot says nothing.

        A part that is out of its robot already has handed over those that the robot has said.
        """
        is_in = self.part.state is JoinState.ACTIVE
        for one in self.device.inputs:
            safe = self.part.safe_value(one.name) if is_in else None
            if safe is None and one.name in self._driven:
                safe = one.safe
            if safe is not None:
                self.device.rests_at(one.name, safe)
        self._driven.clear()

    def _safe_values(self) -> Mapping[str, Message]:
        """What its ports are to have: the slot's values, those of the slot that it had before, or the device's own."""
        kept = self.unsafe or {}
        values = {
            one.name: self.part.safe_value(one.name) or kept.get(one.name, one.safe) for one in self.device.inputs
        }
        return {name: safe for name, safe in values.items() if safe is not None}

    def _has_left(self, unreported: str) -> None:
        """The device is safe, or is not known to be."""
        why = f"it is out of its robot, and not known to be safe: {unreported}" if unreported else ""
        self.unsafe = self._safe_values() if why else None
        if why:
            _log.warning("%s: %s", self.name, why)
        if self._is_over.is_set():
            self._say_goodbye(why)
        if self.part.state is not JoinState.ACTIVE:
            self._finish()

    def _stop_again(self) -> None:
        self._again = None
        self.part.is_safe_now()

    def _left(self) -> None:
        if self._leaving is None or self._leaving.is_over:
            self._finish()

    def _finish(self) -> None:
        """Nothing more is told to the device."""
        if self._again is not None:
            self._again.cancel()
            self._again = None
        if self._leaving is not None:
            self._leaving.cancel()
            self._leaving = None
        self._has_begun = False
        if self._was_in:
            self._was_in = False
            try:
                self.device.end()
            except Exception:  # of a world that an extension has brought: others are left all the same
                _log.exception("%s", self.name)
