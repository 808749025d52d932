"""The cards of slots: what each looks like, the same for all who read it in one language with the same rights."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Protocol

from msbot.operations.rights import Right
from msbot_web.api.dependencies import public_words
from msbot_web.glances import ShownPart, ShownRobot, ShownSlot
from msbot_web.html import Markup, render
from msbot_web.language import Language
from msbot_web.live_channel import LiveView
from msbot_web.models.robot_models import PortLine
from msbot_web.robot_view import LiveRobotView, RobotView
from msbot_web.service import Service
from msbot_web.svg.drawings import (
    HELD_WORDS,
    beat_ring,
    done_fields,
    draw,
    fields_html,
    ring_marks,
    sparkline,
    state_chip,
)

RING = "ring:"
"""Before the name of a slot: only the ring of its card. Names of slots have no colon."""
NOW = "now:"
"""Likewise: only what its part says or does at this moment."""


MOST_CURVES = 4096
_curves: dict[tuple[str, str], tuple[list[float], Markup]] = {}
"""By language and topic, with their values: a curve goes on every 1.5 s, the value beside it often changes sooner."""


class CardReader(Protocol):
    """Who reads cards."""

    language: Language
    sight: RobotView

    def translate(self, text: str, **values: object) -> str:
        """A text as the person may read it, in the person's language."""


class _Readers:
    """All who read in one language and may read the same."""

    def __init__(self, service: Service, language: Language, *, sees_all: bool) -> None:
        self.language = language
        self.sight: RobotView = LiveRobotView(service)
        self._sees_all = sees_all

    def translate(self, text: str, **values: object) -> str:
        """See `CardReader`."""
        return self.language.translate(text if self._sees_all else public_words(text), **values)


class _LivePageReader(CardReader, Protocol):
    """A page that shows the cards of the robot as it is."""

    service: Service

    def may(self, right: Right) -> bool:
        """Whether the person may do that."""


def live_cards(page: _LivePageReader) -> tuple[Hashable, Callable[[], LiveView]]:
    """The view that a page shares with all who see the same cards: its key, and how to make it."""
    service, language, sees_all = page.service, page.language, page.may(Right.ARRANGE)

    def make() -> LiveView:
        readers = _Readers(service, language, sees_all=sees_all)
        cards: dict[str, ShownSlot] = {}
        seen = [service.glance()]

        def marks() -> Mapping[str, Hashable]:
            robot = seen[0] = service.glance()
            cards.clear()
            cards.update({card.name: card for card in robot.slots})
            return looks_of(robot)

        def piece(name: str) -> object:
            return card_piece(readers, name, cards[slot_of(name)], seen[0])

        return LiveView("cards", marks, piece)

    return ("cards", language.code, sees_all), make


def slot_of(name: str) -> str:
    """The slot of a piece."""
    return name.rpartition(":")[2]


def looks_of(robot: ShownRobot) -> dict[str, Hashable]:
    """What the pictures of all cards depend on, by the name of the slot; and what changes more often: their values and
    rings."""
    looks: dict[str, Hashable] = {}
    for card in robot.slots:
        port = card.main_port
        looks[card.name] = look_of(card, port, robot.beat_s)
        if port is not None:
            looks[NOW + card.name] = (tuple(port.fields.items()), tuple(port.safe.items()))
    for card in robot.slots:
        if card.part is not None:
            looks[RING + card.name] = (card.part.part, card.part.life, card.part.beats)
    return looks


def card_piece(reader: CardReader, name: str, card: ShownSlot, robot: ShownRobot) -> object:
    """A card, or only its ring or its value, as `msbotCards` of `page.js` takes it."""
    if name.startswith(RING):
        return ring_marks(card, robot.beat_s, 0 if card.part is None else card.part.life, reader.language)
    if name.startswith(NOW):
        return _now_of(reader, card.main_port)
    return [
        card_html(reader, card, robot),
        open_words(reader, card),
        card.plugged,
        plug_words(reader, card),
        plug_short(reader, card),
    ]


