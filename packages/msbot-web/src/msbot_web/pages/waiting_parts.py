"""The arrivals tray: parts that wait or were refused, each with its reason and what can be done about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.api.dependencies import parts_for
from msbot_web.html import render
from msbot_web.models.robot_models import ChangeResult, PartLine, WireOffer
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, menu_item, page_dialog, set_html, show_dialog
from msbot_web.pages.simulator import simulator_panel
from msbot_web.pages.slot_dialogs import free_name, slot_name
from msbot_web.service import Service
from msbot_web.svg.drawings import state_chip

WINDOW_S = 60.0
MOST_SHOWN = 100
"""Parts that are shown; all of them are counted."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/arrivals")
    def arrivals(request: Request) -> None:
        with page_frame(service, request, "/arrivals", "Arrivals") as page:
            _window(page)
            tray = ArrivalsPanel(page)
            page.every_look(lambda: tray.show(page.service.views.arrivals()))
            if page.may(Right.OPERATE):
                _spares(page)


def _spares(page: Page) -> None:
    """Simulated parts that no card of the robot page shows."""
    shelf = ui.element("div").classes("grid")
    shown: list[str] = []

    def show() -> None:
        names = page.service.views.spares()
        if names == shown:
            return
        shown[:] = names
        shelf.clear()
        with shelf:
            for name in names:
                with ui.element("div"):
                    simulator_panel(
                        page, name, title=page.translate("Simulated part {name}, without a slot of its own", name=name)
                    )

    page.every_look(show)


def _window(page: Page) -> None:
    """The adoption window with its countdown."""
    with ui.element("div").classes("panel row spread"):
        words = ui.label("").props("aria-live=polite")
        if page.may(Right.ARRANGE):
            open_button = ui.button(
                page.translate("Open for {seconds} s", seconds=f"{WINDOW_S:.0f}"),
                icon="lock_open",
                on_click=lambda: page.act("window", seconds=WINDOW_S),
            )
            close_button = ui.button(
                page.translate("Close"), icon="lock", on_click=lambda: page.act("close_window")
            ).props("outline")

    def show() -> None:
        left = page.service.robot().window_s
        words.set_text(
            page.translate(
                "The adoption window is open for {seconds} s more: parts can be adopted.", seconds=f"{left:.0f}"
            )
            if left > 0
            else page.translate("The adoption window is closed. A teacher opens it to let unknown parts in.")
        )
        if page.may(Right.ARRANGE):
            open_button.set_visibility(left <= 0)
            close_button.set_visibility(left > 0)

    page.every_look(show)


class ArrivalsPanel:
    """A card for each part that waits. A part's card stays the same one, or its open menu would close."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._more = ui.label("").props("role=status")
        self._tray = ui.element("div").classes("grid")
        with self._tray:
            self._nobody = ui.element("div").classes("panel")
        with self._nobody:
            ui.label(page.translate("Nobody waits. Plug a part in: it shows up here when its slot is not clear."))
        self._cards: dict[tuple[str, str], _Card] = {}

    def show(self, waiting: Sequence[PartLine]) -> None:
        """Show these, in this order."""
        parts = {(part.client_key, part.uid): part for part in waiting[:MOST_SHOWN]}
        self._more.set_text(
            self._page.translate(
                "{count} parts wait; the newest {shown} are shown.", count=len(waiting), shown=len(parts)
            )
        )
        self._more.set_visibility(len(waiting) > len(parts))
        self._nobody.set_visibility(not parts)
        for key in self._cards.keys() - parts.keys():
            self._cards.pop(key).element.delete()
        for place, (key, part) in enumerate(parts.items(), start=1):
            if key not in self._cards:
                with self._tray:
                    self._cards[key] = _Card(self._page)
            card = self._cards[key]
            card.show(part)
            if self._tray.default_slot.children.index(card.element) != place:
                card.element.move(target_index=place)


class _Card:
    """A part that waits."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._deeds_of: object = None
        self.element = ui.element("div")
        with self.element:
            self._facts = ui.html("", sanitize=False)
            self._row = ui.element("div").classes("row")

    def show(self, part: PartLine) -> None:
        """Show the part as it is now; what can be done with it is laid out anew only when that is something else."""
        page = self._page
        self.element.classes(replace=f"slot is-{part.state}").style(replace="opacity:.6" if part.ignored else "")
        set_html(
            self._facts,
            render(
                "arrival",
                say=page.translate,
                part=parts_for(page.session, [part])[0],
                chip=state_chip(part.state, page.translate(part.state)),
                is_unknown=part.refusal == "unknown_part" and page.may(Right.DESIGN),
            ),
        )
        is_checked = part.says is not None and part.says.checked
        deeds_of = part.part, part.part_number, part.refusal == "blocked", is_checked
        if deeds_of != self._deeds_of:
            self._deeds_of = deeds_of
            self._row.clear()
            with self._row:
                _actions(page, part)


