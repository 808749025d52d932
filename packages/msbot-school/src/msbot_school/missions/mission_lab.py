"""Plays missions in a running robot: plants their faults, listens to what people do, and takes everything back.

Theory of operation. One mission runs at a time. Its faults are the fault lab's, which ends them with STOP and with the
robot whatever happens here; this adds notes of what people say and do, and one timer twice a second while it runs. What
ends a mission, ends its faults.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from random import SystemRandom
from typing import Final

from msbot.operations.dispatch import InProcessOperations, PerformedOperation
from msbot.pnp import PartEvent, PartState, StopStatus
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_school.faults.fault_kinds import Condition, read_condition
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.missions.mission import Mission, MissionEvent, MissionEventKind, drawn
from msbot_school.missions.mission_file import parse_mission, ready_mission, ready_missions
from msbot_school.missions.mission_run import MissionRun
from msbot_school.missions.recorded_missions import PlayedMission
from msbot_xrce.errors import ConfigError

LOOK_S: Final = 0.5
"""Period in which conditions are looked at, and whether it is over."""
MOST_REPORTS: Final = 20
"""Reports that are kept; older ones are in recordings."""
MOST_TOLD: Final = 10
"""Latest answers and repairs that are shown."""
NO_ACTS: Final = frozenset(
    (
        "start_mission",
        "stop_mission",
        "answer_mission",
        "repair",
        "mission_hint",
        "faults",
        "record",
        "end_record",
        "stop",
    )
)
"""Operations that are no acts in a mission, or have notes of their own."""


class MissionLab:
    """Missions of one running robot; made in its event loop.

    Args:
        operations: what can be done to the robot.
        faults: its fault lab.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self, operations: InProcessOperations, faults: FaultLab, *, epoch_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._missions = operations.missions
        self._acts = operations.acts
        self._running = operations.missions.running
        self._faults = faults
        self._epoch_ns = epoch_ns
        self._run: MissionRun | None = None
        self._began_ms = 0
        self._seed = 0
        self._head: Mapping[str, object] = {}
        self._planted: dict[int, int] = {}
        """Number of a fault in the fault lab -> its number in the mission."""
        self._acts_before: dict[int, int] = {}
        """Number of a fault in the mission -> the last thing that anybody did before it began."""
        self._conditions: dict[int, Condition] = {}
        """Number of a task -> what must hold."""
        self._timer: asyncio.TimerHandle | None = None
        self._count = 0
        self._reports: deque[PlayedMission] = deque(maxlen=MOST_REPORTS)
        operations.missions.attach(self)
        operations.faults.on_change(self._fault_changed)
        operations.faults.on_looked(self._looked)
        operations.on_done(self._done)
        self._running.inventory.on_event(self._part_changed)
        # After the fault lab's: that it ends its faults is noted first.
        self._running.master.on_stop(self._stopped)

    # What people do.

    async def start(self, name: str, toml: str, seed: int | None, who: str) -> str:
        """See `MissionControl`."""
        reading = partial(parse_mission, toml, name) if toml else partial(ready_mission, name)
        mission = await asyncio.to_thread(reading)
        return self.begin(mission, SystemRandom().randrange(1_000_000) if seed is None else seed, who)

    def begin(self, mission: Mission, seed: int, who: str) -> str:
        """Begin a mission; says what begins.

        Raises:
            ConfigError: one runs, or the robot is not what it needs; nothing has changed.
        """
        if self._run is not None:
            raise ConfigError(
                said("the mission {mission} runs: `msbot mission stop` ends it", mission=self._run.mission.name)
            )
        self._check_robot(mission)
        conditions = {number: read_condition(task.until) for number, task in enumerate(mission.tasks, 1) if task.until}
        for condition in conditions.values():
            self._faults.prepare(condition)
        faults = drawn(mission, seed)
        planted = self._faults.plant_for_mission(mission.name, [fault.wish for fault in faults])
        self._count += 1
        self._began_ms, self._seed = self._epoch_ns() // 1_000_000, seed
        self._head = PlayedMission(self._count, mission, seed, self._began_ms, ()).head()
        self._planted = dict(zip(planted, (fault.number for fault in faults), strict=True))
        self._conditions = conditions
        self._run = MissionRun(mission, faults, who, self._running.now(), on_fact=self._noted)
        for slot in self._running.slot_names():
            self._run.state(slot, self._running.state_of(slot), "", self._running.now())
        self._missions.journal(said("mission {mission} begins", mission=mission.name), who)
        self._look()
        return said("mission {mission} begins: {title}", mission=mission.name, title=mission.title)

    def stop(self, who: str) -> str:
        """See `MissionControl`."""
        mission = self._the_run().mission
        self._end(said("{who} has stopped it", who=who), who)
        return said("mission {mission} is over", mission=mission.name)

    def answer(self, kind: str, at: str, who: str) -> str:
        """See `MissionControl`."""
        run = self._the_run()
        if at and at not in self._running.slot_names():
            hint = instead_of(at, self._running.slot_names())
            raise ConfigError(said("there is no slot {slot}; {hint}", slot=at, hint=hint))
        words = run.name(who, kind, at, self._running.now())
        self._look()
        return words

    def repair(self, repair: str, at: str, who: str) -> str:
        """See `MissionControl`."""
        run = self._the_run()
        words, mended = run.repair(who, repair, at, self._running.now())
        for number, of_mission in list(self._planted.items()):
            if of_mission == mended:
                self._faults.mend(number, said("{who} has mended it", who=who), who)
        self._look()
        return words

    def hint(self, who: str) -> str:
        """See `MissionControl`."""
        return self._the_run().hint(who, self._running.now())

    def as_json(self) -> Mapping[str, object]:
        """See `MissionControl`."""
        run = self._run
        if run is None:
            return {"reports": [one.number for one in self._reports]}
        grade = run.grade()
        to_find = [one for one in grade.faults if one.fault.find]
        to_mend = [one for one in grade.faults if one.fault.mend]
        return {
            "mission": run.mission.name,
            "title": run.mission.title,
            "story": run.mission.story,
            "who": run.who,
            "time_s": run.mission.time_s,
            "left_s": max(run.ends_at - self._running.now(), 0.0),
            "found": sum(one.found_s is not None for one in to_find),
            "to_find": len(to_find),
            "mended": sum(one.over_s is not None for one in to_mend),
            "to_mend": len(to_mend),
            "hints": list(run.mission.hints[: run.hints_given]),
            "hints_left": len(run.mission.hints) - run.hints_given,
            "tasks": [{"words": one.task.words, "done": one.is_done} for one in grade.tasks],
            "told": self._told(run),
            "reports": [one.number for one in self._reports],
        }

    def obstacles(self) -> Mapping[str, str]:
        """See `MissionControl`."""
        return {name: why for name, mission in ready_missions().items() if (why := self._obstacle(mission))}

    def report(self, number: int | None) -> Mapping[str, object]:
        """See `MissionControl`."""
        return self.played(number).as_json()

    def played(self, number: int | None) -> PlayedMission:
        """A mission that is over; without number the latest.

        Raises:
            ConfigError: there is none.
        """
        found = [one for one in self._reports if number in (None, one.number)]
        if not found:
            known = ", ".join(str(one.number) for one in self._reports) or said("none")
            raise ConfigError(
                said(
                    "there is no report of a mission that is over, or none with that number; there are {known}",
                    known=known,
                )
            )
        return found[-1]

    async def run(self) -> None:
        """Until cancelled; then the mission that runs is over."""
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self._end(said("the robot ends"), "")

    # How it works.

    def _obstacle(self, mission: Mission) -> str:
        """Why the mission needs another robot, a sentence; empty: this one has all that it needs."""
        known = self._running.slot_names()
        missing = [slot for slot in mission.needs if slot not in known]
        if missing:
            sample = said(": `msbot demo --robot {sample}` has them", sample=mission.sample) if mission.sample else ""
            return said(
                "the mission {mission} needs a robot with the slots {missing}{sample}",
                mission=mission.name,
                missing=", ".join(missing),
                sample=sample,
            )
        for fault in mission.faults:  # one of its kinds is drawn
            if why := [words for kind in fault.kinds if (words := self._faults.obstacle(kind))]:
                return why[0]
        return ""

    def _check_robot(self, mission: Mission) -> None:
        if self._running.master.stop.stopped:
            raise ConfigError(said("STOP is in force: no mission begins until GO"))
        if why := self._obstacle(mission):
            raise ConfigError(why)
        ill = [slot for slot in mission.needs if self._running.state_of(slot) != PartState.ACTIVE.value]
        if ill:
            raise ConfigError(
                said("a mission begins in a robot that is well: {slots} must be active first", slots=", ".join(ill))
            )

    def _look(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        run = self._run
        if run is None:
            return
        now = self._running.now()
        for number, condition in self._conditions.items():
            run.holds(number, now, holds=self._faults.holds(condition))
        reason = run.why_over(now)
        if reason:
            self._end(reason, run.who)
        else:
            self._timer = self._running.loop.call_at(min(now + LOOK_S, run.ends_at), self._look)

    def _end(self, reason: str, who: str) -> None:
        run = self._run
        if run is None:
            return
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        now = self._running.now()
        for number, condition in self._conditions.items():
            run.holds(number, now, holds=self._faults.holds(condition))
        run.end(reason, now)
        self._run = None
        self._planted = {}
        self._acts_before = {}
        self._faults.end_mission(said("the mission {mission} is over", mission=run.mission.name))
        played = PlayedMission(self._count, run.mission, self._seed, self._began_ms, tuple(run.facts))
        self._reports.append(played)
        # The whole once more: of a long mission, the recorder's ring may no longer have the beginning.
        self._missions.noted({"began_ms": self._began_ms, "head": played.head(), "facts": played.as_json()["facts"]})
        words = said("mission {mission} is over ({reason})", mission=run.mission.name, reason=reason)
        self._missions.journal(words, who or run.who)

    def _noted(self, fact: MissionEvent) -> None:
        head = {"head": self._head} if fact.what is MissionEventKind.BEGAN else {}
        self._missions.noted({"began_ms": self._began_ms, **head, **fact.as_json()})

    def _the_run(self) -> MissionRun:
        if self._run is None:
            raise ConfigError(said("no mission runs: `msbot mission start` begins one"))
        return self._run

    @staticmethod
    def _told(run: MissionRun) -> list[dict[str, object]]:
        """The latest answers, repairs and hints, as they were answered."""
        told = [fact for fact in run.facts if fact.what in (MissionEventKind.NAMED, MissionEventKind.REPAIRED)]
        return [
            {
                "at_s": fact.at_s,
                "who": fact.who,
                "what": fact.what.value,
                "word": fact.word,
                "slot": fact.slot,
                "text": fact.text,
            }
            for fact in told[-MOST_TOLD:]
        ]

    # What is heard.

    def _fault_changed(self, change: Mapping[str, object]) -> None:
        number = change["number"]
        assert isinstance(number, int)
        of_mission = self._planted.get(number)
        if self._run is None or of_mission is None:
            return
        now = self._running.now()
        if change["begins"]:
            self._acts_before[of_mission] = self._acts.count
            self._run.fault_began(of_mission, now)
        else:
            at = next((one.at for one in self._run.faults if one.number == of_mission), "")
            # Whoever did the last thing there since the fault began.
            act = self._acts.latest([at], self._acts_before.get(of_mission, 0))
            by = "" if act is None else act.who
            self._run.fault_over(of_mission, now, str(change["reason"]), is_mended=bool(change["mended"]), by=by)

    def _looked(self, who: str) -> None:
        if self._run is not None:
            self._run.looked(who, self._running.now())

    def _done(self, deed: PerformedOperation) -> None:
        if self._run is not None and deed.operation not in NO_ACTS:
            self._run.act(deed.operation, deed.arguments, deed.who, deed.words, self._running.now())

    def _part_changed(self, event: PartEvent) -> None:
        if self._run is not None and event.slot:
            self._run.state(event.slot, event.to_state.value, event.reason, event.at)

    def _stopped(self, status: StopStatus) -> None:
        if self._run is not None and status.stopped:
            self._run.act("stop", {"reason": status.reason}, status.by, said("STOP"), self._running.now())
            self._end(said("{who} said STOP", who=status.by), status.by)
