"""The fault lab of a running robot: plants faults, keeps them up, and takes them back.

Theory of operation. The engine says when faults begin and end; an effect does to the robot what a fault is. One timer
runs while something is planted, and none else. STOP ends everything, and so does the end of the robot; a master that
starts again knows of no fault.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence

from msbot.operations.dispatch import InProcessOperations
from msbot.operations.fault_request import FaultRequest
from msbot.pnp import PartInfo, StopStatus
from msbot_agent.link.can.sim import SimBusDriver
from msbot_agent.text.sentence import counted, said
from msbot_school.faults.effects import Effect, PartsHere
from msbot_school.faults.fault_engine import Fault, FaultChange, FaultEngine
from msbot_school.faults.fault_factory import FaultFactory
from msbot_school.faults.fault_kinds import LOAD, Condition, NumberCondition, kind_named
from msbot_school.faults.port_values import LatestPortValues
from msbot_xrce.errors import ConfigError


class FaultLab:
    """The fault lab of one running robot; made in its event loop.

    Args:
        operations: what can be done to the robot.
        parts: its parts that are simulated in this process; None: its stand-ins.
        bus: its simulated bus.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        operations: InProcessOperations,
        *,
        parts: PartsHere | None = None,
        bus: SimBusDriver | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._faults = operations.faults
        self._running = running = operations.faults.running
        self._parts: PartsHere = operations.stand_ins if parts is None else parts
        self._bus = bus
        self._epoch_ns = epoch_ns
        self._engine = FaultEngine()
        self._effects: dict[int, Effect] = {}
        self._numbers = LatestPortValues(running)
        self._planting = FaultFactory(running, self._parts, bus, self._numbers)
        self._timer: asyncio.TimerHandle | None = None
        self._mission = ""
        """The mission whose faults are planted; then there are no others."""
        operations.faults.attach(self)
        running.master.on_stop(self._stopped)
        running.master.on_why(self._why)

    # What people do.

    def plant(self, wish: FaultRequest, who: str) -> str:
        """See `FaultControl`.

        Raises:
            ConfigError: it cannot be planted; the text says why.
        """
        if self._mission:
            raise ConfigError(
                said(
                    "the mission {mission} runs, and no other fault may come in between: `msbot mission stop` ends it",
                    mission=self._mission,
                )
            )
        (fault,) = self._plant([wish], who)
        self._look()
        return said(
            "fault {number}: {words}{when}", number=fault.number, words=fault.spec.describe, when=self._times(fault)
        )

    def clear(self, number: int | None, who: str) -> str:
        """See `FaultControl`.

        Raises:
            ConfigError: there is no such fault.
        """
        ended = self._engine.clear(number, said("{who} has ended it", who=who))
        for change in ended:
            self._over(change, who)
        self._arm()
        if not ended:
            return said("no fault is planted")
        return counted(len(ended), "{count} fault is ended", "{count} faults are ended")

    def as_json(self, *, with_answers: bool) -> Mapping[str, object]:
        """See `FaultControl`."""
        hides = self._mission and not with_answers
        return {
            "faults": [
                {**self._json(fault), **(_concealed(self._mission) if hides else {})} for fault in self._engine.faults
            ]
        }

    def visible_faults(self, slot: str) -> Sequence[str]:
        """See `FaultControl`: those that are there now and are not hidden."""
        return [
            self._sentence(fault)
            for fault in self._engine.faults
            if fault.is_active and not fault.spec.hidden and fault.spec.at == slot
        ]

    # For missions.

    def plant_for_mission(self, mission: str, wishes: Sequence[FaultRequest]) -> list[int]:
        """Plant the faults of a mission, all or none, and keep others out until `end_mission`; their numbers.

        They begin soon, not at once.

        Raises:
            ConfigError: one cannot be planted, or others are planted; nothing has changed.
        """
        if self._engine.faults:
            raise ConfigError(said("faults are planted: `msbot fault clear` ends them; a mission begins without"))
        faults = self._plant(wishes, said("mission {mission}", mission=mission))
        self._mission = mission
        self._arm()
        return [fault.number for fault in faults]

    def mend(self, number: int, reason: str, who: str) -> None:
        """End one fault of the mission because somebody has mended it."""
        for change in self._engine.clear(number, reason):
            self._over(change, who)
        self._arm()

    def end_mission(self, reason: str) -> None:
        """End the faults of the mission; others may be planted again."""
        self._mission = ""
        self._end_all(reason)

    def obstacle(self, kind: str) -> str:
        """Why this robot can have no fault of a kind at any slot, a sentence; empty: it can.

        Raises:
            ConfigError: there is no such kind.
        """
        return self._planting.obstacle(kind_named(kind))

    def prepare(self, condition: Condition) -> None:
        """Make sure that `holds` can tell of it.

        Raises:
            ConfigError: there is no such slot, port or number here.
        """
        self._planting.check_condition(condition)
        self._watch(condition)

    def holds(self, condition: Condition) -> bool:
        """Whether a condition holds now."""
        return condition.holds(self)

    async def run(self) -> None:
        """Until cancelled; then all faults are taken back."""
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self._end_all(said("the robot ends"))

    # How it works.

    def _plant(self, wishes: Sequence[FaultRequest], who: str) -> list[Fault]:
        """Plant them all, or none; they begin with the next look."""
        if self._running.master.stop.stopped:
            raise ConfigError(said("STOP is in force: no fault can be planted until GO"))
        now, planted = self._running.now(), []
        try:
            for wish in wishes:
                spec = self._planting.spec(wish)
                self._engine.check(spec, now)
                effect = self._planting.effect(spec)
                fault = self._engine.plant(spec, who, now)
                self._effects[fault.number] = effect
                planted.append(fault)
                if spec.when is not None:
                    self._watch(spec.when)
        except ConfigError:
            for fault in planted:
                self._engine.clear(fault.number, "")
                del self._effects[fault.number]
            raise
        return planted

    def _watch(self, condition: Condition) -> None:
        if isinstance(condition, NumberCondition) and condition.source != LOAD:
            self._numbers.watch(condition.source)

    def _stopped(self, status: StopStatus) -> None:
        if status.stopped:
            self._end_all(said("STOP"))

    def _end_all(self, reason: str) -> None:
        for change in self._engine.clear(None, reason):
            self._over(change, change.fault.who)
        self._arm()

    def _why(self, info: PartInfo) -> Sequence[str]:
        return [*self.visible_faults(info.slot or ""), *(self.visible_faults("") if info.slot else ())]

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        at = self._engine.timer()
        self._timer = None if at is None else self._running.loop.call_at(at, self._look)

    def _look(self) -> None:
        for change in self._engine.handle_timer(self._running.now(), self.holds):
            if change.begins:
                self._effects[change.fault.number].begin()
                self._tell(change, change.fault.who)
            else:
                self._over(change, change.fault.who)
        for fault in self._engine.faults:
            mended = self._effects[fault.number].sustain() if fault.is_active else ""
            if mended:
                for change in self._engine.clear(fault.number, mended, is_mended=True):
                    self._over(change, change.fault.who)
        self._arm()

    def _over(self, change: FaultChange, who: str) -> None:
        effect = self._effects.pop(change.fault.number)
        if change.was_active:
            effect.end()
        self._tell(change, who)

    def _tell(self, change: FaultChange, who: str) -> None:
        fault = change.fault
        words = fault.spec.describe
        if change.begins:
            line = said("fault {number} begins: {words}", number=fault.number, words=words)
        else:
            line = said(
                "fault {number} is over ({reason}): {words}", number=fault.number, reason=change.reason, words=words
            )
        if fault.spec.hidden:  # people read the journal
            line = said("fault {number} begins or ends: it is hidden", number=fault.number)
        value = {"begins": change.begins, "reason": str(change.reason), "mended": change.is_mended, **self._json(fault)}
        self._faults.changed(value, line, who)

    def _json(self, fault: Fault) -> dict[str, object]:
        spec, now = fault.spec, self._running.now()
        ends_at = fault.ends_at
        return {
            "number": fault.number,
            "kind": spec.kind.name,
            "at": spec.at,
            "words": spec.describe,
            "who": fault.who,
            "active": fault.is_active,
            "hidden": spec.hidden,
            "when": str(spec.when or ""),
            "begins_in_s": None if fault.is_active or fault.begins_at is None else max(fault.begins_at - now, 0.0),
            "since_s": None if fault.began_at is None else now - fault.began_at,
            "left_s": None if not fault.is_active or ends_at is None else max(ends_at - now, 0.0),
            "for_s": spec.for_s,
        }

    @staticmethod
    def _sentence(fault: Fault) -> str:
        # Without the time that is left: pages would change every second.
        return said(
            "{who} has planted fault {number} here: {words}; it ends by itself",
            who=fault.who,
            number=fault.number,
            words=fault.spec.describe,
        )

    @staticmethod
    def _times(fault: Fault) -> str:
        spec = fault.spec
        times = said(", for {seconds:g} s", seconds=spec.for_s)
        if spec.after_s:
            times = said("{times}, in {seconds:g} s", times=times, seconds=spec.after_s)
        if spec.when is not None:
            times = said("{times}, when {condition}", times=times, condition=str(spec.when))
        if spec.chance is not None:
            times = said("{times}, by chance ({chance:g} each second)", times=times, chance=spec.chance)
        return times

    def is_in_state(self, slot: str, state: str) -> bool:
        """See `fault_kinds.ConditionInputs`."""
        return self._running.is_in_state(slot, state)

    def number(self, source: str) -> float | None:
        """See `fault_kinds.ConditionInputs`."""
        if source == LOAD:
            return None if self._bus is None else 100 * self._bus.load()
        return self._numbers.newest(source)


def _concealed(mission: str) -> Mapping[str, object]:
    """What may be told of a fault that is to be found."""
    words = said("a fault of the mission {mission}; which one is to be found", mission=mission)
    return {
        "kind": "",
        "at": "",
        "words": words,
        "when": "",
        "begins_in_s": None,
        "for_s": None,
        "left_s": None,
        "since_s": None,
        "active": False,
        "concealed": True,
    }
