"""The wires page: who publishes what to whom, drawn with rates; changed by mouse or keyboard, each change undoable."""

from __future__ import annotations

import json

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Right
from msbot_web.api.models import TopicLine
from msbot_web.html import render
from msbot_web.pages.layout import Page, page_frame
from msbot_web.pages.page_elements import set_html
from msbot_web.pages.slots_by_hand import ask_for_slot, ask_to_take_out
from msbot_web.pages.topics_by_hand import join, say_misfit
from msbot_web.place import root
from msbot_web.service import Service
from msbot_web.svg.drawings import value_words
from msbot_web.svg.wiring_graph import box_colour, rate_words, wiring_svg


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/wires")
    def wires(request: Request) -> None:
        with page_frame(service, request, "/wires", "Wires") as page:
            ui.add_head_html(f'<script src="{root()}/web/wires.js"></script>')
            _Drawing(page)
            _table(page)


class _Drawing:
    """The graph; drawn again only when the wiring has changed, so that it stays still under a person's hand."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._shown: object = None
        self._rates: dict[str, tuple[str, bool]] = {}
        self._colours: dict[str, str] = {}
        self._may_change = page.may(Right.DESIGN)
        with ui.element("div").classes("panel"):
            with ui.element("div").classes("row spread"):
                ui.label(page.say("Green: samples are flowing. Dashed: silence. Click a slot to open it.")).classes(
                    "soft"
                )
                with ui.element("div").classes("row"):
                    new = ui.button(page.say("New slot"), icon="add", on_click=lambda: ask_for_slot(page))
                    self._only_now: list[ui.element] = [new]
                    ui.button(page.say("Picture (SVG)"), icon="image", on_click=self._save).props("flat")
            if self._may_change:
                hint = ui.label(page.say(
                    "Drag from one port to another, or click one after the other, or press Enter on both: ports that "
                    "fit light up. Delete takes a port off its topic, the cross a slot out of the robot. The journal "
                    "undoes each change."
                )).classes("soft")  # fmt: skip
                self._only_now.append(hint)
            ui.label(page.say("The drawing goes on to the right: swipe, or scroll. On a touch screen tap one port "
                              "after the other.")).classes("soft ms-narrow")  # fmt: skip
            self._element = ui.html("", sanitize=False).classes("w-full scroll ms-shaded").props("tabindex=0")
            if self._may_change:
                self._element.on("wire", self._told)
                ui.run_javascript(
                    f"msbotWires(getHtmlElement({self._element.id}), (deed) => "
                    f"getHtmlElement({self._element.id}).dispatchEvent(new CustomEvent('wire', {{detail: deed}})))"
                )
        page.every_look(self._show)

    def _show(self) -> None:
        sight, is_past = self._page.sight, self._page.is_past
        may_change = self._may_change and not is_past
        for one in self._only_now:
            one.set_visibility(may_change)
        topics, ports = sight.topics(), sight.ports()
        states = {card.name: card.state for card in sight.robot().slots}
        colours = {slot: box_colour(state) for slot, state in states.items()}
        wiring = (may_change, is_past, [(one.topic, one.publishers, one.subscribers) for one in topics], ports)
        rates = {one.topic: (rate_words(one, self._page.language, is_past=is_past), one.rate_hz > 0) for one in topics}
        if wiring != self._shown:
            self._shown, self._rates, self._colours = wiring, rates, colours
            drawing = wiring_svg(topics, ports, states, self._page.language, may_change=may_change, is_past=is_past)
            self._element.set_content(drawing)
            return
        changed = {topic: rate for topic, rate in rates.items() if self._rates.get(topic) != rate}
        if changed:
            self._rates.update(changed)
            ui.run_javascript(f"msbotRates({json.dumps(changed)})")
        other = {slot: colour for slot, colour in colours.items() if self._colours.get(slot) != colour}
        if other:
            self._colours = colours
            ui.run_javascript(f"msbotBoxes({json.dumps(other)})")

    def _save(self) -> None:
        sight = self._page.sight
        states = {card.name: card.state for card in sight.robot().slots}
        drawing = wiring_svg(sight.topics(), sight.ports(), states, self._page.language, is_past=self._page.is_past)
        ui.download.content(str(drawing), "wires.svg")

    async def _told(self, event: GenericEventArguments) -> None:
        told = event.args["detail"]
        deed, start, end = str(told["deed"]), str(told["from"]), str(told["to"])
        if deed == "take_out":
            ask_to_take_out(self._page, start)
        elif deed == "misfit":
            say_misfit(self._page, start, end)
        elif deed == "cut":
            await self._page.act("unbind", topic=end, port=start)
        else:
            await join(self._page, start, end)


def _table(page: Page) -> None:
    table = ui.html("", sanitize=False).classes("panel scroll").props("tabindex=0")
    titles = ("Topic", "Type", "From", "To", "Rate", "Samples", "Latest value")

    def show() -> None:
        rows = [_row(topic, page) for topic in page.sight.topics()]
        empty = page.say("Nothing is wired yet. Drag from one port to another in the drawing above.")
        content = render("table", heads=[page.say(title) for title in titles], rows=rows or [(empty,)])
        set_html(table, content)

    page.every_look(show)


def _row(topic: TopicLine, page: Page) -> tuple[str, ...]:
    values = ", ".join(f"{name} {value_words(value, page.language)}" for name, value in topic.fields.items())
    return (
        topic.topic, topic.type_name, ", ".join(topic.publishers), ", ".join(topic.subscribers),
        f"{page.number(topic.rate_hz, '.1f')} Hz", "–" if page.is_past else str(topic.count), values,
    )  # fmt: skip
