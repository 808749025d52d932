"""The robot's wiring as a drawing: parts left and right, topics between them, rates on the lines. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from msbot.web.models import TopicLine
from msbot.web.plots import STATE_COLOURS

_ROW = 74
_WIDTH = 1000


def wiring_svg(topics: Sequence[TopicLine], states: Mapping[str, str]) -> str:
    """Slots that publish at the left, topics in the middle, slots that subscribe at the right.

    Args:
        topics: the bindings with their rates.
        states: state of each slot by its name, for the colour of its edge.
    """
    sources = list(dict.fromkeys(_slot_of(end) for topic in topics for end in topic.publishers))
    targets = list(dict.fromkeys(_slot_of(end) for topic in topics for end in topic.subscribers))
    rows = max(len(sources), len(targets), len(topics), 1)
    height = rows * _ROW + 30
    left = _places(sources, height)
    middle = _places([topic.topic for topic in topics], height)
    right = _places(targets, height)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" width="100%" '
        f'style="min-width:40rem;font-family:system-ui,sans-serif" role="img" aria-label="{escape(_words(topics), quote=True)}">'
    ]
    for topic in topics:
        y = middle[topic.topic]
        is_busy = topic.rate_hz > 0
        for end in topic.publishers:
            parts.append(_line(190, left[_slot_of(end)], 360, y, is_busy=is_busy, word=_port_of(end), at_start=True))
        for end in topic.subscribers:
            parts.append(_line(640, y, 810, right[_slot_of(end)], is_busy=is_busy, word=_port_of(end), at_start=False))
    for topic in topics:
        y = middle[topic.topic]
        parts.append(
            f'<rect x="360" y="{y - 24}" width="280" height="48" rx="24" fill="currentColor" fill-opacity=".06" '
            f'stroke="#7a6ae0" stroke-width="2"/>'
            f'<text x="500" y="{y - 3}" font-size="14" font-weight="600" text-anchor="middle" fill="currentColor">'
            f"{escape(topic.topic[:34])}</text>"
            f'<text x="500" y="{y + 15}" font-size="12" text-anchor="middle" fill="currentColor" opacity=".75">'
            f"{escape(topic.type_name)} · {topic.rate_hz:.1f} Hz · {topic.count}</text>"
        )
    for names, places, x in ((sources, left, 10), (targets, right, 810)):
        for name in names:
            parts.append(_box(name, x, places[name], states.get(name, "empty")))
    return "".join(parts) + "</svg>"


def _places(names: Sequence[str], height: int) -> dict[str, float]:
    step = height / max(len(names), 1)
    return {name: step * (number + 0.5) for number, name in enumerate(names)}


def _slot_of(end: str) -> str:
    return end.rpartition(".")[0]


def _port_of(end: str) -> str:
    return end.rpartition(".")[2]


def _line(x1: float, y1: float, x2: float, y2: float, *, is_busy: bool, word: str, at_start: bool) -> str:
    style = (
        'stroke="#2e9e57" stroke-width="3"'
        if is_busy
        else 'stroke="currentColor" stroke-opacity=".35" stroke-dasharray="6 5" stroke-width="2"'
    )
    x, y, anchor = (x1 + 8, y1 - 7, "start") if at_start else (x2 - 12, y2 - 7, "end")
    return (
        f'<path d="M{x1} {y1:.0f} C {(x1 + x2) / 2:.0f} {y1:.0f}, {(x1 + x2) / 2:.0f} {y2:.0f}, {x2 - 8} {y2:.0f}" fill="none" {style}/>'
        f'<path d="M{x2 - 9} {y2 - 6:.0f} L{x2} {y2:.0f} L{x2 - 9} {y2 + 6:.0f} z" fill="{"#2e9e57" if is_busy else "currentColor"}"/>'
        f'<text x="{x:.0f}" y="{y:.0f}" font-size="12" text-anchor="{anchor}" fill="currentColor" opacity=".8">{escape(word)}</text>'
    )


def _box(name: str, x: float, y: float, state: str) -> str:
    colour = STATE_COLOURS.get(state, "#888")
    return (
        f'<a href="/?slot={escape(name, quote=True)}"><rect x="{x}" y="{y - 26:.0f}" width="180" height="52" rx="10" fill="currentColor" '
        f'fill-opacity=".05" stroke="{colour}" stroke-width="3"/>'
        f'<text x="{x + 90}" y="{y - 1:.0f}" font-size="15" font-weight="700" text-anchor="middle" fill="currentColor">{escape(name[:18])}</text>'
        f'<text x="{x + 90}" y="{y + 16:.0f}" font-size="12" text-anchor="middle" fill="{colour}">{escape(state)}</text></a>'
    )


def _words(topics: Sequence[TopicLine]) -> str:
    return "; ".join(
        f"{', '.join(topic.publishers)} to {', '.join(topic.subscribers)} by {topic.topic}" for topic in topics
    )
