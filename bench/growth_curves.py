"""Curves of growth side by side as an SVG picture: the number of things on a logarithmic axis, what they cost upwards.

On a light ground of its own, so that it can be read on a light and on a dark page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import floor, log10

PANEL, HEIGHT = 270, 230
LEFT, RIGHT, TOP, BOTTOM = 46, 14, 34, 34
INK, FAINT, LINE = "#263238", "#cfd8dc", "#00695c"


@dataclass(frozen=True, slots=True)
class Curve:
    """One panel: its title with the unit, and (number, value)."""

    title: str
    points: Sequence[tuple[float, float]]


def curves(drawn: Sequence[Curve], across: str = "sessions") -> str:
    """The picture."""
    width = PANEL * len(drawn)
    title = "; ".join(curve.title for curve in drawn)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" width="{width}" height="{HEIGHT}" '
            'font-family="sans-serif" font-size="11" role="img">',
            f"<title>{escape(f'Growth with the number of {across}: {title}')}</title>",
            f'<rect width="{width}" height="{HEIGHT}" rx="8" fill="#ffffff"/>',
            *(line for number, curve in enumerate(drawn) for line in _panel(curve, number * PANEL, across)),
            "</svg>",
            "",
        ]
    )


def _panel(curve: Curve, at: int, across: str) -> list[str]:
    low, high = log10(curve.points[0][0]), log10(curve.points[-1][0])
    step = _step(max(value for _, value in curve.points))
    top = step * (floor(max(value for _, value in curve.points) / step) + 1)
    floor_y, wide, tall = HEIGHT - BOTTOM, PANEL - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def x(number: float) -> float:
        return at + LEFT + wide * (log10(number) - low) / max(high - low, 1e-9)

    def y(value: float) -> float:
        return floor_y - tall * value / top

    lines = [f'<text x="{at + LEFT}" y="20" fill="{INK}" font-weight="bold">{escape(curve.title)}</text>']
    for count in range(round(top / step) + 1):
        value = count * step
        lines.append(
            f'<line x1="{at + LEFT}" x2="{at + PANEL - RIGHT}" y1="{y(value):.1f}" y2="{y(value):.1f}" '
            f'stroke="{FAINT}"/><text x="{at + LEFT - 5}" y="{y(value) + 4:.1f}" fill="{INK}" '
            f'text-anchor="end">{value:g}</text>'
        )
    lines += [
        f'<text x="{x(number):.1f}" y="{floor_y + 14}" fill="{INK}" text-anchor="middle">{number:,.0f}</text>'
        for number in (10**power for power in range(round(low), floor(high) + 1))
    ]
    lines.append(
        f'<text x="{at + LEFT + wide / 2:.0f}" y="{HEIGHT - 6}" fill="{INK}" text-anchor="middle">{across}</text>'
    )
    way = " ".join(f"{x(number):.1f},{y(value):.1f}" for number, value in curve.points)
    lines.append(f'<polyline points="{way}" fill="none" stroke="{LINE}" stroke-width="2"/>')
    lines += [
        f'<circle cx="{x(number):.1f}" cy="{y(value):.1f}" r="3" fill="{LINE}"/>' for number, value in curve.points
    ]
    return lines


def _step(most: float) -> float:
    """Of the scale: 1, 2 or 5 times a power of ten, four to ten of them."""
    power = float(10 ** floor(log10(most)))
    return next(part * power for part in (0.1, 0.2, 0.5, 1.0, 2.0) if most / (part * power) <= 8)
