"""How `msbot demo` looks in a terminal: the live table. No logic of the robot here."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from msbot_school.demo import DemoEvent, DemoRobot, DemoSnapshot, PartSnapshot

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


STATE_STYLES = {
    "active": ("●", "bold green"),
    "checking": ("◔", "yellow"),
    "new": ("○", "yellow"),
    "late": ("◐", "bold yellow"),
    "standby": ("◌", "cyan"),
    "lost": ("✕", "bold red"),
    "left": ("✕", "red"),
    "refused": ("⊘", "bold red"),
}
LIFE_BARS = {3: "▮▮▮ 3", 2: "▮▮▯ 2", 1: "▮▯▯ 1", 0: "▯▯▯ 0"}
MOST_EVENTS = 8
KEYS = "a letter: pull that part out, plug it in again   q: quit"
COLUMNS = ("key", "slot", "part", "state", "life", "beat", "in", "out", "plug-in to active", "outputs 0-7")
RIGHT = frozenset({"beat", "in", "out", "plug-in to active"})
GIVEN_UP = ("outputs 0-7", "plug-in to active", "out", "in", "part", "beat", "life")
"""What a terminal without room does without, the first one first: a column is there whole, or not at all."""
LEAST = {"state": len("✕ lost (out)"), "life": 5, "beat": len("99.9 s"), "in": 4, "out": 4}
"""Characters that a column is taken to need, whatever is in it now: none comes and goes as values change."""
_BETWEEN = 3
"""Characters between two columns."""


def live_view(
    snapshot: DemoSnapshot, events: list[DemoEvent], notes: list[str], width: int, height: int
) -> RenderableType:
    """The whole screen, the page's link first: parts, wire, keys, and as many of the latest events as fit.

    Args:
        snapshot: the robot now.
        events: what happened, oldest first.
        notes: lines for the person, where the page is.
        width: columns of the terminal.
        height: lines of the terminal.
    """
    title = f"{snapshot.robot} on {snapshot.link}   {snapshot.at_s:6.1f} s"
    above: list[RenderableType] = [
        *(Text(note, style="bold", overflow="fold") for note in notes),
        Text(title, style="bold"),
        _parts_table(snapshot, width),
        Text(wire_words(snapshot, width), no_wrap=True, overflow="ellipsis"),
        Text(KEYS, style="italic"),
    ]
    folded = sum(max(0, len(line) - 1) // width for line in (*notes, title, KEYS))
    room = height - len(above) - folded - len(snapshot.parts) - _TABLE_FRAME
    recent: list[str] = []
    for event in reversed(events[-MOST_EVENTS:]):
        lines = event_lines(event, width, None if recent else max(room, 1))
        if len(recent) + len(lines) > room:
            break
        recent[:0] = lines
    return Group(*above, *(Text(line, style="dim", no_wrap=True, overflow="ellipsis") for line in recent))


_TABLE_FRAME = 3
"""Lines of the table besides its parts, and the one below everything, for the cursor."""


def _parts_table(snapshot: DemoSnapshot, width: int) -> Table:
    keys = {name: key for key, name in keys_of([part.name for part in snapshot.parts]).items()}
    rows = [_part_row(part, keys.get(part.name, "")) for part in snapshot.parts]
    needed = {
        title: max(len(title), LEAST.get(title, 0), *(len(row[title]) for row in rows))
        for title in COLUMNS
        if title != "outputs 0-7" or any(part.outputs for part in snapshot.parts)
    }
    for title in GIVEN_UP:
        if sum(needed.values()) + _BETWEEN * (len(needed) - 1) > width:
            needed.pop(title, None)
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for title in needed:
        table.add_column(title, justify="right" if title in RIGHT else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(row[title] for title in needed))
    return table


def _part_row(part: PartSnapshot, key: str) -> dict[str, str | Text]:
    icon, style = STATE_STYLES.get(part.state, ("○", ""))
    state = Text(f"{icon} {part.state}", style=style)
    if not part.plugged:
        state.append(" (out)", style="dim")
    return {
        "key": key,
        "slot": part.slot or f"({part.name})",
        "part": part.part_number,
        "state": state,
        "life": LIFE_BARS.get(part.life, "-"),
        "beat": "-" if part.beat_age_s is None else f"{part.beat_age_s:.1f} s",
        "in": str(part.messages_in),
        "out": str(part.messages_out),
        "plug-in to active": "-" if part.plug_in_to_active_ms is None else f"{part.plug_in_to_active_ms:.0f} ms",
        "outputs 0-7": "".join("●" if level else "·" for level in part.outputs),
    }


def keys_of(names: Sequence[str]) -> dict[str, str]:
    """The key that pulls and plugs each part: the first letter of its name that is free, else a digit."""
    keys: dict[str, str] = {}
    for name in names:
        candidates = [*name.lower(), *"1234567890"]
        key = next((one for one in candidates if one.isascii() and one.isalnum() and one not in ("q", *keys)), None)
        if key is not None:
            keys[key] = name
    return keys
