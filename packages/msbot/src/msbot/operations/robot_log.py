"""What happens in a running robot, line by line, for whoever follows it: states of parts, STOP, what people do.

The newest lines are kept, numbered from 1. A request names the number of the line after which it wants more, and waits
a while for the next one; the master keeps nothing about who asks. What is said of planted faults and missions is left
out: a class is to find them.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Mapping
from math import inf
from typing import Final

from msbot.operations.operation import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.operations.table import OPERATIONS
from msbot.pnp import PartEvent
from msbot.pnp.model import ProgramLogLine
from msbot.pnp.part_log import EVIDENCE

MOST_KEPT: Final = 1000
MOST_TOLD: Final = 200
"""Lines in one answer."""
MOST_WAITING: Final = 64
"""Requests that wait for a line at once; one more is answered at once."""
LONGEST: Final = 500
"""Letters of a line; longer ones are cut off."""
QUIET_S: Final = 5.0
"""Who drives a port or a topic by hand again within this time has no further line."""
MOST_DRIVEN: Final = 200
_REPEATED: Final = ("publish", "publish_topic")
_SECRET: Final = ("fault", "mission")
"""The journal's words for what a class is to find."""


class RobotLog:
    """Collects the lines of one running robot."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._lines: deque[dict[str, object]] = deque(maxlen=MOST_KEPT)
        self._total = 0
        self._waiting = 0
        self._driven: dict[tuple[str, str, object], float] = {}
        """Who drives what by hand -> when last."""
        self._news = asyncio.Event()
        running.master.inventory.on_event(self._part_changed)
        running.master.inventory.log.on_line(self._program_said)

    def operation_done(self, who: str, operation: str, arguments: Mapping[str, object], words: str) -> None:
        """Take what somebody did; what the operations call."""
        row = OPERATIONS.get(operation)
        if row is None or row.journal in _SECRET or not words:
            return
        where = arguments.get("port") or arguments.get("topic")
        if where and operation in _REPEATED:
            now, before = self._running.now(), self._driven.pop((who, operation, where), -inf)
            self._driven[who, operation, where] = now
            if len(self._driven) > MOST_DRIVEN:
                del self._driven[next(iter(self._driven))]
            if now - before < QUIET_S:
                return
        slot = str(arguments.get("slot") or str(arguments.get("port") or "").rpartition(".")[0])
        self._add("person", who, slot, words if who in words else f"{who}: {words}")

    async def log_lines(self, after: int | None, last: int, wait: float) -> Outcome:
        """The lines after the one with that number; without a number, the last ones.

        The answer has `next`, the number to ask for next time, and `missed`, how many were gone before they were asked
        for. `at` of a line is in seconds since 1970.
        """
        oldest = self._total - len(self._lines)
        if after is None:
            after = max(self._total - last, oldest)
        elif after >= self._total and wait and self._waiting < MOST_WAITING:
            await self._wait(wait)
            oldest = self._total - len(self._lines)
        after = min(after, self._total)
        missed = max(oldest - after, 0)
        begin = after + missed - oldest
        found = [self._lines[place] for place in range(begin, min(begin + MOST_TOLD, len(self._lines)))]
        return Outcome(answer={"next": after + missed + len(found), "missed": missed, "lines": found})

    async def _wait(self, wait: float) -> None:
        self._news.clear()
        self._waiting += 1
        try:
            async with asyncio.timeout(wait):
                await self._news.wait()
        except TimeoutError:
            pass  # the answer has no line: that is one, too
        finally:
            self._waiting -= 1

    def _program_said(self, line: ProgramLogLine) -> None:
        self._add("program", line.part, line.slot, f"{line.part}: {line.words}", line.level.word)

    def _part_changed(self, event: PartEvent) -> None:
        if any(name == EVIDENCE for name, _ in event.evidence):
            return  # the journal's line of what a program said, which is here already
        self._add("part", event.part, event.slot or "", event.sentences()[0])

    def _add(self, kind: str, who: str, slot: str, words: str, level: str = "info") -> None:
        """Sentences stay sentences: whoever may not read addresses gets them without."""
        line = {
            "at": round(time.time(), 3),
            "kind": kind,
            "who": who,
            "slot": slot,
            "level": level,
            "words": words if len(words) <= LONGEST else words[:LONGEST],
        }
        self._lines.append(line)
        self._total += 1
        self._news.set()
