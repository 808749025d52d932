"""What people did in a recording, as far as it can be done again."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Final

from msbot.recording.recordings.mcap_reader import OWN, RecordingReader
from msbot.recording.replay.replay_excerpt import NS
from msbot.recording.replay.schedule import Schedule
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

REPLAYED: Final = ("set", "reset", "bind", "unbind", "publish", "let_go", "stop", "go")
"""Operations whose arguments mean the same in another robot of the same slots. Others name edits by their numbers,
parts by their UIDs, or files."""
LEFT_OUT_OF: Final = ("record", "end_record", "identify", "window", "close_window", "ignore")
"""Operations that change nothing of what the robot does: nobody misses them."""
MOST_ACTS: Final = 100_000


@dataclass(frozen=True, slots=True)
class RecordedOperation:
    """Something that somebody did."""

    at_ns: int
    who: str
    operation: str
    arguments: Mapping[str, object]

    @property
    def describe(self) -> str:
        """The act as a person reads it."""
        words = [self.operation]
        for value in self.arguments.values():
            words += map(str, value) if isinstance(value, list) else [str(value)] if _is_said(value) else []
        return " ".join(words)


@dataclass(frozen=True, slots=True)
class RecordedOperations:
    """The acts of a piece of a recording."""

    acts: tuple[RecordedOperation, ...]
    """In the order of their times; at least one."""
    begin_ns: int
    """When the replay begins: the time that was asked for, else the first act's."""
    left_out: Mapping[str, int]
    """Operations that cannot be done again, and how many there were of each."""
    damage: str
    """Why the file could not be read to its end, in words; empty: it could."""


def read_operations(path: Path, *, from_s: float | None = None, to_s: float | None = None) -> RecordedOperations:
    """Read what people did.

    Args:
        path: the file.
        from_s: from this second of the recording on.
        to_s: until this one.

    Raises:
        ConfigError: the file is no recording, or nobody did anything in that piece.
    """
    reader = RecordingReader(path)
    acts: list[RecordedOperation] = []
    left_out: Counter[str] = Counter()
    began_ns: int | None = None
    for message in reader.messages():
        began_ns = message.logged_ns if began_ns is None else began_ns
        if message.topic != f"{OWN}acts" or message.is_repeated:
            continue
        at_s = (message.at_ns - began_ns) / NS
        act = _act(message.at_ns, message.data)
        if act is None or (from_s is not None and at_s < from_s) or (to_s is not None and at_s > to_s):
            continue
        if act.operation in REPLAYED:
            acts.append(act)
        elif act.operation not in LEFT_OUT_OF:
            left_out[act.operation] += 1
        if len(acts) > MOST_ACTS:
            raise ConfigError(f"{path}: these are more than {MOST_ACTS} acts: choose a shorter piece")
    if not acts:
        others = f" but {', '.join(left_out)}, which cannot be done again" if left_out else ""
        raise ConfigError(f"{path}: nobody did anything in that time{others}, so there is nothing to replay")
    acts.sort(key=lambda one: one.at_ns)
    begin_ns = acts[0].at_ns if from_s is None or began_ns is None else began_ns + round(from_s * NS)
    return RecordedOperations(tuple(acts), begin_ns, dict(left_out), reader.damage)


def _is_said(value: object) -> bool:
    return value is not None and not isinstance(value, bool) and value != ""


def _act(at_ns: int, data: bytes) -> RecordedOperation | None:
    """The act in a message; None: it makes no sense."""
    try:
        value = read_json(data)
    except ValueError:
        return None
    match value:
        case {"who": str(who), "operation": str(operation), "arguments": dict(arguments)}:
            return RecordedOperation(at_ns, who, operation, arguments)
    return None


# Acts of a recording, done again in a running robot: at their times, in their order, told as replayed.
#
# Nothing is done before it is known that the slots of all acts are there. The first act that the robot refuses ends the
# replay: what follows would be done to another robot than the recorded one. While a STOP of somebody else holds, time
# stands still; a replayed GO ends only a STOP that the replay itself has said, and that nobody has said besides.


LOOK_S = 0.1
"""How often it is looked whether a STOP holds."""
ACTS_REPLAYED = ", replayed"

Ask = Callable[[Mapping[str, object]], Awaitable[Mapping[str, object]]]
"""Has the robot do something: takes `{"do": ..., "args": ..., "who": ...}`; the answer has `error` if it refuses."""


