"""The home page: every slot as a card with its state, its beat and its value; a click opens the drawer.

A pupil of a group sees the group's slots first, and those of other groups folded.

All cards are one element: a robot of a thousand slots opens in a moment, and only cards that have changed are sent.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Right
from msbot_web.glances import ShownRobot
from msbot_web.html import Markup, render
from msbot_web.nicegui_internals.elements import forget_content
from msbot_web.page_errors import read_from_browser
from msbot_web.pages.gallery import back_to_rover
from msbot_web.pages.layout import page_frame
from msbot_web.pages.live_cards import (
    card_html,
    card_piece,
    live_cards,
    looks_of,
    open_words,
    plug_short,
    plug_words,
    slot_of,
)
from msbot_web.pages.menu import is_pupil
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.pages.slot_drawer import open_slot_drawer
from msbot_web.robot_view import OfRobot
from msbot_web.service import Service
from msbot_web.svg.drawings import state_chip

NOT_SAID = "-"
"""What a blueprint has that names no manufacturer."""

MANY = 12
"""With more slots than this, there is a field that leaves only some of the cards."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/")
    def home(request: Request, slot: str = "") -> None:
        with page_frame(service, request, "/", "Robot") as page:
            back_to_rover(page)
            _summary(page)
            if len(page.service.robot().slots) > MANY:
                ui.html(render("cards_find", say=page.translate), sanitize=False).classes("w-full")
            _Grid(page)
            if slot:
                open_slot_drawer(page, slot)


def _summary(page: Page) -> None:
    line = ui.html("", sanitize=False).classes("soft w-full")
    shown: dict[str, object] = {}

    def show() -> None:
        robot = page.sight.glance()
        counts = _states(robot)
        first = robot.slots[0].shown_number if robot.slots else ""
        whose = (robot.version, robot.serial_number, robot.manufacturer, *robot.links)
        wanted = (page.is_past, whose, first, tuple(counts.items()))
        if wanted == shown.get("wanted"):
            return
        shown["wanted"] = wanted
        chips = [
            state_chip(state, page.translate("{count} {state}", count=count, state=page.translate(state)))
            for state, count in counts.items()
        ]
        links = [page.translate(link) for link in robot.links]  # one of them is no address: "simulated here"
        version = page.translate("version {version}", version=robot.version)
        serial_number = page.translate("serial number {number}", number=robot.serial_number)
        manufacturer = "" if robot.manufacturer == NOT_SAID else robot.manufacturer
        words = [word for word in (version, serial_number, manufacturer, *links) if word]
        hint = ""
        if robot.slots and set(counts) == {"empty"} and not page.is_past:
            hint = page.translate(
                "Nothing is plugged in yet. Plug a part in, start one ({command} in a terminal), or open a "
                "card and simulate its part.",
                command=f"msbot part {first}",
            )
        content = render("summary", words=" · ".join(words), chips=chips, hint=hint)
        set_html(line, content)

    page.every_look(show)


def _count_states(robot: ShownRobot) -> Mapping[str, int]:
    counts: dict[str, int] = {}
    for card in robot.slots:
        counts[card.state] = counts.get(card.state, 0) + 1
    return counts


_states, _names = OfRobot(_count_states), OfRobot(lambda robot: tuple(card.name for card in robot.slots))
"""How many slots are in each state; the names of all slots."""


class _Grid:
    """The cards of all slots."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._places: object = None
        """Whether it is the past, and which slots there are."""
        self._shown: dict[str, object] = {}
        self._is_kept = False
        """Whether the server still has the text of all cards that it gave to the browser."""
        self._element = ui.html("", sanitize=False).classes("w-full")
        self._element.on("click", self._clicked, js_handler=_CLICKED)
        self._element.on("keydown", self._clicked, js_handler=_KEY)
        ui.run_javascript(f"msbotLiveCards('{self._element.html_id}')")
        page.every_look(self._show)

    def _show(self) -> None:
        page, live = self._page, self._page.service.live
        robot = page.sight.glance()
        places = (page.is_past, _names(robot), self._groups, self._own)
        if places != self._places:
            self._places, self._shown = places, looks_of(robot)
            self._element.set_content(self._whole(robot))
            self._is_kept = True
            live.again(page.client_id)
        elif self._is_kept:
            self._is_kept = not forget_content(self._element)
        if page.is_past:
            live.hide(page.client_id)
        elif live.show(page.client_id, *live_cards(page)):
            self._shown = {}  # should that end, all are drawn once more
            return
        looks = looks_of(robot)
        cards = {card.name: card for card in robot.slots}
        changed = {
            name: card_piece(page, name, cards[slot_of(name)], robot)
            for name, look in looks.items()
            if self._shown.get(name) != look
        }
        if changed:
            self._shown.update({name: looks[name] for name in changed})
            ui.run_javascript(f"msbotCards('{self._element.html_id}', {json.dumps(changed)})")

    def _whole(self, robot: ShownRobot) -> Markup:
        group_of = {slot: group for group, slots in self._groups for slot in slots}
        places = [
            {
                "name": card.name,
                "group": group_of.get(card.name, ""),
                "html": card_html(self._page, card, robot),
                "is_plugged": card.plugged,
                "open_words": open_words(self._page, card),
                "plug_words": plug_words(self._page, card) if self._page.may_at(Right.OPERATE, card.name) else "",
                "plug_short": plug_short(self._page, card),
            }
            for card in robot.slots
        ]
        return render("grid", say=self._page.translate, sections=self._sections(places))

    @property
    def _groups(self) -> list[tuple[str, tuple[str, ...]]]:
        return [(group.name, group.slots) for group in self._page.service.operations.pupils.groups]

    @property
    def _own(self) -> str:
        return self._page.service.operations.pupils.group_of(self._page.session.name)

    def _sections(self, places: Sequence[Mapping[str, object]]) -> list[Mapping[str, object]]:
        """The cards in the order in which the person needs them; teachers see them as the blueprint has them."""
        page, own = self._page, self._own
        if not is_pupil(page) or not any(place["group"] for place in places):
            return [{"title": "", "places": places, "look": ""}]
        mine = [place for place in places if own and place["group"] == own]
        others = [place for place in places if place["group"] not in ("", own)]
        common = [place for place in places if not place["group"]]
        sections: list[Mapping[str, object]] = [
            {"title": page.translate("Your group: {group}", group=own), "places": mine, "look": "own"},
            {"title": page.translate("For everybody"), "places": common, "look": ""},
            {"title": page.translate("Other groups ({count})", count=len(others)), "places": others, "look": "others"},
        ]
        return [section for section in sections if section["places"]]

    async def _clicked(self, event: GenericEventArguments) -> None:
        with read_from_browser():
            name, is_plug = str(event.args["slot"]), bool(event.args["plug"])
        if not is_plug:
            open_slot_drawer(self._page, name)
            return
        is_plugged = self._page.service.views.bench.is_plugged(name)
        await self._page.do(lambda session: self._page.service.plug(session, name, plugged=not is_plugged), quiet=True)


_FIND = (
    "const plug = event.target.closest('[data-plug]'), card = event.target.closest('[data-slot]');"
    "if (plug) emit({slot: plug.dataset.plug, plug: true}); else if (card) emit({slot: card.dataset.slot, plug: false});"
)
_CLICKED = f"(event) => {{ {_FIND} }}"
_KEY = (
    "(event) => { if ((event.key !== 'Enter' && event.key !== ' ') || event.target.closest('[data-plug]')) return;"
    f" event.preventDefault(); {_FIND} }}"
)
