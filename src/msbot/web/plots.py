"""Curves and bars as SVG, on the page and as a picture to take along. Pure: values in, SVG out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape

from msbot.web.models import Lane

Say = Callable[[str], str]
COLOURS = ("#0b84b8", "#d9822b", "#3c9a5f", "#a24bb5", "#c8443a", "#7d6b1c")
STATE_COLOURS = {
    "active": "#2e9e57", "late": "#e0a21b", "lost": "#cf3f35", "refused": "#8f2f4a", "checking": "#7a6ae0", "new": "#a79df0",
    "standby": "#2f93c4", "left": "#8a98a3", "empty": "#c9d2d9",
}  # fmt: skip
"""As on the cards; the words stand in the tooltips and in the table below."""
_WIDTH = 1000
_LEFT = 120
_HEAD = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="100%" style="min-width:34rem;font-family:system-ui,sans-serif" role="img" aria-label="{label}">'


def bars_svg(lanes: Sequence[Lane], span_s: float, say: Say) -> str:
    """The states of slots over the last `span_s` seconds, now at the right."""
    row_height = 30
    height = 40 + row_height * max(len(lanes), 1)
    scale = (_WIDTH - _LEFT - 10) / span_s
    parts = [_HEAD.format(width=_WIDTH, height=height, label=escape(say("States of the slots over time")))]
    for step in range(6):
        x = _LEFT + (_WIDTH - _LEFT - 10) * step / 5
        ago = span_s * (5 - step) / 5
        word = say("now") if step == 5 else _ago_words(ago)
        anchor = "end" if step == 5 else "middle" if step else "start"
        parts.append(
            f'<line x1="{x:.0f}" y1="22" x2="{x:.0f}" y2="{height - 6}" stroke="currentColor" stroke-opacity=".15"/>'
            f'<text x="{x:.0f}" y="14" font-size="12" text-anchor="{anchor}" fill="currentColor" opacity=".7">{escape(word)}</text>'
        )
    for row, lane in enumerate(lanes):
        y = 28 + row * row_height
        parts.append(
            f'<text x="{_LEFT - 10}" y="{y + 16}" font-size="13" font-weight="600" text-anchor="end" fill="currentColor">'
            f"{escape(lane.slot[:16])}</text>"
        )
        for span in lane.spans:
            if span.end_age_s >= span_s:
                continue
            begin = max(_LEFT, _LEFT + (span_s - span.begin_age_s) * scale)
            end = _LEFT + (span_s - span.end_age_s) * scale
            parts.append(
                f'<rect x="{begin:.1f}" y="{y}" width="{max(end - begin, 2):.1f}" height="22" rx="4" '
                f'fill="{STATE_COLOURS.get(span.state, "#888")}"><title>{escape(say(span.state))}: {escape(span.reason)}</title></rect>'
            )
            if end - begin > 60:
                parts.append(
                    f'<text x="{begin + 8:.1f}" y="{y + 15}" font-size="12" fill="#fff" pointer-events="none">'
                    f"{escape(say(span.state))}</text>"
                )
    return "".join(parts) + "</svg>"


def curve_svg(curves: Mapping[str, Sequence[tuple[float, float]]], say: Say) -> str:
    """Curves of numbers over time, each with its name and latest value."""
    height = 300
    parts = [_HEAD.format(width=_WIDTH, height=height + 24 * len(curves), label=escape(say("Values over time")))]
    points = [point for curve in curves.values() for point in curve]
    if len(points) < 2:
        parts.append(f'<text x="20" y="40" font-size="14" fill="currentColor">{escape(say("No numbers yet."))}</text>')
        return "".join(parts) + "</svg>"
    first, last = min(at for at, _ in points), max(at for at, _ in points)
    low, high = min(value for _, value in points), max(value for _, value in points)
    if high == low:
        low, high = low - 1, high + 1
    span_s = max(last - first, 1e-3)

    def place(at: float, value: float) -> tuple[float, float]:
        return 70 + (at - first) / span_s * (_WIDTH - 90), height - 26 - (value - low) / (high - low) * (height - 50)

    for step in range(5):
        value = low + (high - low) * step / 4
        _, y = place(first, value)
        parts.append(
            f'<line x1="70" y1="{y:.1f}" x2="{_WIDTH - 20}" y2="{y:.1f}" stroke="currentColor" stroke-opacity=".15"/>'
            f'<text x="62" y="{y + 4:.1f}" font-size="12" text-anchor="end" fill="currentColor">{value:.4g}</text>'
        )
    parts.append(
        f'<text x="70" y="{height - 6}" font-size="12" fill="currentColor" opacity=".7">{escape(_ago_words(span_s))}</text>'
        f'<text x="{_WIDTH - 20}" y="{height - 6}" font-size="12" text-anchor="end" fill="currentColor" opacity=".7">'
        f"{escape(say('now'))}</text>"
    )
    for number, (name, curve) in enumerate(curves.items()):
        colour = COLOURS[number % len(COLOURS)]
        line = " ".join("{:.1f},{:.1f}".format(*place(at, value)) for at, value in curve)
        newest = f"{curve[-1][1]:.4g}" if curve else "–"
        y = height + 16 + 24 * number
        parts.append(
            f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>'
            f'<rect x="70" y="{y - 11}" width="14" height="14" rx="3" fill="{colour}"/>'
            f'<text x="92" y="{y}" font-size="13" fill="currentColor">{escape(name)}: {newest}</text>'
        )
    return "".join(parts) + "</svg>"


def _ago_words(seconds: float) -> str:
    if seconds >= 7200:
        return f"-{seconds / 3600:.1f} h"
    return f"-{seconds / 60:.3g} min" if seconds >= 60 else f"-{seconds:.0f} s"
