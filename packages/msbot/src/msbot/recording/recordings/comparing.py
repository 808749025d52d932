"""What happened in one recording and not in another."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Final

from msbot.recording.recordings.reading import FRAMES, OWN, Decoder, RecordedMessage
from msbot.recording.recordings.telling import line_of
from msbot_xrce.common.amount import amount

HAPPENINGS: Final = (f"{OWN}events", f"{OWN}acts", f"{OWN}stop")
_TIME: Final = re.compile(r"\d+(?:\.\d+)?(?= ?(?:s|ms)\b)")
"""A time inside a sentence; two runs are never exactly alike in their times."""


def differences(before: Iterable[RecordedMessage], after: Iterable[RecordedMessage]) -> list[str]:
    """Lines: `- ` only before, `+ ` only after, `~ ` a topic that says more or less; none: the same happened."""
    happened, said = [], []
    for messages in (before, after):
        lines, counts = _read(messages)
        happened.append(lines)
        said.append(counts)
    found = [line for line in difflib.ndiff(happened[0], happened[1]) if line[:2] in ("- ", "+ ")]
    first, second = said
    for topic in sorted(first.keys() | second.keys()):
        if not (first[topic] and second[topic]):
            found.append(f"{'-' if first[topic] else '+'} {topic}: {amount(first[topic] or second[topic], 'sample')}")
    return found


def _read(messages: Iterable[RecordedMessage]) -> tuple[list[str], Counter[str]]:
    decoder = Decoder()
    lines: list[str] = []
    counts: Counter[str] = Counter()
    for message in _fresh(messages):
        if message.topic in HAPPENINGS:
            lines.append(_TIME.sub("...", line_of(message, decoder) or ""))
        elif not message.topic.startswith(OWN):
            counts[message.topic] += 1
    return lines, counts


def _fresh(messages: Iterable[RecordedMessage]) -> Iterator[RecordedMessage]:
    return (one for one in messages if not one.is_repeated and not one.topic.startswith(FRAMES))
