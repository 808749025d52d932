"""Other forms of log lines than that for a terminal: JSON for programs, and what systemd's journal understands."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Final, TextIO

from msbot_agent.log.terminal_log import PlainFormatter
from msbot_agent.process.own_code import room_of

FIELDS: Final = "msbot_fields"
"""Attribute of a record with values that belong to its message, for programs."""
ALWAYS: Final = "msbot_always"
"""Attribute of a record that is written however many like it there are."""

_PRIORITIES: Final = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


class JsonFormatter(logging.Formatter):
    """One record, one JSON object on one line; anything but ASCII is escaped, so nothing can break out of it."""

    def format(self, record: logging.LogRecord) -> str:
        """See `logging.Formatter`."""
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "room": room_of(record.name),
            "logger": record.name,
            "message": record.getMessage(),
        }
        fields = getattr(record, FIELDS, None)
        if isinstance(fields, Mapping):
            line.update(fields)
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class JournalFormatter(PlainFormatter):
    """Lines with their priority in front, as systemd's journal takes them from standard error (sd-daemon(3))."""

    def __init__(self) -> None:
        super().__init__("%(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """See `logging.Formatter`; each line of a traceback has its priority, too."""
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).split("\n"))


def goes_to_journal(stream: TextIO) -> bool:
    """Whether standard output or standard error is connected to systemd's journal (systemd.exec(5),
    JOURNAL_STREAM)."""
    device, _, number = os.environ.get("JOURNAL_STREAM", "").partition(":")
    if not (device.isdecimal() and number.isdecimal()):
        return False
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):  # closed, or no file, as in tests
        return False
    return (status.st_dev, status.st_ino) == (int(device), int(number))
