"""Live values drawn as the thing they are: a lamp, a servo horn, a gauge, a thermometer. Pure: values in, SVG out.

What is drawn follows from the message type of the port that matters most for the part (what an actuator obeys, what a
sensor tells). The words beside the picture say the same, so nothing depends on seeing it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from html import escape
from textwrap import wrap

from msbot.web.models import PortLine, Scalar, SlotCard

Fields = Mapping[str, Scalar]
SIZE = 84

STATE_ICONS = {
    "active": "●", "late": "◐", "lost": "✖", "refused": "⊘", "checking": "…", "new": "✦", "standby": "‖", "empty": "○", "left": "↩",
}  # fmt: skip
"""A sign for every state besides its colour and its word."""


def state_chip(state: str, word: str) -> str:
    """A state as a coloured chip with sign and word."""
    return (
        f'<span class="state s-{escape(state)}"><span aria-hidden="true">{STATE_ICONS.get(state, "")}</span>'
        f"{escape(word)}</span>"
    )


def beat_ring(card: SlotCard, beat_s: float) -> str:
    """The ring around a slot's life status: how much of the time to the next beat is left, and life 3-2-1-0.

    The browser lets it run down by itself, in steps: 120 rings that move smoothly would keep a tablet busy.
    """
    part = card.part
    life = "–" if part is None or not part.life else str(part.life)
    left = 0.0 if card.next_beat_s is None else max(0.0, min(1.0, card.next_beat_s / beat_s))
    length = 2 * math.pi * 18
    words = f"life {life}" + ("" if card.next_beat_s is None else f", next beat in {max(card.next_beat_s, 0):.1f} s")
    return (
        f'<svg width="46" height="46" viewBox="0 0 46 46" role="img" aria-label="{escape(words)}">'
        f'<circle class="beat" cx="23" cy="23" r="18" fill="none" stroke-width="5"/>'
        f'<circle class="beat-now" cx="23" cy="23" r="18" fill="none" stroke-width="5" stroke-linecap="round" '
        f'stroke-dasharray="{length:.1f}" stroke-dashoffset="{length * (1 - left):.1f}" transform="rotate(-90 23 23)"'
        f"{_running(beat_s, left) if card.next_beat_s is not None else ''}/>"
        f'<text class="life num" x="23" y="29" text-anchor="middle" font-size="17">{life}</text></svg>'
    )


def _running(beat_s: float, left: float) -> str:
    return f' style="animation:ms-beat {beat_s:g}s steps(6) {-beat_s * (1 - left):.2f}s forwards"'


def main_port(card: SlotCard) -> PortLine | None:
    """The port that says most about a part: what an actuator was told, else what the part tells."""
    told = [port for port in card.ports if not port.publishes and port.fields]
    tells = [port for port in card.ports if port.publishes and port.fields]
    ports = [*told, *tells] if card.category in ("actuator", "display") else [*tells, *told]
    return ports[0] if ports else (card.ports[0] if card.ports else None)


def draw(type_name: str, fields: Fields) -> str:
    """A value as a picture, 84 by 84 pixels; an empty frame when there is no value yet."""
    inner = _DRAWERS.get(type_name, _draw_any)(fields) if fields else _draw_nothing()
    words = ", ".join(f"{name} {value_words(value)}" for name, value in fields.items()) or "no value yet"
    return (
        f'<svg width="{SIZE}" height="{SIZE}" viewBox="0 0 84 84" role="img" aria-label="{escape(words, quote=True)}" '
        f'style="flex:none">{inner}</svg>'
    )


def value_words(value: Scalar) -> str:
    """A value for people: at most four significant digits, yes and no as words."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def fields_html(fields: Fields, limit: int = 4) -> str:
    """The first few fields of a value, a line each."""
    lines = [
        f'<div><span class="soft">{escape(name)}</span> <b class="num">{escape(value_words(value))}</b></div>'
        for name, value in list(fields.items())[:limit]
    ]
    return "".join(lines)