def _now_of(reader: CardReader, port: PortLine | None) -> tuple[Markup | str, Markup | str, Markup | str]:
    """What a part says or does at a port: as a picture, in words, and its curve."""
    fields = {} if port is None else done_fields(port)
    is_gone = port is None or port.held == "gone"
    return (
        "" if port is None else draw(port.type_name, fields, reader.language),
        fields_html(fields, reader.language),
        "" if port is None or is_gone else _curve_of(reader, port.topic),
    )


def _curve_of(reader: CardReader, topic: str) -> Markup:
    values, key = reader.sight.sparkline(topic), (reader.language.code, topic)
    known = _curves.get(key)
    if known is not None and known[0] == values:
        return known[1]
    if len(_curves) >= MOST_CURVES:
        _curves.clear()
    drawn = sparkline(values, reader.language, width=72, height=36)
    _curves[key] = (values, drawn)
    return drawn


def ring_html(reader: CardReader, card: ShownSlot, robot: ShownRobot) -> Markup:
    """The ring around a slot's life status."""
    return beat_ring(card, robot.beat_s, 0 if card.part is None else card.part.life, reader.language)


def open_words(reader: CardReader, card: ShownSlot) -> str:
    """A card's name for who does not see it: what a click does, and in which state the slot is."""
    say, port = reader.translate, card.main_port
    words = [say(card.state), *map(say, card.faults)]
    if port is not None and port.held not in ("", "gone"):
        words.append(say(HELD_WORDS[port.held]))
    return f"{say('Open slot {name}', name=card.name)}: {', '.join(words)}"


def plug_words(reader: CardReader, card: ShownSlot) -> str:
    """What the button that plugs a simulated part does; nothing without one."""
    if card.plugged is None:
        return ""
    return reader.translate("Unplug {name}" if card.plugged else "Plug {name} in", name=card.name)


def plug_short(reader: CardReader, card: ShownSlot) -> str:
    """What is on the button, as lessons call it."""
    return reader.translate("Unplug") if card.plugged else reader.translate("Plug in")


def look_of(card: ShownSlot, port: PortLine | None, beat_s: float) -> Hashable:
    """What a card's picture depends on, without the value at its main port and without its ring; between two beats the
    browser turns that by itself."""
    part = card.part
    return (
        card.state,
        card.reason,
        card.shown_number,
        card.type_name,
        card.simulated,
        card.plugged,
        tuple(card.faults),
        tuple(card.spares),
        tuple(card.type_differences),
        None if part is None else (part.part, part.nature, _age(part, beat_s)),
        None if port is None else (port.topic, port.port, port.publishes, port.type_name, port.held, _stale_age(port)),
    )


def _age(part: ShownPart, beat_s: float) -> str:
    """Seconds since the last beat, as they are shown: exact as soon as one is overdue."""
    if part.beat_age_s is None or part.state not in ("active", "late"):
        return ""
    return f"< {beat_s:g}" if part.beat_age_s < beat_s else f"{part.beat_age_s:.1f}"


def _stale_age(port: PortLine) -> str:
    """How old a stale value is, as it is shown; nothing for a fresh one."""
    if not port.stale or port.age_s is None:
        return ""
    return f"{port.age_s:.0f} s" if port.age_s < 120 else f"{port.age_s / 60:.0f} min"


def card_html(reader: CardReader, card: ShownSlot, robot: ShownRobot) -> Markup:
    """One slot as a card."""
    part, port = card.part, card.main_port
    age = "" if part is None else _age(part, robot.beat_s)
    is_gone = port is not None and port.held == "gone"  # the state says so: no need for more words
    drawing, values, spark = _now_of(reader, port)
    return render(
        "card",
        say=reader.translate,
        card=card,
        look=card.state,
        port=port,
        ring=ring_html(reader, card, robot),
        chip=state_chip(card.state, reader.translate(card.state)),
        drawing=drawing,
        values=values,
        spark=spark,
        held="" if port is None or is_gone or not port.held else reader.translate(HELD_WORDS[port.held]),
        stale_age="" if port is None or port.held else _stale_age(port),
        beat=age and reader.translate("beat {age} s ago", age=reader.language.digits(age)),
    )
