"""Live values drawn as the thing they are: a lamp, a servo horn, a gauge, a thermometer. Pure: values in, SVG out.

What is drawn follows from the message type of the port that matters most for the part (what an actuator obeys, what a
sensor tells). The words beside the picture say the same, so nothing depends on seeing it.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Mapping, Sequence
from textwrap import wrap

from msbot.config import PartType
from msbot.config.library.picture import picture_svg
from msbot_agent.text.sentence import Sentence
from msbot_web.glances import ShownSlot
from msbot_web.html import Markup, render
from msbot_web.language import PLAIN, Language
from msbot_web.models.robot_models import PortLine, Scalar
from msbot_web.svg.list_drawings import bars, fan, lamps, listed, picture, short_list

Fields = Mapping[str, Scalar]
Drawing = Mapping[str, object]
"""What the template `drawing` needs: the kind of picture, its numbers, and the words under it."""

UNDER_WORDS = ("on", "off", "nothing")
"""What may stand under a picture in place of a number."""
RING_ROUND = 113.1
"""The ring's circumference, in pixels."""
CALM = 0.05
"""A small curve spans at least this share of its values."""
STATE_ICONS = {
    "active": "●", "late": "◐", "lost": "✖", "refused": "⊘", "checking": "…", "new": "✦", "standby": "‖", "empty": "○", "left": "↩",
}  # fmt: skip
"""A sign for every state besides its colour and its word."""


HELD_WORDS = {
    "stopped": "stopped: at its safe values",
    "unconfirmed": "STOP not confirmed: it may still move",
    "partner lost": "partner lost: it applies its safe values",
    "by hand": "driven by hand: its wire is not heard",
    "gone": "no part receives it",
}
"""Why a part does not do what it was told, by `PortLine.held`."""


def done_fields(port: PortLine) -> Mapping[str, Scalar]:
    """What a part says or does at a port, not what it was told: its safe values while it is held; empty: not known."""
    return port.safe or ({} if port.held in ("unconfirmed", "gone") else port.fields)


def state_chip(state: str, word: str) -> Markup:
    """A state as a coloured chip with sign and word."""
    return render("state_chip", state=state, word=word, sign=STATE_ICONS.get(state, ""))


def beat_ring(card: ShownSlot, beat_s: float, life: int, language: Language) -> Markup:
    """The ring around a slot's life status: how much of the time to the next beat is left, and life 3-2-1-0.

    The browser lets it run down by itself, in steps: 120 rings that move smoothly would keep a tablet busy.
    """
    words, gap, animation, shown_life = ring_marks(card, beat_s, life, language)
    return render("ring", words=words, gap=gap, animation=animation, life=shown_life)


def ring_marks(card: ShownSlot, beat_s: float, life: int, language: Language) -> tuple[str, str, str, str]:
    """What differs between rings: its words, how much of it is missing, how it goes on (CSS), and the number in it."""
    next_s, say = card.next_beat_s, language.translate
    if card.part is None or not life:
        words = say("no life status")
    elif next_s is None:
        words = say("life status {life}", life=life)
    elif next_s >= 0:
        words = say("life status {life}, next beat in {seconds} s", life=life, seconds=language.number(next_s, ".1f"))
    else:
        words = say(
            "life status {life}, beat overdue for {seconds} s", life=life, seconds=language.number(-next_s, ".1f")
        )
    over = 1.0 if next_s is None else 1.0 - max(0.0, min(1.0, next_s / beat_s))
    animation = "" if next_s is None else f"ms-beat {beat_s:g}s steps(6) {-beat_s * over:.2f}s forwards"
    return words, f"{RING_ROUND * over:.1f}", animation, str(life or "–")


def draw(type_name: str, fields: Fields, language: Language = PLAIN) -> Markup:
    """A value as a picture, 84 by 84 pixels; an empty frame when there is no value yet."""
    drawing = _DRAWERS.get(type_name, _any)(fields) if fields else {"kind": "nothing"}
    told = drawing.get("said")
    values = [f"{name} {value_words(value, language)}" for name, value in fields.items()]
    words = ", ".join(values) or language.translate("no value yet")
    if isinstance(told, Sentence):
        words = language.translate(told)
    under = str(drawing.get("under", ""))
    under = language.translate(under) if under in UNDER_WORDS else language.digits(under)
    text = language.digits(str(drawing.get("text", "")))
    return render("drawing", **{"words": words, **drawing, "under": under, "text": text})


def value_words(value: Scalar, language: Language = PLAIN) -> str:
    """A value for people: at most four significant digits, yes and no as words."""
    if isinstance(value, bool):
        return language.translate("on") if value else language.translate("off")
    if isinstance(value, float):
        return language.number(value, ".4g")
    return short_list(value) if isinstance(value, str) else str(value)


def fields_html(fields: Fields, language: Language = PLAIN, *, limit: int = 4) -> Markup:
    """The first few fields of a value, a line each."""
    return render(
        "fields", fields=[(name, value_words(value, language)) for name, value in list(fields.items())[:limit]]
    )


def sparkline(
    values: Sequence[float],
    language: Language = PLAIN,
    *,
    width: int = 220,
    height: int = 44,
    least: float | None = None,
) -> Markup:
    """A small curve of numbers, oldest left."""
    if len(values) < 2:
        return render("sparkline", width=width, height=height, points="", words=language.translate("no curve yet"))
    low = min(values) if least is None else min(least, *values)
    high = max(values)
    # The last digit of a value that stays still is not a mountain.
    span = max(high - low, CALM * max(abs(high), abs(low))) or 1.0
    low -= (span - (high - low)) / 2 if least is None else 0.0
    step = (width - 4) / (len(values) - 1)
    points = " ".join(
        f"{2 + number * step:.1f},{height - 4 - (value - low) / span * (height - 8):.1f}"
        for number, value in enumerate(values)
    )
    words = language.translate("{least:.3g} to {most:.3g}", least=float(min(values)), most=float(high))
    return render("sparkline", width=width, height=height, points=points, words=words)


