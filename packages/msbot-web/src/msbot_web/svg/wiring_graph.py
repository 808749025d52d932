"""The robot's wiring as a drawing: parts left and right, topics between them, rates on the topics. Pure.

Every port is there, wired or not, as something that can be picked up with the mouse or the keyboard; what the browser
does with it is in `static/wires.js`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msbot.service_types import service_type
from msbot_web.html import Markup, render
from msbot_web.language import Language
from msbot_web.models.robot_models import SpanLine, TimelineLane, TopicLine, WirePort
from msbot_xrce.lazy import dataclass

# Bars as SVG, on the page and as a picture to take along. Pure: values in, SVG out.


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
_LETTER, _MOST_LETTERS = 9.2, 16
"""Width of a bold letter of a name beside its bars in the widest of the usual fonts, and how many a name may have."""


def bars_svg(lanes: Sequence[TimelineLane], span_s: float, language: Language, *, is_narrow: bool = False) -> Markup:
    """The states of slots over the last `span_s` seconds, now at the right; narrow for a phone."""
    width, ticks, letters = (380, 3, 13) if is_narrow else (_WIDTH, _TICKS, _MOST_LETTERS)
    longest = max((min(len(lane.slot), letters) for lane in lanes), default=0)
    left = round(max(80.0, 12 + longest * _LETTER))
    room = width - left - 10
    rows = [
        {
            "name": shortened(lane.slot, letters),
            "full": lane.slot,
            "y": 28 + row * _ROW,
            "bars": [_bar(span, span_s, left, room, language) for span in lane.spans if span.end_age_s < span_s],
        }
        for row, lane in enumerate(lanes)
    ]
    return render(
        "bars",
        say=language.translate,
        look="narrow" if is_narrow else "wide",
        width=width,
        height=40 + _ROW * max(len(lanes), 1),
        left=left,
        lanes=rows,
        ticks=_time_ticks(span_s, left, left + room, ticks, language),
    )


def _bar(span: SpanLine, span_s: float, left: float, room: float, language: Language) -> dict[str, object]:
    scale = room / span_s
    begin = max(left, left + (span_s - span.begin_age_s) * scale)
    end = left + (span_s - span.end_age_s) * scale
    return {
        "x": f"{begin:.1f}",
        "width": f"{max(end - begin, 2):.1f}",
        "text_x": f"{begin + 8:.1f}",
        "is_wide": end - begin > 60,
        "state": language.translate(span.state),
        "reason": span.reason,
        "colour": STATE_COLOURS.get(span.state, "#666"),
        "ink": "#10202c" if span.state in _DARK_ON else "#fff",
    }


def shortened(text: str, most: int) -> str:
    """A text that fits, with an ellipsis where it was cut."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _time_ticks(span_s: float, left: float, right: float, count: int, language: Language) -> list[tuple[str, str, str]]:
    ticks = []
    for step in range(count):
        share = step / (count - 1)
        anchor = "start" if step == 0 else "end" if step == count - 1 else "middle"
        word = language.translate("now") if step == count - 1 else language.digits(_ago_words(span_s * (1 - share)))
        ticks.append((f"{left + (right - left) * share:.0f}", anchor, word))
    return ticks


def _ago_words(seconds: float) -> str:
    seconds = round(seconds, 3)
    if seconds >= 7200:
        return f"-{seconds / 3600:.1f} h"
    return f"-{seconds / 60:.3g} min" if seconds >= 60 else f"-{seconds:.0f} s"


_GAP, _TOPIC = 16, 64
_FINGER = 44
"""Height of what a finger presses, in pixels: a drawing for fingers is never made smaller."""


@dataclass(frozen=True, slots=True)
class _Form:
    """Where things are, across the drawing, and how high a line of a box is."""

    width: int
    left: int
    right: int
    box: int
    """Width of a slot's box."""
    topic: int
    """Width of a topic's box, in the middle."""
    head: int
    line: int
    least: str
    """The width below which it is scrolled instead of drawn smaller."""
    letters: int
    """Of a topic's name."""

    @property
    def topic_at(self) -> int:
        """The left edge of the topics."""
        return (self.width - self.topic) // 2


_BY_MOUSE = _Form(1000, 10, 790, 200, 270, 30, 26, "54rem", 32)
_BY_FINGER = _Form(696, 4, 524, 168, 228, _FINGER, _FINGER, "696px", 26)
"""As narrow as a tablet that is held upright."""


@dataclass(slots=True)
class _Column:
    """The boxes of one side, from top to bottom."""

    boxes: list[dict[str, object]]
    at: dict[str, float]
    """Where the end of each port is, down the drawing."""
    height: float


