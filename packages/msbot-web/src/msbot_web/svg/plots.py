"""Bars as SVG, on the page and as a picture to take along. Pure: values in, SVG out."""

from __future__ import annotations

from collections.abc import Sequence

from msbot_web.api.models import SpanLine, TimelineLane
from msbot_web.html import Markup, render
from msbot_web.language import Language

STATE_COLOURS = {
    "active": "#1f7a42", "late": "#e0a21b", "lost": "#b92f26", "refused": "#8f2f4a", "checking": "#6a5ad0",
    "new": "#a79df0", "standby": "#1b73a1", "left": "#5f6d78", "empty": "#c9d2d9",
}  # fmt: skip
"""As on the cards; the words stand in the bars, in the tooltips and in the table below."""
_DARK_ON = ("late", "new", "empty")
"""States whose colour is so light that dark letters are read better on it."""
_WIDTH = 1000
_TICKS = 6
_ROW = 30


def bars_svg(lanes: Sequence[TimelineLane], span_s: float, language: Language, *, is_narrow: bool = False) -> Markup:
    """The states of slots over the last `span_s` seconds, now at the right; narrow for a phone."""
    width, left, ticks = (380, 84, 3) if is_narrow else (_WIDTH, 130, _TICKS)
    room = width - left - 10
    letters = 10 if is_narrow else 16
    rows = [
        {
            "name": shortened(lane.slot, letters), "full": lane.slot, "y": 28 + row * _ROW,
            "bars": [_bar(span, span_s, left, room, language) for span in lane.spans if span.end_age_s < span_s],
        }
        for row, lane in enumerate(lanes)
    ]  # fmt: skip
    return render(
        "bars", say=language.say, look="narrow" if is_narrow else "wide", width=width, height=40 + _ROW * max(len(lanes), 1),
        left=left, lanes=rows, ticks=_time_ticks(span_s, left, left + room, ticks, language),
    )  # fmt: skip


def _bar(span: SpanLine, span_s: float, left: float, room: float, language: Language) -> dict[str, object]:
    scale = room / span_s
    begin = max(left, left + (span_s - span.begin_age_s) * scale)
    end = left + (span_s - span.end_age_s) * scale
    return {
        "x": f"{begin:.1f}", "width": f"{max(end - begin, 2):.1f}", "text_x": f"{begin + 8:.1f}",
        "is_wide": end - begin > 60, "state": language.say(span.state), "reason": span.reason,
        "colour": STATE_COLOURS.get(span.state, "#666"), "ink": "#10202c" if span.state in _DARK_ON else "#fff",
    }  # fmt: skip


def shortened(text: str, most: int) -> str:
    """A text that fits, with an ellipsis where it was cut."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _time_ticks(span_s: float, left: float, right: float, count: int, language: Language) -> list[tuple[str, str, str]]:
    ticks = []
    for step in range(count):
        share = step / (count - 1)
        anchor = "start" if step == 0 else "end" if step == count - 1 else "middle"
        word = language.say("now") if step == count - 1 else language.digits(_ago_words(span_s * (1 - share)))
        ticks.append((f"{left + (right - left) * share:.0f}", anchor, word))
    return ticks


def _ago_words(seconds: float) -> str:
    seconds = round(seconds, 3)
    if seconds >= 7200:
        return f"-{seconds / 3600:.1f} h"
    return f"-{seconds / 60:.3g} min" if seconds >= 60 else f"-{seconds:.0f} s"
