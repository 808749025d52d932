"""What `msbot demo` says outside of its table: as JSON, as notes at the terminal, and in plain lines without one."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

from msbot_school.demo import DemoRobot, DemoSnapshot, DemoStateChange

# The JSON object of `msbot demo --json`; its keys are described in docs/tutorial/demo.md.


Json = dict[str, "Json"] | list["Json"] | str | float | int | bool | None


def as_json(robot: DemoRobot) -> Json:
    """Everything that happened, as values that `json.dumps` takes."""
    snapshot = robot.snapshot()
    bus = snapshot.bus
    return {
        "robot": snapshot.robot,
        "link": snapshot.link,
        "parts": [
            {
                "name": part.name,
                "part_number": part.part_number,
                "slot": part.slot,
                "state": part.state,
                "plug_in_to_active_ms": _rounded(part.plug_in_to_active_ms),
                "beats": part.beats,
                "life": part.life,
            }
            for part in snapshot.parts
        ],
        "topics": [
            {"name": topic.name, "published": topic.published, "delivered": topic.delivered}
            for topic in snapshot.topics
        ],
        "bus": None
        if bus is None
        else {
            "bitrate": bus.bitrate,
            "frames": bus.frames,
            "bits": bus.bits,
            "load_percent": _rounded(bus.load_percent),
            "errors": bus.errors,
        },
        "events": [
            {
                "at_s": _rounded(event.at_s),
                "part": event.part,
                "from": event.from_state,
                "to": event.to_state,
                "reason": event.reason,
                "slot": event.slot,
            }
            for event in robot.events
        ],
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


# Lines for the person at the terminal while a demo runs.


class Notes:
    """Lines for the person at the terminal while the robot runs, such as the page's address."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.say: Callable[[str], None] | None = None
        """Prints a line at once; None: the screen shows `lines`."""

    def add(self, line: str) -> None:
        """Say a line, now or on the screen."""
        self.lines.append(line)
        if self.say is not None:
            self.say(line)


# What `msbot demo` says in plain lines, where it is no terminal that reads them: without the library of terminals.


def wire_words(snapshot: DemoSnapshot, width: int) -> str:
    """The wire in one line; what has no room in it is left out whole, the first in `_GIVEN_UP` first."""
    bus = snapshot.bus
    if bus is None:
        return f"{snapshot.link}: no bus to measure"
    known = {
        "rate": f"bus {bus.bitrate / 1000:g} kbit/s",
        "load": f"load now {bus.load_now_percent:.1f} %",
        "mean": f"mean {bus.load_percent:.1f} %",
        "frames": f"frames {bus.frames}",
        "errors": f"errors {bus.errors}",
    }
    for name in _GIVEN_UP:
        if len(_BETWEEN_LINES.join(known.values())) > width:
            del known[name]
    return _BETWEEN_LINES.join(known.values())


_GIVEN_UP = ("mean", "frames", "rate")
_BETWEEN_LINES = "   "


def event_words(event: DemoStateChange) -> str:
    """One event in one line."""
    before = "" if event.from_state in ("", event.to_state) else f"{event.from_state} -> "
    return f"{event.at_s:7.3f} s  {event.part:<9} {before}{event.to_state}: {event.reason}"


def event_lines(event: DemoStateChange, width: int, most: int | None) -> list[str]:
    """One event in at most so many lines, or in all; where one is not enough: when, who, what it is now, and why."""
    words = event_words(event)
    if len(words) <= width:
        return [words]
    short = f"{event.at_s:.1f} s {event.part} {event.to_state}: {event.reason}"
    return textwrap.wrap(short, max(width, 10), subsequent_indent="  ", max_lines=most, placeholder="…")


def status_words(snapshot: DemoSnapshot) -> str:
    """The state of the robot in one line, for a log."""
    parts = "  ".join(
        f"{part.name} {part.state} life {part.life} in {part.messages_in} out {part.messages_out}"
        for part in snapshot.parts
    )
    load = "" if snapshot.bus is None else f"  bus {snapshot.bus.load_now_percent:.1f} %"
    return f"{snapshot.at_s:7.1f} s  {parts}{load}"