def _actions(page: Page, part: PartLine) -> None:
    name = part.uid or part.client_key
    if page.may(Right.DESIGN) and part.says is not None and part.says.checked:
        ui.button(page.translate("Adopt"), icon="add_circle", on_click=partial(adopt, page, name)).props(
            "color=positive"
        )
    if page.may(Right.ARRANGE):
        with ui.button(page.translate("Adopt into slot …"), icon="add_link").props("outline") as into:
            into.on_click(_Offers(page, part).show)  # as they are then, not when the part came
        ui.button(page.translate("Ignore"), on_click=lambda: page.act("ignore", part=name)).props("flat")
        if part.refusal == "blocked":
            ui.button(page.translate("Unblock"), on_click=lambda: page.act("unblock", part=name)).props("flat")
        else:
            ui.button(page.translate("Block"), on_click=lambda: page.act("block", part=name)).props(
                "flat color=negative"
            )
    if page.may(Right.OPERATE):
        ui.button(
            page.translate("Identify"),
            icon="lightbulb",
            on_click=lambda: page.act("identify", part=name if page.may(Right.ARRANGE) else part.part),
        ).props("flat")
    ui.button(page.translate("Why?"), on_click=partial(_why, page, part)).props("flat")


async def adopt(page: Page, name: str) -> None:
    """Make the part what it says it is, and offer the wires that fit."""
    with page.in_page():
        done = await page.act("adopt", part=name)
        if done is not None and (done.offers or done.for_people or done.by_hand):
            offer_wires(page, done)


def offer_wires(page: Page, done: ChangeResult) -> None:
    """Show wires that would fit, and those on which people look, call or send; each is made with one press."""
    say = page.translate
    with ui.dialog() as dialog, ui.card().style("max-width:min(40rem,95vw)"):
        heading(say("Wires that fit"))
        _offers(page, say("These ports carry the same message. Press what is to be joined."), done.offers)
        _offers(page, say("For people, who look at it or call it:"), done.for_people)
        _offers(page, say("For people, who send to it by hand:"), done.by_hand)
        ui.button(page.translate("Close"), on_click=dialog.close).props("flat")
    show_dialog(dialog)


def _offers(page: Page, words: str, offers: Sequence[WireOffer]) -> None:
    if offers:
        ui.label(words)
        with ui.element("div").classes("ms-offers"):
            for offer in offers:
                _offered(page, offer)


def _offered(page: Page, offer: WireOffer) -> None:
    ends = " → ".join(filter(None, (offer.source, ", ".join(offer.to))))
    button = ui.button(ends, icon="add_link").props("outline no-caps")

    async def join() -> None:
        wish: dict[str, Any] = {"from": offer.source} if offer.source else {}
        done = await page.act("bind", topic=offer.topic, type=offer.type, to=offer.to, **wish)
        if done is not None:
            button.props("icon=check")
            button.disable()

    button.on_click(join)


class _Offer(NamedTuple):
    """A place for a part that waits."""

    words: str
    operation: str = ""
    """Empty: it can only be read."""
    arguments: tuple[tuple[str, Any], ...] = ()


class _Offers:
    """The menu with the places for a part. Its items stay the same ones as long as they would do the same.

    A click takes its time to the server: on an item that had just been made anew it would be for nothing.
    """

    def __init__(self, page: Page, part: PartLine) -> None:
        self._page, self._part = page, part
        self._menu = ui.menu()
        self._shown: list[_Offer] = []
        self.show()

    def show(self) -> None:
        """Offer what is free now."""
        wanted = list(self._wanted())
        if wanted == self._shown:
            return
        self._shown = wanted
        self._menu.clear()
        with self._menu:
            for offer in wanted:
                if offer.operation:
                    act = partial(self._page.act, offer.operation, **dict(offer.arguments))
                    menu_item(offer.words, act)
                else:
                    ui.menu_item(offer.words).props("disable role=menuitem")

    def _wanted(self) -> Iterator[_Offer]:
        page, part = self._page, self._part
        free = page.service.views.free_slots(part.part_number)
        part_type = page.service.views.library.find(part.part_number)
        if part_type is not None and page.may(Right.DESIGN):
            taken = {card.name for card in page.service.robot().slots}
            new = free_name(slot_name(part_type.name), taken)
            words = page.translate("Into a new slot, {name}", name=new)
            yield _Offer(words, "add_slot", (("slot", new), ("part", part_type.number)))
        if not free:
            yield _Offer(page.translate("No slot is free: release or swap one."))
        for card in free:
            words = f"{card.name} · {card.part_number} · {page.translate(card.state)}"
            yield _Offer(words, "adopt", (("part", part.uid or part.client_key), ("slot", card.name)))


def _why(page: Page, part: PartLine) -> None:
    lines = page.service.views.why(part.uid or part.part)
    with page_dialog(page) as dialog, ui.card().style("max-width:min(44rem,95vw)"):
        heading(page.translate("Why?"))
        ui.html(render("lines", say=page.translate, lines=lines), sanitize=False)
        ui.button(page.translate("Close"), on_click=dialog.close).props("flat")
    show_dialog(dialog)
