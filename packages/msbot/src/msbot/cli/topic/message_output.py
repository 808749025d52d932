"""A message of a topic as text: YAML, a line with its time as candump has it, CSV, JSON. Pure."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from enum import Enum
from struct import pack, unpack
from typing import Any

from msbot_agent.text.sentence import as_cell, printable
from msbot_xrce.errors import ConfigError

LARGEST_FLOAT32 = 3.4e38
_PLACES = re.compile(r"([^.\[\]]+)|\[([0-9]{1,9})\]")
"""The steps to a field inside others: names, and places in lists."""


class TimeForm(Enum):
    """The times in front of lines, by candump's letters."""

    ABSOLUTE = "a"
    DELTA = "d"
    ZERO = "z"
    DATE = "A"


class MessageOutput:
    """Turns messages into lines of text.

    Args:
        topic: whose messages they are.
        field: only this field, `pose.x` for one in a nested message; empty: all.
        as_csv: values with commas.
        as_json: JSON objects.
        times: a line with its time for each message; None: none of the kind.
    """

    def __init__(
        self, topic: str, *, field: str = "", as_csv: bool = False, as_json: bool = False, times: TimeForm | None = None
    ) -> None:
        self._topic = topic
        self._field = field
        self._as_csv, self._as_json, self._times = as_csv, as_json, times
        self._began: float | None = None
        self._before: float | None = None

    def lines(self, sample: Mapping[str, Any]) -> Iterator[str]:
        """The lines of one message as `topic_samples` answers it.

        Raises:
            ConfigError: it has no such field.
        """
        at = float(sample["at"])
        value = _chosen(sample["fields"], self._field, self._topic)
        if self._as_json:
            slot = sample.get("slot", "")
            yield json.dumps({"at": at, "topic": self._topic, "slot": slot, "fields": value})
        elif self._as_csv:
            yield _csv_line(value)
        elif self._times is not None:
            yield f" ({self._time(at)})  {printable(self._topic)}  {', '.join(_pairs(value))}"
        else:
            yield from _yaml(value, 0)
            yield "---"
        self._before = at

    def _time(self, at: float) -> str:
        if self._began is None:
            self._began = self._before = at
        assert self._before is not None
        match self._times:
            case TimeForm.DELTA:
                return f"{at - self._before:010.6f}"
            case TimeForm.ZERO:
                return f"{at - self._began:010.6f}"
            case TimeForm.DATE:
                return datetime.fromtimestamp(at).strftime("%Y-%m-%d %H:%M:%S.%f")
            case _:
                return f"{at:.6f}"


def _chosen(fields: object, path: str, topic: str) -> object:
    value = fields
    for name, place in _PLACES.findall(path):
        if place:
            if not isinstance(value, list) or int(place) >= len(value):
                has = f"it has {len(value)} elements there" if isinstance(value, list) else "that is no list"
                raise ConfigError(f"a message of {topic} has no {path!r}; {has}")
            value = value[int(place)]
            continue
        if not isinstance(value, dict) or name not in value:
            known = ", ".join(value) if isinstance(value, dict) else "none"
            raise ConfigError(f"a message of {topic} has no field {path!r}; it has {known}")
        value = value[name]
    return value


def _scalar(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float):
        # 49.9, not 49.900001525878906, when it came in 32 bits.
        is_short = abs(value) < LARGEST_FLOAT32 and unpack("<f", pack("<f", value))[0] == value
        text = f"{value:.7g}" if is_short else f"{value:.15g}"
        return text if set(text) & set(".en") else f"{text}.0"
    return str(value)


_LIKE_OTHERS = frozenset({"", "true", "false", "null", "yes", "no", "on", "off", "~"})
_MARKS = "-?:,[]{}#&*!|>'\"%@`"


def _text(value: str) -> str:
    """A text that YAML reads as that text."""
    plain = value == value.strip() and value.isprintable() and value.casefold() not in _LIKE_OTHERS
    if plain and value[0] not in _MARKS and ": " not in value and " #" not in value and not value.endswith(":"):
        try:
            float(value)
        except ValueError:
            return value
    return json.dumps(value, ensure_ascii=not value.isprintable())


def _yaml(value: object, depth: int) -> Iterator[str]:
    pad = "  " * depth
    if isinstance(value, dict):
        for name, one in value.items():
            if isinstance(one, dict | list) and one:
                yield f"{pad}{name}:"
                yield from _yaml(one, depth if isinstance(one, list) else depth + 1)
            else:
                yield f"{pad}{name}: {_empty_or(one)}"
    elif isinstance(value, list):
        for one in value:
            if isinstance(one, dict) and one:
                first, *others = _yaml(one, depth + 1)
                yield f"{pad}- {first.strip()}"
                yield from others
            else:
                yield f"{pad}- {_empty_or(one)}"
    else:
        yield f"{pad}{_scalar(value)}"


def _empty_or(value: object) -> str:
    if isinstance(value, list | dict):
        return json.dumps(value)
    return _scalar(value)


def _leaves(value: object, path: str = "") -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        for name, one in value.items():
            yield from _leaves(one, f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for number, one in enumerate(value):
            yield from _leaves(one, f"{path}[{number}]")
    else:
        yield path, value


def _pairs(value: object) -> Iterator[str]:
    for name, one in _leaves(value):
        yield f"{name} {_scalar(one)}".strip()


def _csv_line(value: object) -> str:
    line = io.StringIO()
    cells = (printable(as_cell(one)) if isinstance(one, str) else _scalar(one) for _, one in _leaves(value))
    csv.writer(line, lineterminator="").writerow(cells)
    return line.getvalue()
