"""Who is late and who is lost, beside a second model that looks at every part at every instant somebody is called."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

import pytest

from msbot.config import Slot
from msbot.pnp import LifeTiming, PartState
from tests.pnp.robot import Rig, sample_store

START = 100.0
STEP = 1 / 64
"""Times are whole multiples of it, so that sums of them are exact."""


@dataclass
class Part:
    """A part as the model sees it."""

    kind: str
    """`beats`, `packets` (an original program), `unseen` (one whose packets the agent cannot tell), `spare`."""
    state: str
    last: float
    """Its last sign of life that counts."""
    life: int


class Model:
    """Plain: the page's rules, one after the other, for every part."""

    def __init__(self, timing: LifeTiming) -> None:
        self.timing = timing
        self.parts: dict[int, Part] = {}
        self.heard: dict[int, float] = {}
        self.said: list[tuple[float, int, str, str, tuple[tuple[str, str], ...]]] = []
        self.asked: list[tuple[float, int]] = []
        self.behind = 0.0
        """How late this was called of late: a beat waits six times as long for a busy master."""
        self.next_watch, self.next_tick = START + timing.beat_s / 2, START + timing.tick_s

    def change(self, now: float, key: int, state: str, reason: str, *rules: tuple[str, str]) -> None:
        self.parts[key].state = state
        self.said.append((now, key, state, reason, rules))

    def beat(self, now: float, key: int) -> None:
        part = self.parts[key]
        if part.kind == "spare":
            part.last = now
        elif part.state != "lost":
            self.sign(now, key, now)

    def sign(self, now: float, key: int, at: float) -> None:
        part = self.parts[key]
        if part.state == "late":
            self.change(now, key, "active", f"heard again after {at - part.last:.1f} s")
        part.last, part.life = at, self.timing.life

    def look_at(self, now: float, key: int) -> None:
        """Whether the agent has heard an original program; one that is silent for a beat is asked for a packet."""
        if self.parts[key].kind != "packets":
            return
        if now - self.heard[key] > self.timing.beat_s:
            self.asked.append((now, key))
        if self.heard[key] > self.parts[key].last:
            self.sign(now, key, self.heard[key])

    def late(self, now: float, key: int) -> None:
        silence = f"no beat for {now - self.parts[key].last:.1f} s"
        rule = f"a beat every {self.timing.beat_s:g} s, late after {self.timing.beat_s * 1.5:g} s"
        self.change(now, key, "late", silence, (rule, silence))

    def called(self, now: float, late_s: float) -> None:
        there = [(key, part) for key, part in self.parts.items() if part.state != "lost"]
        if now >= self.next_watch:
            is_in_time = now - self.next_watch <= self.timing.beat_s / 2
            self.behind = max(late_s if is_in_time else 0.0, self.behind / 2)
            self.next_watch = (self.next_watch if is_in_time else now) + self.timing.beat_s / 2
            for key, part in there if is_in_time else ():
                self.look_at(now, key)
                away = now - part.last
                if part.kind == "spare":
                    if away > max(6.0, self.timing.life * self.timing.tick_s):
                        self.change(now, key, "lost", f"has not claimed for {away:.1f} s")
                elif part.state == "active" and now - 6 * self.behind - part.last > self.timing.beat_s * 1.5:
                    self.late(now, key)
        if now >= self.next_tick:
            self.next_tick += self.timing.tick_s + 6 * self.behind
            if self.next_tick <= now:  # the process was held up: one tick is made up for
                self.next_tick = now + self.timing.tick_s
            for key, part in there:
                if part.kind == "spare":
                    continue
                self.look_at(now, key)
                part.life -= 1
                if part.life == 0:
                    silence = f"no beat for {now - part.last:.1f} s"
                    if part.state == "active":
                        self.late(now, key)
                    rule = f"{self.timing.life} ticks of {self.timing.tick_s:g} s without a beat"
                    self.change(now, key, "lost", f"{silence}: life status 0", (rule, silence))


STEADY = 8
PARTS = {
    1: ("ABCD", "AA", "packets"), 2: ("EFGH", "BB", "unseen"), 3: ("EFGH", "DD", "beats"), 4: ("ABCD", "EE", "packets"),
    STEADY: ("WXYZ", "CC", "beats"), 6: ("WXYZ", "", "spare"), 7: ("WXYZ", "", "spare"),
}  # fmt: skip
"""By session, in the order in which they come: the steady one never falls silent, so no spare gets its slot."""

