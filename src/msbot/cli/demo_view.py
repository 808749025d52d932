"""How `msbot demo` looks: the live table, the plain lines, the JSON object. No logic of the robot here."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

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
RECENT_EVENTS = 8


def live_view(snapshot: DemoSnapshot, events: list[DemoEvent], notes: list[str]) -> RenderableType:
    """The whole screen: parts, wire, latest events, keys."""
    return Group(
        Text(f"{snapshot.robot} on {snapshot.link}   {snapshot.at_s:6.1f} s", style="bold"),
        _parts_table(snapshot),
        Text(wire_words(snapshot)),
        Text(""),
        *(Text(event_words(event), style="dim") for event in events[-RECENT_EVENTS:]),
        *(Text(note, style="bold") for note in notes),
        Text(""),
        Text(_key_words(snapshot), style="italic"),
    )


def _parts_table(snapshot: DemoSnapshot) -> Table:
    table = Table(expand=False)
    for title, justify in (
        ("slot", "left"),
        ("part", "left"),
        ("state", "left"),
        ("life", "left"),
        ("last beat", "right"),
        ("beats", "right"),
        ("in", "right"),
        ("out", "right"),
        ("plug-in to active", "right"),
        ("outputs 0-7", "left"),
    ):
        table.add_column(title, justify="right" if justify == "right" else "left", no_wrap=True)
    for part in snapshot.parts:
        table.add_row(*_part_row(part))
    return table


def _part_row(part: PartSnapshot) -> tuple[str | Text, ...]:
    icon, style = STATE_STYLES.get(part.state, ("○", ""))
    state = Text(f"{icon} {part.state}", style=style)
    if not part.plugged:
        state.append("  (unplugged)", style="dim")
    return (
        part.slot or "-",
        f"{part.part_number} {part.name}",
        state,
        LIFE_BARS.get(part.life, "-"),
        "-" if part.beat_age_s is None else f"{part.beat_age_s:.1f} s",
        str(part.beats),
        str(part.messages_in),
        str(part.messages_out),
        "-" if part.plug_in_to_active_ms is None else f"{part.plug_in_to_active_ms:.0f} ms",
        "".join("●" if level else "·" for level in part.outputs),
    )


def _key_words(snapshot: DemoSnapshot) -> str:
    plugged = {part.name: part.plugged for part in snapshot.parts}
    keys = [
        f"[{key}] {'unplug' if plugged[name] else 'plug in'} {name}" for key, name in keys_of(list(plugged)).items()
    ]
    return "   ".join([*keys, "[q] quit"])


def keys_of(names: Sequence[str]) -> dict[str, str]:
    """The key that pulls and plugs each part: the first letter of its name that is free, else a digit."""
    keys: dict[str, str] = {}
    for name in names:
        candidates = [*name.lower(), *"1234567890"]
        key = next((one for one in candidates if one.isascii() and one.isalnum() and one not in ("q", *keys)), None)
        if key is not None:
            keys[key] = name
    return keys


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
    return f"{event.at_s:7.3f} s  {event.part:<4} {event.from_state} -> {event.to_state}: {event.reason}"


def status_words(snapshot: DemoSnapshot) -> str:
    """The state of the robot in one line, for a log."""
    parts = "  ".join(
        f"{part.name} {part.state} life {part.life} in {part.messages_in} out {part.messages_out}"
        for part in snapshot.parts
    )
    load = "" if snapshot.bus is None else f"  bus {snapshot.bus.load_now_percent:.1f} %"
    return f"{snapshot.at_s:7.1f} s  {parts}{load}"
