"""What `msbot demo` says in plain lines, where it is no terminal that reads them: without the library of terminals."""

from __future__ import annotations

import textwrap

from msbot_school.demo import DemoEvent, DemoSnapshot


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
        if len(_BETWEEN.join(known.values())) > width:
            del known[name]
    return _BETWEEN.join(known.values())


_GIVEN_UP = ("mean", "frames", "rate")
_BETWEEN = "   "


def event_words(event: DemoEvent) -> str:
    """One event in one line."""
    before = "" if event.from_state in ("", event.to_state) else f"{event.from_state} -> "
    return f"{event.at_s:7.3f} s  {event.part:<9} {before}{event.to_state}: {event.reason}"


def event_lines(event: DemoEvent, width: int, most: int | None) -> list[str]:
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
