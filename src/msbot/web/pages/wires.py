"""The wires page: who publishes what to whom, drawn with rates; wired again by mouse or keyboard, each change undoable."""

from __future__ import annotations

import json
from typing import Any

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Right
from msbot.web.api.models import TopicLine, WirePort
from msbot.web.html import render
from msbot.web.language import Language
from msbot.web.pages.layout import Page, page_frame
from msbot.web.pages.page_elements import set_html
from msbot.web.service import Service
from msbot.web.svg.drawings import value_words
from msbot.web.svg.wiring_graph import rate_words, wiring_svg


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/wires")
    def wires(request: Request) -> None:
        with page_frame(service, request, "/wires", "Wires") as page:
            ui.add_head_html('<script src="/web/wires.js"></script>')
            _Drawing(page)
            _table(page)


class _Drawing:
    """The graph; drawn again only when the wiring has changed, so that it stays still under a person's hand."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._shown: object = None
        self._rates: dict[str, tuple[str, bool]] = {}
        may_wire = page.may(Right.DESIGN)
        with ui.element("div").classes("panel"):
            with ui.element("div").classes("row spread"):
                ui.label(page.say("Green: samples are flowing. Dashed: silence. Click a slot to open it.")).classes(
                    "soft"
                )
                ui.button(page.say("Picture (SVG)"), icon="image", on_click=self._save).props("flat")
            if may_wire:
                ui.label(page.say(
                    "Drag from one port to another, or press Enter on both: ports that fit light up. Delete takes a "
                    "port off its topic. The journal undoes each change."
                )).classes("soft")  # fmt: skip
            self._element = ui.html("", sanitize=False).classes("w-full scroll").props("tabindex=0")
            if may_wire:
                self._element.on("wire", self._told)
                ui.run_javascript(
                    f"msbotWires(getHtmlElement({self._element.id}), (deed) => "
                    f"getHtmlElement({self._element.id}).dispatchEvent(new CustomEvent('wire', {{detail: deed}})))"
                )
        page.every_look(self._show)

    def _show(self) -> None:
        views = self._page.service.views
        topics, ports = views.topics(), views.ports()
        states = {card.name: card.state for card in self._page.service.robot().slots}
        wiring = ([(one.topic, one.publishers, one.subscribers) for one in topics], ports, states)
        rates = {one.topic: (rate_words(one, self._page.language), one.rate_hz > 0) for one in topics}
        if wiring != self._shown:
            self._shown, self._rates = wiring, rates
            self._element.set_content(wiring_svg(topics, ports, states, self._page.language))
            return
        changed = {topic: rate for topic, rate in rates.items() if self._rates.get(topic) != rate}
        if changed:
            self._rates.update(changed)
            ui.run_javascript(f"msbotRates({json.dumps(changed)})")

    def _save(self) -> None:
        views = self._page.service.views
        states = {card.name: card.state for card in self._page.service.robot().slots}
        ui.download.content(str(wiring_svg(views.topics(), views.ports(), states, self._page.language)), "wires.svg")

    async def _told(self, event: GenericEventArguments) -> None:
        told = event.args["detail"]
        deed, start, end = str(told["deed"]), str(told["from"]), str(told["to"])
        if deed == "cut":
            await self._page.act("unbind", topic=end, port=start)
            return
        ports = {f"{port.slot}.{port.port}": port for port in self._page.service.views.ports()}
        if start not in ports or end not in ports:
            return  # another blueprint holds by now
        await _join(self._page, ports[start], ports[end])


async def _join(page: Page, source: WirePort, target: WirePort) -> None:
    """Have the target hear what the source publishes, on the topic it has or on a new one."""
    topic = source.topic or f"{source.slot}_{source.port}"
    if target.topic == topic:
        ui.notify(page.say("These two are joined already."), type="info")
        return
    end = f"{target.slot}.{target.port}"
    if target.topic and await page.act("unbind", quiet=True, topic=target.topic, port=end) is None:
        return
    arguments: dict[str, Any] = {"topic": topic, "type": source.type_name, "to": [end]}
    if not source.topic:
        arguments["from"] = f"{source.slot}.{source.port}"
    await page.act("bind", **arguments)


def _table(page: Page) -> None:
    table = ui.html("", sanitize=False).classes("panel scroll").props("tabindex=0")
    titles = ("Topic", "Type", "From", "To", "Rate", "Samples", "Latest value")

    def show() -> None:
        rows = [_row(topic, page.language) for topic in page.service.views.topics()]
        empty = page.say("Nothing is wired yet. Drag from one port to another in the drawing above.")
        content = render("table", heads=[page.say(title) for title in titles], rows=rows or [(empty,)])
        set_html(table, content)

    page.every_look(show)


def _row(topic: TopicLine, language: Language) -> tuple[str, ...]:
    values = ", ".join(f"{name} {value_words(value, language)}" for name, value in topic.fields.items())
    return (
        topic.topic, topic.type_name, ", ".join(topic.publishers), ", ".join(topic.subscribers),
        f"{language.number(topic.rate_hz, '.1f')} Hz", str(topic.count), values,
    )  # fmt: skip
