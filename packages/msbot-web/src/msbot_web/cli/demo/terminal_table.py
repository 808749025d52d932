"""The table that `msbot demo` shows in a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from msbot_school.demo import DemoSnapshot, DemoStateChange, PartSnapshot
from msbot_web.cli.demo.output import event_lines, wire_words

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
    snapshot: DemoSnapshot, events: Sequence[DemoStateChange], notes: list[str], width: int, height: int
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
    for event in islice(reversed(events), MOST_EVENTS):
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