def sparkline(values: list[float], *, width: int = 220, height: int = 44, least: float | None = None) -> str:
    """A small curve of numbers, oldest left."""
    if len(values) < 2:
        return f'<svg width="{width}" height="{height}" role="img" aria-label="no curve yet"></svg>'
    low = min(values) if least is None else min(least, *values)
    high = max(values)
    span = (high - low) or 1.0
    step = (width - 4) / (len(values) - 1)
    points = " ".join(
        f"{2 + number * step:.1f},{height - 4 - (value - low) / span * (height - 8):.1f}"
        for number, value in enumerate(values)
    )
    return (
        f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{min(values):.3g} to {high:.3g}">'
        f'<polyline class="accent-line" stroke-width="2" points="{points}"/></svg>'
    )


def _number(fields: Fields, name: str = "") -> float:
    """A field as a number, or the first field that is one."""
    values = [fields[name]] if name in fields else list(fields.values())
    return next((float(value) for value in values if isinstance(value, int | float)), 0.0)


def _arc(share: float) -> str:
    """A gauge from lower left to lower right with a needle."""
    share = max(0.0, min(1.0, share))
    angle = math.radians(225 - 270 * share)
    x, y = 42 + 24 * math.cos(angle), 42 - 24 * math.sin(angle)
    length = 0.75 * 2 * math.pi * 32
    return (
        f'<circle cx="42" cy="42" r="32" class="soft-line" stroke-width="8" stroke-linecap="round" '
        f'stroke-dasharray="{length:.1f} 400" transform="rotate(135 42 42)"/>'
        f'<circle cx="42" cy="42" r="32" class="accent-line" stroke-width="8" stroke-linecap="round" '
        f'stroke-dasharray="{max(length * share, 0.1):.1f} 400" transform="rotate(135 42 42)"/>'
        f'<line x1="42" y1="42" x2="{x:.1f}" y2="{y:.1f}" class="ink-line" stroke-width="4" stroke-linecap="round"/>'
        f'<circle cx="42" cy="42" r="5" class="ink"/>'
    )


def _under(text: str) -> str:
    return f'<text x="42" y="80" text-anchor="middle" font-size="13" font-weight="700" class="ink num">{escape(text)}</text>'


def _gauge(low: float, high: float, unit: str, field: str) -> Callable[[Fields], str]:
    def draw_gauge(fields: Fields) -> str:
        value = _number(fields, field)
        return _arc((value - low) / (high - low)) + _under(f"{value:.3g} {unit}".strip())

    return draw_gauge


def _logarithmic(most: float, unit: str, field: str) -> Callable[[Fields], str]:
    def draw_gauge(fields: Fields) -> str:
        value = max(_number(fields, field), 0.0)
        return _arc(math.log10(1 + value) / math.log10(1 + most)) + _under(f"{value:.3g} {unit}".strip())

    return draw_gauge


def _draw_lamp(fields: Fields) -> str:
    is_on = any(bool(value) for value in fields.values())
    rays = "".join(
        f'<line x1="42" y1="8" x2="42" y2="15" transform="rotate({angle} 42 38)" stroke="#e0a300" stroke-width="4" '
        f'stroke-linecap="round"/>'
        for angle in range(-90, 91, 30)
    )
    bulb = (
        f'<circle cx="42" cy="38" r="18" class="{"lit" if is_on else "unlit"}" stroke-width="3"/>'
        f'<rect x="34" y="56" width="16" height="9" rx="3" class="ink"/>'
    )
    return (rays if is_on else "") + bulb + _under("on" if is_on else "off")


def _draw_angle(fields: Fields) -> str:
    degrees = _number(fields, "degrees")
    return (
        f'<rect x="22" y="34" width="40" height="34" rx="6" class="soft-fill"/>'
        f'<g transform="rotate({degrees - 90:.1f} 42 42)"><rect x="37" y="10" width="10" height="36" rx="5" class="accent-fill"/>'
        f'</g><circle cx="42" cy="42" r="6" class="ink"/>' + _under(f"{degrees:.0f}°")
    )


def _draw_colour(fields: Fields) -> str:
    red, green, blue = (int(max(0, min(255, _number(fields, name)))) for name in ("red", "green", "blue"))
    return (
        f'<circle cx="42" cy="36" r="26" fill="rgb({red},{green},{blue})" class="soft-line" stroke-width="3" '
        f'style="fill:rgb({red},{green},{blue})"/>' + _under(f"#{red:02x}{green:02x}{blue:02x}")
    )