TIMINGS = (
    LifeTiming(),
    LifeTiming(beat_s=1.0, tick_s=0.78125, life=3),
    LifeTiming(beat_s=0.25, tick_s=0.5, life=3),
    LifeTiming(beat_s=1.0, tick_s=2.5, life=4),
)


@pytest.mark.parametrize("seed", range(8))
def test_what_becomes_of_parts_is_what_the_rules_say_of_each_at_every_call(seed: int) -> None:
    random = Random(seed)
    timing = TIMINGS[seed % len(TIMINGS)]
    rig = Rig(sample_store(Slot("DD", "EFGH"), Slot("EE", "ABCD")), timing=timing, start=START)
    model = Model(timing)
    asked: list[tuple[float, int]] = []
    rig.inventory.watch.use_agent(last_heard=model.heard.get, probe=lambda key: asked.append((rig.now, key)))
    for key, (part_number, slot, kind) in PARTS.items():
        rig.claim(key, part_number, name=slot, layout="compat" if kind in ("packets", "unseen") else "compact")
        model.parts[key] = Part(kind, "standby" if kind == "spare" else "active", START, timing.life)
        if kind == "packets":
            model.heard[key] = START
    rig.events.clear()
    silent_from = {key: START + random.choice((0.0, 3.0, 9.0, 20.0)) for key in PARTS}
    held_up_until = START
    for number in range(1, int(40 / STEP)):
        rig.now = now = START + number * STEP
        for key, part in model.parts.items():
            if random.random() < STEP / timing.beat_s and now < silent_from[key]:
                if part.kind == "packets":
                    model.heard[key] = now
                elif part.kind == "spare" and part.state != "lost":
                    rig.claim(key, PARTS[key][0])
                    model.beat(now, key)
        if number % round(timing.beat_s / 2 / STEP) == 0:
            for key in (key for key, part in model.parts.items() if part.kind == "beats"):
                if now < silent_from[key] or key == STEADY:
                    rig.beat(key)
                    model.beat(now, key)
        if random.random() < 0.002:
            held_up_until = random.choice((now + 2 * timing.tick_s, now + 1.0, model.next_tick + timing.tick_s))
        if now >= max(held_up_until, min(model.next_watch, model.next_tick)):
            late_s = max(0.0, now - min(model.next_watch, model.next_tick) - 0.05)
            model.called(now, late_s)
            rig.inventory.watch.handle_timer(now, late_s)
        assert rig.inventory.watch.timer() == min(model.next_watch, model.next_tick)
    heard = [(one.at, one.client_key, one.to_state.value, one.reason, one.evidence) for one in rig.events]
    assert heard == model.said
    assert asked == model.asked
    assert {key: rig.state(key).value for key in PARTS} == {key: part.state for key, part in model.parts.items()}


def test_nobody_is_late_because_the_master_itself_was_held_up() -> None:
    rig = Rig(start=START)
    rig.claim(1, "ABCD", name="AA", layout="compact")
    watch = rig.inventory.watch
    rig.now = START + 2.5  # as after a computer that slept: the beats of that time have not been read yet
    watch.handle_timer(rig.now)
    rig.beat(1)
    while rig.now < START + 4.0:
        assert rig.state(1) is PartState.ACTIVE
        rig.now = watch.timer()
        watch.handle_timer(rig.now)
    rig.now = watch.timer()
    watch.handle_timer(rig.now)
    assert rig.state(1) is PartState.LATE, "one that says nothing any more is"


def test_a_busy_master_gives_parts_the_time_that_their_beats_wait_for_it() -> None:
    rig = Rig(start=START)
    rig.claim(1, "ABCD", name="AA", layout="compact")
    watch = rig.inventory.watch
    late_s = 0.2  # each turn of the loop takes so long
    while rig.now < START + 2.1:  # a quiet one would be late after 1.5 s
        rig.now = watch.timer() + late_s
        watch.handle_timer(rig.now, late_s)
        assert rig.state(1) is PartState.ACTIVE
    while rig.now < START + 20.0:
        rig.now = watch.timer() + late_s
        watch.handle_timer(rig.now, late_s)
    assert rig.state(1) is PartState.LOST, "one that says nothing any more is"


def test_a_part_whose_agent_says_nothing_of_it_is_asked_for_nothing() -> None:
    watch = Rig().inventory.watch
    assert watch.last_heard(1) is None
    watch.use_agent(last_heard={1: 7.0}.get, probe=print)
    assert (watch.last_heard(1), watch.last_heard(2)) == (7.0, None)
