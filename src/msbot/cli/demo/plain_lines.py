"""What `msbot demo` says in plain lines, where it is no terminal that reads them: without the library of terminals."""

from __future__ import annotations

from msbot.demo import DemoEvent, DemoSnapshot


def wire_words(snapshot: DemoSnapshot) -> str:
    """The wire in one line."""
    bus = snapshot.bus
    if bus is None:
        return f"{snapshot.link}: no bus to measure"
    return (
        f"bus {bus.bitrate / 1000:g} kbit/s   load now {bus.load_now_percent:.1f} %   mean {bus.load_percent:.1f} %   "
        f"frames {bus.frames}   errors {bus.errors}"
    )


def event_words(event: DemoEvent) -> str:
    """One event in one line."""
    return f"{event.at_s:7.3f} s  {event.part:<9} {event.from_state} -> {event.to_state}: {event.reason}"


def status_words(snapshot: DemoSnapshot) -> str:
    """The state of the robot in one line, for a log."""
    parts = "  ".join(
        f"{part.name} {part.state} life {part.life} in {part.messages_in} out {part.messages_out}"
        for part in snapshot.parts
    )
    load = "" if snapshot.bus is None else f"  bus {snapshot.bus.load_now_percent:.1f} %"
    return f"{snapshot.at_s:7.1f} s  {parts}{load}"
