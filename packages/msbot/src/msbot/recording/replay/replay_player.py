"""Replayed parts: they join a running robot as any part does, and publish what others once published in their slots.

All slots of a replay share one schedule, so that what was said at the same time is said at the same time again. It goes
while every one of the parts is active and no STOP holds; `schedule` decides what is due, this file publishes it.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable
from random import Random

from msbot.part import JoinState, Part
from msbot.part.join.pnp_messages import Nature
from msbot.part.join.refusal import Refusal
from msbot.recording.replay.replay_excerpt import RecordedSample, RecordedSlot, ReplayExcerpt
from msbot.recording.replay.schedule import Schedule
from msbot_agent.link import Link
from msbot_agent.process.end_signals import ungrouped
from msbot_xrce.errors import ConfigError, LocalProtocolError, MsbotError

LOOK_S = 0.05
"""How often a replay looks whether it may go: a part that was refused does not call anybody."""
RETRY_S = 0.01
"""A sample for which there was no room is tried again after this time."""
BURST = 64
"""Most samples in one turn of the event loop."""
SETTLE_S = 0.5
"""Between the last sample and the goodbye: samples that were lost on the way are repeated meanwhile."""

PASSING = (Refusal.NO_SLOT, Refusal.DUPLICATE, Refusal.NOT_READY, Refusal.REPLAYED)
"""Refusals that may end by themselves, or by what a person does; the part keeps asking."""


class ReplayPlayer:
    """Replays a piece of a recording, once. Use it in the thread of its loop.

    Args:
        piece: what is replayed.
        speed: seconds of the recording in one second.
        say: called with sentences about how it goes.
        warn: called with sentences about what a person has to do, or what is left out.
        random: draws the client keys.
        is_own_stop: whether the STOP that holds is one of this recording, said again: then time goes on.
    """

    def __init__(
        self,
        piece: ReplayExcerpt,
        *,
        speed: float = 1.0,
        say: Callable[[str], None],
        warn: Callable[[str], None],
        random: Random | None = None,
        is_own_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.parts = {slot.name: _part(slot, random) for slot in piece.slots}
        """Slot -> the part that is replayed there."""
        self.published = 0
        """Samples that were published."""
        self.left_out: Counter[tuple[str, str]] = Counter()
        """(slot, port) -> samples that the robot of today has no use for."""
        self.late_s = 0.0
        """How late the latest sample was, seconds."""
        self._samples = piece.samples
        self._schedule = Schedule([one.at_ns for one in piece.samples], begin_ns=piece.begin_ns, speed=speed)
        self._is_own_stop = is_own_stop
        self._say = say
        self._warn = warn
        self._warned: set[tuple[str, str]] = set()
        self._waits_for = ""
        self._has_begun = False
        self._fault: ConfigError | None = None
        self._timer: asyncio.TimerHandle | None = None

    async def run(self, connect: Callable[[Part], Link], *, epoch_ns: Callable[[], int] = time.time_ns) -> None:
        """Join, publish everything, say goodbye.

        Args:
            connect: gives each part its link.
            epoch_ns: wall clock, ns since 1970.

        Raises:
            ConfigError: the robot does not take a part, or puts it into another slot.
            LinkDown: a link broke before it ever carried anything.
        """
        try:
            with ungrouped(MsbotError):
                async with asyncio.TaskGroup() as tasks:
                    for part in self.parts.values():
                        tasks.create_task(part.run_async(connect(part), epoch_ns=epoch_ns))
                    self._arm(asyncio.get_running_loop().time())
        finally:
            if self._timer is not None:
                self._timer.cancel()
        if self._fault is not None:
            raise self._fault

    def end(self) -> None:
        """End before everything is published."""
        if self._timer is not None:
            self._timer.cancel()
        for part in self.parts.values():
            part.end()

    @property
    def is_going(self) -> bool:
        """Whether the recording's time passes."""
        return self._schedule.is_going

    @property
    def ended(self) -> bool:
        """Whether everything was published, or left out."""
        return self._schedule.ended

    def _arm(self, at: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_at(at, self._step)

    def _step(self) -> None:
        now = asyncio.get_running_loop().time()
        self._fault = self._look()
        if self._fault is not None:
            self.end()
            return
        self._follow(now)
        for _ in range(BURST):
            index = self._schedule.due(now)
            if index is None:
                break
            due_at = self._schedule.timer()
            if not self._publish(self._samples[index]):
                self._arm(now + RETRY_S)
                return
            self.late_s = max(self.late_s, now - (now if due_at is None else due_at))
            self._schedule.done()
        if self._schedule.ended:
            self._timer = asyncio.get_running_loop().call_at(now + SETTLE_S, self.end)
            return
        due_at = self._schedule.timer()
        self._arm(now + LOOK_S if due_at is None else min(due_at, now + LOOK_S))

    def _look(self) -> ConfigError | None:
        """Why this cannot become a replay; None: it can."""
        for slot, part in self.parts.items():
            if part.state is JoinState.ACTIVE and part.slot != slot:
                return ConfigError(
                    f"the robot has put the replayed part into slot {part.slot}, not into {slot}: take the part out of "
                    f"slot {slot} first, or put the replayed one there with `msbot swap {slot} --to {_uid(part)}`"
                )
            if part.state is JoinState.REFUSED:
                if part.reason not in [refusal.describe for refusal in PASSING]:
                    return ConfigError(f"slot {slot}: the robot refuses part number {part.part_number}: {part.reason}")
                self._warn_once(
                    slot,
                    part.reason,
                    f"slot {slot}: {part.reason}; it waits. Take the part out of slot {slot}, or put the replayed one "
                    f"there with `msbot swap {slot} --to {_uid(part)}`",
                )
        return None

    def _follow(self, now: float) -> None:
        """Go, or wait."""
        reason = self._wait_reason()
        if reason:
            self._schedule.hold(now)
            if self._has_begun and reason != self._waits_for:
                self._say(f"The replay waits: {reason}")
        elif not self._schedule.is_going:
            self._say("The replay goes on" if self._has_begun else "The replay begins")
            self._has_begun = True
            self._schedule.go(now)
        self._waits_for = reason

    def _wait_reason(self) -> str:
        for slot, part in self.parts.items():
            if part.state is not JoinState.ACTIVE:
                return f"the part in slot {slot} is {part.state.value} ({part.reason})"
            if part.stopped and not self._is_own_stop():
                return "STOP holds"
        return ""

    def _publish(self, sample: RecordedSample) -> bool:
        """False: there was no room for it."""
        try:
            sent = self.parts[sample.slot].publish_octets(sample.port, sample.type_name, sample.octets)
        except (ConfigError, LocalProtocolError) as error:  # no such port, another type, more than a message may have
            self.left_out[sample.slot, sample.port] += 1
            self._warn_once(sample.slot, sample.port, f"slot {sample.slot}: {error}; what it said there is left out")
            return True
        self.published += sent
        return sent

    def _warn_once(self, slot: str, about: str, words: str) -> None:
        if (slot, about) not in self._warned:
            self._warned.add((slot, about))
            self._warn(words)


def _part(slot: RecordedSlot, random: Random | None) -> Part:
    part = Part(slot.part_number, local_name=slot.local_name, random=random)
    part.nature = Nature.REPLAYED
    return part


def _uid(part: Part) -> str:
    return "" if part.uid is None else part.uid.hex()
