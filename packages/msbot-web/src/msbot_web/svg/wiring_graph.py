"""The robot's wiring as a drawing: parts left and right, topics between them, rates on the topics. Pure.

Every port is there, wired or not, as something that can be picked up with the mouse or the keyboard; what the browser
does with it is in `static/wires.js`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msbot_web.api.models import TopicLine, WirePort
from msbot_web.html import Markup, render
from msbot_web.language import Language
from msbot_web.svg.plots import STATE_COLOURS, shortened
from msbot_xrce.common.lazy_dataclass import dataclass

_LEFT, _RIGHT, _BOX = 10, 790, 200
_HEAD, _PORT, _GAP, _TOPIC = 30, 26, 16, 64


@dataclass(slots=True)
class _Column:
    """The boxes of one side, from top to bottom."""

    boxes: list[dict[str, object]]
    at: dict[str, float]
    """Where the end of each port is, down the drawing."""
    height: float


def wiring_svg(
    topics: Sequence[TopicLine], ports: Sequence[WirePort], states: Mapping[str, str], language: Language,
    *, may_change: bool = False, is_past: bool = False,
) -> Markup:  # fmt: skip
    """Slots that publish at the left, topics in the middle, slots that subscribe at the right.

    Args:
        topics: the bindings with their rates.
        ports: all ports of all slots.
        states: state of each slot by its name, for the colour of its edge.
        language: of the person.
        may_change: each slot has a button that takes it out.
        is_past: it is drawn as it was.
    """
    sources = _column([port for port in ports if port.publishes], states, _LEFT, language)
    targets = _column([port for port in ports if not port.publishes], states, _RIGHT, language)
    height = max(sources.height, targets.height, len(topics) * _TOPIC, 1) + _GAP
    step = height / max(len(topics), 1)
    middle = {topic.topic: step * (number + 0.5) for number, topic in enumerate(topics)}
    wires = []
    for topic in topics:
        y = middle[topic.topic]
        wires += [_wire(topic, _LEFT + _BOX, sources.at[end], 365, y) for end in topic.publishers if end in sources.at]
        wires += [_wire(topic, 635, y, _RIGHT, targets.at[end]) for end in topic.subscribers if end in targets.at]
    return render(
        "wires", height=round(height), may_change=may_change, words=_words(topics, language), wires=wires, boxes=[*sources.boxes, *targets.boxes],
        topics=[
            {"y": round(middle[topic.topic]), "full": topic.topic, "name": shortened(topic.topic, 32),
             "rate": rate_words(topic, language, is_past=is_past)}
            for topic in topics
        ],
    )  # fmt: skip


def rate_words(topic: TopicLine, language: Language, *, is_past: bool = False) -> str:
    """What stands under a topic: its type and how often it comes; of the past nobody has counted the samples."""
    if is_past:
        return f"{topic.type_name} · {language.number(topic.rate_hz, '.1f')} Hz"
    samples = language.count(topic.count, "{count} sample", "{count} samples")
    return f"{topic.type_name} · {language.number(topic.rate_hz, '.1f')} Hz · {samples}"


def box_colour(state: str) -> str:
    """The edge of a slot in that state."""
    return STATE_COLOURS.get(state, "#888")


def _column(ports: Sequence[WirePort], states: Mapping[str, str], x: int, language: Language) -> _Column:
    column = _Column([], {}, _GAP)
    by_slot: dict[str, list[WirePort]] = {}
    for port in ports:
        by_slot.setdefault(port.slot, []).append(port)
    for slot, own in by_slot.items():
        top = column.height
        lines = []
        for number, port in enumerate(own):
            y = top + _HEAD + _PORT * (number + 0.5)
            end = f"{slot}.{port.port}"
            column.at[end] = y
            lines.append({
                "end": end, "name": shortened(port.port, 26), "type_name": port.type_name, "publishes": port.publishes,
                "topic": port.topic, "y": round(y), "x": x + _BOX if port.publishes else x, "words": _port_words(port, language),
            })  # fmt: skip
        height = _HEAD + _PORT * len(own) + 8
        column.boxes.append({
            "x": x, "y": round(top), "height": height, "full": slot, "name": shortened(slot, 16),
            "colour": box_colour(states.get(slot, "empty")), "ports": lines,
            "take_out": language.say("Take slot {slot} out", slot=slot),
        })  # fmt: skip
        column.height += height + _GAP
    return column


def _port_words(port: WirePort, language: Language) -> str:
    end = f"{port.slot}.{port.port} ({port.type_name})"
    if not port.topic:
        return language.say("{port}: not wired", port=end)
    return language.say(
        "{port}: publishes on {topic}" if port.publishes else "{port}: hears {topic}", port=end, topic=port.topic
    )


def _wire(topic: TopicLine, x1: float, y1: float, x2: float, y2: float) -> dict[str, object]:
    half = (x1 + x2) / 2
    return {
        "topic": topic.topic, "is_busy": topic.rate_hz > 0,
        "path": f"M{x1} {y1:.0f} C {half:.0f} {y1:.0f}, {half:.0f} {y2:.0f}, {x2 - 8} {y2:.0f}",
        "tip": f"M{x2 - 9} {y2 - 6:.0f} L{x2} {y2:.0f} L{x2 - 9} {y2 + 6:.0f} z",
    }  # fmt: skip


def _words(topics: Sequence[TopicLine], language: Language) -> str:
    return "; ".join(
        language.say(
            "{sources} to {targets} by {topic}",
            sources=", ".join(topic.publishers),
            targets=", ".join(topic.subscribers),
            topic=topic.topic,
        )
        for topic in topics
    )
