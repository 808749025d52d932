"""What people did in a recording, as far as it can be done again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from msbot.recording.recordings.reading import OWN, RecordingReader
from msbot.recording.replay.piece import NS
from msbot_agent.text.json_reading import read_json
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

REPLAYED: Final = ("set", "reset", "bind", "unbind", "publish", "let_go", "stop", "go")
"""Operations whose arguments mean the same in another robot of the same slots. Others name edits by their numbers,
parts by their UIDs, or files."""
LEFT_OUT_OF: Final = ("record", "end_record", "identify", "window", "close_window", "ignore")
"""Operations that change nothing of what the robot does: nobody misses them."""
MOST_ACTS: Final = 100_000


@dataclass(frozen=True, slots=True)
class RecordedAct:
    """Something that somebody did."""

    at_ns: int
    who: str
    operation: str
    arguments: Mapping[str, object]

    @property
    def words(self) -> str:
        """The act as a person reads it."""
        words = [self.operation]
        for value in self.arguments.values():
            words += map(str, value) if isinstance(value, list) else [str(value)] if _is_said(value) else []
        return " ".join(words)


@dataclass(frozen=True, slots=True)
class RecordedActs:
    """The acts of a piece of a recording."""

    acts: tuple[RecordedAct, ...]
    """In the order of their times; at least one."""
    begin_ns: int
    """When the replay begins: the time that was asked for, else the first act's."""
    left_out: Mapping[str, int]
    """Operations that cannot be done again, and how many there were of each."""
    damage: str
    """Why the file could not be read to its end, in words; empty: it could."""


def read_acts(path: Path, *, from_s: float | None = None, to_s: float | None = None) -> RecordedActs:
    """Read what people did.

    Args:
        path: the file.
        from_s: from this second of the recording on.
        to_s: until this one.

    Raises:
        ConfigError: the file is no recording, or nobody did anything in that piece.
    """
    reader = RecordingReader(path)
    acts: list[RecordedAct] = []
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
    return RecordedActs(tuple(acts), begin_ns, dict(left_out), reader.damage)


def _is_said(value: object) -> bool:
    return value is not None and not isinstance(value, bool) and value != ""


def _act(at_ns: int, data: bytes) -> RecordedAct | None:
    """The act in a message; None: it makes no sense."""
    try:
        value = read_json(data)
    except ValueError:
        return None
    match value:
        case {"who": str(who), "operation": str(operation), "arguments": dict(arguments)}:
            return RecordedAct(at_ns, who, operation, arguments)
    return None