class OperationPlayer:
    """Replays acts once. Use it in the thread of its loop.

    Args:
        acts: what is done.
        ask: how the robot is asked.
        speed: seconds of the recording in one second.
        say: called with sentences about how it goes.
        may_go: whether time may pass, besides what STOP says: the parts of the same replay are in the robot.
        begin_ns: when the replay begins, if not with the acts.
    """

    def __init__(
        self,
        acts: RecordedOperations,
        ask: Ask,
        *,
        speed: float = 1.0,
        say: Callable[[str], None],
        may_go: Callable[[], bool] = lambda: True,
        begin_ns: int | None = None,
    ) -> None:
        self.done = 0
        """Acts that were done."""
        self._acts = acts.acts
        self._ask = ask
        self._say = say
        self._may_go = may_go
        self._schedule = Schedule(
            [one.at_ns for one in acts.acts], begin_ns=acts.begin_ns if begin_ns is None else begin_ns, speed=speed
        )
        self._said_stop = ""
        """In whose name the replay has said the STOP that holds."""
        self._waits = False
        self._ending = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Whether everything was done."""
        return self._schedule.ended

    @property
    def holds_stop(self) -> bool:
        """Whether the STOP that holds is one that the replay has said, and nobody besides."""
        return bool(self._said_stop) and not self._waits

    def end(self) -> None:
        """End before everything is done."""
        self._ending.set()

    async def run(self) -> None:
        """Do everything at its time.

        Raises:
            ConfigError: the robot has other slots, or refuses an act; the text says which.
        """
        await self._check()
        loop = asyncio.get_running_loop()
        while not self.ended and not self._ending.is_set():
            await self._follow(loop.time())
            index = self._schedule.due(loop.time())
            if index is not None:
                await self._do(self._acts[index])
                self._schedule.done()
                continue
            due_at = self._schedule.timer()
            await self._sleep(LOOK_S if due_at is None else min(due_at - loop.time(), LOOK_S))

    async def _check(self) -> None:
        """Refuse before anything is done what does not fit.

        Raises:
            ConfigError: there is no such slot.
        """
        known: set[str] = set()
        for act in self._acts:
            for slot in _slots(act):
                if slot not in known:
                    answer = await self._ask({"do": "values", "args": {"slot": slot}, "who": act.who})
                    if "error" in answer:
                        raise _misfit(act, str(answer["error"]))
                    known.add(slot)

    async def _follow(self, now: float) -> None:
        """Go, or wait."""
        stop = await self._ask({"do": "stop_report", "args": {}, "who": "replay"})
        if not stop.get("stopped"):
            self._said_stop = ""  # somebody has ended it
        is_ours = stop.get("by") == self._said_stop and not stop.get("also_by")
        if stop.get("stopped") and not is_ours:
            if not self._waits:
                self._say(f"The replay waits: STOP by {' and '.join([str(stop.get('by')), *_names(stop)])} holds")
            self._waits = True
            self._schedule.hold(now)
        elif not self._may_go():
            self._schedule.hold(now)
        else:
            if self._waits:
                self._say("The replay goes on")
            self._waits = False
            self._schedule.go(now)

    async def _do(self, act: RecordedOperation) -> None:
        who = act.who if act.who.endswith(ACTS_REPLAYED) else f"{act.who}{ACTS_REPLAYED}"
        if act.operation == "go" and not self._said_stop:
            self._say("A recorded GO is left out: no STOP of this replay holds")
            return
        arguments = {name: value for name, value in act.arguments.items() if value is not None}
        answer = await self._ask({"do": act.operation, "args": arguments, "who": who})
        if "error" in answer:
            raise _misfit(act, str(answer["error"]))
        if act.operation in ("stop", "go"):
            self._said_stop = who if act.operation == "stop" else ""
        self.done += 1

    async def _sleep(self, seconds: float) -> None:
        try:
            async with asyncio.timeout(max(seconds, 0.0)):
                await self._ending.wait()
        except TimeoutError:
            return


def _slots(act: RecordedOperation) -> list[str]:
    """The slots that an act names."""
    found = [act.arguments.get("slot")]
    ports = [act.arguments.get("port"), act.arguments.get("from")]
    targets = act.arguments.get("to")
    ports += targets if isinstance(targets, list) else []
    found += [port.partition(".")[0] for port in ports if isinstance(port, str)]
    return [slot for slot in found if isinstance(slot, str) and slot]


def _names(stop: Mapping[str, object]) -> list[str]:
    names = stop.get("also_by")
    return [str(name) for name in names] if isinstance(names, list) else []


def _misfit(act: RecordedOperation, error: str) -> ConfigError:
    return ConfigError(f"what {act.who} did ({act.describe}) does not fit this robot: {error}")