def _number(fields: Fields, name: str = "") -> float:
    """A field as a number, or the first field that is one."""
    values = [fields[name]] if name in fields else list(fields.values())
    return next((float(value) for value in values if isinstance(value, int | float)), 0.0)


def _needle(share: float, under: str) -> Drawing:
    """A gauge from lower left to lower right with a needle."""
    share = max(0.0, min(1.0, share))
    angle = math.radians(225 - 270 * share)
    length = 0.75 * 2 * math.pi * 32
    return {
        "kind": "gauge",
        "round": f"{length:.1f}",
        "arc": f"{max(length * share, 0.1):.1f}",
        "x": f"{42 + 24 * math.cos(angle):.1f}",
        "y": f"{42 - 24 * math.sin(angle):.1f}",
        "under": under,
    }


def _gauge(low: float, high: float, unit: str, field: str) -> Callable[[Fields], Drawing]:
    def gauge(fields: Fields) -> Drawing:
        value = _number(fields, field)
        return _needle((value - low) / (high - low), f"{value:.3g} {unit}".strip())

    return gauge


def _logarithmic(most: float, unit: str, field: str) -> Callable[[Fields], Drawing]:
    def gauge(fields: Fields) -> Drawing:
        value = max(_number(fields, field), 0.0)
        return _needle(math.log10(1 + value) / math.log10(1 + most), f"{value:.3g} {unit}".strip())

    return gauge


def _lamp(fields: Fields) -> Drawing:
    is_on = any(bool(value) for value in fields.values())
    return {"kind": "lamp", "is_on": is_on, "under": "on" if is_on else "off"}


def _angle(fields: Fields) -> Drawing:
    degrees = _number(fields, "degrees")
    return {"kind": "angle", "turn": f"{degrees - 90:.1f}", "under": f"{degrees:.0f}°"}


def _colour(fields: Fields) -> Drawing:
    red, green, blue = (int(max(0, min(255, _number(fields, name)))) for name in ("red", "green", "blue"))
    colour = f"#{red:02x}{green:02x}{blue:02x}"
    return {"kind": "colour", "colour": colour, "under": colour}


def _temperature(fields: Fields) -> Drawing:
    celsius = _number(fields, "celsius")
    height = max(0.0, min(1.0, (celsius + 10) / 60)) * 40
    return {"kind": "temperature", "top": f"{52 - height:.1f}", "height": f"{height:.1f}", "under": f"{celsius:.1f} °C"}


def _distance(fields: Fields) -> Drawing:
    metres = _number(fields, "metres")
    is_seen = fields.get("in_range", True)
    reach = round(22 + max(0.0, min(1.0, metres / 4.0)) * 46)
    return {
        "kind": "distance",
        "is_seen": is_seen,
        "reach": reach,
        "under": f"{metres:.2f} m" if is_seen else "nothing",
    }


def _speed(fields: Fields) -> Drawing:
    rpm = _number(fields)
    sign = "↻" if rpm > 0 else "↺" if rpm < 0 else "■"
    return {"kind": "speed", "turn": round(rpm % 60), "under": f"{sign} {rpm:.0f}"}


def _text(fields: Fields) -> Drawing:
    text = next((value for value in fields.values() if isinstance(value, str)), "")
    return {"kind": "text", "lines": wrap(text, 11)[:4] or [""]}


def _any(fields: Fields) -> Drawing:
    for value in fields.values():
        if (found := listed(value)) and all(isinstance(one, int | float) for one in found):
            return bars(found)
    return {"kind": "any", "text": value_words(next(iter(fields.values()), ""))[:9]}


_DRAWERS: dict[str, Callable[[Fields], Drawing]] = {
    "Switch": _lamp,
    "Light": _logarithmic(100_000.0, "lx", "lux"),
    "Level": _gauge(0.0, 100.0, "%", "percent"),
    "Angle": _angle,
    "Colour": _colour,
    "Temperature": _temperature,
    "Distance": _distance,
    "Speed": _speed,
    "Gas": _logarithmic(10_000.0, "ppm", "ppm"),
    "Text": _text,
    "HelloWorld": _text,
    "Scan": fan,
    "Strip": lamps,
    "Picture": picture,
}
"""How values of a message type are drawn."""


# What identifies a part type on paper: its picture with the pins, and a QR code that leads to its page.


def picture_of(part_type: PartType) -> Markup:
    """The picture of a part type, which a stranger may have sent.

    As an image, not as a piece of the page: nothing in it is HTML, runs, or fetches anything, whatever it holds.
    """
    data = base64.b64encode(picture_svg(part_type).encode()).decode()
    return render(
        "part_picture", source=f"data:image/svg+xml;base64,{data}", words=f"{part_type.number}: {part_type.name}"
    )


def qr_svg(text: str, *, scale: int = 4) -> Markup:
    """A QR code (ISO/IEC 18004) of a text as SVG, black on white so that every camera reads it."""
    import segno  # no first page has a QR code

    out = io.BytesIO()
    segno.make(text, error="m").save(out, kind="svg", scale=scale, border=2, light="#fff", xmldecl=False, svgns=True)
    return Markup(out.getvalue().decode())
