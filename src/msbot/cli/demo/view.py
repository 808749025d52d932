"""How `msbot demo` looks in a terminal: the live table. No logic of the robot here."""

from __future__ import annotations

from collections.abc import Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from msbot.cli.demo.plain_lines import event_words, wire_words
from msbot.demo import DemoEvent, DemoSnapshot, PartSnapshot

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
WIDE = 110
"""Columns of a terminal that has room for every column of the table."""


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
    above: list[RenderableType] = [
        *(Text(note, style="bold", overflow="fold") for note in notes),
        Text(f"{snapshot.robot} on {snapshot.link}   {snapshot.at_s:6.1f} s", style="bold"),
        _parts_table(snapshot, is_wide=width >= WIDE),
        Text(wire_words(snapshot), no_wrap=True, overflow="ellipsis"),
        Text("a letter: pull that part out, plug it in again   q: quit", style="italic"),
    ]
    folded = sum(max(0, len(note) - 1) // width for note in notes)
    room = height - len(above) - folded - len(snapshot.parts) - _TABLE_FRAME
    recent = events[-min(MOST_EVENTS, max(room, 0)) :] if room > 0 else []
    return Group(*above, *(Text(event_words(one), style="dim", no_wrap=True, overflow="ellipsis") for one in recent))


_TABLE_FRAME = 3
"""Lines of the table besides its parts, and the one below everything, for the cursor."""


def _parts_table(snapshot: DemoSnapshot, *, is_wide: bool) -> Table:
    has_outputs = any(part.outputs for part in snapshot.parts)
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for title, right in (("key", False), ("slot", False), ("part", False), ("state", False), ("life", False),
                         ("beat", True), ("in", True), ("out", True)):  # fmt: skip
        table.add_column(title, justify="right" if right else "left", no_wrap=True)
    if is_wide:
        table.add_column("plug-in to active", justify="right", no_wrap=True)
    if has_outputs and is_wide:
        table.add_column("outputs 0-7", no_wrap=True)
    keys = {name: key for key, name in keys_of([part.name for part in snapshot.parts]).items()}
    for part in snapshot.parts:
        table.add_row(keys.get(part.name, ""), *_part_row(part, is_wide=is_wide, has_outputs=has_outputs))
    return table


def _part_row(part: PartSnapshot, *, is_wide: bool, has_outputs: bool) -> list[str | Text]:
    icon, style = STATE_STYLES.get(part.state, ("○", ""))
    state = Text(f"{icon} {part.state}", style=style)
    if not part.plugged:
        state.append(" (out)", style="dim")
    row: list[str | Text] = [
        part.slot or f"({part.name})",
        part.part_number,
        state,
        LIFE_BARS.get(part.life, "-"),
        "-" if part.beat_age_s is None else f"{part.beat_age_s:.1f} s",
        str(part.messages_in),
        str(part.messages_out),
    ]
    if is_wide:
        row.append("-" if part.plug_in_to_active_ms is None else f"{part.plug_in_to_active_ms:.0f} ms")
    if has_outputs and is_wide:
        row.append("".join("●" if level else "·" for level in part.outputs))
    return row


def keys_of(names: Sequence[str]) -> dict[str, str]:
    """The key that pulls and plugs each part: the first letter of its name that is free, else a digit."""
    keys: dict[str, str] = {}
    for name in names:
        candidates = [*name.lower(), *"1234567890"]
        key = next((one for one in candidates if one.isascii() and one.isalnum() and one not in ("q", *keys)), None)
        if key is not None:
            keys[key] = name
    return keys
