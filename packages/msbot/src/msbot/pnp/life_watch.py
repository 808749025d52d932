"""Who is late and who is lost: checks every part when it is due, and counts down its life status. Pure.

A part of MsBOT lives by its beats. For the thesis' own programs any packet counts: while samples reach such a program
every second, its client library never returns to the program's own lines, and no request comes. One that is silent for
a beat is asked for a packet, because a program that only listens on a best-effort stream sends nothing by itself.
"""

from __future__ import annotations

from collections.abc import Callable

from msbot.pnp.inventory_index import InventoryIndex
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import LifeTiming
from msbot.pnp.part_events import PartState
from msbot.pnp.state_changes import StateChanges
from msbot_agent.text.sentence import said

STANDBY_SILENCE_S = 6.0
"""A standby part that has not claimed for this long, or for the longest detection time, is gone."""
TURNS = 6.0
"""A beat has to wait so many times for a busy process: to be read, to be passed on, to be answered, to be sent."""


class LifeWatch:
    """Moves silent parts to late and lost.

    Args:
        index: the parts.
        changes: where changes are made.
        timing: the robot's periods.
        now: the present time; ticks count from here.
    """

    def __init__(self, index: InventoryIndex, changes: StateChanges, timing: LifeTiming, now: float) -> None:
        self._last_heard: Callable[[int], float | None] = lambda _: None
        self._probe: Callable[[int], object] = lambda _: None
        self._index = index
        self._changes = changes
        self.timing = timing
        self._tick_at = now + timing.tick_s
        self._watch_at = now + timing.beat_s / 2
        self._late_s = 0.0
        """How late it was called of late."""

    def use_agent(self, *, last_heard: Callable[[int], float | None], probe: Callable[[int], object]) -> None:
        """Use what the agent has heard in addition to the beats.

        Args:
            last_heard: when the latest packet of the client with that key came, whatever was in it.
            probe: asks the client with that key for a packet.
        """
        self._last_heard, self._probe = last_heard, probe

    def last_heard(self, client_key: int) -> float | None:
        """When the latest packet of that client came, whatever was in it; None: unknown."""
        return self._last_heard(client_key)

    def timer(self) -> float:
        """When `handle_timer` wants to be called next."""
        return min(self._tick_at, self._watch_at)

    def handle_timer(self, now: float, late_s: float = 0.0) -> None:
        """Do what is due: mark late parts, count down life status.

        When this process was held up, nobody is looked for at once, and only one tick is made up for: the beats of that
        time are waiting in some queue, and no part may be late, or delisted, for our own delay. While this process has
        more work than time, parts are given as much more time as their beats may have to wait here.

        Args:
            now: the time.
            late_s: how much later this is called than the loop was to call it, seconds.
        """
        if now >= self._watch_at:
            half = self.timing.beat_s / 2
            was_held_up = now - self._watch_at > half
            self._late_s = max(0.0 if was_held_up else late_s, self._late_s / 2)
            self._watch_at = now + half if was_held_up else self._watch_at + half
            if not was_held_up:
                self._watch(now)
        if now >= self._tick_at:
            self._tick_at += self.timing.tick_s + TURNS * self._late_s
            if self._tick_at <= now:
                self._tick_at = now + self.timing.tick_s
            self._tick(now)

    def _watch(self, now: float) -> None:
        patience = max(STANDBY_SILENCE_S, self.timing.longest_detection_s)
        for record in list(self._index.records):
            self._listen(record, now)
            if record.state is PartState.ACTIVE and record.life.is_late(now - TURNS * self._late_s):
                self._late(record, now)
            elif record.state is PartState.STANDBY and now - record.heard_at > patience:
                self._changes.retire(
                    record,
                    PartState.LOST,
                    now,
                    said("has not claimed for {seconds:.1f} s", seconds=now - record.heard_at),
                )

    def _tick(self, now: float) -> None:
        for record in list(self._index.holders.values()):
            self._listen(record, now)
            if not record.life.tick():
                continue
            if record.state is PartState.ACTIVE:
                self._late(record, now)
            silence = said("no beat for {seconds:.1f} s", seconds=record.life.silence_s(now))
            rule = said("{life} ticks of {tick_s:g} s without a beat", life=self.timing.life, tick_s=self.timing.tick_s)
            reason = record.with_what_was_said(said("{silence}: life status 0", silence=silence))
            self._changes.retire(record, PartState.LOST, now, reason, ((rule, silence),))

    def _listen(self, record: InventoryRecord, now: float) -> None:
        """Take any packet of a thesis program as a sign of life."""
        if record.claim is None or record.claim.layout != "compat" or not record.is_registered:
            return
        at, known_at = self.last_heard(record.client_key), record.life.last_beat_at
        if at is None or known_at is None:
            return
        if now - at > self.timing.beat_s:
            self._probe(record.client_key)
        if at <= known_at:
            return
        record.heard_at = at
        record.life.refresh(at)
        if record.state is PartState.LATE:
            self._changes.move(
                record, PartState.ACTIVE, now, said("heard again after {silence:.1f} s", silence=at - known_at)
            )

    def _late(self, record: InventoryRecord, now: float) -> None:
        silence = said("no beat for {seconds:.1f} s", seconds=record.life.silence_s(now))
        rule = said(
            "a beat every {beat_s:g} s, late after {late_s:g} s", beat_s=self.timing.beat_s, late_s=self.timing.late_s
        )
        self._changes.move(record, PartState.LATE, now, silence, ((rule, silence),))