def wiring_svg(
    topics: Sequence[TopicLine],
    ports: Sequence[WirePort],
    states: Mapping[str, str],
    language: Language,
    *,
    may_change: bool = False,
    is_past: bool = False,
    by_finger: bool = False,
) -> Markup:
    """Slots that publish at the left, topics in the middle, slots that subscribe at the right.

    Args:
        topics: the bindings with their rates.
        ports: all ports of all slots.
        states: state of each slot by its name, for the colour of its edge.
        language: of the person.
        may_change: each slot has a button that takes it out.
        is_past: it is drawn as it was.
        by_finger: ports and buttons are as large as a finger needs them.
    """
    form = _BY_FINGER if by_finger else _BY_MOUSE
    sources = _column([port for port in ports if port.publishes], states, form.left, language, form)
    targets = _column([port for port in ports if not port.publishes], states, form.right, language, form)
    height = max(sources.height, targets.height, len(topics) * _TOPIC, 1) + _GAP
    middle = _middles(topics, sources.at, targets.at, height)
    wires = []
    for topic in topics:
        y = middle[topic.topic]
        begin, after = form.topic_at, form.topic_at + form.topic
        wires += [
            _wire(topic, form.left + form.box, sources.at[end], begin, y)
            for end in topic.publishers
            if end in sources.at
        ]
        wires += [_wire(topic, after, y, form.right, targets.at[end]) for end in topic.subscribers if end in targets.at]
    return render(
        "wires",
        height=round(height),
        form=form,
        by_finger=by_finger,
        may_change=may_change,
        words=_words(topics, language),
        wires=wires,
        boxes=[*sources.boxes, *targets.boxes],
        topics=[
            {
                "y": round(middle[topic.topic]),
                "full": topic.topic,
                "name": shortened(topic.topic, form.letters),
                "rate": rate_words(topic, language, is_past=is_past),
            }
            for topic in topics
        ],
    )


def _middles(
    topics: Sequence[TopicLine], sources: Mapping[str, float], targets: Mapping[str, float], height: float
) -> dict[str, float]:
    """Where each topic is, down the drawing: as near to the middle of its ports as the others leave room."""
    wished = []
    for number, topic in enumerate(topics):
        ends = [sources[end] for end in topic.publishers if end in sources]
        ends += [targets[end] for end in topic.subscribers if end in targets]
        wished.append((sum(ends) / len(ends) if ends else height, number))
    wished.sort()
    placed: list[float] = []
    for wish, _ in wished:
        placed.append(max(wish, placed[-1] + _TOPIC if placed else _TOPIC / 2))
    most = height - _TOPIC / 2
    for place in range(len(placed) - 1, -1, -1):
        placed[place] = min(placed[place], most)
        most = placed[place] - _TOPIC
    return {topics[number].topic: y for (_, number), y in zip(wished, placed, strict=True)}


def rate_words(topic: TopicLine, language: Language, *, is_past: bool = False) -> str:
    """What stands under a topic: its type and how often it comes; of the past nobody has counted the samples."""
    if is_past:
        return f"{topic.type_name} · {language.number(topic.rate_hz, '.1f')} Hz"
    samples = language.count(topic.count, "{count} sample", "{count} samples")
    return f"{topic.type_name} · {language.number(topic.rate_hz, '.1f')} Hz · {samples}"


def box_colour(state: str) -> str:
    """The edge of a slot in that state."""
    return STATE_COLOURS.get(state, "#888")


def _column(ports: Sequence[WirePort], states: Mapping[str, str], x: int, language: Language, form: _Form) -> _Column:
    column = _Column([], {}, _GAP)
    by_slot: dict[str, list[WirePort]] = {}
    for port in ports:
        by_slot.setdefault(port.slot, []).append(port)
    for slot, own in by_slot.items():
        top = column.height
        lines = []
        for number, port in enumerate(own):
            y = top + form.head + form.line * (number + 0.5)
            end = f"{slot}.{port.port}"
            column.at[end] = y
            lines.append(
                {
                    "end": end,
                    "name": shortened(port.port, form.letters - 6),
                    "type_name": port.type_name,
                    "publishes": port.publishes,
                    "topic": port.topic,
                    "y": round(y),
                    "x": x + form.box if port.publishes else x,
                    "words": _port_words(port, language),
                }
            )
        height = form.head + form.line * len(own) + 8
        column.boxes.append(
            {
                "x": x,
                "y": round(top),
                "height": height,
                "full": slot,
                "name": shortened(slot, form.box // 14),
                "colour": box_colour(states.get(slot, "empty")),
                "ports": lines,
                "take_out": language.translate("Take slot {slot} out", slot=slot),
            }
        )
        column.height += height + _GAP
    return column


def _port_words(port: WirePort, language: Language) -> str:
    end = f"{port.slot}.{port.port} ({port.type_name})"
    if not port.topic:
        return language.translate("{port}: not wired", port=end)
    if service_type(port.type_name) is not None:
        return language.translate(
            "{port}: serves {topic}" if port.publishes else "{port}: calls {topic}", port=end, topic=port.topic
        )
    return language.translate(
        "{port}: publishes on {topic}" if port.publishes else "{port}: subscribes to {topic}",
        port=end,
        topic=port.topic,
    )


def _wire(topic: TopicLine, x1: float, y1: float, x2: float, y2: float) -> dict[str, object]:
    half = (x1 + x2) / 2
    return {
        "topic": topic.topic,
        "is_busy": topic.rate_hz > 0,
        "path": f"M{x1} {y1:.0f} C {half:.0f} {y1:.0f}, {half:.0f} {y2:.0f}, {x2 - 8} {y2:.0f}",
        "tip": f"M{x2 - 9} {y2 - 6:.0f} L{x2} {y2:.0f} L{x2 - 9} {y2 + 6:.0f} z",
    }


def _words(topics: Sequence[TopicLine], language: Language) -> str:
    return "; ".join(
        language.translate(
            "{sources} to {targets} by {topic}",
            sources=", ".join(topic.publishers),
            targets=", ".join(topic.subscribers),
            topic=topic.topic,
        )
        for topic in topics
    )