def _draw_temperature(fields: Fields) -> str:
    celsius = _number(fields, "celsius")
    height = max(0.0, min(1.0, (celsius + 10) / 60)) * 40
    return (
        '<rect x="36" y="6" width="12" height="50" rx="6" class="soft-fill"/>'
        f'<rect x="39" y="{52 - height:.1f}" width="6" height="{height:.1f}" fill="#d23c2a"/>'
        '<circle cx="42" cy="57" r="9" fill="#d23c2a"/>' + _under(f"{celsius:.1f} °C")
    )


def _draw_distance(fields: Fields) -> str:
    metres = _number(fields, "metres")
    share = max(0.0, min(1.0, metres / 4.0))
    is_seen = fields.get("in_range", True)
    wall = (
        f'<rect x="{24 + share * 46:.0f}" y="14" width="6" height="44" rx="2" class="accent-fill"/>' if is_seen else ""
    )
    return (
        '<rect x="4" y="26" width="14" height="20" rx="4" class="ink"/>'
        f'<line x1="20" y1="36" x2="{22 + share * 46:.0f}" y2="36" class="soft-line" stroke-width="3" stroke-dasharray="4 4"/>'
        f"{wall}" + _under(f"{metres:.2f} m" if is_seen else "nothing")
    )


def _draw_speed(fields: Fields) -> str:
    rpm = _number(fields)
    turn = "↻" if rpm > 0 else "↺" if rpm < 0 else "■"
    spokes = "".join(
        f'<line x1="42" y1="36" x2="42" y2="14" transform="rotate({angle + rpm % 60:.0f} 42 36)" class="ink-line" stroke-width="4"/>'
        for angle in (0, 120, 240)
    )
    return (
        f'<circle cx="42" cy="36" r="26" class="accent-line" stroke-width="6"/>{spokes}<circle cx="42" cy="36" r="6" class="ink"/>'
        + _under(f"{turn} {rpm:.0f}")
    )


def _draw_text(fields: Fields) -> str:
    text = next((value for value in fields.values() if isinstance(value, str)), "")
    rows = wrap(text, 11)[:4] or [""]
    first = 42 - 6 * len(rows)
    lines = "".join(
        f'<text x="42" y="{first + 12 * row}" text-anchor="middle" font-size="10" class="ink" '
        f'font-family="ui-monospace, Menlo, Consolas, monospace">{escape(line)}</text>'
        for row, line in enumerate(rows)
    )
    return (
        '<rect x="3" y="8" width="78" height="58" rx="9" class="soft-fill"/>'
        f'<path d="M24 66l0 12l14 -12z" class="soft-fill"/>{lines}'
    )


def _draw_any(fields: Fields) -> str:
    value = next(iter(fields.values()), "")
    text = value_words(value)[:9]
    return (
        '<rect x="6" y="16" width="72" height="44" rx="9" class="soft-fill"/>'
        f'<text x="42" y="44" text-anchor="middle" font-size="17" font-weight="700" class="ink num">{escape(text)}</text>'
    )


def _draw_nothing() -> str:
    return (
        '<rect x="8" y="12" width="68" height="56" rx="12" class="soft-line" stroke-width="2" stroke-dasharray="5 5"/>'
        '<text x="42" y="46" text-anchor="middle" font-size="20" class="ink" opacity=".5">–</text>'
    )


_DRAWERS: dict[str, Callable[[Fields], str]] = {
    "Switch": _draw_lamp,
    "Light": _logarithmic(100_000.0, "lx", "lux"),
    "Level": _gauge(0.0, 100.0, "%", "percent"),
    "Angle": _draw_angle,
    "Colour": _draw_colour,
    "Temperature": _draw_temperature,
    "Distance": _draw_distance,
    "Speed": _draw_speed,
    "Gas": _logarithmic(10_000.0, "ppm", "ppm"),
    "Text": _draw_text,
    "HelloWorld": _draw_text,
}
"""How values of a message type are drawn."""
